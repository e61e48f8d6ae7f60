//! What the vehicle measures.

use super::listening::by_differences;
use super::scenario::{Scenario, UwbBy};
use crate::streams::normal;
use nalgebra::{UnitQuaternion, Vector3};
use nova_solver::delivery::{CameraMount, Input, Measurement, Pose, SingleTag, SingleTagOptions};
use nova_solver::multilateration::{Height, MultilaterationOptions};
use nova_solver::positioning::{AnchorRange, locate};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::VecDeque;

/// Ticks between two GPS poses, marker poses and UWB places, at 100 Hz.
const GPS_TICKS: u32 = 10;
const MARKER_TICKS: u32 = 7;
const UWB_TICKS: u32 = 10;
/// Ticks between two ranges to a single tag.
const TAG_TICKS: u32 = 5;
/// One exchange in twenty is lost.
const HEARD: f64 = 0.95;
/// So many places share their anchors' biases: a filter must not take a hundred of them for ten times better than one.
const REPEATED: f64 = 20.0;
/// Poses of the marker from higher up are not used (Sec. 5.1), metres.
const MARKER_HEIGHT_M: f64 = 30.0;
/// Half of the camera's view (Raspberry Pi Camera 2: 62.2 by 48.8 degrees), as tangents.
const VIEW: [f64; 2] = [0.6032, 0.4536];
/// Its focal length, pixels of an image 1280 wide.
const FOCAL_PX: f64 = 1061.0;
/// A marker's side has to be so many pixels to be read (judged on pictures: docs/delivery.md).
const LEAST_PX: f64 = 20.0;
/// How well a corner is found, pixels: worse than in clear pictures, as bad as with some motion.
const CORNER_PX: f64 = 1.0;
/// Sides of the two markers, metres (Sec. 4.2.1).
const SIDES_M: [f64; 2] = [0.8, 0.09];
/// The anchors stand around the platform.
const ANCHORS_M: [[f64; 3]; 4] = [
    [1.5, 1.5, 0.1],
    [-1.5, 1.5, 0.6],
    [-1.5, -1.5, 0.1],
    [1.5, -1.5, 0.6],
];

/// A measurement and when it was taken.
#[derive(Debug, Clone, Copy)]
pub(super) struct Timed {
    pub(super) taken_s: f64,
    pub(super) measurement: Measurement,
}

/// The sensors of one flight.
pub(super) struct Sensors {
    rng: ChaCha8Rng,
    scenario: Scenario,
    gps_bias_m: Vector3<f64>,
    gps_wander_m: Vector3<f64>,
    gyro_bias_rad_s: Vector3<f64>,
    velocity_offset_m_s: Vector3<f64>,
    mount_turn: UnitQuaternion<f64>,
    mount_off_m: Vector3<f64>,
    anchor_bias_m: [f64; 4],
    /// Where one tag has to do.
    single_tag: Option<SingleTag>,
    /// Poses of the marker that are being computed: when they will be there.
    under_way: VecDeque<(f64, Timed)>,
}

impl Sensors {
    pub(super) fn new(scenario: &Scenario, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(11);
        let mut vector = |sigma: f64| Vector3::from_fn(|_, _| sigma * normal(&mut rng));
        let bias = vector(scenario.gps_bias_m).component_mul(&Vector3::new(1.0, 1.0, 1.5));
        let (gyro_bias_rad_s, velocity_offset_m_s) = (vector(0.003), vector(0.03));
        let mount_turn = UnitQuaternion::from_scaled_axis(vector(scenario.mount_turn_rad));
        let mount_off_m = vector(scenario.mount_off_m);
        let anchor_bias_m = [(); 4].map(|()| scenario.anchor_bias_m * normal(&mut rng));
        let single_tag = (scenario.uwb && scenario.uwb_by == UwbBy::SingleTag).then(|| {
            let place_sigma_m = scenario.first_bias_sigma_m();
            SingleTag::new(SingleTagOptions {
                place_sigma_m,
                height_sigma_m: 1.5 * place_sigma_m,
                ..SingleTagOptions::default()
            })
        });
        Self {
            rng,
            single_tag,
            scenario: scenario.clone(),
            gps_bias_m: bias,
            gps_wander_m: Vector3::zeros(),
            gyro_bias_rad_s,
            velocity_offset_m_s,
            mount_turn,
            mount_off_m,
            anchor_bias_m,
            under_way: VecDeque::new(),
        }
    }

