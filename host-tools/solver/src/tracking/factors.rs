//! What a sighting tells about the target's position, linearised at a guess of it.
//!
//! ```text
//! range     r = (|p - p_R| - z_r) / sigma_r                                       (eq. 19)
//! bearing   r = C^-1/2 B' Log_h(z),  h = R_SE (p - p_R) / |p - p_R|               (eq. 22, 23)
//!           C = sigma_b^2 I + B' [h]x Sigma_att [h]x' B
//! ```
//!
//! `C` is the paper's `Sigma_b` and beside it what an attitude that is not quite known turns the
//! bearing by. Slopes: `dr/dp = n' / sigma_r` of the range, `n` the direction to the target. Moving the target
//! by `dp` across the line of sight moves `h` by `R_SE dp / d`, and the Log by as much the other way;
//! how the Log's length changes its slope is left out, as in Gauss-Newton what is curved is. The
//! gradient stays that of the exact residual, so the minimum is too.

use nalgebra::{Matrix2, Matrix2x3, Matrix3, Vector2, Vector3};

use super::sighting::{Bearing, Range, SensorPose, Sighting};
use super::sphere;
use crate::kernel::Kernel;

/// Nearer than this to the sensor a target has no direction.
const NEAREST_M: f64 = 1e-3;

/// A quadratic in the position `p` about the guess `p0`: `1/2 (p - p0)' information (p - p0) - pull'
/// (p - p0) + cost`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Quadratic {
    pub(crate) information: Matrix3<f64>,
    pub(crate) pull: Vector3<f64>,
    /// Half the sum of `rho` at the guess.
    pub(crate) cost: f64,
    /// Weight of the bearing by its kernel, 1 without.
    pub(crate) bearing_weight: f64,
}

/// The kernels of both readings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Kernels {
    /// Of the range; the paper has none.
    pub range: Kernel,
    /// Of the bearing; the paper's is Cauchy's (eq. 24), of both components in one.
    pub bearing: Kernel,
}

impl Kernels {
    /// Both wider by a factor.
    pub(crate) fn widened(self, factor: f64) -> Self {
        let wider = |kernel| match kernel {
            Kernel::None => Kernel::None,
            Kernel::Huber { k } => Kernel::Huber { k: k * factor },
            Kernel::Cauchy { c } => Kernel::Cauchy { c: c * factor },
        };
        Self {
            range: wider(self.range),
            bearing: wider(self.bearing),
        }
    }
}

/// A whitened bearing residual and its slope.
pub(crate) struct BearingResidual {
    pub(crate) residual: Vector2<f64>,
    pub(crate) slope: Matrix2x3<f64>,
}

/// The residual of a bearing with the target at `at`, `None` on top of the sensor.
pub(crate) fn bearing_residual(
    pose: &SensorPose,
    bearing: &Bearing,
    at: &Vector3<f64>,
) -> Option<BearingResidual> {
    let offset = at - pose.position_m;
    let distance = offset.norm();
    if distance < NEAREST_M {
        return None;
    }
    let to_sensor = pose.to_sensor.to_rotation_matrix();
    let h = to_sensor * (offset / distance);
    let across = sphere::tangents(&h).transpose();
    let mut covariance = Matrix2::from_diagonal_element(bearing.sigma_rad * bearing.sigma_rad);
    if pose.attitude_covariance != Matrix3::zeros() {
        let turned = across * h.cross_matrix();
        covariance += turned * pose.attitude_covariance * turned.transpose();
    }
    // Of a 2 by 2 matrix L L' = C, written out.
    let l11 = covariance.m11.sqrt();
    let l21 = covariance.m21 / l11;
    let l22 = (covariance.m22 - l21 * l21).max(0.0).sqrt();
    if l22.is_nan() || l22 <= 0.0 {
        return None;
    }
    let white = Matrix2::new(1.0 / l11, 0.0, -l21 / (l11 * l22), 1.0 / l22);
    Some(BearingResidual {
        residual: white * (across * sphere::log(&h, &bearing.direction)),
        slope: white * (across * to_sensor.matrix()) * (-1.0 / distance),
    })
}

