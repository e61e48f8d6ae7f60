//! The phases of a flight (paper Fig. 6).
//!
//! ```text
//!  Initial      Waiting ──► Down ──► Across ─┐          first INS reading; z_init; D_init
//!                  │(no initial flight)      │coarse fix
//!  Mid-flight      └──────► Approach ◄───────┘
//!                           │ ▲ │ └──┐ at each waypoint: localise, plan the next
//!                           │ └─│────┘
//!           D_2D < D_2D^thr │   │(no final descent)
//!  Final        FirstDescent│   │
//!                     Lateral   │
//!               SecondDescent   │                       circles meet, candidate chosen
//!  Landing            Deliver ◄─┘                       level, to over the tag
//!                     Landing
//! ```
//!
//! Left open by the paper, and taken so:
//! - Moves across the line of sight, `D_init` and `d_lat`, go to the left.
//! - The second descent ends [`CLEARANCE_M`] over the tag, not at half the height, so that the
//!   vehicle can still fly to the candidate that was chosen.
//! - The circles are about the places where the vehicle was told to go down. Their candidates have
//!   the height that the second descent gives the tag.
//! - Where the descents cannot be made or tell nothing, the mid-flight estimate stands.
//! - An approach that has flown [`DETOUR`] times the first distance ends there, however far the tag
//!   seems.

use nalgebra::{Vector2, Vector3};

use super::circles::{Meeting, meet};
use super::descent::Descent;
use super::localiser::Localiser;
use super::options::NovaOptions;
use super::segment::{Segment, SegmentRecorder};
use super::variants::Stride;
use crate::dop::Dop;
use crate::measurement::LARGEST_LENGTH_M;
use crate::navigation::{
    Action, Command, Doubts, Estimate, FirstGuess, InputFault, InputGate, InsError, InsSample,
    Navigator, Phase, RangeSample,
};

/// Height over the tag, as measured by the first descent, at which the second one ends, metres. Of
/// the order of that measurement's error.
const CLEARANCE_M: f64 = 1.0;
/// A descent over less than this is not made, metres: its thirds would not differ.
const LEAST_DESCENT_M: f64 = 1.0;
/// Longest approach, in first distances to the tag (and of a few metres more). With `lambda` at 0.3 a
/// flight takes three.
const DETOUR: f64 = 10.0;
/// Shorter legs count as this long, metres: an approach must end even if it stays in place, and soon.
const SHORTEST_LEG_M: f64 = 5.0;
/// A leg that takes this many times as long as it should, and [`OVERDUE_S`], has been flown: news of
/// the arrival was lost, or errors keep the vehicle from ever coming near enough.
const OVERDUE_FACTOR: f64 = 2.0;
/// Grace for a leg of any length, seconds.
const OVERDUE_S: f64 = 10.0;
/// Geometry that magnifies range noise by more than this is weak.
const WEAK_HDOP: f64 = 10.0;
/// A candidate whose loss is at most this many times that of the chosen one is a serious rival.
const RIVAL: f64 = 2.0;

/// NOVA as the paper has it, or one of its ablation variants.
#[derive(Debug, Clone)]
pub struct NovaNavigator {
    options: NovaOptions,
    localiser: Localiser,
    gate: InputGate,
    leg: Leg,
    recorder: Option<SegmentRecorder>,
    overdue_s: f64,
    command: Command,
    segments: Vec<Segment>,
    /// `P_UAV`: waypoints that were reached.
    history_m: Vec<Vector3<f64>>,
    tag_m: Vector3<f64>,
    alternative_m: Option<Vector3<f64>>,
    doubts: Doubts,
    /// What is left of the longest approach, metres; `None` before it begins.
    left_m: Option<f64>,
    /// The first descent: its place, and what it told.
    first_descent: Option<(Vector2<f64>, Descent)>,
}

/// What the vehicle is doing; see the module's diagram.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Leg {
    Waiting,
    Down,
    Across,
    Approach,
    FirstDescent,
    Lateral,
    SecondDescent,
    Deliver,
    Landing,
}

impl NovaNavigator {
    /// For a flight that begins with the first reading of dead reckoning.
    pub fn new(first_guess: FirstGuess, options: NovaOptions) -> Self {
        Self {
            localiser: Localiser::new(&options),
            options,
            gate: InputGate::default(),
            leg: Leg::Waiting,
            recorder: None,
            overdue_s: f64::INFINITY,
            command: Command {
                id: 0,
                action: Action::Hold,
                waypoint_m: Vector3::zeros(),
                ins_error: InsError::none(),
            },
            segments: Vec::new(),
            history_m: Vec::new(),
            tag_m: first_guess.tag_m,
            alternative_m: None,
            doubts: Doubts {
                weak_geometry: true,
                ..Doubts::default()
            },
            left_m: None,
            first_descent: None,
        }
    }

