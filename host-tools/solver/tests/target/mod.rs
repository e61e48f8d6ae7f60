//! A target on a smooth path, seen from a sensor that flies beside it; some bearings are wrong.

use nalgebra::{UnitQuaternion, Vector3};
use nova_solver::tracking::{Bearing, Belief, Range, SensorPose, Sighting};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

pub(crate) const STEP_S: f64 = 0.05;
pub(crate) const RANGE_SIGMA_M: f64 = 0.05;
pub(crate) const BEARING_SIGMA: f64 = 3.0 * std::f64::consts::PI / 180.0;
const OUTLIER_SIGMA: f64 = 25.0 * std::f64::consts::PI / 180.0;

/// Where the target is, metres.
pub(crate) fn truth_m(t_s: f64) -> Vector3<f64> {
    Vector3::new(
        0.8 * t_s,
        3.0 * (0.4 * t_s).sin(),
        1.5 + 0.6 * (0.25 * t_s).sin(),
    )
}

pub(crate) fn prior() -> Belief {
    let velocity = (truth_m(1e-3) - truth_m(0.0)) * 1e3;
    Belief::about(
        truth_m(0.0) + Vector3::new(0.3, -0.2, 0.1),
        0.5,
        velocity * 0.5,
        1.0,
    )
}

/// So many sightings, 20 a second.
pub(crate) fn sightings(n: usize, outliers: f64, seed: u64) -> Vec<Sighting> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let normal = |rng: &mut ChaCha8Rng| -> f64 { rng.sample(StandardNormal) };
    (0..n)
        .map(|i| {
            let t_s = STEP_S * i as f64;
            let position_m = Vector3::new(
                0.8 * t_s - 3.0,
                1.0 * (0.3 * t_s).cos(),
                1.8 + 0.2 * (0.5 * t_s).sin(),
            );
            let to_sensor = UnitQuaternion::from_euler_angles(
                0.1 * (t_s).sin(),
                0.1 * (0.7 * t_s).cos(),
                -0.2 * t_s,
            );
            let offset = truth_m(t_s) - position_m;
            let range_m = offset.norm() + RANGE_SIGMA_M * normal(&mut rng);
            let exact = Bearing {
                direction: to_sensor * offset.normalize(),
                sigma_rad: BEARING_SIGMA,
            };
            let (azimuth, elevation) = exact.angles();
            let sigma = if rng.random_bool(outliers) {
                OUTLIER_SIGMA
            } else {
                BEARING_SIGMA
            };
            let azimuth = azimuth + sigma * normal(&mut rng);
            let elevation = elevation + sigma * normal(&mut rng);
            Sighting {
                t_s,
                pose: SensorPose::known(position_m, to_sensor),
                range: Some(Range {
                    range_m,
                    sigma_m: RANGE_SIGMA_M,
                }),
                bearing: Some(Bearing::from_angles(azimuth, elevation, BEARING_SIGMA)),
            }
        })
        .collect()
}
