//! One delivery.

use super::craft::Craft;
use super::lander::Lander;
use super::recording::{Begin, Event, InputRecord, measured};
use super::scenario::{FilterKind, Scenario, ScenarioFault, UwbBy};
use super::sensors::Sensors;
use nalgebra::Vector3;
use nova_solver::delivery::{
    Circling, LandingFilter, Measurement, Mission, Order, Pose, Sector, Situation, Spiral, State,
    Trouble, VectorField, Verdict,
};
use nova_solver::navigation::horizontal_sigma_m;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde::Serialize;

/// Ticks a second.
const TICK_S: f64 = 0.01;
/// A delivery takes no longer, seconds.
const LONGEST_S: f64 = 1200.0;
/// How long the holder takes to open, seconds.
const RELEASE_S: f64 = 2.0;
/// Wanted velocities change no faster, m/s^2.
const COMMAND_M_S2: f64 = 2.0;
/// Half of the platform (1 x 1 m), metres.
const PLATFORM_M: f64 = 0.5;

/// What one delivery came to.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DeliveryResult {
    /// Where it first came down at the goal, from the platform's centre, metres; `None` where it did not.
    pub touchdown_m: Option<[f64; 2]>,
    /// How far that is, metres.
    pub off_centre_m: Option<f64>,
    /// Whether that is on the platform.
    pub on_platform: bool,
    /// Distance between estimate and truth then, horizontally, metres.
    pub estimate_error_m: Option<f64>,
    /// Largest distance to the path after take-off and before the platform is first measured, by the estimate, metres.
    pub off_path_m: f64,
    /// The package was released.
    pub delivered: bool,
    /// How the mission ended.
    pub finished: bool,
    /// What went wrong on the way: when, what.
    pub troubles: Vec<String>,
    /// When it ended, seconds.
    pub end_s: f64,
    /// Measurements that the filter set aside.
    pub outliers: u64,
}

/// A moment of a flight, ten a second.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Sample {
    /// Time, seconds.
    pub t_s: f64,
    /// Truth, metres.
    pub true_m: [f64; 3],
    /// Estimate, metres.
    pub estimate_m: [f64; 3],
    /// The Lyapunov function at the estimate, square metres.
    pub lyapunov_m2: f64,
    /// Estimated GPS bias, metres.
    pub gps_bias_m: [f64; 3],
}

/// Flies one delivery; `watch` is shown all that the filter is told and says, and ten moments a second beside the truth.
///
/// # Errors
/// [`ScenarioFault`] where it cannot be flown.
pub fn deliver(
    scenario: &Scenario,
    seed: u64,
    mut watch: impl FnMut(&Event),
) -> Result<DeliveryResult, ScenarioFault> {
    let field = scenario.field()?;
    let mut sensors = Sensors::new(scenario, seed);
    let start = Craft::on_ground(
        field.path().start_m(),
        scenario.vehicle_kg + scenario.package_kg,
    );
    // The first word of GPS is where the filter begins.
    let first = (sensors.measure(0, 0.0, TICK_S, &start.pose()).iter())
        .find_map(|timed| match timed.measurement {
            Measurement::Autopilot {
                position_m,
                attitude,
            } => Some(Pose {
                position_m,
                attitude,
            }),
            _ => None,
        })
        .unwrap_or_else(|| start.pose());
    let begin = Begin::new(scenario.filter, &first, scenario.first_bias_sigma_m());
    let lander = begin.lander()?;
    watch(&Event::Begin(begin));
    let flight = Flight {
        scenario,
        field,
        circling: (scenario.uwb && scenario.uwb_by == UwbBy::SingleTag).then(Circling::default),
        sensors,
        craft: start,
        seed,
        watch,
    };
    Ok(flight.run(lander))
}

struct Flight<'a, W> {
    scenario: &'a Scenario,
    field: VectorField,
    circling: Option<Circling>,
    sensors: Sensors,
    craft: Craft,
    seed: u64,
    watch: W,
}

