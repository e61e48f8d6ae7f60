//! What happened during a flight.

use crate::scene::Scene;
use nalgebra::{Vector2, Vector3};
use nova_solver::navigation::{
    Command, Estimate, InputFault, InsSample, Navigator, Phase, RangeSample,
};
use std::time::Instant;

/// A flight, moment by moment. Times are seconds since hand-over.
#[derive(Debug, Clone)]
pub struct Recording {
    /// What was there before it.
    pub scene: Scene,
    /// Where the vehicle truly was, metres: at each time of a range and at the end.
    pub truth: Vec<(f64, Vector3<f64>)>,
    /// Dead reckoning as the navigator was told.
    pub ins: Vec<InsSample>,
    /// Ranges as the navigator was told.
    pub ranges: Vec<RangeSample>,
    /// Commands, when they changed in any way.
    pub commands: Vec<(f64, Command)>,
    /// Arrivals that were reported, with the command that was in force.
    pub arrivals: Vec<(f64, Command)>,
    /// Estimates, when they were computed anew, with the time of that.
    pub estimates: Vec<(f64, Estimate)>,
    /// Beginnings of the flight's parts.
    pub phases: Vec<(f64, Phase)>,
    /// Computing time of each new estimate, milliseconds.
    pub update_ms: Vec<f32>,
    /// Readings that the navigator refused.
    pub refused: u64,
    /// Length of the true path over ground, metres.
    pub path_length_m: f64,
    /// Whether it ended on the ground.
    pub landed: bool,
}

impl Recording {
    /// Calls a navigator at `t_s`, with a stop watch, and notes what comes of it.
    pub(crate) fn call(
        &mut self,
        t_s: f64,
        navigator: &mut dyn Navigator,
        call: impl FnOnce(&mut dyn Navigator) -> Result<(), InputFault>,
    ) {
        let updates = navigator.updates();
        let started = Instant::now();
        let taken = call(navigator);
        let elapsed = started.elapsed();
        self.note(taken);
        if navigator.updates() > updates {
            self.update_ms.push(1e3 * elapsed.as_secs_f32());
            let estimate = navigator.estimate();
            self.estimates
                .extend(estimate.map(|estimate| (t_s, estimate)));
        }
    }

    /// Counts a refused reading.
    pub(crate) fn note(&mut self, taken: Result<(), InputFault>) {
        self.refused += u64::from(taken.is_err());
    }

    /// When it ended.
    pub fn end_s(&self) -> f64 {
        self.truth.last().map_or(0.0, |&(t_s, _)| t_s)
    }

    /// Where it ended, metres.
    pub fn end_m(&self) -> Vector3<f64> {
        self.truth
            .last()
            .map_or(self.scene.start_m, |&(_, position_m)| position_m)
    }

    /// Where the vehicle truly was at `t_s`, between recorded moments by straight lines.
    pub fn true_position_m(&self, t_s: f64) -> Vector3<f64> {
        interpolate(&self.truth, t_s).unwrap_or(self.scene.start_m)
    }

    /// Where dead reckoning had the vehicle at `t_s`, likewise.
    pub fn reckoned_position_m(&self, t_s: f64) -> Vector3<f64> {
        let after = self.ins.partition_point(|sample| sample.t_s < t_s);
        let at = |index: usize| self.ins.get(index).map(|s| (s.t_s, s.position_m));
        between(after.checked_sub(1).and_then(at), at(after), t_s).unwrap_or(self.scene.start_m)
    }

    /// Horizontal error of an estimate of where the tag is relative to the vehicle, as it stands at
    /// `t_s`: what has been flown since the estimate is known from dead reckoning.
    pub fn relative_error_m(&self, estimate: &Estimate, t_s: f64) -> Vector2<f64> {
        let flown_m = self.reckoned_position_m(t_s) - self.reckoned_position_m(estimate.t_s);
        let believed_m = estimate.tag_m - (estimate.vehicle_m + flown_m);
        let true_m = self.scene.tag_m - self.true_position_m(t_s);
        (believed_m - true_m).xy()
    }
}

fn interpolate(path: &[(f64, Vector3<f64>)], t_s: f64) -> Option<Vector3<f64>> {
    let after = path.partition_point(|&(at_s, _)| at_s < t_s);
    let at = |index: usize| path.get(index).copied();
    between(after.checked_sub(1).and_then(at), at(after), t_s)
}

type Point = (f64, Vector3<f64>);

fn between(before: Option<Point>, after: Option<Point>, t_s: f64) -> Option<Vector3<f64>> {
    match (before, after) {
        (Some((t0, p0)), Some((t1, p1))) => Some(p0.lerp(&p1, (t_s - t0) / (t1 - t0))),
        (Some((_, only)), None) | (None, Some((_, only))) => Some(only),
        (None, None) => None,
    }
}
