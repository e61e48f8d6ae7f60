//! The navigator: measurements in, the best explanation and a direction out.

mod doubt;
mod steering;

use super::elimination::Factor;
use super::hypotheses::Hypotheses;
use super::hypothesis::Hypothesis;
use super::mixture::{Mixture, Moments};
use super::noise::NoiseModel;
use super::options::MapOptions;
use super::planner::Planner;
use super::record::{Observation, Record};
use super::roughness::Roughness;
use crate::navigation::{
    Action, Command, Doubts, Estimate, FirstGuess, InputFault, InputGate, InsError, InsSample,
    Navigator, Phase, RangeSample,
};
use nalgebra::Vector3;

/// Ranges that are waited for before the search begins.
const SEARCH_AFTER: usize = 25;
/// Gauss-Newton steps an update.
const STEPS: u32 = 2;
/// How long the beginning lasts, seconds.
const YOUNG_S: f64 = 20.0;
/// A direction is unmeasured if its sigma exceeds this part of the distance.
const WEAK_SHARE: f64 = 0.25;
/// A path narrower than this part of its length is straight: it leaves a ring of places, and errors
/// of dead reckoning decide among them.
const STRAIGHT: f64 = 0.15;
/// A path whose standard deviation is less than this part of the distance is none: so far dead reckoning
/// drifts while the vehicle stands still, and what looks like a direction to the tag is that drift's.
const SHORT: f64 = 0.03;
/// Ranges shorter than this are not used, metres: their direction is as unsure as the place itself,
/// so a linearised range would tell more than it knows.
const NEAREST_M: f64 = 0.5;
/// Height below which the mixture takes over, and above which it is given up, metres.
const CLOSE_M: f64 = 15.0;
const NO_LONGER_CLOSE_M: f64 = 25.0;
/// It begins once the standard deviation is less than this part of the distance: it has no room for a
/// whole ring of places.
const COMPACT_SHARE: f64 = 0.15;
/// The mixture is started anew when it explains the ranges this much worse than the best explanation.
const LOST: f64 = 15.0;
/// Ranges further apart than this are not a series, seconds.
const LONGEST_PAUSE_S: f64 = 0.5;

/// Maximum a posteriori estimation of tag, range bias and dead reckoning's error over the whole
/// flight, and a flight that serves it. The module's text says how.
#[derive(Debug, Clone)]
pub struct MapNavigator {
    options: MapOptions,
    guess: FirstGuess,
    gate: InputGate,
    /// The reading of dead reckoning before the newest.
    previous_ins: Option<InsSample>,
    start: Option<InsSample>,
    record: Option<Record>,
    range_roughness: Roughness,
    height_roughness: Roughness,
    hypotheses: Hypotheses,
    mixture: Mixture,
    /// Score of the best explanation when the mixture began.
    score_at_start: f64,
    /// What the mixture says.
    close: Option<Moments>,
    factors: Vec<Factor>,
    planner: Planner,
    command: Command,
    phase: Phase,
    ranges: u64,
    updates: u64,
    doubted_s: f64,
    doubts: usize,
}

impl MapNavigator {
    /// Of a tag that is said to be at `guess`.
    pub fn new(guess: FirstGuess, options: MapOptions) -> Self {
        Self {
            options,
            guess,
            gate: InputGate::default(),
            previous_ins: None,
            start: None,
            record: None,
            range_roughness: Roughness::new(options.noise.range_sigma_m),
            height_roughness: Roughness::new(options.noise.ins.height_sigma_m),
            hypotheses: Hypotheses::new(&options, guess.tag_m, options.most_knots + 2),
            mixture: Mixture::new(),
            score_at_start: 0.0,
            close: None,
            factors: Vec::with_capacity(options.most_knots + 2),
            planner: Planner::new(),
            command: Command {
                id: 0,
                action: Action::Hold,
                waypoint_m: Vector3::zeros(),
                ins_error: InsError::none(),
            },
            phase: Phase::Initial,
            ranges: 0,
            updates: 0,
            doubted_s: f64::NEG_INFINITY,
            doubts: 0,
        }
    }