    /// What the autopilot's velocity is off by.
    pub(super) fn velocity_offset_m_s(&self) -> Vector3<f64> {
        self.velocity_offset_m_s
    }

    /// Velocity and turning rate of the last tick.
    pub(super) fn input(&mut self, t_s: f64, before: &Pose, after: &Pose, dt_s: f64) -> Input {
        let rate = (before.attitude.inverse() * after.attitude).scaled_axis() / dt_s;
        let velocity_m_s = (after.position_m - before.position_m) / dt_s
            + self.velocity_offset_m_s
            + self.noise(0.05);
        if let Some(tag) = &mut self.single_tag {
            tag.moved(t_s, &velocity_m_s, dt_s);
        }
        Input {
            velocity_m_s,
            rate_rad_s: rate + self.gyro_bias_rad_s + self.noise(0.01),
        }
    }

    /// What has been measured by now.
    pub(super) fn measure(&mut self, tick: u32, t_s: f64, dt_s: f64, truth: &Pose) -> Vec<Timed> {
        let mut told = Vec::new();
        let now = |measurement| Timed {
            taken_s: t_s,
            measurement,
        };
        let step = self.noise(0.02 * dt_s.sqrt());
        self.gps_wander_m += step - self.gps_wander_m * (dt_s / 60.0);
        let gps_lost = self.scenario.gps_lost_s.is_some_and(|lost_s| t_s >= lost_s);
        if tick.is_multiple_of(GPS_TICKS) && !gps_lost {
            let error = self.gps_bias_m + self.gps_wander_m + self.noise(0.05);
            let turn = UnitQuaternion::from_scaled_axis(self.noise(0.01));
            let position_m = truth.position_m + error;
            if let Some(tag) = &mut self.single_tag {
                tag.autopilot(t_s, &position_m);
            }
            told.push(now(Measurement::Autopilot {
                position_m,
                attitude: truth.attitude * turn,
            }));
        }
        // Marker and anchors are on the platform, wherever that is.
        let [x, y] = self.scenario.platform_off_m;
        let from_platform = Pose {
            position_m: truth.position_m - Vector3::new(x, y, 0.0),
            attitude: truth.attitude,
        };
        if self.single_tag.is_some() {
            if tick.is_multiple_of(TAG_TICKS) {
                told.extend(self.by_tag(t_s, &from_platform.position_m).map(now));
            }
        } else if tick.is_multiple_of(UWB_TICKS) && self.scenario.uwb {
            told.extend(self.uwb(&from_platform.position_m).map(now));
        }
        if tick.is_multiple_of(MARKER_TICKS)
            && let Some(marker) = self.marker(&from_platform)
        {
            let there_s = t_s + self.scenario.marker_delay_s;
            self.under_way.push_back((there_s, now(marker)));
        }
        while let Some(&(there_s, timed)) = self.under_way.front()
            && there_s <= t_s
        {
            self.under_way.pop_front();
            told.push(timed);
        }
        told
    }

