//! A flight whose ranges are measured by simulated boards: the firmware's node on the vehicle and on
//! the tag, the air between them, records over the serial port. The navigator steers by them in
//! closed loop. What it gets is what the flight simulator's formula for ranges gives.
#![allow(clippy::unwrap_used)]

use nalgebra::Vector3;
use nova_flight::{
    FlightResult, Method, Pilot, RangeSource, Recording, Settings, Trial, UwbLink, fly_with,
};
use nova_hal_sim::{BoardConfig, ClockConfig, Motion, SimConfig};
use nova_node::ranging::Address;
use nova_node::{NodeConfig, Part};
use nova_tests::Network;
use std::cell::RefCell;
use std::rc::Rc;
use std::sync::LazyLock;

/// What the noise of the three receive time stamps of an exchange makes of the range, for equal
/// reply times: `c s sqrt(1 + 4 + 1) / 4`.
const METRES_PER_PS: f64 = 299_702_547.0 * 1e-12 * 0.612;
/// Noise of a range in either model, metres.
const SIGMA_M: f64 = 0.02;
/// Between two ranges, seconds.
const PERIOD_S: f64 = 0.1;
/// How long the boards run before the flight, to start up and settle into their rhythm, seconds.
const WARM_UP_S: f64 = 1.0;
/// From the time for which a range is asked to the time at which it is measured, seconds.
const LEAD_S: f64 = 0.001;
/// From there until the record has arrived at the host, at most, seconds.
const ANSWER_S: f64 = 0.02;

/// Where the vehicle is, as far as it is known: in between and a little ahead, by its last velocity.
#[derive(Default)]
struct Track {
    /// Time, position, velocity.
    points: Vec<(f64, Vector3<f64>, Vector3<f64>)>,
}

impl Track {
    fn extend(&mut self, t_s: f64, position_m: Vector3<f64>) {
        let velocity = self
            .points
            .last()
            .map_or_else(Vector3::zeros, |&(before_s, before_m, _)| {
                (position_m - before_m) / (t_s - before_s)
            });
        self.points.push((t_s, position_m, velocity));
    }

    fn at(&self, t_s: f64) -> Vector3<f64> {
        let known = self.points.partition_point(|&(from_s, _, _)| from_s <= t_s);
        match known.checked_sub(1).map(|last| self.points[last]) {
            Some((from_s, position_m, velocity)) => position_m + velocity * (t_s - from_s),
            None => self
                .points
                .first()
                .map_or_else(Vector3::zeros, |&(_, first_m, _)| first_m),
        }
    }
}

/// Two boards, one of which moves with the vehicle.
struct Boards {
    network: Network,
    vehicle: usize,
    track: Rc<RefCell<Track>>,
    /// The boards' time, seconds, when the flight's is zero.
    origin_s: f64,
    /// Ranges of the vehicle's board that have been looked at.
    seen: usize,
}

impl Boards {
    fn new(seed: u64, start_m: Vector3<f64>, tag_m: Vector3<f64>) -> Self {
        let mut network = Network::new(SimConfig {
            seed,
            ..SimConfig::default()
        });
        let track = Rc::new(RefCell::new(Track::default()));
        track.borrow_mut().extend(0.0, start_m);
        let path = Rc::clone(&track);
        let board = |name: &str, ppm, motion| BoardConfig {
            name: name.to_owned(),
            clock: ClockConfig {
                ppm,
                ..ClockConfig::default()
            },
            motion,
            rx_noise_ps: SIGMA_M / METRES_PER_PS,
            ..BoardConfig::default()
        };
        let moving = Motion::path(move |t_s| path.borrow().at(t_s).into());
        let mut initiator = NodeConfig::anchor(Address(1));
        initiator.part = Part::Initiator {
            period_us: (PERIOD_S * 1e6) as u32,
            per_round: 1,
            peers: [Address(2)].into_iter().collect(),
            sharing: nova_node::Sharing::Elect,
            sleep: false,
        };
        let vehicle = network
            .add(board("vehicle", 3.0, moving), initiator)
            .unwrap();
        let tag = board("tag", -2.0, Motion::fixed(tag_m.into()));
        network.add(tag, NodeConfig::tag(Address(2))).unwrap();
        network.run_until_s(WARM_UP_S).unwrap();

        let ranges = &network.log(vehicle).unwrap().ranges;
        let last_s = measured_s(ranges.last().unwrap().t_us);
        Self {
            origin_s: last_s + PERIOD_S - LEAD_S,
            seen: ranges.len(),
            network,
            vehicle,
            track,
        }
    }
}