    /// Noise that the flight so far agrees with.
    pub fn noise(&self) -> &NoiseModel {
        self.hypotheses
            .best()
            .map_or(&self.options.noise, |best| best.noise())
    }

    /// Dead reckoning at the time of a range.
    fn ins_at(&self, t_s: f64) -> Option<Vector3<f64>> {
        let last = self.gate.last_ins()?;
        let Some(before) = self.previous_ins else {
            return Some(last.position_m);
        };
        let ahead_s = t_s - last.t_s;
        let dt_s = last.t_s - before.t_s;
        // Extrapolation by much more than the step would multiply noise.
        if ahead_s > 2.0 * dt_s {
            return Some(last.position_m);
        }
        let velocity = (last.position_m - before.position_m) / dt_s;
        Some(last.position_m + velocity * ahead_s)
    }

    /// What gusts add to the roughness of ranges, over the square of their strength: a third of the time
    /// between ranges, along the line of sight.
    fn gusts_s(&self, sample: &RangeSample, ins_m: Vector3<f64>) -> f64 {
        let (tag_m, error_m) = self.hypotheses.best().map_or_else(
            || (self.guess.tag_m, Vector3::zeros()),
            |best| (best.tag_m(), best.ins_error().0),
        );
        let down_m = (ins_m - error_m - tag_m).z;
        let level = 1.0 - (down_m / sample.range_m).powi(2);
        let dt_s = self
            .newest()
            .map_or(0.0, |newest| sample.t_s - newest.t_s)
            .min(LONGEST_PAUSE_S);
        level.max(0.0) * dt_s / 3.0
    }

    fn observe(&mut self, observation: Observation) {
        let record = self.record.get_or_insert_with(|| {
            let start_s = self
                .start
                .map_or(observation.t_s, |s| s.t_s)
                .min(observation.t_s - 1e-3);
            Record::new(
                self.options.knot_interval_s,
                start_s,
                self.options.most_knots + 2,
            )
        });
        let last_s = record
            .knot_times_s()
            .last()
            .copied()
            .unwrap_or(observation.t_s);
        let growth = record.push(observation);
        self.hypotheses.follow(growth, observation.t_s - last_s);
        if record.knot_times_s().len() > self.options.most_knots {
            self.hypotheses.marginalise_first(record);
            record.drop_first_interval();
        }
    }

    fn update(&mut self) {
        let Some(record) = &self.record else {
            return;
        };
        if self.hypotheses.best().is_none() {
            if record.observations().len() < SEARCH_AFTER {
                return;
            }
            self.hypotheses.start(record, &mut self.factors);
        }
        self.hypotheses.update(record, STEPS, &mut self.factors);
        let ready = self.hypotheses.best().is_some_and(|best| !self.vague(best));
        if self.options.adapt_noise && ready {
            self.hypotheses.tune_best(record, &mut self.factors);
        }
        self.updates += 1;
        self.doubt();
    }

    /// Hands over to the mixture when the vehicle comes low, and follows it.
    fn look_closely(&mut self, observation: &Observation) {
        let Some(best) = self.hypotheses.best() else {
            return;
        };
        let height_m = observation.ins_m.z - best.ins_error().0.z - best.tag_m().z;
        if self.mixture.is_running() {
            self.mixture.observe(observation, best.noise());
            // Both have foretold the same ranges since the mixture began.
            let evidence = self.score_at_start - best.score();
            let lost = self.mixture.log_likelihood() < evidence - LOST;
            if lost || height_m > NO_LONGER_CLOSE_M {
                self.mixture.stop();
            }
        }
        if !self.mixture.is_running() && height_m < CLOSE_M && self.may_begin(observation) {
            if let Some(record) = &self.record {
                let components = self.hypotheses.components(record, &mut self.factors);
                self.mixture.start(components, observation);
            }
            self.score_at_start = best.score();
        }
        self.close = self.mixture.moments();
    }

