//! The ADAM optimiser (Kingma and Ba 2014) with its second moment held between bounds.
//!
//! ```text
//! m = b1 m + (1 - b1) g            m^ = m / (1 - b1^k)
//! v = b2 v + (1 - b2) g^2          v^ = min(max(v / (1 - b2^k), v_min), v_max)
//! x = x - eta m^ / (sqrt(v^) + 1e-8)
//! ```
//!
//! element by element, with `b1 = 0.9`, `b2 = 0.999`. The bounds are the paper's "velocity clipping"
//! (Table II): `v_min` keeps steps from growing as gradients vanish, `v_max` lets large gradients
//! take steps longer than `eta`.

use nalgebra::Vector3;

const B1: f64 = 0.9;
const B2: f64 = 0.999;
const EPSILON: f64 = 1e-8;
/// A step shorter than this is the last one, metres.
const REST_M: f64 = 1e-5;

/// How to descend.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Adam {
    /// `eta`.
    pub(super) learning_rate: f64,
    /// Most iterations.
    pub(super) iterations: u32,
    /// `v_min` and `v_max`.
    pub(super) velocity: [f64; 2],
}

impl Adam {
    /// Follows the gradient from `start`. The end may be anywhere, NaN included, if the gradient
    /// leads there: the caller has to judge it.
    pub(super) fn descend(
        &self,
        start: Vector3<f64>,
        mut gradient: impl FnMut(&Vector3<f64>) -> Vector3<f64>,
    ) -> Vector3<f64> {
        let mut x = start;
        let (mut m, mut v) = (Vector3::zeros(), Vector3::zeros());
        let (mut b1_power, mut b2_power) = (1.0, 1.0);
        let [v_min, v_max] = self.velocity;
        for _ in 0..self.iterations {
            let g = gradient(&x);
            m = m * B1 + g * (1.0 - B1);
            v = v * B2 + g.component_mul(&g) * (1.0 - B2);
            b1_power *= B1;
            b2_power *= B2;
            let (m_scale, v_scale) = (1.0 / (1.0 - b1_power), 1.0 / (1.0 - b2_power));
            let step = m.zip_map(&v, |m, v| {
                let clipped = (v * v_scale).max(v_min).min(v_max);
                self.learning_rate * m * m_scale / (clipped.sqrt() + EPSILON)
            });
            x -= step;
            if step.norm() < REST_M {
                break;
            }
        }
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAPER: Adam = Adam {
        learning_rate: 0.1,
        iterations: 500,
        velocity: [0.1, 30.0],
    };

    #[test]
    fn finds_the_bottom_of_a_skewed_bowl() {
        let bottom = Vector3::new(3.0, -2.0, 0.5);
        let slopes = Vector3::new(30.0, 3.0, 0.5);
        let end = PAPER.descend(Vector3::zeros(), |x| (x - bottom).component_mul(&slopes));
        assert!((end - bottom).norm() < 1e-2, "{end}");
    }

    #[test]
    fn first_step_without_clipping_is_eta_whatever_the_slope() {
        let free = Adam {
            iterations: 1,
            velocity: [0.0, f64::INFINITY],
            ..PAPER
        };
        for slope in [1e-3, 1.0, 1e3] {
            let end = free.descend(Vector3::zeros(), |_| Vector3::repeat(slope));
            assert!((end + Vector3::repeat(0.1)).norm() < 1e-5, "{end}");
        }
    }

    #[test]
    fn clipping_shortens_steps_on_gentle_slopes_and_lengthens_them_on_steep_ones() {
        let one = Adam {
            iterations: 1,
            ..PAPER
        };
        let step = |slope| {
            one.descend(Vector3::zeros(), |_| Vector3::repeat(slope))
                .norm()
        };
        let plain = 0.1 * 3f64.sqrt();
        assert!(step(0.01) < 0.1 * plain);
        assert!(step(100.0) > 10.0 * plain);
    }

    #[test]
    fn contradictory_bounds_do_not_panic() {
        let odd = Adam {
            velocity: [f64::NAN, -1.0],
            ..PAPER
        };
        odd.descend(Vector3::zeros(), |x| *x);
    }
}
