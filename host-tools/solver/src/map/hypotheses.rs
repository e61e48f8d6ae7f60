//! All explanations that are still in the running.
//!
//! One range leaves a sphere, a straight path a ring, a flat path a mirror image. So the search
//! starts from several places around the vehicle, follows each by its own Gauss-Newton, and drops
//! those that the measurements come to contradict. As long as the flight could still be mistaken,
//! images of the best one in the path flown so far are tried again.

use super::elimination::{Factor, GLOBAL, JOINT, KNOT};
use super::hypothesis::Hypothesis;
use super::mixture::Component;
use super::noise::NoiseModel;
use super::options::MapOptions;
use super::prior::Prior;
use super::record::{Growth, Record};
use super::tuning::Tuner;
use crate::measurement::RangeMeasurement;
use crate::multilateration::{Height, MultilaterationOptions, multilaterate};
use nalgebra::{Matrix3, Rotation3, SymmetricEigen, Unit, Vector3};
use std::f64::consts::{PI, TAU};

/// Directions of the first search.
const STARTS: usize = 8;
/// The first search begins from the median of this many ranges.
const OLDEST: usize = 9;
/// Starts are at least this part of the range away horizontally.
const LEAST_SHARE: f64 = 0.3;
/// Cost beyond the best one's at which an explanation is given up: one in 10^5.
const HOPELESS: f64 = 12.0;
/// Noises between which the last metres may have to decide: gusts of any strength, a worse accelerometer.
const NOISES: [fn(&mut NoiseModel); 9] = [
    |noise| noise.ins.position_random_walk = CALM,
    |noise| noise.ins.position_random_walk = 0.03,
    |noise| noise.ins.position_random_walk = 0.06,
    |noise| noise.ins.position_random_walk = 0.1,
    |noise| noise.ins.position_random_walk = 0.15,
    |noise| noise.ins.position_random_walk = 0.25,
    |noise| noise.ins.velocity_random_walk *= 2.0,
    |noise| noise.ins.acceleration_random_walk = 0.003,
    |noise| noise.ins.acceleration_random_walk = WANDERING,
];
/// Most explanations that are tried with other noises, and that are sliced.
const MOST_RETUNED: usize = 4;
const MOST_SLICED: usize = 8;
/// An explanation that is worse by more than this does not count: one in 10^4.
const COUNTS: f64 = 9.0;
/// Tags may seem this much above the lowest place of the flight, metres: barometers drift.
const HEIGHT_TOLERANCE_M: f64 = 1.0;
/// Newest stretch for a fresh search, seconds, and how many of its ranges are used.
const FRESH_S: f64 = 15.0;
const FRESH_RANGES: usize = 60;
/// Gusts in still air and the strongest that come (0.35 m/s for half a second each are 0.25), m/sqrt(s).
const CALM: f64 = 3e-3;
const STRONG: f64 = 0.2;
/// An accelerometer that wanders, m/s^2/sqrt(s).
const WANDERING: f64 = 0.01;
/// What may be wrong with the data sheet. A flight in gusts that dead reckoning does not see, taken
/// for one in still air, contradicts the right place of the tag first of all; taken for one in stronger gusts it
/// does not, and the evidence leads the gusts down.
const BEGINNINGS: [fn(&mut NoiseModel); 3] = [
    |_| {},
    |noise| noise.ins.position_random_walk = STRONG,
    |noise| noise.ins.acceleration_random_walk = WANDERING,
];
/// Explanations that differ by less than this part of the distance, in the place of the tag and of
/// the vehicle, are the same.
const SAME: f64 = 0.02;

/// The explanations, best first.
#[derive(Debug, Clone)]
pub(super) struct Hypotheses {
    prior: Prior,
    /// The noise that new explanations begin with.
    tuner: Tuner,
    next_beginning: usize,
    tag_below_flight: bool,
    alive: Vec<Hypothesis>,
    guess_m: Vector3<f64>,
    capacity: usize,
    /// Which image is tried next.
    next_image: usize,
}

