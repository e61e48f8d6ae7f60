//! The navigator: measurements in, the best explanation and a direction out.

use super::elimination::Factor;
use super::guidance::{self, CENTRE_BELOW_M, LAND_FROM_M, Shape};
use super::hypotheses::Hypotheses;
use super::hypothesis::Hypothesis;
use super::noise::NoiseModel;
use super::options::{MapOptions, Plan};
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
/// How often other explanations are looked for, seconds: in the beginning, and later.
const OFTEN_S: f64 = 0.5;
const SELDOM_S: f64 = 1.0;
/// How long the beginning lasts, seconds.
const YOUNG_S: f64 = 20.0;
/// The runner-up counts as a competitor within this cost of the best.
const COMPETES: f64 = 7.0;
/// A direction is unmeasured if its sigma exceeds this part of the distance.
const WEAK_SHARE: f64 = 0.25;
/// A path narrower than this part of its length is straight: it leaves a ring of places, and errors
/// of dead reckoning decide among them.
const STRAIGHT: f64 = 0.15;
/// The tag's place is vague while a sigma, or the distance to a rival, exceeds this part of the
/// distance.
const VAGUE_SHARE: f64 = 0.06;
/// Not less than this, metres.
const VAGUE_FROM_M: f64 = 0.7;
/// Distance from the point above the tag at which landing begins, metres.
const CENTRED_M: f64 = 0.08;
/// Height below which there is nothing left to do but to land, metres.
const GROUNDED_M: f64 = 0.1;
/// Longest exploration, seconds.
const EXPLORE_S: f64 = 25.0;
/// Height above the first guess that is kept while far from the tag, metres.
const CLEARANCE_M: f64 = 8.0;
/// How far ahead of the vehicle the waypoint lies, metres.
const AHEAD_M: f64 = 3.0;
/// Ranges shorter than this are not used, metres: their direction is as unsure as the place itself,
/// so a linearised range would tell more than it knows.
const NEAREST_M: f64 = 0.5;
/// Height below which every range leads to an update, metres.
const LOW_M: f64 = 8.0;

/// Mistrust of ranges: at the tag, and growing with distance, 1/m.
const MISTRUST: f64 = 1.0;
const MISTRUST_PER_M: f64 = 0.025;

/// Path length over that of flying horizontally and then down, less one.
fn overhead(plan: Plan) -> f64 {
    match plan {
        Plan::Careful => 0.04,
        Plan::Fast => -0.18,
    }
}