impl<W: FnMut(&Event)> Flight<'_, W> {
    fn run(mut self, mut filter: Lander) -> DeliveryResult {
        let times_are_known = self.scenario.filter == FilterKind::ErrorState;
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(10);
        let mut mission = Mission::new(self.scenario.mission_options(self.field.path()));
        let mut result = DeliveryResult {
            touchdown_m: None,
            off_centre_m: None,
            on_platform: false,
            estimate_error_m: None,
            off_path_m: 0.0,
            delivered: false,
            finished: false,
            troubles: Vec::new(),
            end_s: 0.0,
            outliers: 0,
        };
        let (mut gps_s, mut local_s) = (0.0, f64::NEG_INFINITY);
        let mut commanded = Vector3::zeros();
        let mut release_begin_s: Option<f64> = None;
        let mut search_begin: Option<(f64, Vector3<f64>)> = None;
        for tick in 1..(LONGEST_S / TICK_S) as u32 {
            let t_s = f64::from(tick) * TICK_S;
            result.end_s = t_s;
            // What is measured.
            let truth = self.craft.pose();
            for timed in self.sensors.measure(tick, t_s, TICK_S, &truth) {
                let taken_s = if times_are_known { timed.taken_s } else { t_s };
                let event = measured(t_s, taken_s, &timed.measurement);
                (self.watch)(&event);
                match (take(&mut filter, &event), timed.measurement) {
                    (Verdict::Outlier, _) => result.outliers += 1,
                    (Verdict::Used, Measurement::Autopilot { .. }) => gps_s = t_s,
                    (Verdict::Used, _) => local_s = t_s,
                    (Verdict::Unusable, _) => {}
                }
            }
            let place_m = filter.filter().pose().position_m;
            let path = self.field.path();
            let released = release_begin_s.is_some_and(|begin_s| t_s - begin_s >= RELEASE_S);
            let order = mission.step(&Situation {
                t_s,
                along_m: path.along_m(&place_m),
                height_m: place_m.z,
                sigma_m: horizontal_sigma_m(&filter.filter().position_covariance_m2()),
                off_path_m: path.distance_m(&place_m),
                gps_age_s: t_s - gps_s,
                local_age_s: t_s - local_s,
                battery: 1.0 - self.scenario.battery_per_minute * t_s / 60.0,
                on_ground: self.craft.is_on_ground(),
                released,
            });
            if local_s == f64::NEG_INFINITY && t_s > 5.0 {
                result.off_path_m = result.off_path_m.max(path.distance_m(&place_m));
            }
            if order != Order::Search {
                search_begin = None;
            }
            // What is done.
            let wanted = match order {
                Order::FollowToGoal => self.to_goal_m_s(t_s, &place_m),
                Order::FollowToStart => self.field.velocity_m_s(&place_m, false),
                Order::Search => {
                    let (since_s, centre_m) = *search_begin.get_or_insert((t_s, place_m));
                    Spiral::default().velocity_m_s(t_s - since_s, &centre_m, &place_m)
                }
                Order::Climb => Vector3::new(0.0, 0.0, 1.0),
                Order::Hold | Order::Release => Vector3::zeros(),
                Order::Stop | Order::HandOver => break,
            };
            if order == Order::Release && release_begin_s.is_none() {
                release_begin_s = Some(t_s);
                self.note_touchdown(&place_m, &mut result);
            }
            if released && !result.delivered {
                result.delivered = true;
                self.craft.mass_kg = self.scenario.vehicle_kg;
                if !self.scenario.return_trip {
                    break;
                }
            }
            let change: Vector3<f64> = wanted - commanded;
            commanded += change.cap_magnitude(COMMAND_M_S2 * TICK_S);
            // updateMass() of Algorithm 1.
            let believed_kg = self.scenario.vehicle_kg
                + if result.delivered {
                    0.0
                } else {
                    self.scenario.package_kg
                };
            let on_the_ground = order == Order::Release;
            if !on_the_ground {
                let offset = self.sensors.velocity_offset_m_s();
                let gust = self.scenario.gust_m_s2;
                self.craft
                    .step(commanded, offset, believed_kg, gust, TICK_S, &mut rng);
            } else {
                commanded = Vector3::zeros();
                self.craft.velocity_m_s = Vector3::zeros();
            }
            let input = self.sensors.input(
                f64::from(tick + 1) * TICK_S,
                &truth,
                &self.craft.pose(),
                TICK_S,
            );
            let event = Event::Input(InputRecord {
                t_s,
                velocity_m_s: input.velocity_m_s.into(),
                rate_rad_s: input.rate_rad_s.into(),
            });
            (self.watch)(&event);
            take(&mut filter, &event);
            (self.watch)(&Event::Estimate(filter.estimate(t_s)));
            if tick.is_multiple_of(10) {
                let estimate = filter.filter().pose().position_m;
                (self.watch)(&Event::Sample(Sample {
                    t_s,
                    true_m: self.craft.position_m.into(),
                    estimate_m: estimate.into(),
                    lyapunov_m2: path.lyapunov_m2(&estimate),
                    gps_bias_m: filter.filter().gps_bias_m().into(),
                }));
            }
        }
        result.finished =
            mission.state() == State::Finished || (result.delivered && !self.scenario.return_trip);
        result.troubles = (mission.troubles().iter())
            .map(|(t_s, what)| format!("{t_s:.1} s: {}", name(*what)))
            .collect();
        result
    }

    /// Along the path; on the way down to a single tag in circles about it.
    fn to_goal_m_s(&self, t_s: f64, place_m: &Vector3<f64>) -> Vector3<f64> {
        let path = self.field.path();
        match &self.circling {
            Some(circling) if path.sector(place_m) == Sector::Descent => {
                circling.velocity_m_s(&self.field, t_s, place_m)
            }
            _ => self.field.velocity_m_s(place_m, true),
        }
    }

    fn note_touchdown(&self, place_m: &Vector3<f64>, result: &mut DeliveryResult) {
        let [x, y] = self.scenario.platform_off_m;
        let truth = self.craft.position_m;
        let off = [truth.x - x, truth.y - y];
        result.touchdown_m = Some(off);
        result.off_centre_m = Some(off[0].hypot(off[1]));
        result.on_platform = off.iter().all(|off| off.abs() <= PLATFORM_M);
        // The estimate counts from the platform once it has been measured, else from where it was said to be.
        let error = |a: f64, b: f64| (place_m.x - a).hypot(place_m.y - b);
        let from_platform = error(off[0], off[1]);
        let heard = self.scenario.uwb || self.scenario.large_marker || self.scenario.small_marker;
        result.estimate_error_m = Some(if heard {
            from_platform
        } else {
            error(truth.x, truth.y)
        });
    }
}

/// What cannot be taken has no use, as what the filter cannot compute with.
fn take(filter: &mut Lander, event: &Event) -> Verdict {
    filter.take(event).unwrap_or(Verdict::Unusable)
}

fn name(trouble: Trouble) -> &'static str {
    match trouble {
        Trouble::NoPlace => "nothing tells the place",
        Trouble::NotFound => "nothing that marks the goal is seen or heard",
        Trouble::Unsure => "the place is not sure enough to land",
        Trouble::TooManyTries => "too many landings were not sure",
        Trouble::LowBattery => "the battery does not suffice for both ways",
        Trouble::EmptyBattery => "the battery is empty",
        Trouble::Fence => "outside the fence",
    }
}
