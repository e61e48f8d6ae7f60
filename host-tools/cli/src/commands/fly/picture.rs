//! A flight as it is shown: seen from above and from the side, moment by moment.

use crate::chart::half_axes_95;
use nalgebra::{Matrix2, Matrix2x3, Matrix3, Vector2, Vector3};
use nova_flight::Recording;
use nova_solver::navigation::{Action, Estimate, Phase};

/// A place seen from above and from the side.
#[derive(Clone, Copy)]
pub(super) struct Seen {
    /// East, north, metres.
    pub(super) above: (f64, f64),
    /// Along the line from start to tag, and up from the tag, metres.
    pub(super) side: (f64, f64),
}

/// What is believed at some time.
pub(super) struct Belief {
    pub(super) t_s: f64,
    /// Where the tag is, seen from where the vehicle truly was.
    pub(super) tag: Seen,
    /// Its covariance relative to the vehicle, in both views.
    pub(super) covariance: Option<[Matrix2<f64>; 2]>,
}

/// The vehicle at some time.
pub(super) struct Moment {
    pub(super) t_s: f64,
    pub(super) vehicle: Seen,
    /// Horizontal error of the tag's place relative to the vehicle, metres, from the first estimate on.
    pub(super) error_m: Option<f64>,
    /// Longer half-axis of the 95 % ellipse, metres.
    pub(super) claimed_m: Option<f64>,
}

/// An order to the autopilot.
pub(super) struct Order {
    pub(super) t_s: f64,
    pub(super) waypoint: Seen,
    pub(super) action: &'static str,
    /// In force long enough to be called a leg of the flight.
    pub(super) leg: bool,
}

/// The whole flight.
pub(super) struct Picture {
    pub(super) end_s: f64,
    pub(super) start: Seen,
    pub(super) tag: Seen,
    pub(super) first_guess: Seen,
    pub(super) moments: Vec<Moment>,
    /// Where dead reckoning had the vehicle.
    pub(super) reckoned: Vec<Seen>,
    pub(super) beliefs: Vec<Belief>,
    pub(super) orders: Vec<Order>,
    /// Beginnings of the flight's parts.
    pub(super) phases: Vec<(f64, &'static str)>,
}

/// A waypoint that is replaced sooner is a direction, not a leg.
const LEG_S: f64 = 1.5;

impl Picture {
    /// What was recorded.
    pub(super) fn new(recording: &Recording) -> Self {
        let view = View::new(recording);
        let latest = |t_s: f64| {
            let after = recording
                .estimates
                .partition_point(|(at_s, _)| *at_s <= t_s);
            after
                .checked_sub(1)
                .and_then(|i| recording.estimates.get(i))
        };
        let moments = (recording.truth.iter())
            .map(|&(t_s, position_m)| {
                let estimate = latest(t_s).map(|(_, estimate)| estimate);
                Moment {
                    t_s,
                    vehicle: view.of(position_m),
                    error_m: estimate.map(|e| recording.relative_error_m(e, t_s).norm()),
                    claimed_m: estimate.and_then(claimed_m),
                }
            })
            .collect();
        Self {
            end_s: recording.end_s(),
            start: view.of(recording.scene.start_m),
            tag: view.of(recording.scene.tag_m),
            first_guess: view.of(recording.scene.first_guess.tag_m),
            moments,
            reckoned: (recording.ins.iter())
                .map(|sample| view.of(sample.position_m))
                .collect(),
            beliefs: (recording.estimates.iter())
                .map(|(t_s, estimate)| view.belief(*t_s, estimate, recording))
                .collect(),
            orders: orders(recording, &view),
            phases: (recording.phases.iter())
                .map(|&(t_s, phase)| (t_s, name(phase)))
                .collect(),
        }
    }
}

fn claimed_m(estimate: &Estimate) -> Option<f64> {
    let covariance = horizontal(&estimate.relative_covariance_m2?);
    let ([longer, _], _) = half_axes_95(&covariance);
    Some(longer)
}

fn horizontal(covariance: &Matrix3<f64>) -> Matrix2<f64> {
    covariance.fixed_view::<2, 2>(0, 0).into_owned()
}

fn orders(recording: &Recording, view: &View) -> Vec<Order> {
    let ends = (recording.commands.iter().skip(1))
        .map(|(t_s, command)| (*t_s, Some(command.id)))
        .chain([(recording.end_s(), None)]);
    let mut orders: Vec<Order> = Vec::new();
    let mut since: Option<(u32, f64)> = None;
    for ((t_s, command), (end_s, next)) in recording.commands.iter().zip(ends) {
        // A command whose estimate of the INS error changes keeps its number.
        let (_, begun_s) = *since.get_or_insert((command.id, *t_s));
        let done = next != Some(command.id);
        orders.push(Order {
            t_s: *t_s,
            waypoint: view.of(command.waypoint_m),
            action: match command.action {
                Action::Hold => "hold",
                Action::Fly => "fly",
                Action::Land => "land",
            },
            leg: done && end_s - begun_s >= LEG_S && command.action != Action::Hold,
        });
        if done {
            since = None;
        }
    }
    orders
}

fn name(phase: Phase) -> &'static str {
    match phase {
        Phase::Initial => "initial",
        Phase::MidFlight => "mid-flight",
        Phase::Final => "final",
        Phase::Landing => "landing",
    }
}

/// How places are projected.
struct View {
    start_m: Vector3<f64>,
    ground_m: f64,
    /// From start to tag, horizontal, length 1.
    ahead: Vector2<f64>,
}

impl View {
    fn new(recording: &Recording) -> Self {
        let scene = &recording.scene;
        let ahead = (scene.tag_m - scene.start_m).xy();
        Self {
            start_m: scene.start_m,
            ground_m: scene.tag_m.z,
            ahead: ahead.try_normalize(1e-9).unwrap_or_else(Vector2::x),
        }
    }

    fn of(&self, place_m: Vector3<f64>) -> Seen {
        let along_m = (place_m - self.start_m).xy().dot(&self.ahead);
        Seen {
            above: (place_m.x, place_m.y),
            side: (along_m, place_m.z - self.ground_m),
        }
    }

    /// Where the vehicle would go from where it truly is: errors that tag and vehicle share do not
    /// matter to it, and the covariance leaves them out as well.
    fn belief(&self, t_s: f64, estimate: &Estimate, recording: &Recording) -> Belief {
        let vehicle_m = recording.true_position_m(estimate.t_s);
        Belief {
            t_s,
            tag: self.of(vehicle_m + estimate.tag_m - estimate.vehicle_m),
            covariance: estimate.relative_covariance_m2.map(|covariance| {
                let across = Matrix2x3::new(
                    self.ahead.x,
                    self.ahead.y,
                    0.0, //
                    0.0,
                    0.0,
                    1.0,
                );
                [
                    horizontal(&covariance),
                    across * covariance * across.transpose(),
                ]
            }),
        }
    }
}
