//! How a target may move: every motion takes velocities to changes of place `S v` and to new velocities
//! `C v`, and adds white acceleration.
//!
//! | motion | `C` | white acceleration |
//! |---|---|---|
//! | walks on | 1 | little |
//! | does anything | 1 | much |
//! | brakes | `e^(-t / braking_s)` | little more |
//! | turns left, right | rotation about the vertical by `turn_rad_s` | little more |

use nalgebra::Matrix3;

use super::options::InteractingOptions;
use crate::tracking::motion::Belief;

pub(super) const MOTIONS: usize = 5;
pub(super) const STEADY: usize = 0;
const ANYTHING: usize = 1;
const BRAKES: usize = 2;
const LEFT: usize = 3;

/// A belief after this motion.
pub(super) fn moved(o: &InteractingOptions, motion: usize, belief: &Belief, dt_s: f64) -> Belief {
    match motion {
        STEADY => belief.after(dt_s, o.steady_density),
        ANYTHING => belief.after(dt_s, o.anything_density),
        BRAKES => {
            let left = (-dt_s / o.braking_s).exp();
            let along = o.braking_s * (1.0 - left);
            belief.moved(
                &Matrix3::from_diagonal_element(along),
                &Matrix3::from_diagonal_element(left),
                dt_s,
                o.changing_density,
            )
        }
        turn => {
            let rate = if turn == LEFT {
                o.turn_rad_s
            } else {
                -o.turn_rad_s
            };
            let (sine, cosine) = (rate * dt_s).sin_cos();
            let (a, b) = (sine / rate, (1.0 - cosine) / rate);
            belief.moved(
                &Matrix3::new(a, -b, 0.0, b, a, 0.0, 0.0, 0.0, dt_s),
                &Matrix3::new(cosine, -sine, 0.0, sine, cosine, 0.0, 0.0, 0.0, 1.0),
                dt_s,
                o.changing_density,
            )
        }
    }
}

/// The probability that one motion has become another after this time. What ends walking on is any
/// other with equal chance; whatever else ends becomes walking on.
pub(super) fn turns_into(o: &InteractingOptions, from: usize, to: usize, dt_s: f64) -> f64 {
    let ends = |lasts_s: f64| 1.0 - (-dt_s / lasts_s).exp();
    match (from, to) {
        (STEADY, STEADY) => 1.0 - ends(o.steady_s),
        (STEADY, _) => ends(o.steady_s) / (MOTIONS - 1) as f64,
        (_, STEADY) => ends(o.changing_s),
        (from, to) if from == to => 1.0 - ends(o.changing_s),
        _ => 0.0,
    }
}

/// How often each is met in the long run.
pub(super) fn long_run(o: &InteractingOptions) -> [f64; MOTIONS] {
    let steady = o.steady_s / (o.steady_s + o.changing_s);
    let mut all = [(1.0 - steady) / (MOTIONS - 1) as f64; MOTIONS];
    all[STEADY] = steady;
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn motions_are_those_of_their_table() {
        let o = InteractingOptions::default();
        let start = Belief::about(Vector3::zeros(), 0.1, Vector3::new(2.0, 0.0, 0.5), 0.1);
        // Many small steps and one large one are the same motion.
        for motion in 0..MOTIONS {
            let mut steps = start;
            for _ in 0..100 {
                steps = moved(&o, motion, &steps, 0.01);
            }
            let once = moved(&o, motion, &start, 1.0);
            assert!(
                (steps.position_m - once.position_m).norm() < 1e-9,
                "{motion}"
            );
            assert!((steps.velocity_m_s - once.velocity_m_s).norm() < 1e-9);
        }
        let speed = |motion| moved(&o, motion, &start, 1.0).velocity_m_s;
        assert_eq!(speed(STEADY), start.velocity_m_s);
        assert!(speed(BRAKES).norm() < 0.5 * start.velocity_m_s.norm());
        assert!(speed(LEFT).y > 0.5 && speed(LEFT + 1).y < -0.5);
        assert!((speed(LEFT).norm() - start.velocity_m_s.norm()).abs() < 1e-12);
    }

    #[test]
    fn probabilities_of_what_comes_next_sum_to_one_and_keep_the_long_run() {
        let o = InteractingOptions::default();
        let long_run = long_run(&o);
        let mut next = [0.0; MOTIONS];
        for (from, share) in long_run.iter().enumerate() {
            let row: Vec<f64> = (0..MOTIONS)
                .map(|to| turns_into(&o, from, to, 0.01))
                .collect();
            assert!((row.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            for (next, p) in next.iter_mut().zip(&row) {
                *next += share * p;
            }
        }
        for (next, share) in next.iter().zip(&long_run) {
            assert!((next - share).abs() < 1e-4);
        }
    }
}
