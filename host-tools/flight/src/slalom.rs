//! A prescribed path for the paper's Table I: no planning, one fix at its end.

use nalgebra::Vector3;
use nova_solver::navigation::{
    Action, Command, Doubts, Estimate, FirstGuess, InputFault, InputGate, InsError, InsSample,
    Navigator, Phase, RangeSample,
};
use nova_solver::{MultilaterationOptions, RangeMeasurement, multilaterate};

/// Progress towards the first guess, how far it weaves to either side, and how much it goes down, as
/// in the paper's Fig. 3(c): "resolves the ambiguity entirely". Metres.
const LENGTH_M: f64 = 30.0;
const ASIDE_M: f64 = 5.0;
const DOWN_M: f64 = 5.0;
/// Waypoints on the path.
const TURNS: u32 = 6;

/// What a range is taken to be worth where nothing is known, metres. All are the same, so that the
/// answer does not depend on it.
const RANGE_SIGMA_M: f64 = 0.1;

/// Flies a slalom of 30 m towards the first guess, finds the tag from all that was measured (Eq. 4),
/// and lands there.
pub(crate) struct Slalom {
    guess: FirstGuess,
    gate: InputGate,
    /// Waypoints not yet reached, the last first.
    ahead_m: Vec<Vector3<f64>>,
    measurements: Vec<RangeMeasurement>,
    estimate: Option<Estimate>,
    command: Command,
    updates: u64,
}

impl Slalom {
    pub(crate) fn new(guess: FirstGuess) -> Self {
        Self {
            guess,
            gate: InputGate::default(),
            ahead_m: Vec::new(),
            measurements: Vec::new(),
            estimate: None,
            command: Command {
                id: 0,
                action: Action::Hold,
                waypoint_m: Vector3::zeros(),
                ins_error: InsError::none(),
            },
            updates: 0,
        }
    }

    fn order(&mut self, action: Action, waypoint_m: Vector3<f64>) {
        self.command = Command {
            id: self.command.id + 1,
            action,
            waypoint_m,
            ..self.command
        };
    }

    /// Where the tag is by all ranges so far; the first guess if they cannot tell.
    fn fix(&mut self, vehicle: InsSample) {
        let options = MultilaterationOptions::default();
        let found = multilaterate(&self.measurements, &options).ok();
        let other = found.as_ref().and_then(|found| found.alternative.as_ref());
        self.updates += 1;
        self.estimate = Some(Estimate {
            t_s: vehicle.t_s,
            tag_m: (found.as_ref()).map_or(self.guess.tag_m, |found| found.position_m),
            vehicle_m: vehicle.position_m,
            // Multilateration knows nothing of the drift of dead reckoning.
            relative_covariance_m2: None,
            alternative_m: other.map(|other| other.position_m),
            range_bias_m: None,
            range_sigma_m: None,
            doubts: Doubts {
                weak_geometry: found.as_ref().is_none_or(|found| !found.observable()),
                ambiguous: other.is_some(),
                ..self.gate.doubts()
            },
        });
    }
}

/// The waypoints of the path; it goes down in its first half, since a path in one plane leaves the
/// tag's image in that plane. From `start_m` towards `guess_m`, the last first.
fn waypoints(start_m: Vector3<f64>, guess_m: Vector3<f64>) -> Vec<Vector3<f64>> {
    let towards = (guess_m - start_m).xy().try_normalize(1e-9);
    let towards = towards.unwrap_or_else(nalgebra::Vector2::x).push(0.0);
    let aside = Vector3::new(-towards.y, towards.x, 0.0);
    (1..=TURNS)
        .rev()
        .map(|turn| {
            let part = f64::from(turn) / f64::from(TURNS);
            let side = if turn % 2 == 0 { -ASIDE_M } else { ASIDE_M };
            let down_m = DOWN_M * (2.0 * part).min(1.0);
            start_m + towards * (LENGTH_M * part) + aside * side - Vector3::z() * down_m
        })
        .collect()
}

impl Navigator for Slalom {
    fn on_ins(&mut self, sample: InsSample) -> Result<(), InputFault> {
        self.gate.admit_ins(sample)?;
        if self.command.action == Action::Hold {
            self.ahead_m = waypoints(sample.position_m, self.guess.tag_m);
            if let Some(first_m) = self.ahead_m.pop() {
                self.order(Action::Fly, first_m);
            }
        }
        Ok(())
    }

    fn on_range(&mut self, sample: RangeSample) -> Result<(), InputFault> {
        self.gate.admit_range(sample)?;
        if let (None, Some(vehicle)) = (self.estimate, self.gate.last_ins()) {
            self.measurements.push(RangeMeasurement {
                t_s: sample.t_s,
                position_m: vehicle.position_m,
                range_m: sample.range_m,
                sigma_m: RANGE_SIGMA_M,
            });
        }
        Ok(())
    }

    fn on_arrival(&mut self, command_id: u32) {
        let (Some(vehicle), true) = (self.gate.last_ins(), command_id == self.command.id) else {
            return;
        };
        if let Some(next_m) = self.ahead_m.pop() {
            self.order(Action::Fly, next_m);
            return;
        }
        match self.estimate {
            None => {
                self.fix(vehicle);
                let tag_m = self.estimate.map_or(self.guess.tag_m, |e| e.tag_m);
                let height_m = vehicle.position_m.z;
                self.order(Action::Fly, Vector3::new(tag_m.x, tag_m.y, height_m));
            }
            Some(estimate) => self.order(Action::Land, estimate.tag_m),
        }
    }

    fn command(&self) -> Command {
        self.command
    }

    fn estimate(&self) -> Option<Estimate> {
        self.estimate
    }

    fn phase(&self) -> Phase {
        match (self.command.action, self.estimate) {
            (Action::Land, _) => Phase::Landing,
            (_, Some(_)) => Phase::Final,
            (_, None) => Phase::MidFlight,
        }
    }

    fn updates(&self) -> u64 {
        self.updates
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Method, Pilot, Settings, Trial, fly};

    #[test]
    fn the_path_weaves_to_both_sides_and_ends_thirty_metres_on() {
        let path = waypoints(Vector3::new(0.0, -30.0, 30.0), Vector3::new(0.0, 3.0, 0.0));
        assert_eq!(path[0], Vector3::new(5.0, 0.0, 25.0));
        assert_eq!(path.len(), 6);
        let sides: Vec<f64> = path.iter().rev().map(|p| p.x.signum()).collect();
        assert_eq!(sides, [-1.0, 1.0, -1.0, 1.0, -1.0, 1.0]);
    }

    /// Table I, case 1.
    #[test]
    fn with_perfect_sensors_it_lands_on_the_tag() {
        let settings = Settings {
            pilot: Pilot::Follow,
            distance_m: 30.0,
            imu_scale: 0.0,
            baro_sigma_m: 0.0,
            baro_drift: 0.0,
            uwb_floor_m: 0.0,
            uwb_reference_m: 0.0,
            ..Settings::default()
        };
        for seed in 0..5 {
            let trial = Trial {
                method: Method::Slalom,
                settings: settings.clone(),
                seed,
            };
            let result = fly(&trial);
            assert!(result.landed && result.error_m < 0.1, "{}", result.error_m);
        }
    }
}