/// The simulation's time, seconds, of a board's time in microseconds.
fn measured_s(t_us: u64) -> f64 {
    BoardConfig::default().boot_delay.as_s_f64() + t_us as f64 * 1e-6
}

impl RangeSource for Boards {
    fn range(&mut self, t_s: f64, vehicle_m: Vector3<f64>, _tag_m: Vector3<f64>) -> Option<f64> {
        let now_s = self.origin_s + t_s;
        // Every answer asked for earlier was in before this: the past stays as it was.
        self.track.borrow_mut().extend(now_s, vehicle_m);
        self.network.run_until_s(now_s + ANSWER_S).unwrap();
        let ranges = &self.network.log(self.vehicle).unwrap().ranges;
        let fresh = &ranges[self.seen..];
        self.seen = ranges.len();
        let timely = |t_us| (0.0..2.0 * LEAD_S).contains(&(measured_s(t_us) - now_s));
        let range = fresh.iter().find(|range| timely(range.t_us))?;
        Some(f64::from(range.raw_m))
    }
}

fn trial() -> Trial {
    Trial {
        method: Method::Map,
        settings: Settings {
            pilot: Pilot::SelfNav,
            uwb_floor_m: SIGMA_M,
            uwb_reference_m: 0.0,
            ..Settings::default()
        },
        seed: 2026,
    }
}

/// Errors of the ranges that a flight has seen, metres.
fn errors_m(recording: &Recording) -> Vec<f64> {
    let error = |range: &nova_solver::navigation::RangeSample| {
        let apart = recording.true_position_m(range.t_s) - recording.scene.tag_m;
        range.range_m - apart.norm()
    };
    recording.ranges.iter().map(error).collect()
}

fn mean_and_std(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean, variance.sqrt())
}

/// Flights that more than one test looks at.
static THROUGH_BOARDS: LazyLock<(FlightResult, Recording)> = LazyLock::new(fly_through_boards);
static BY_FORMULA: LazyLock<(FlightResult, Recording)> = LazyLock::new(fly_by_formula);

fn fly_through_boards() -> (FlightResult, Recording) {
    let trial = trial();
    let scene = nova_flight::Scene::new(&trial.settings, trial.seed);
    let mut boards = Boards::new(trial.seed, scene.start_m, scene.tag_m);
    fly_with(&trial, &mut boards)
}

fn fly_by_formula() -> (FlightResult, Recording) {
    let trial = trial();
    fly_with(&trial, &mut UwbLink::new(&trial.settings, trial.seed))
}

#[test]
fn ranges_of_boards_in_flight_scatter_about_the_true_distance_as_the_formula_says() {
    for (name, (result, recording), systematic_m) in [
        // Half a millimetre by clocks that are fast together, one by what is flown until the
        // response.
        ("boards", &*THROUGH_BOARDS, 0.002),
        ("formula", &*BY_FORMULA, 0.0),
    ] {
        let errors = errors_m(recording);
        let n = errors.len() as f64;
        let (mean, std) = mean_and_std(&errors);
        println!(
            "{name}: {n} ranges, mean error {:+.2} mm, std {:.2} mm, landed {:.3} m beside the tag",
            1e3 * mean,
            1e3 * std,
            result.error_m
        );
        assert!(
            recording.ranges.len() == recording.ins.len(),
            "{name}: none lost, all in time"
        );
        assert!(
            mean.abs() < 4.0 * SIGMA_M / n.sqrt() + systematic_m,
            "{name}: mean {mean}"
        );
        // 2 % for time stamps in whole ticks and reply times that are not quite equal.
        assert!(
            (std / SIGMA_M - 1.0).abs() < 4.0 / (2.0 * n).sqrt() + 0.02,
            "{name}: {std}"
        );
    }
}

#[test]
fn a_navigator_lands_by_the_ranges_of_boards_as_well_as_by_the_formula() {
    for (result, recording) in [&*THROUGH_BOARDS, &*BY_FORMULA] {
        assert!(result.landed);
        assert_eq!(recording.refused, 0);
        // A Rayleigh-distributed error exceeds three times its mean once in 1200 flights.
        let bound_m = result.bound_m.unwrap();
        assert!(
            result.error_m < 3.0 * 2.2 * bound_m,
            "{} m, bound {bound_m} m",
            result.error_m
        );
    }
}

#[test]
fn a_flight_through_boards_is_the_same_every_time() {
    let (once, again) = (&THROUGH_BOARDS.1, fly_through_boards().1);
    assert_eq!(once.ranges, again.ranges);
    assert_eq!(once.truth, again.truth);
}