impl Hypotheses {
    pub(super) fn new(options: &MapOptions, guess_m: Vector3<f64>, knot_capacity: usize) -> Self {
        let mut mean = [0.0; JOINT];
        mean[KNOT..KNOT + 3].copy_from_slice(guess_m.as_slice());
        mean[JOINT - 1] = options.bias_prior_m;
        let mut sigma = [0.0; JOINT];
        sigma[..KNOT].copy_from_slice(&options.initial_ins_sigma());
        sigma[KNOT..KNOT + 2].fill(options.guess_sigma_horizontal_m);
        sigma[KNOT + 2] = options.guess_sigma_vertical_m;
        sigma[KNOT + GLOBAL - 1] = options.bias_sigma_m;
        Self {
            prior: Prior::independent(mean, sigma),
            tuner: Tuner::new(options.noise),
            next_beginning: 0,
            tag_below_flight: options.tag_below_flight,
            alive: Vec::with_capacity(2 * STARTS),
            guess_m,
            capacity: knot_capacity,
            next_image: 0,
        }
    }

    pub(super) fn best(&self) -> Option<&Hypothesis> {
        self.alive.first()
    }

    /// Covariance of `tag - vehicle` about what the best explanation says, with all explanations
    /// counted by their evidence.
    pub(super) fn relative_covariance(&self) -> Matrix3<f64> {
        let Some(best) = self.alive.first() else {
            return Matrix3::zeros();
        };
        let place = |h: &Hypothesis| h.tag_m() + h.ins_error().0;
        let (mut sum, mut weights) = (Matrix3::zeros(), 0.0);
        for explanation in &self.alive {
            let weight = (best.score() - explanation.score()).exp();
            let off = place(explanation) - place(best);
            sum += (explanation.relative_covariance() + off * off.transpose()) * weight;
            weights += weight;
        }
        sum / weights
    }

    /// All explanations at the newest range, under all noises that may be and in slices, weighted by
    /// their evidence.
    pub(super) fn components(&self, record: &Record, factors: &mut Vec<Factor>) -> Vec<Component> {
        let mut explanations: Vec<Hypothesis> = self
            .alive
            .iter()
            .take(MOST_RETUNED)
            .flat_map(|h| NOISES.map(|noise| h.with_noise(noise, record, factors)))
            .flatten()
            .collect();
        explanations.sort_by(|a, b| a.score().total_cmp(&b.score()));
        let least = explanations.first().map_or(0.0, Hypothesis::score);
        explanations.retain(|h| h.score() < least + COUNTS);
        explanations.truncate(MOST_SLICED);
        let mut components = Vec::new();
        for explanation in &explanations {
            for slice in explanation.slices(record, factors) {
                components.push(Component {
                    mean: slice.bound_mean(),
                    covariance: slice.bound_covariance(),
                    noise: slice.noise().ins,
                    weight: (least - slice.score()).exp(),
                });
            }
        }
        components
    }

    /// The runner-up.
    pub(super) fn second(&self) -> Option<&Hypothesis> {
        self.alive.get(1)
    }

    /// Starts in all directions.
    pub(super) fn start(&mut self, record: &Record, factors: &mut Vec<Factor>) {
        self.alive.clear();
        for direction in 0..STARTS {
            for _ in 0..BEGINNINGS.len() {
                self.try_direction(direction, record, factors);
            }
        }
    }

    /// Starts from the circle that the oldest ranges leave at the guessed height, in one of
    /// [`STARTS`] directions; dead reckoning is taken to be right.
    pub(super) fn try_direction(
        &mut self,
        direction: usize,
        record: &Record,
        factors: &mut Vec<Factor>,
    ) {
        let Some(oldest) = record.observations().first() else {
            return;
        };
        let range = typical_range_m(record);
        let toward = self.guess_m - oldest.ins_m;
        let below = (-toward.z).clamp(0.0, range);
        let radius = (range * range - below * below)
            .sqrt()
            .max(LEAST_SHARE * range);
        let angle = toward.y.atan2(toward.x) + TAU * (direction % STARTS) as f64 / STARTS as f64;
        let tag = oldest.ins_m + Vector3::new(radius * angle.cos(), radius * angle.sin(), -below);
        self.add(tag, None, record, factors);
        self.judge(record);
    }