/// What a sighting tells with the target near `at`.
pub(crate) fn quadratic(sighting: &Sighting, at: &Vector3<f64>, kernels: &Kernels) -> Quadratic {
    let mut sum = Quadratic {
        information: Matrix3::zeros(),
        pull: Vector3::zeros(),
        cost: 0.0,
        bearing_weight: 1.0,
    };
    let offset = at - sighting.pose.position_m;
    let distance = offset.norm();
    if let Some(Range { range_m, sigma_m }) = sighting.range
        && distance >= NEAREST_M
    {
        let slope = offset / (distance * sigma_m);
        let residual = (distance - range_m) / sigma_m;
        let (rho, weight) = kernels.range.rho_and_weight(residual * residual);
        sum.information += slope * slope.transpose() * weight;
        sum.pull -= slope * (residual * weight);
        sum.cost += 0.5 * rho;
    }
    if let Some(bearing) = &sighting.bearing
        && let Some(BearingResidual { residual, slope }) =
            bearing_residual(&sighting.pose, bearing, at)
    {
        let (rho, weight) = kernels.bearing.rho_and_weight(residual.norm_squared());
        sum.information += slope.transpose() * slope * weight;
        sum.pull -= slope.transpose() * (residual * weight);
        sum.cost += 0.5 * rho;
        sum.bearing_weight = weight;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;

    fn sighting() -> Sighting {
        let pose = SensorPose {
            position_m: Vector3::new(1.0, -2.0, 0.5),
            to_sensor: UnitQuaternion::from_euler_angles(0.2, -0.4, 2.0),
            attitude_covariance: Matrix3::from_diagonal(&Vector3::new(1e-3, 4e-3, 2e-3)),
        };
        let target = Vector3::new(3.0, 1.0, 2.0);
        let direction = (pose.to_sensor * (target - pose.position_m)).normalize();
        let (azimuth, elevation) = Bearing {
            direction,
            sigma_rad: 0.05,
        }
        .angles();
        Sighting {
            t_s: 0.0,
            pose,
            range: Some(Range {
                range_m: (target - pose.position_m).norm() + 0.1,
                sigma_m: 0.05,
            }),
            bearing: Some(Bearing::from_angles(azimuth + 0.3, elevation - 0.2, 0.05)),
        }
    }

    #[test]
    fn the_pull_is_the_downward_slope_of_the_cost() {
        // With a known attitude the covariance does not depend on the place, so the slope is exact.
        let mut sighting = sighting();
        sighting.pose.attitude_covariance = Matrix3::zeros();
        let kernels = Kernels {
            range: Kernel::Huber { k: 1.3 },
            bearing: Kernel::default(),
        };
        let at = Vector3::new(2.6, 1.3, 1.8);
        let cost = |p: Vector3<f64>| quadratic(&sighting, &p, &kernels).cost;
        let pull = quadratic(&sighting, &at, &kernels).pull;
        for axis in 0..3 {
            let mut step = Vector3::zeros();
            step[axis] = 1e-6;
            let slope = (cost(at + step) - cost(at - step)) / 2e-6;
            assert!((slope + pull[axis]).abs() < 1e-5 * pull.norm(), "{axis}");
        }
    }

    #[test]
    fn doubt_in_the_attitude_weakens_the_bearing_only_where_it_turns_it() {
        let mut sighting = sighting();
        sighting.range = None;
        let at = Vector3::new(3.0, 1.0, 2.0);
        let kernels = Kernels {
            range: Kernel::None,
            bearing: Kernel::None,
        };
        let information = |covariance: Matrix3<f64>| {
            let mut sighting = sighting;
            sighting.pose.attitude_covariance = covariance;
            quadratic(&sighting, &at, &kernels).information
        };
        let offset = at - sighting.pose.position_m;
        let h = sighting.pose.to_sensor * offset.normalize();
        let known = information(Matrix3::zeros());
        // A turn about the line of sight does not move what lies on it.
        let about = information(h * h.transpose() * 0.01);
        assert!((about - known).norm() < 1e-9 * known.norm());
        // The same doubt about all axes is that much more noise.
        let all = information(Matrix3::identity() * 0.05 * 0.05);
        assert!((all * 2.0 - known).norm() < 1e-9 * known.norm());
    }

    #[test]
    fn on_top_of_the_sensor_nothing_is_told() {
        let sighting = sighting();
        let told = quadratic(
            &sighting,
            &sighting.pose.position_m,
            &Kernels {
                range: Kernel::None,
                bearing: Kernel::default(),
            },
        );
        assert_eq!(told.information, Matrix3::zeros());
    }
}
