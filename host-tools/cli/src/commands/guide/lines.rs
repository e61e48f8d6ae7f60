//! What `nova guide` says: one JSON object a line.

use crate::peer::Peer;
use nalgebra::{Matrix3, Vector3};
use nova_solver::navigation::{Action, Command, Doubts, Estimate, Phase};
use serde::Serialize;

/// News of one navigator.
#[derive(Serialize)]
pub(crate) struct News<'a> {
    pub(crate) t_s: f64,
    pub(crate) peer: &'a Peer,
    pub(crate) phase: &'static str,
    pub(crate) estimate: Option<Believed>,
    pub(crate) command: Ordered,
}

/// The last word on one node.
#[derive(Serialize)]
pub(crate) struct Summary {
    pub(crate) peer: Peer,
    /// Ranges that the navigator took.
    pub(crate) ranges: u64,
    /// Ranges that it refused: not finite, or time went back.
    pub(crate) refused: u64,
    /// Ranges that dead reckoning does not reach.
    pub(crate) unpaired: u64,
    pub(crate) estimate: Option<Believed>,
}

/// An [`Estimate`] in JSON.
#[derive(Serialize)]
pub(crate) struct Believed {
    pub(crate) t_s: f64,
    pub(crate) tag_m: [f64; 3],
    pub(crate) vehicle_m: [f64; 3],
    /// Of the tag relative to the vehicle.
    pub(crate) covariance_m2: Option<[[f64; 3]; 3]>,
    /// Of the tag relative to the vehicle.
    pub(crate) sigma_m: Option<[f64; 3]>,
    pub(crate) alternative_m: Option<[f64; 3]>,
    pub(crate) range_bias_m: Option<f64>,
    pub(crate) range_sigma_m: Option<f64>,
    pub(crate) doubts: Vec<&'static str>,
}

/// A [`Command`] in JSON.
#[derive(Clone, Copy, Serialize)]
pub(crate) struct Ordered {
    id: u32,
    action: &'static str,
    waypoint_m: [f64; 3],
    ins_error: InsErrorLine,
}

#[derive(Clone, Copy, Serialize)]
struct InsErrorLine {
    t_s: f64,
    position_m: [f64; 3],
    velocity_m_s: [f64; 3],
}

impl From<&Estimate> for Believed {
    fn from(estimate: &Estimate) -> Self {
        // Symmetric: columns are rows.
        let covariance = estimate.relative_covariance_m2;
        let sigma = |c: Matrix3<f64>| c.diagonal().map(|v| v.max(0.0).sqrt());
        Self {
            t_s: estimate.t_s,
            tag_m: estimate.tag_m.into(),
            vehicle_m: estimate.vehicle_m.into(),
            covariance_m2: covariance.map(Into::into),
            sigma_m: covariance.map(sigma).map(Into::into),
            alternative_m: estimate.alternative_m.map(Into::<[f64; 3]>::into),
            range_bias_m: estimate.range_bias_m,
            range_sigma_m: estimate.range_sigma_m,
            doubts: doubts(estimate.doubts),
        }
    }
}

impl From<&Command> for Ordered {
    fn from(command: &Command) -> Self {
        let array = |v: Vector3<f64>| v.into();
        Self {
            id: command.id,
            action: match command.action {
                Action::Hold => "hold",
                Action::Fly => "fly",
                Action::Land => "land",
            },
            waypoint_m: array(command.waypoint_m),
            ins_error: InsErrorLine {
                t_s: command.ins_error.t_s,
                position_m: array(command.ins_error.position_m),
                velocity_m_s: array(command.ins_error.velocity_m_s),
            },
        }
    }
}

/// The name of a phase.
pub(crate) fn phase(phase: Phase) -> &'static str {
    match phase {
        Phase::Initial => "initial",
        Phase::MidFlight => "mid_flight",
        Phase::Final => "final",
        Phase::Landing => "landing",
    }
}

/// The names of those doubts that there are.
fn doubts(doubts: Doubts) -> Vec<&'static str> {
    [
        (doubts.weak_geometry, "weak_geometry"),
        (doubts.ambiguous, "ambiguous"),
        (doubts.gap, "gap"),
        (doubts.frozen_ins, "frozen_ins"),
    ]
    .into_iter()
    .filter_map(|(there, name)| there.then_some(name))
    .collect()
}