    /// Follows the record after it took an observation.
    pub(super) fn follow(&mut self, growth: Growth, moved_by_s: f64) {
        for hypothesis in &mut self.alive {
            hypothesis.follow(growth, moved_by_s);
        }
    }

    /// Computes every explanation anew.
    pub(super) fn update(&mut self, record: &Record, iterations: u32, factors: &mut Vec<Factor>) {
        self.alive
            .retain_mut(|hypothesis| hypothesis.refine(record, iterations, factors).is_some());
        self.judge(record);
    }

    /// Lets the noise of the best explanation follow the evidence.
    pub(super) fn tune_best(&mut self, record: &Record, factors: &mut Vec<Factor>) {
        if let Some(best) = self.alive.first_mut() {
            best.tune(record, factors);
        }
    }

    /// Tries what plain multilateration makes of the newest stretch, during which dead reckoning
    /// has hardly drifted: it searches everywhere and knows nothing of the explanations so far.
    pub(super) fn try_fresh(&mut self, record: &Record, factors: &mut Vec<Factor>) {
        let observations = record.observations();
        let Some(newest) = observations.last() else {
            return;
        };
        let from = observations.partition_point(|o| o.t_s < newest.t_s - FRESH_S);
        let stretch = &observations[from..];
        let stride = stretch.len().div_ceil(FRESH_RANGES).max(1);
        let measurements: Vec<RangeMeasurement> = stretch
            .iter()
            .step_by(stride)
            .map(|o| RangeMeasurement {
                t_s: o.t_s,
                position_m: o.ins_m,
                range_m: o.range_m,
                sigma_m: o.variance_m2(0.0).sqrt(),
            })
            .collect();
        let options = MultilaterationOptions {
            height: Height::Between {
                min_m: f64::NEG_INFINITY,
                max_m: self.highest_tag_m(record),
            },
            ..MultilaterationOptions::default()
        };
        let Ok(found) = multilaterate(&measurements, &options) else {
            return;
        };
        let places = [
            Some(found.position_m),
            found.alternative.map(|other| other.position_m),
        ];
        for place in places.into_iter().flatten() {
            self.add(place, None, record, factors);
        }
        self.judge(record);
    }

    /// Tries an image of the best explanation.
    pub(super) fn try_image(&mut self, record: &Record, factors: &mut Vec<Factor>) {
        let Some(best) = self.alive.first() else {
            return;
        };
        let Some(image) = image(record, best.tag_m(), self.next_image) else {
            return;
        };
        self.next_image = (self.next_image + 1) % IMAGES;
        let template = best.clone();
        self.add(image, Some(template), record, factors);
        self.judge(record);
    }

    /// Tries the best explanation's tag again, with dead reckoning taken to be right.
    pub(super) fn try_anew(&mut self, record: &Record, factors: &mut Vec<Factor>) {
        if let Some(tag_m) = self.alive.first().map(Hypothesis::tag_m) {
            self.add(tag_m, None, record, factors);
            self.judge(record);
        }
    }

    /// Tries the best explanation with a worse accelerometer in place of gusts.
    pub(super) fn try_calm(&mut self, record: &Record, factors: &mut Vec<Factor>) {
        let calm = |noise: &mut NoiseModel| {
            noise.ins.position_random_walk = CALM;
            noise.ins.acceleration_random_walk = WANDERING;
        };
        if let Some(best) = self.alive.first()
            && let Some(other) = best.with_noise(calm, record, factors)
        {
            self.alive.push(other);
            self.judge(record);
        }
    }

    /// Tries the vehicle elsewhere, so that the tag is seen at `offset_m(as the best one sees it)`.
    pub(super) fn try_offset(
        &mut self,
        offset_m: impl FnOnce(Vector3<f64>) -> Vector3<f64>,
        record: &Record,
        factors: &mut Vec<Factor>,
    ) {
        let Some(mut copy) = self.alive.first().cloned() else {
            return;
        };
        copy.lead_newest(record, offset_m);
        if copy.approach_gently(record, factors).is_some() {
            self.alive.push(copy);
        }
        self.judge(record);
    }