/// Factor on the noise of a range. Ranges from far away err together in ways that no model knows, and
/// lead astray if there is no doubt about them; near the tag there are better ones.
fn mistrust(range_m: f64) -> f64 {
    MISTRUST + MISTRUST_PER_M * range_m.abs()
}

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
    factors: Vec<Factor>,
    shape: Shape,
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
            factors: Vec::with_capacity(options.most_knots + 2),
            shape: Shape {
                gate_m: 5.0,
                radius_m: 0.8,
                side: 1.0,
            },
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
        let sure = self.hypotheses.best().is_some_and(|best| !self.vague(best));
        if self.options.adapt_noise && sure {
            self.hypotheses.tune_best(record, &mut self.factors);
        }
        self.updates += 1;
        self.doubt();
    }

    /// Looks for other explanations, often at first and now and then later.
    fn doubt(&mut self) {
        let (Some(record), Some(start)) = (&self.record, self.start) else {
            return;
        };
        let newest_s = record.knot_times_s().last().copied().unwrap_or(start.t_s);
        let low = self.low();
        let pause_s = if low || newest_s - start.t_s < YOUNG_S {
            OFTEN_S
        } else {
            SELDOM_S
        };
        if newest_s - self.doubted_s < pause_s {
            return;
        }
        self.doubted_s = newest_s;
        self.doubts = self.doubts.wrapping_add(1);
        // Far away the tag may be elsewhere; near it, the vehicle.
        match (low, self.doubts % 3) {
            (false, 0) => self.hypotheses.try_image(record, &mut self.factors),
            (false, 1) => self.hypotheses.try_fresh(record, &mut self.factors),
            (false, _) => self
                .hypotheses
                .try_direction(self.doubts / 3, record, &mut self.factors),
            (true, 0) => self.hypotheses.try_anew(record, &mut self.factors),
            (true, _) => self.hypotheses.try_other_side(record, &mut self.factors),
        }
    }

    fn steer(&mut self, t_s: f64) {
        let (Some(best), Some(ins_m), Some(start)) =
            (self.hypotheses.best(), self.ins_at(t_s), self.start)
        else {
            return;
        };
        let (position_m, velocity_m_s) = best.ins_error();
        let known_s = self
            .record
            .as_ref()
            .and_then(|record| record.observations().last())
            .map_or(t_s, |o| o.t_s);
        let ins_error = InsError {
            t_s: known_s,
            position_m,
            velocity_m_s,
        };
        let vehicle_m = ins_m - ins_error.at(t_s);
        let tag_m = best.tag_m();
        let offset_m = vehicle_m - tag_m;
        let to_tag = tag_m - start.position_m;
        let whole_m = (to_tag.xy().norm() + to_tag.z.abs()) * (1.0 + overhead(self.options.plan));
        let left_m = whole_m - self.options.speed_m_s * (t_s - start.t_s);
        let above = Vector3::new(0.0, 0.0, LAND_FROM_M);
        let vague = self.vague(best);
        let landing = self.phase == Phase::Landing && offset_m.z < CENTRE_BELOW_M;
        let land =
            !vague && (landing || (offset_m - above).norm() < CENTRED_M || offset_m.z < GROUNDED_M);
        self.phase = match () {
            () if land => Phase::Landing,
            () if offset_m.z < self.shape.gate_m => Phase::Final,
            () => Phase::MidFlight,
        };
        let spare_m = vehicle_m.z - self.guess.tag_m.z - CLEARANCE_M;
        let waypoint_m = if land {
            tag_m
        } else if vague && t_s - start.t_s < EXPLORE_S {
            let toward = self.guess.tag_m - start.position_m;
            vehicle_m + guidance::exploration(toward, t_s - start.t_s, spare_m) * AHEAD_M
        } else if offset_m.z < CENTRE_BELOW_M {
            tag_m + above
        } else {
            vehicle_m
                + guidance::direction(
                    offset_m,
                    horizontal_sigma(best),
                    &self.shape,
                    left_m,
                    spare_m,
                ) * AHEAD_M
        };
        self.command = Command {
            id: self.command.id.wrapping_add(1),
            action: if land { Action::Land } else { Action::Fly },
            waypoint_m,
            ins_error,
        };
    }

    /// Whether flying at the best explanation would be flying at a phantom.
    fn vague(&self, best: &Hypothesis) -> bool {
        let newest = self
            .record
            .as_ref()
            .and_then(|record| record.observations().last());
        let limit_m = newest
            .map_or(0.0, |o| VAGUE_SHARE * (best.tag_m() - o.ins_m).norm())
            .max(VAGUE_FROM_M);
        let sigma_m = best
            .relative_covariance()
            .symmetric_eigenvalues()
            .max()
            .max(0.0)
            .sqrt();
        let rival = self
            .hypotheses
            .second()
            .filter(|rival| rival.score() - best.score() < COMPETES)
            .is_some_and(|rival| rival.distance_m(best) > limit_m);
        rival || sigma_m > limit_m
    }

    fn low(&self) -> bool {
        self.phase != Phase::Initial
            && self
                .estimate()
                .is_some_and(|e| e.vehicle_m.z - e.tag_m.z < LOW_M)
    }
}

/// Largest horizontal standard deviation of the tag seen from the vehicle, metres.
fn horizontal_sigma(explanation: &Hypothesis) -> f64 {
    let covariance = explanation
        .relative_covariance()
        .fixed_view::<2, 2>(0, 0)
        .into_owned();
    covariance.symmetric_eigenvalues().max().max(0.0).sqrt()
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
        if sample.range_m < NEAREST_M {
            self.steer(sample.t_s);
            return Ok(());
        }
        let (range_sigma_m, height_sigma_m) = if self.options.adapt_noise {
            (
                self.range_roughness.add(sample.range_m) * mistrust(sample.range_m),
                self.height_roughness.add(ins_m.z),
            )
        } else {
            (
                self.options.noise.range_sigma_m,
                self.options.noise.ins.height_sigma_m,
            )
        };
        self.observe(Observation {
            t_s: sample.t_s,
            ins_m,
            range_m: sample.range_m,
            range_sigma_m,
            height_sigma_m,
        });
        self.ranges += 1;
        if self.ranges.is_multiple_of(2) || self.low() {
            self.update();
        }
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
        let (error_m, _) = best.ins_error();
        let vehicle_m = newest.ins_m - error_m;
        let covariance = self.hypotheses.relative_covariance();
        let distance_m = (best.tag_m() - vehicle_m).norm();
        let rival = self
            .hypotheses
            .second()
            .filter(|rival| rival.score() - best.score() < COMPETES);
        let largest = covariance.symmetric_eigenvalues().max().max(0.0).sqrt();
        Some(Estimate {
            t_s: newest.t_s,
            tag_m: best.tag_m(),
            vehicle_m,
            relative_covariance_m2: Some(covariance),
            alternative_m: rival.map(|rival| rival.tag_m()),
            range_bias_m: Some(best.bias_m()),
            range_sigma_m: Some(newest.range_sigma_m),
            doubts: Doubts {
                weak_geometry: largest > WEAK_SHARE * distance_m.max(1.0)
                    || record.width_over_length() < STRAIGHT,
                ambiguous: rival.is_some(),
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
