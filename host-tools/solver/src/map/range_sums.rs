//! What the ranges of an interval between two knots add to the normal equations.

use super::elimination::{Array, JOINT, KNOT};
use super::likelihood::Influence;
use nalgebra::Vector3;

/// Sums over the ranges of an interval. With `j = [u, 1]` all blocks are moments in `s` of `w j
/// j^T`.
#[derive(Default)]
pub(super) struct RangeSums {
    /// `sum w (1 - s)^2 j j^T`, `sum w s (1 - s) j j^T`, `sum w s^2 j j^T`, upper triangles of
    /// symmetric 4x4.
    moments: [[[f64; 4]; 4]; 3],
    /// `sum slope (1 - s) j`, `sum slope s j`.
    pulls: [[f64; 4]; 2],
}

impl RangeSums {
    /// `curvature` counts across the line of sight.
    #[inline]
    pub(super) fn add(&mut self, u: Vector3<f64>, s: f64, influence: &Influence, curvature: f64) {
        let j = [u.x, u.y, u.z, 1.0];
        let c = 1.0 - s;
        let along = influence.information - curvature;
        let mut block = [[0.0; 4]; 4];
        for row in 0..4 {
            for column in 0..4 {
                block[row][column] = along * j[row] * j[column];
            }
        }
        // The bias is no direction: its information stays whole.
        for i in 0..3 {
            block[i][i] += curvature;
            block[i][3] += curvature * j[i];
            block[3][i] += curvature * j[i];
        }
        block[3][3] += curvature;
        for (moment, weight) in self.moments.iter_mut().zip([c * c, s * c, s * s]) {
            for (sums, terms) in moment.iter_mut().zip(&block) {
                for (sum, term) in sums.iter_mut().zip(terms) {
                    *sum += weight * term;
                }
            }
        }
        for (pull, weight) in self.pulls.iter_mut().zip([c, s]) {
            for (sum, along) in pull.iter_mut().zip(&j) {
                *sum += influence.slope * weight * along;
            }
        }
    }

    pub(super) fn spread(
        &self,
        here: &mut Array,
        coupling: &mut [[f64; KNOT]; KNOT],
        next: &mut Array,
    ) {
        let [cc, cs, ss] = &self.moments;
        for i in 0..4 {
            let pull = self.pulls[0][i] + self.pulls[1][i];
            here.0[KNOT + i][JOINT] += pull;
            for j in 0..4 {
                // Globals: (1-s)^2 + 2 s (1-s) + s^2 = 1.
                here.0[KNOT + i][KNOT + j] += cc[i][j] + 2.0 * cs[i][j] + ss[i][j];
            }
        }
        for i in 0..3 {
            here.0[i][JOINT] += self.pulls[0][i];
            next.0[i][JOINT] += self.pulls[1][i];
            for j in 0..3 {
                here.0[i][j] += cc[i][j];
                coupling[i][j] += cs[i][j];
                next.0[i][j] += ss[i][j];
            }
            for j in 0..4 {
                // (1-s) = (1-s)^2 + s (1-s) and s = s^2 + s (1-s).
                let (a, b) = (cc[i][j] + cs[i][j], ss[i][j] + cs[i][j]);
                here.0[i][KNOT + j] += a;
                here.0[KNOT + j][i] += a;
                next.0[i][KNOT + j] += b;
                next.0[KNOT + j][i] += b;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::likelihood::RangeLikelihood;
    use proptest::prelude::*;

    /// Sums over one range of a vehicle at a third of the way, and its slope: of the tag at `tag_m`
    /// and the vehicle at the origin.
    fn sums(tag_m: Vector3<f64>, measured_m: f64, variance_m2: f64) -> RangeSums {
        let distance = tag_m.norm();
        let likelihood = RangeLikelihood::new(0.0);
        let influence = likelihood.influence(distance - measured_m, variance_m2);
        let mut sums = RangeSums::default();
        sums.add(
            tag_m / distance,
            1.0 / 3.0,
            &influence,
            influence.slope / distance,
        );
        sums
    }

    proptest! {
        #[test]
        fn curved_information_is_the_derivative_of_the_pull(
            x in -2.0..2.0f64, y in -2.0..2.0f64, z in 0.3..3.0f64, off_m in -0.2..0.2f64,
        ) {
            let tag_m = Vector3::new(x, y, z);
            let measured_m = tag_m.norm() + off_m;
            let h = 1e-6;
            for axis in 0..3 {
                let mut step = Vector3::zeros();
                step[axis] = h;
                let [less, more] = [tag_m - step, tag_m + step].map(|t| sums(t, measured_m, 0.01));
                for row in 0..4 {
                    let slope = (more.pulls[0][row] - less.pulls[0][row]) / (2.0 * h) * (2.0 / 3.0);
                    let told = sums(tag_m, measured_m, 0.01).moments[0][row][axis];
                    prop_assert!((slope - told).abs() < 1e-3 * (1.0 + told.abs()), "{row} {axis}: {slope} {told}");
                }
            }
        }
    }
}
