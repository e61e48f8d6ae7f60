//! What the sensors of a flight say.

use nalgebra::{Matrix3, Rotation3, Vector3};
use nova_solver::fusion::{GnssFix, ImuSample};
use nova_solver::ins::GRAVITY_M_S2;
use nova_solver::survey::{TagRange, TrackPoint};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::anchors_m;
use super::path::{Moment, STEP_S};
use crate::streams::normal;

/// What spoils measurements.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Air {
    /// Root mean square error of GNSS, metres: horizontal (both axes together), vertical.
    pub gnss_rms_m: [f64; 2],
    /// Time over which that hangs together, seconds.
    pub gnss_memory_s: f64,
    /// GNSS ends at this time, seconds.
    pub gnss_until_s: f64,
    /// UWB works until the first and from the second time, seconds.
    pub uwb_gap_s: [f64; 2],
    /// Noise of a range, metres.
    pub range_sigma_m: f64,
    /// Biases of anchors, one sigma, metres.
    pub bias_sigma_m: f64,
    /// How late ranges are stamped, seconds.
    pub lag_s: f64,
    /// How often a path becomes blocked, per second; for some three seconds then.
    pub blocked_rate_hz: f64,
    /// Mean of what blocked ranges read too long beyond half a metre, metres.
    pub blocked_extra_m: f64,
    /// Constant bias of the accelerometer, one sigma, m/s^2.
    pub imu_bias: f64,
    /// Error of the attitude, one sigma, radians.
    pub attitude_sigma: f64,
}

impl Air {
    /// As in the paper's flight of this number (0 to 2): GNSS of the size of Table 6.
    pub fn of_flight(flight: usize) -> Self {
        let table_6 = [[2.00, 4.17], [2.42, 5.74], [5.26, 14.62]];
        Self {
            gnss_rms_m: table_6.get(flight).copied().unwrap_or([5.26, 14.62]),
            gnss_memory_s: 15.0,
            gnss_until_s: f64::INFINITY,
            uwb_gap_s: [f64::INFINITY; 2],
            range_sigma_m: 0.06,
            bias_sigma_m: 0.1,
            lag_s: 0.1,
            blocked_rate_hz: 0.02,
            blocked_extra_m: 1.5,
            imu_bias: 0.05,
            attitude_sigma: 0.005,
        }
    }
}

/// A range as it is received.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range {
    /// Time stamp, seconds.
    pub t_s: f64,
    /// Number of the anchor.
    pub anchor: usize,
    /// Metres.
    pub range_m: f64,
    /// Total and first-path receive power, dBm.
    pub power_dbm: [f64; 2],
    /// Whether the path was blocked: what the paper's authors found by looking. For that method alone.
    pub blocked: bool,
}

/// A receiver whose track the survey uses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Receiver {
    /// What it is called in the paper.
    pub name: &'static str,
    /// Root mean square error, metres: horizontal (both axes together), vertical.
    pub rms_m: [f64; 2],
    /// Part of the time in which it has a solution.
    pub available: f64,
}

impl Receiver {
    /// Table 4; the first is what the others are compared with.
    pub const ALL: [Self; 3] = [
        Self {
            name: "PwrPak7",
            rms_m: [0.02, 0.03],
            available: 1.0,
        },
        Self {
            name: "AsteRx-i3 D pro+",
            rms_m: [6.04, 6.65],
            available: 0.934,
        },
        Self {
            name: "mosaic-go",
            rms_m: [3.29, 3.66],
            available: 0.586,
        },
    ];
}

/// A flight as its sensors saw it.
#[derive(Debug, Clone, PartialEq)]
pub struct Log {
    /// 100 Hz.
    pub imu: Vec<ImuSample>,
    /// 5 Hz.
    pub gnss: Vec<GnssFix>,
    /// 10 Hz from each anchor in reach.
    pub ranges: Vec<Range>,
    /// 5 Hz, one of each of [`Receiver::ALL`].
    pub tracks: [Vec<TrackPoint>; 3],
}

/// An error of given size that hangs together in time.
struct Markov {
    value: Vector3<f64>,
    sigma: Vector3<f64>,
}

impl Markov {
    fn new(rms_m: [f64; 2], rng: &mut ChaCha8Rng) -> Self {
        let [horizontal, vertical] = rms_m;
        let sigma = Vector3::new(horizontal / 2f64.sqrt(), horizontal / 2f64.sqrt(), vertical);
        Self {
            value: sigma.map(|s| s * normal(rng)),
            sigma,
        }
    }

    fn step(&mut self, dt: f64, memory_s: f64, rng: &mut ChaCha8Rng) -> Vector3<f64> {
        let keep = (-dt / memory_s).exp();
        let fresh = (1.0 - keep * keep).sqrt();
        self.value = self.value * keep + self.sigma.map(|s| s * fresh * normal(rng));
        self.value
    }
}

/// Reach of the radios, metres.
pub(super) const REACH_M: f64 = 35.0;
/// Part of the ranges that get lost.
pub(super) const LOST: f64 = 0.1;
/// Mean time for which a path stays blocked, seconds.
const BLOCKED_S: f64 = 3.0;

impl Log {
    /// Of a flight, with this seed. Biases of anchors come from `installation`, which flights share.
    pub fn new(path: &[Moment], air: &Air, installation: u64, seed: u64) -> Self {
        let stream = |number: u64| {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            rng.set_stream(number);
            rng
        };
        Self {
            imu: imu(path, air, &mut stream(1)),
            gnss: gnss(path, air, &mut stream(2)),
            ranges: ranges(path, air, installation, &mut stream(3)),
            tracks: Receiver::ALL.map(|receiver| {
                let number = 4 + receiver.name.len() as u64;
                track(path, &receiver, air, &mut stream(number))
            }),
        }
    }