    /// The larger marker that is wholly in view and can be read.
    fn marker(&mut self, truth: &Pose) -> Option<Measurement> {
        if truth.position_m.z > MARKER_HEIGHT_M {
            return None;
        }
        let camera = CameraMount::looking_down(Vector3::zeros());
        let (place, rotation) = camera.marker(truth);
        let can = [self.scenario.large_marker, self.scenario.small_marker];
        let side_m = (SIDES_M.iter().zip(can)).find_map(|(&side_m, can)| {
            let edge = [place.x.abs(), place.y.abs()].map(|off| (off + 0.71 * side_m) / place.z);
            let in_view = place.z > 0.05 && edge.iter().zip(VIEW).all(|(edge, view)| *edge < view);
            (can && in_view && side_m * FOCAL_PX / place.z >= LEAST_PX).then_some(side_m)
        })?;
        // Corners found to a pixel: across by the distance, along by how small the marker looks, turned out of the image
        // hardly to be seen.
        let z = place.z;
        let side_px = side_m * FOCAL_PX / z;
        let across = 0.5 * CORNER_PX * z / FOCAL_PX;
        let along = z * CORNER_PX / side_px;
        let (tilt, yaw) = ((4.0 * CORNER_PX / side_px).min(0.5), CORNER_PX / side_px);
        let noise = Vector3::new(across * self.one(), across * self.one(), along * self.one());
        let turn = Vector3::new(tilt * self.one(), tilt * self.one(), yaw * self.one());
        // The camera is not quite mounted as it was measured; the filter is told how well that is known, not what was drawn.
        let seen = self.mount_turn * place + self.mount_off_m + noise;
        let (turned, off_m) = (self.scenario.mount_turn_rad, self.scenario.mount_off_m);
        let tilt_sigma = tilt.hypot(turned);
        Some(Measurement::Marker {
            position_m: seen,
            attitude: self.mount_turn * rotation * UnitQuaternion::from_scaled_axis(turn),
            sigma_m: [across.hypot(turned * z).hypot(off_m), along.hypot(off_m)],
            sigma_rad: [tilt_sigma, tilt_sigma, yaw.hypot(turned)],
        })
    }

    /// The tag lies in the middle of the platform.
    fn by_tag(&mut self, t_s: f64, from_platform: &Vector3<f64>) -> Option<Measurement> {
        let [bias_m, ..] = self.anchor_bias_m;
        let range_m = self.range_m(from_platform.norm(), bias_m)?;
        self.single_tag.as_mut()?.range(t_s, range_m)
    }

    /// What is measured over a distance; nothing beyond reach, and where the exchange is lost.
    fn range_m(&mut self, distance_m: f64, bias_m: f64) -> Option<f64> {
        let range_m = distance_m + bias_m + self.scenario.range_sigma_m * normal(&mut self.rng);
        let heard = distance_m <= self.scenario.uwb_reach_m && self.rng.random_bool(HEARD);
        heard.then_some(range_m)
    }

    /// By the four anchors.
    fn uwb(&mut self, from_platform: &Vector3<f64>) -> Option<Measurement> {
        if self.scenario.uwb_by != UwbBy::Differences {
            return self.by_anchors(from_platform);
        }
        let biases = self.anchor_bias_m.into_iter();
        let anchors: Vec<_> = ANCHORS_M.into_iter().zip(biases).collect();
        let (rng, scenario) = (&mut self.rng, &self.scenario);
        by_differences(rng, scenario, &anchors, from_platform, HEARD, REPEATED)
    }

    fn by_anchors(&mut self, from_platform: &Vector3<f64>) -> Option<Measurement> {
        let sigma_m = self.scenario.range_sigma_m;
        let ranges: Vec<AnchorRange> = (ANCHORS_M.iter().zip(self.anchor_bias_m))
            .filter_map(|(&anchor, bias_m)| {
                let anchor_m = Vector3::from(anchor);
                let range_m = self.range_m((from_platform - anchor_m).norm(), bias_m)?;
                Some(AnchorRange {
                    anchor_m,
                    range_m,
                    sigma_m,
                })
            })
            .collect();
        let options = MultilaterationOptions {
            height: Height::Between {
                min_m: -0.5,
                max_m: 20.0,
            },
            ..MultilaterationOptions::default()
        };
        let found = locate(&ranges, &options).ok()?.found;
        // What biases do to a place is what noise of their size does.
        let bias = (self.scenario.anchor_bias_m / sigma_m).powi(2);
        Some(Measurement::Uwb {
            position_m: found.position_m,
            covariance_m2: found.covariance_m2 * (1.0 + REPEATED * bias),
        })
    }

    fn one(&mut self) -> f64 {
        normal(&mut self.rng)
    }

    fn noise(&mut self, sigma: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| sigma * normal(&mut self.rng))
    }
}
