//! Two simple navigators for tests of what is around them.

// Each test binary uses a part of this.
#![allow(dead_code, unreachable_pub)]

use nalgebra::Vector3;
use nova_solver::navigation::{
    Action, Command, Doubts, Estimate, FirstGuess, InputFault, InsError, InsSample, Navigator,
    Phase, RangeSample,
};
use nova_solver::{MultilaterationOptions, RangeMeasurement, multilaterate};

/// Flies given waypoints one after the other and lands at the last; measures nothing.
pub struct Legs {
    waypoints_m: Vec<Vector3<f64>>,
    reached: usize,
}

impl Legs {
    pub fn new(waypoints_m: Vec<Vector3<f64>>) -> Self {
        Self {
            waypoints_m,
            reached: 0,
        }
    }
}

impl Navigator for Legs {
    fn on_ins(&mut self, _: InsSample) -> Result<(), InputFault> {
        Ok(())
    }

    fn on_range(&mut self, _: RangeSample) -> Result<(), InputFault> {
        Ok(())
    }

    fn on_arrival(&mut self, command_id: u32) {
        assert_eq!(
            command_id as usize, self.reached,
            "one arrival for each waypoint, in order"
        );
        self.reached += 1;
    }

    fn command(&self) -> Command {
        let last = self.waypoints_m.len() - 1;
        let flying = self.reached <= last;
        Command {
            id: self.reached as u32,
            action: if flying { Action::Fly } else { Action::Land },
            waypoint_m: self.waypoints_m[self.reached.min(last)],
            ins_error: InsError::none(),
        }
    }

    fn estimate(&self) -> Option<Estimate> {
        None
    }

    fn phase(&self) -> Phase {
        Phase::MidFlight
    }

    fn updates(&self) -> u64 {
        0
    }
}

/// Flies an elbow down and aside, multilaterates once a second from there on, flies over the tag
/// found, and lands there. Takes dead reckoning for the truth.
pub struct Homing {
    guess: FirstGuess,
    elbow_m: Vec<Vector3<f64>>,
    reached: u32,
    landing: bool,
    log: Vec<RangeMeasurement>,
    last_ins: Option<InsSample>,
    estimate: Option<Estimate>,
    updates: u64,
}

impl Homing {
    pub fn new(guess: FirstGuess) -> Self {
        Self {
            guess,
            elbow_m: Vec::new(),
            reached: 0,
            landing: false,
            log: Vec::new(),
            last_ins: None,
            estimate: None,
            updates: 0,
        }
    }

    fn locate(&mut self, t_s: f64, vehicle_m: Vector3<f64>) {
        let Ok(found) = multilaterate(&self.log, &MultilaterationOptions::default()) else {
            return;
        };
        self.updates += 1;
        self.estimate = Some(Estimate {
            t_s,
            tag_m: found.position_m,
            vehicle_m,
            relative_covariance_m2: None,
            alternative_m: None,
            range_bias_m: None,
            range_sigma_m: None,
            doubts: Doubts::default(),
        });
    }
}

impl Navigator for Homing {
    fn on_ins(&mut self, sample: InsSample) -> Result<(), InputFault> {
        if self.last_ins.is_none() {
            let ahead = (self.guess.tag_m - sample.position_m).xy();
            let aside = Vector3::new(-ahead.y, ahead.x, 0.0).normalize();
            let down = sample.position_m - Vector3::new(0.0, 0.0, 5.0);
            self.elbow_m = vec![
                down,
                down + aside * 8.0,
                down + aside * 8.0 + ahead.push(0.0) * 0.3,
            ];
        }
        self.last_ins = Some(sample);
        Ok(())
    }

    fn on_range(&mut self, sample: RangeSample) -> Result<(), InputFault> {
        let fault = InputFault::NoInsNearby { t_s: sample.t_s };
        let ins = self.last_ins.ok_or(fault)?;
        self.log.push(RangeMeasurement {
            t_s: sample.t_s,
            position_m: ins.position_m,
            range_m: sample.range_m,
            sigma_m: 0.05,
        });
        if self.reached >= 3 && self.log.len().is_multiple_of(10) {
            self.locate(sample.t_s, ins.position_m);
        }
        Ok(())
    }

    fn on_arrival(&mut self, command_id: u32) {
        if command_id == self.reached {
            self.reached += 1;
            self.landing = self.reached > 3;
        }
    }

    fn command(&self) -> Command {
        let elbow = self.elbow_m.get(self.reached as usize).copied();
        let over_tag = || {
            let height_m = self.elbow_m.last()?.z;
            Some(self.estimate?.tag_m.xy().push(height_m))
        };
        let (action, waypoint) = match elbow.or_else(over_tag) {
            Some(waypoint) if self.landing => (Action::Land, waypoint),
            Some(waypoint) => (Action::Fly, waypoint),
            None => (Action::Hold, Vector3::zeros()),
        };
        Command {
            id: self.reached,
            action,
            waypoint_m: waypoint,
            ins_error: InsError::none(),
        }
    }

    fn estimate(&self) -> Option<Estimate> {
        self.estimate
    }

    fn phase(&self) -> Phase {
        if self.landing {
            Phase::Landing
        } else {
            Phase::Initial
        }
    }

    fn updates(&self) -> u64 {
        self.updates
    }
}