    /// Legs flown so far, for those who want to look into the method.
    pub fn segments(&self) -> &[Segment] {
        &self.segments
    }

    fn begin(&mut self, first: InsSample) {
        if !self.tag_m.iter().all(|c| c.abs() <= LARGEST_LENGTH_M) {
            // Not a guess. Right here is as good as any place.
            self.tag_m = first.position_m;
        }
        self.history_m.push(first.position_m);
        if self.options.switches.initial_flight {
            let drop_m = self.options.parameters.init_descent_m;
            self.fly(Leg::Down, first.position_m - Vector3::z() * drop_m, first);
        } else {
            self.approach(first);
        }
    }

    /// The present leg's waypoint has been reached.
    fn arrive(&mut self) {
        let Some((segment, last)) = self.close_leg() else {
            return;
        };
        self.segments.push(segment);
        match self.leg {
            Leg::Waiting | Leg::Landing => {}
            Leg::Down => {
                let to_m = self.beside(self.options.parameters.init_distance_m);
                self.fly(Leg::Across, to_m, last);
            }
            Leg::Across => {
                self.tag_m = self.localiser.coarse(&self.segments, self.tag_m);
                self.approach(last);
            }
            Leg::Approach => {
                self.tag_m = self.localiser.refine(&self.segments, self.tag_m);
                self.approach(last);
            }
            Leg::FirstDescent => {
                self.first_descent = self.descended();
                self.fly(
                    Leg::Lateral,
                    self.beside(self.options.parameters.lateral_m),
                    last,
                );
            }
            Leg::Lateral => self.descend_again(last),
            Leg::SecondDescent => {
                if let (Some(first), Some(second)) = (self.first_descent, self.descended()) {
                    self.choose(first, second);
                }
                self.deliver(last);
            }
            Leg::Deliver => {
                self.leg = Leg::Landing;
                self.order(Action::Land, self.tag_m);
            }
        }
    }

    /// Ends the recording of the leg and takes note of where the vehicle is.
    fn close_leg(&mut self) -> Option<(Segment, InsSample)> {
        let recorder = self.recorder.take()?;
        let last = recorder.last_ins()?;
        self.overdue_s = f64::INFINITY;
        let segment = recorder.finish();
        let place_m = segment.goal_m();
        self.history_m.push(place_m);
        // The corrected trajectory goes on from the waypoint. Its heights are the barometer's too.
        let mut error_m = last.position_m - place_m;
        error_m.z = 0.0;
        self.command.ins_error = InsError {
            t_s: last.t_s,
            position_m: error_m,
            velocity_m_s: Vector3::zeros(),
        };
        Some((segment, last))
    }

    /// Plans the next leg of the approach, or its end.
    fn approach(&mut self, last: InsSample) {
        let hdop = Dop::of(&self.history_m, self.tag_m).map(|dop| dop.hdop);
        self.doubts.weak_geometry = hdop.is_none_or(|hdop| hdop > WEAK_HDOP);
        let distance_m = self.offset_m().norm();
        let longest_m = DETOUR * (distance_m + self.options.parameters.init_distance_m);
        let left_m = *self.left_m.get_or_insert(longest_m);
        if distance_m < self.options.parameters.descend_within_m || left_m <= 0.0 {
            if self.options.switches.final_descent {
                self.descend(last);
            } else {
                self.deliver(last);
            }
            return;
        }
        let next_m = self.next_waypoint_m();
        let length_m = (next_m - self.here_m()).norm();
        self.left_m = Some(left_m - length_m.max(SHORTEST_LEG_M));
        self.fly(Leg::Approach, next_m, last);
    }

    fn next_waypoint_m(&self) -> Vector3<f64> {
        let here_m = self.here_m();
        if self.options.switches.trajectory_planning {
            let planner = self.options.planner();
            return planner
                .next_waypoint(&self.history_m, here_m, self.tag_m)
                .position_m;
        }
        let offset_m = self.offset_m();
        let step_m = match self.options.switches.stride {
            Stride::Fixed(length_m) => offset_m.cap_magnitude(length_m),
            Stride::HalfDistance => 0.5 * offset_m,
        };
        here_m + step_m.push(0.0)
    }

    /// First of the two descents: half the height over the tag.
    fn descend(&mut self, last: InsSample) {
        let here_m = self.here_m();
        let drop_m = 0.5 * (here_m.z - self.tag_m.z);
        if drop_m < LEAST_DESCENT_M {
            self.deliver(last);
        } else {
            self.fly(Leg::FirstDescent, here_m - Vector3::z() * drop_m, last);
        }
    }