    /// Ranges of each anchor for the survey.
    pub fn survey_ranges(&self, sigma_m: f64) -> [Vec<TagRange>; 6] {
        std::array::from_fn(|anchor| {
            (self.ranges.iter())
                .filter(|range| range.anchor == anchor)
                .map(|range| TagRange {
                    t_s: range.t_s,
                    range_m: range.range_m,
                    sigma_m,
                })
                .collect()
        })
    }
}

fn every(path: &[Moment], ticks: usize) -> impl Iterator<Item = &Moment> {
    path.iter().step_by(ticks)
}

fn imu(path: &[Moment], air: &Air, rng: &mut ChaCha8Rng) -> Vec<ImuSample> {
    /// Noise of one reading, m/s^2: 0.003 m/s^2 / sqrt(Hz) at 100 Hz.
    const WHITE: f64 = 0.03;
    let bias = Vector3::from_fn(|_, _| air.imu_bias * normal(rng));
    let mut tilt = Markov {
        value: Vector3::from_fn(|_, _| air.attitude_sigma * normal(rng)),
        sigma: Vector3::repeat(air.attitude_sigma),
    };
    path.iter()
        .map(|moment| {
            // A multirotor leans into its acceleration.
            let thrust = moment.acceleration + Vector3::z() * GRAVITY_M_S2;
            let attitude = Rotation3::rotation_between(&Vector3::z(), &thrust)
                .map_or_else(Matrix3::identity, |r| *r.matrix());
            let error = Rotation3::from_scaled_axis(tilt.step(STEP_S, 30.0, rng));
            let noise = Vector3::from_fn(|_, _| WHITE * normal(rng));
            ImuSample {
                t_s: moment.t_s,
                force_m_s2: attitude.tr_mul(&thrust) + bias + noise,
                enu_from_body: error.matrix() * attitude,
            }
        })
        .collect()
}

fn gnss(path: &[Moment], air: &Air, rng: &mut ChaCha8Rng) -> Vec<GnssFix> {
    let mut error = Markov::new(air.gnss_rms_m, rng);
    let mut pdop = Markov::new([0.0, 0.8], rng);
    every(path, 20)
        .map(|moment| GnssFix {
            t_s: moment.t_s,
            position_m: moment.position_m
                + error.step(0.2, air.gnss_memory_s, rng)
                + Vector3::from_fn(|_, _| 0.3 * normal(rng)),
            pdop: (3.0 + pdop.step(0.2, 20.0, rng).z).max(1.5),
        })
        .filter(|fix| fix.t_s < air.gnss_until_s)
        .collect()
}

fn ranges(path: &[Moment], air: &Air, installation: u64, rng: &mut ChaCha8Rng) -> Vec<Range> {
    let mut of_site = ChaCha8Rng::seed_from_u64(installation);
    let biases = [(); 6].map(|()| air.bias_sigma_m * normal(&mut of_site));
    let anchors = anchors_m();
    let mut blocked: [Option<f64>; 6] = [None; 6];
    let mut ranges = Vec::new();
    for (k, moment) in path.iter().enumerate() {
        // The six answer in six slots of a tenth of a second.
        let Some(anchor) = (k % 10).checked_sub(2).filter(|slot| *slot < 6) else {
            continue;
        };
        let chance: f64 = rng.random();
        let dt = 0.1;
        blocked[anchor] = match blocked[anchor] {
            None if chance < air.blocked_rate_hz * dt => {
                let extra: f64 = -(1.0 - rng.random::<f64>()).ln() * air.blocked_extra_m;
                Some(0.5 + extra)
            }
            Some(_) if chance < dt / BLOCKED_S => None,
            same => same,
        };
        let distance = (moment.position_m - anchors[anchor]).norm();
        let noise = air.range_sigma_m * normal(rng);
        let (lost, rx) = (
            rng.random::<f64>() < LOST,
            -78.0 - 20.0 * (distance / 10.0).log10(),
        );
        let missing_db = match blocked[anchor] {
            Some(_) => 11.0 + 2.5 * normal(rng),
            None => 3.0 + 1.2 * normal(rng),
        };
        let working = moment.t_s < air.uwb_gap_s[0] || moment.t_s >= air.uwb_gap_s[1];
        if lost || distance > REACH_M || !working {
            continue;
        }
        ranges.push(Range {
            t_s: moment.t_s + air.lag_s,
            anchor,
            range_m: distance + biases[anchor] + noise + blocked[anchor].unwrap_or(0.0),
            power_dbm: [rx, rx - missing_db.max(0.5)],
            blocked: blocked[anchor].is_some(),
        });
    }
    ranges
}

fn track(path: &[Moment], receiver: &Receiver, air: &Air, rng: &mut ChaCha8Rng) -> Vec<TrackPoint> {
    let mut error = Markov::new(receiver.rms_m, rng);
    let mut working = true;
    /// Mean time between losing a solution and having one again, together, seconds.
    const SPELL_S: f64 = 4.0;
    every(path, 20)
        .filter_map(|moment| {
            let off = error.step(0.2, air.gnss_memory_s, rng);
            let share = if working {
                1.0 - receiver.available
            } else {
                receiver.available
            };
            if rng.random::<f64>() < 0.2 / SPELL_S * 2.0 * share {
                working = !working;
            }
            working.then_some(TrackPoint {
                t_s: moment.t_s,
                position_m: moment.position_m + off,
            })
        })
        .collect()
}