    /// Whether the explanations are ripe for a mixture: of this observation, after a while, and together.
    fn may_begin(&self, observation: &Observation) -> bool {
        let known = self
            .newest()
            .is_some_and(|newest| newest.t_s == observation.t_s);
        let young = self
            .start
            .is_none_or(|start| observation.t_s - start.t_s < self.options.mixture_after_s);
        let compact = || {
            let spread = self.hypotheses.relative_covariance();
            let limit_m = COMPACT_SHARE * observation.range_m;
            spread.symmetric_eigenvalues().max() < limit_m.powi(2)
        };
        known && !young && compact()
    }

    fn newest(&self) -> Option<&Observation> {
        self.record.as_ref()?.observations().last()
    }
}

/// Where the vehicle was at an observation at the end of the record.
fn vehicle_m(explanation: &Hypothesis, newest: &Observation) -> Vector3<f64> {
    newest.ins_m - explanation.ins_error().0
}

impl Navigator for MapNavigator {
    fn on_ins(&mut self, sample: InsSample) -> Result<(), InputFault> {
        let previous = self.gate.last_ins();
        self.gate.admit_ins(sample)?;
        self.previous_ins = previous;
        self.start.get_or_insert(sample);
        Ok(())
    }

    fn on_range(&mut self, sample: RangeSample) -> Result<(), InputFault> {
        self.gate.admit_range(sample)?;
        let Some(ins_m) = self.ins_at(sample.t_s) else {
            return Ok(());
        };
        let (range_sigma_m, height_sigma_m) = if self.options.adapt_noise {
            (
                self.range_roughness
                    .add(sample.range_m, self.gusts_s(&sample, ins_m)),
                self.height_roughness.add(ins_m.z, 0.0),
            )
        } else {
            (
                self.options.noise.range_sigma_m,
                self.options.noise.ins.height_sigma_m,
            )
        };
        let observation = Observation {
            t_s: sample.t_s,
            ins_m,
            range_m: sample.range_m,
            range_sigma_m,
            height_sigma_m,
            gusts_s: self.range_roughness.gusts_s(),
        };
        if sample.range_m >= NEAREST_M {
            self.observe(observation);
            self.ranges += 1;
            if self.ranges.is_multiple_of(2) || self.low() {
                self.update();
            }
        }
        let observation = self
            .newest()
            .filter(|o| o.t_s == observation.t_s)
            .copied()
            .unwrap_or(observation);
        self.look_closely(&observation);
        self.steer(sample.t_s);
        Ok(())
    }

    fn on_arrival(&mut self, _command_id: u32) {}

    fn command(&self) -> Command {
        self.command
    }

    fn estimate(&self) -> Option<Estimate> {
        let best = self.hypotheses.best()?;
        let record = self.record.as_ref()?;
        let newest = record.observations().last()?;
        let (t_s, vehicle_m, covariance) = match self.close {
            Some(close) => (
                close.t_s,
                best.tag_m() - close.offset_m,
                close.covariance_m2,
            ),
            None => (
                newest.t_s,
                vehicle_m(best, newest),
                self.hypotheses.relative_covariance(),
            ),
        };
        let distance_m = (best.tag_m() - vehicle_m).norm();
        let rival = self.rival(best);
        let (narrowness, length_m) = record.width_over_length_and_length_m();
        let largest = covariance.symmetric_eigenvalues().max().max(0.0).sqrt();
        Some(Estimate {
            t_s,
            tag_m: best.tag_m(),
            vehicle_m,
            relative_covariance_m2: Some(covariance),
            alternative_m: rival.map(|rival| rival.tag_m()),
            range_bias_m: Some(best.bias_m()),
            range_sigma_m: Some(newest.range_sigma_m),
            doubts: Doubts {
                weak_geometry: largest > WEAK_SHARE * distance_m.max(1.0)
                    || narrowness < STRAIGHT
                    || length_m < SHORT * distance_m,
                ambiguous: rival.is_some() && self.close.is_none(),
                ..self.gate.doubts()
            },
        })
    }

    fn phase(&self) -> Phase {
        self.phase
    }

    fn updates(&self) -> u64 {
        self.updates
    }
}