    /// Forgets the oldest knot of all.
    pub(super) fn marginalise_first(&mut self, record: &Record) {
        self.alive
            .retain_mut(|hypothesis| hypothesis.marginalise_first(record).is_some());
        // New explanations begin where the best one's memory ends.
        if let Some(best) = self.alive.first() {
            self.prior = best.prior();
        }
    }

    /// Noise for a new explanation: that of the best one and [`BEGINNINGS`] by turns.
    fn fresh_tuner(&mut self) -> Tuner {
        self.next_beginning = (self.next_beginning + 1) % (BEGINNINGS.len() + 1);
        match (BEGINNINGS.get(self.next_beginning), self.alive.first()) {
            (Some(change), _) => self.tuner.beginning_with(*change),
            (None, Some(best)) => best.tuner().clone(),
            (None, None) => self.tuner.clone(),
        }
    }

    fn add(
        &mut self,
        tag_m: Vector3<f64>,
        template: Option<Hypothesis>,
        record: &Record,
        factors: &mut Vec<Factor>,
    ) {
        let mut hypothesis = match template {
            Some(mut copy) => {
                copy.move_tag(tag_m);
                copy
            }
            None => Hypothesis::new(
                self.prior,
                self.fresh_tuner(),
                tag_m,
                record.knot_times_s().len(),
                self.capacity,
            ),
        };
        if hypothesis.approach(record, factors).is_some() {
            self.alive.push(hypothesis);
        }
    }

    /// Above this the tag cannot be.
    fn highest_tag_m(&self, record: &Record) -> f64 {
        if self.tag_below_flight {
            record.lowest_m()
        } else {
            f64::INFINITY
        }
    }

    /// Sorts by cost, drops the hopeless and the doubles.
    fn judge(&mut self, record: &Record) {
        let highest_m = self.highest_tag_m(record) + HEIGHT_TOLERANCE_M;
        self.alive
            .retain(|h| h.score().is_finite() && h.tag_m().z < highest_m);
        self.alive.sort_by(|a, b| a.score().total_cmp(&b.score()));
        let Some(best) = self.alive.first() else {
            return;
        };
        let (limit, tag_m) = (best.score() + HOPELESS, best.tag_m());
        self.alive.retain(|h| h.score() <= limit);
        // By its own account: a wild range must not make everything look near.
        let same = record
            .observations()
            .last()
            .map_or(0.0, |o| SAME * (tag_m - o.ins_m).norm())
            .max(0.1);
        let mut i = 1;
        while i < self.alive.len() {
            let here = &self.alive[i];
            if self.alive[..i]
                .iter()
                .any(|better| better.distance_m(here) < same)
            {
                self.alive.remove(i);
            } else {
                i += 1;
            }
        }
    }
}

/// The median of the oldest ranges: the first of all may be a wild one.
fn typical_range_m(record: &Record) -> f64 {
    let mut ranges = [0.0; OLDEST];
    let count = record.observations().len().min(OLDEST);
    for (range, observation) in ranges.iter_mut().zip(record.observations()) {
        *range = observation.range_m.abs();
    }
    let (_, median, _) = ranges[..count.max(1)].select_nth_unstable_by(count / 2, f64::total_cmp);
    *median
}

/// Images of a tag in the path: turned about the path's long axis, mirrored in its plane.
const IMAGES: usize = 4;

fn image(record: &Record, tag_m: Vector3<f64>, which: usize) -> Option<Vector3<f64>> {
    let (centre, spread) = record.spread();
    let eigen = SymmetricEigen::new(spread);
    let long = eigen
        .eigenvectors
        .column(eigen.eigenvalues.imax())
        .into_owned();
    let normal = eigen
        .eigenvectors
        .column(eigen.eigenvalues.imin())
        .into_owned();
    let arm = tag_m - centre;
    let turned = |angle: f64| Rotation3::from_axis_angle(&Unit::new_normalize(long), angle) * arm;
    let image = match which {
        0 => arm - normal * (2.0 * arm.dot(&normal)),
        1 => turned(PI),
        2 => turned(0.5 * PI),
        _ => turned(-0.5 * PI),
    };
    image
        .iter()
        .all(|x| x.is_finite())
        .then_some(centre + image)
}