    fn descend_again(&mut self, last: InsSample) {
        let mut to_m = self.here_m();
        let tag_height_m = self
            .first_descent
            .map_or(self.tag_m.z, |(_, descent)| descent.tag_height_m);
        to_m.z = tag_height_m + CLEARANCE_M;
        if self.here_m().z - to_m.z < LEAST_DESCENT_M {
            self.deliver(last);
        } else {
            self.fly(Leg::SecondDescent, to_m, last);
        }
    }

    /// The leg just flown as a descent.
    fn descended(&self) -> Option<(Vector2<f64>, Descent)> {
        let leg = self.segments.last()?;
        Some((leg.goal_m().xy(), Descent::of(leg)?))
    }

    /// The tag from both descents.
    fn choose(&mut self, first: (Vector2<f64>, Descent), second: (Vector2<f64>, Descent)) {
        let height_m = second.1.tag_height_m;
        let radii_m = [first.1.distance_m, second.1.distance_m];
        match meet([first.0, second.0], radii_m) {
            Meeting::Nowhere => {}
            Meeting::Nearly(place) => self.tag_m = place.push(height_m),
            Meeting::Twice(places) => {
                let candidates_m = places.map(|place| place.push(height_m));
                let [(tag_m, loss), (other_m, others)] =
                    self.localiser
                        .rank(&self.segments, self.tag_m, candidates_m);
                self.tag_m = tag_m;
                self.alternative_m = Some(other_m);
                self.doubts.ambiguous = others <= RIVAL * loss;
            }
        }
    }

    fn deliver(&mut self, last: InsSample) {
        let to_m = self.here_m() + self.offset_m().push(0.0);
        self.fly(Leg::Deliver, to_m, last);
    }

    fn fly(&mut self, leg: Leg, to_m: Vector3<f64>, from: InsSample) {
        let (here_m, parameters) = (self.here_m(), &self.options.parameters);
        let due_s = (to_m - here_m).norm() / parameters.speed_m_s;
        self.overdue_s = from.t_s + OVERDUE_FACTOR * due_s + OVERDUE_S;
        self.recorder = Some(SegmentRecorder::new(here_m, to_m, from, parameters));
        self.leg = leg;
        self.order(Action::Fly, to_m);
    }

    fn order(&mut self, action: Action, waypoint_m: Vector3<f64>) {
        self.command.id += 1;
        self.command.action = action;
        self.command.waypoint_m = waypoint_m;
    }

    /// Where the vehicle is: at the waypoint it reached last.
    fn here_m(&self) -> Vector3<f64> {
        self.history_m.last().copied().unwrap_or_default()
    }

    /// Horizontal way to the tag.
    fn offset_m(&self) -> Vector2<f64> {
        (self.tag_m - self.here_m()).xy()
    }

    /// The place so far to the left of the line of sight. Right over the tag any direction does.
    fn beside(&self, distance_m: f64) -> Vector3<f64> {
        let sight = self.offset_m().try_normalize(1e-6);
        let sight = sight.unwrap_or_else(Vector2::x);
        self.here_m() + Vector3::new(-sight.y, sight.x, 0.0) * distance_m
    }
}

impl Navigator for NovaNavigator {
    fn on_ins(&mut self, sample: InsSample) -> Result<(), InputFault> {
        self.gate.admit_ins(sample)?;
        if let Some(recorder) = &mut self.recorder {
            recorder.push_ins(sample);
        } else if self.leg == Leg::Waiting {
            self.begin(sample);
        }
        if sample.t_s > self.overdue_s {
            self.arrive();
        }
        Ok(())
    }

    fn on_range(&mut self, sample: RangeSample) -> Result<(), InputFault> {
        self.gate.admit_range(sample)?;
        if let Some(recorder) = &mut self.recorder {
            recorder.push_range(sample);
        }
        Ok(())
    }

    fn on_arrival(&mut self, command_id: u32) {
        if command_id == self.command.id {
            self.arrive();
        }
    }

    fn command(&self) -> Command {
        self.command
    }

    fn estimate(&self) -> Option<Estimate> {
        let last = self.gate.last_ins()?;
        let seen = self.gate.doubts();
        Some(Estimate {
            t_s: last.t_s,
            tag_m: self.tag_m,
            vehicle_m: last.position_m - self.command.ins_error.at(last.t_s),
            relative_covariance_m2: None,
            alternative_m: self.alternative_m,
            range_bias_m: None,
            range_sigma_m: None,
            doubts: Doubts {
                gap: seen.gap,
                frozen_ins: seen.frozen_ins,
                ..self.doubts
            },
        })
    }

    fn phase(&self) -> Phase {
        match self.leg {
            Leg::Waiting | Leg::Down | Leg::Across => Phase::Initial,
            Leg::Approach => Phase::MidFlight,
            Leg::FirstDescent | Leg::Lateral | Leg::SecondDescent => Phase::Final,
            Leg::Deliver | Leg::Landing => Phase::Landing,
        }
    }

    fn updates(&self) -> u64 {
        self.localiser.updates()
    }
}
