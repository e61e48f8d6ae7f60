//! Straight towards the estimate, then down on it.

use nalgebra::Vector3;

use crate::navigation::{Action, Command, InsError, Phase};

/// Horizontal distance from the estimate at which to begin going down, metres.
const LAND_WITHIN_M: f64 = 0.5;

/// Steers by a relative position.
#[derive(Debug, Clone, Copy)]
pub(super) struct Homing {
    command: Command,
}

impl Homing {
    pub(super) fn new() -> Self {
        Self {
            command: Command {
                id: 0,
                action: Action::Hold,
                waypoint_m: Vector3::zeros(),
                ins_error: InsError::none(),
            },
        }
    }

    /// The tag is believed `relative_m` from the vehicle, which dead reckoning places at
    /// `reckoned_m`.
    pub(super) fn steer(&mut self, reckoned_m: Vector3<f64>, relative_m: Vector3<f64>) {
        let landing = self.command.action == Action::Land || relative_m.xy().norm() < LAND_WITHIN_M;
        let tag_m = reckoned_m + relative_m;
        if landing {
            self.order(Action::Land, tag_m);
        } else {
            self.order(Action::Fly, Vector3::new(tag_m.x, tag_m.y, reckoned_m.z));
        }
    }

    /// Above the estimate as it was.
    pub(super) fn on_arrival(&mut self, command_id: u32, tag_m: Vector3<f64>) {
        if command_id == self.command.id && self.command.action == Action::Fly {
            self.order(Action::Land, tag_m);
        }
    }

    pub(super) fn command(&self) -> Command {
        self.command
    }

    pub(super) fn phase(&self) -> Phase {
        match self.command.action {
            Action::Hold => Phase::Initial,
            Action::Fly => Phase::MidFlight,
            Action::Land => Phase::Landing,
        }
    }

    fn order(&mut self, action: Action, waypoint_m: Vector3<f64>) {
        self.command = Command {
            id: self.command.id.wrapping_add(1),
            action,
            waypoint_m,
            ins_error: InsError::none(),
        };
    }
}
