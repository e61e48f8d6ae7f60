//! Simulated sightings.

use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use nova_solver::tracking::{Bearing, Range, SensorPose, Sighting};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::scene::Sensor;
use crate::streams::{Stream, generator, normal};

/// The sensor of one flight.
pub(super) struct SimulatedSensor<'a> {
    settings: &'a Sensor,
    outlier_probability: f64,
    tilt: UnitQuaternion<f64>,
    rng: ChaCha8Rng,
}

/// A sighting, and whether its bearing is one that nothing tells about.
pub(super) struct Seen {
    pub(super) sighting: Sighting,
    pub(super) outlier: bool,
}

impl<'a> SimulatedSensor<'a> {
    pub(super) fn new(settings: &'a Sensor, outlier_probability: f64, seed: u64) -> Self {
        let mut rng = generator(seed, Stream::Tilt);
        let tilt = Vector3::from_fn(|_, _| normal(&mut rng)) * settings.tilt_sigma_deg.to_radians();
        Self {
            settings,
            outlier_probability,
            tilt: UnitQuaternion::from_scaled_axis(tilt),
            rng: generator(seed, Stream::Uwb),
        }
    }

    /// What is seen of the target. As many numbers are drawn at every sighting, whatever becomes of
    /// it, so that trackers and controllers that are compared meet the same noise.
    pub(super) fn see(
        &mut self,
        t_s: f64,
        position_m: Vector3<f64>,
        attitude: UnitQuaternion<f64>,
        target_m: Vector3<f64>,
    ) -> Seen {
        let s = self.settings;
        let rng = &mut self.rng;
        let noise: [f64; 6] = std::array::from_fn(|_| normal(rng));
        let chance: [f64; 5] = std::array::from_fn(|_| rng.random());

        let blocked = s.blocked.iter().any(|b| b.holds(t_s))
            || s.walls_m
                .iter()
                .any(|wall| crosses(wall, &position_m, &target_m));
        let degraded = |t_s: f64| {
            s.degraded
                .iter()
                .filter(|d| t_s >= d.from_s && t_s < d.to_s)
                .map(|d| d.factor)
                .product::<f64>()
        };
        let factor = degraded(t_s);
        let range_sigma_m = s.range_sigma_m * factor;
        let bearing_sigma = s.bearing_sigma_deg.to_radians() * factor;

        let attitude_sigma = s.attitude_sigma_deg.to_radians();
        let error = Vector3::new(noise[0], noise[1], noise[2]) * attitude_sigma;
        let truly = UnitQuaternion::from_scaled_axis(error) * self.tilt * attitude;

        let offset = target_m - position_m;
        let outlier = chance[0] < self.outlier_probability;
        let drawn_sigma = if blocked {
            s.nlos.bearing_sigma_deg.to_radians()
        } else if outlier {
            s.outlier_sigma_deg.to_radians()
        } else {
            bearing_sigma
        };
        let extra_m = if blocked {
            -s.nlos.extra_m * (1.0 - chance[1]).max(1e-12).ln()
        } else {
            0.0
        };
        let exact = Bearing {
            direction: truly * offset.try_normalize(1e-9).unwrap_or_else(Vector3::x),
            sigma_rad: bearing_sigma,
        };
        let (azimuth, elevation) = exact.angles();
        let gone = blocked && chance[2] < s.nlos.loss;
        let range_m = offset.norm() + extra_m + range_sigma_m * noise[3];
        let [range_loss, bearing_loss] = s.loss;
        let sighting = Sighting {
            t_s,
            pose: SensorPose {
                position_m,
                to_sensor: attitude,
                attitude_covariance: Matrix3::identity() * (attitude_sigma * attitude_sigma),
            },
            range: (!gone && chance[3] >= range_loss && range_m > 0.0).then_some(Range {
                range_m,
                sigma_m: range_sigma_m,
            }),
            bearing: (!gone && chance[4] >= bearing_loss).then(|| {
                Bearing::from_angles(
                    azimuth + drawn_sigma * noise[4],
                    elevation + drawn_sigma * noise[5],
                    bearing_sigma,
                )
            }),
        };
        Seen {
            sighting,
            outlier: outlier || blocked,
        }
    }
}

/// Whether the line between two places crosses a wall, seen from above.
fn crosses(wall: &[f64; 4], a: &Vector3<f64>, b: &Vector3<f64>) -> bool {
    let [x1, y1, x2, y2] = *wall;
    let side = |x: f64, y: f64| (x2 - x1) * (y - y1) - (y2 - y1) * (x - x1);
    let other = |x: f64, y: f64| (b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x);
    side(a.x, a.y) * side(b.x, b.y) < 0.0 && other(x1, y1) * other(x2, y2) < 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wall_blocks_what_lies_behind_it_only() {
        let wall = [0.0, -1.0, 0.0, 1.0];
        let at = |x: f64, y: f64| Vector3::new(x, y, 0.0);
        assert!(crosses(&wall, &at(-1.0, 0.0), &at(1.0, 0.5)));
        assert!(!crosses(&wall, &at(-1.0, 0.0), &at(-0.1, 0.5)));
        assert!(!crosses(&wall, &at(-1.0, 2.0), &at(1.0, 2.5)));
    }
}
