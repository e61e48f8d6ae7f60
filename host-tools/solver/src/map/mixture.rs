//! The last metres, where the answer is not Gaussian.
//!
//! Within a metre or two of the tag, ranges from one side of it look like those from the other, and
//! what dead reckoning loses in a second is no longer small beside the distance. A minimum of a cost
//! and the curvature there describe such a posterior badly. A sum of Gaussians describes it as it is
//! (Alspach and Sorenson 1972): each is carried by an extended Kalman filter, weighed by how well it
//! foretold each range, and split where the sphere about the tag bends within its own width
//! (DeMars, Bishop and Jah 2013); those that have come to say the same are merged (Salmond 1990).
//!
//! ```text
//! explanations ──► split ──► step ──► range: gain, weight ──► prune, merge ──► moments
//!                    ▲                                             │
//!                    └─────────────────────────────────────────────┘
//! ```
//!
//! The state is that of [`crate::bound`], `[r (3), v (2), a (2), b]`: tag plus error of dead
//! reckoning, its velocity and acceleration, range bias. With `ins` the reading of dead reckoning,
//! `r - ins` is the way from vehicle to tag.

use super::bend::Bend;
use super::likelihood::RangeLikelihood;
use super::noise::NoiseModel;
use super::record::Observation;
use crate::bound::{BIAS, Covariance, Recursion, STATES};
use crate::ins_error::InsNoise;
use nalgebra::{Matrix2, Matrix3, SVector, Vector2, Vector3};

/// Most Gaussians between two ranges.
const MOST: usize = 64;
/// Room while they are being split.
const ROOM: usize = 3 * MOST;
/// Split if the variance that a straight line leaves out of a range exceeds this part of its noise.
const BENT: f64 = 0.003;
/// Three Gaussians in place of a standard one: weights and places of the outer two, standard
/// deviation of all (DeMars, Bishop and Jah 2013, table 1).
const OUTER_WEIGHT: f64 = 0.225_224_6;
const OUTER_PLACE: f64 = 1.057_515_5;
const NARROWED: f64 = 0.671_566_3;
/// What may be lost by merging, and by which factor that is raised until enough are merged.
const LEAST_BAR: f64 = 1e-3;
const RAISE: f64 = 4.0;
/// Gaussians of different noises are never merged, whatever the bar.
const LAST_BAR: f64 = 1e9;
/// Gaussians of less weight are dropped.
const LEAST_WEIGHT: f64 = 1e-6;
/// A range that is less likely sound than this tells a Gaussian nothing.
const LEAST_SOUND: f64 = 1e-3;

type State = SVector<f64, STATES>;

/// One Gaussian of the sum.
#[derive(Debug, Clone, Copy)]
pub(super) struct Component {
    pub(super) mean: State,
    pub(super) covariance: Covariance,
    /// Noise of dead reckoning in which it believes.
    pub(super) noise: InsNoise,
    pub(super) weight: f64,
}

/// Mean and covariance of all together.
#[derive(Debug, Clone, Copy)]
pub(super) struct Moments {
    /// When.
    pub(super) t_s: f64,
    /// From vehicle to tag.
    pub(super) offset_m: Vector3<f64>,
    /// Of that.
    pub(super) covariance_m2: Matrix3<f64>,
    /// Of the whole state.
    pub(super) covariance: Covariance,
}

/// The sum of Gaussians; empty until it is started.
#[derive(Debug, Clone)]
pub(super) struct Mixture {
    components: Vec<Component>,
    t_s: f64,
    /// Reading of dead reckoning then.
    ins_m: Vector3<f64>,
    /// Logarithm of the likelihood of all ranges since the start.
    log_likelihood: f64,
}

impl Mixture {
    pub(super) fn new() -> Self {
        Self {
            components: Vec::with_capacity(ROOM),
            t_s: 0.0,
            ins_m: Vector3::zeros(),
            log_likelihood: 0.0,
        }
    }

    /// Whether there is any.
    pub(super) fn is_running(&self) -> bool {
        !self.components.is_empty()
    }

    /// Forgets everything.
    pub(super) fn stop(&mut self) {
        self.components.clear();
    }

    /// Begins with what the explanations say at an observation.
    pub(super) fn start(&mut self, components: Vec<Component>, at: &Observation) {
        self.components.clear();
        self.components.extend(components.into_iter().take(ROOM));
        (self.t_s, self.ins_m) = (at.t_s, at.ins_m);
        self.normalise();
        self.log_likelihood = 0.0;
    }

    /// Logarithm of the likelihood of all ranges since the start: what an explanation's evidence has
    /// lost in the same time.
    pub(super) fn log_likelihood(&self) -> f64 {
        self.log_likelihood
    }

    /// Takes an observation later than all before.
    pub(super) fn observe(&mut self, observation: &Observation, noise: &NoiseModel) {
        let dt_s = observation.t_s - self.t_s;
        (self.t_s, self.ins_m) = (observation.t_s, observation.ins_m);
        for component in &mut self.components {
            component.step(dt_s);
        }
        self.split(observation);
        let likelihood = RangeLikelihood::new(noise.outlier_probability);
        for component in &mut self.components {
            component.observe(observation, &likelihood);
        }
        self.normalise();
        self.merge();
    }

    /// Splits what is too wide for a straight line.
    fn split(&mut self, observation: &Observation) {
        let mut i = 0;
        while i < self.components.len() {
            let (u, distance) = self.components[i].sight(observation);
            let variance = self.components[i].variance_m2(observation);
            let bend = self.components[i].bend(&u, distance);
            if bend.variance_m2() > BENT * variance && self.components.len() + 2 <= ROOM {
                let [low, middle, high] = self.components[i].split_along(bend.direction());
                self.components[i] = middle;
                self.components.push(low);
                self.components.push(high);
                // The middle one may still be too wide; the outer ones are looked at in turn.
            } else {
                i += 1;
            }
        }
    }

    fn normalise(&mut self) {
        let sum: f64 = self.components.iter().map(|c| c.weight).sum();
        if !(sum > 0.0 && sum.is_finite()) {
            self.components.clear();
            return;
        }
        self.log_likelihood += sum.ln();
        for component in &mut self.components {
            component.weight /= sum;
        }
        self.components.retain(|c| c.weight > LEAST_WEIGHT);
    }

    /// Merges the most alike until few enough are left, with a bar that is raised as needed.
    fn merge(&mut self) {
        let mut bar = LEAST_BAR;
        while self.components.len() > MOST && bar < LAST_BAR {
            let mut i = 0;
            while i < self.components.len() {
                let mut j = i + 1;
                while j < self.components.len() && self.components.len() > MOST {
                    if self.components[i].merging_cost(&self.components[j]) < bar {
                        let other = self.components.swap_remove(j);
                        self.components[i].take_in(&other);
                    } else {
                        j += 1;
                    }
                }
                i += 1;
            }
            bar *= RAISE;
        }
    }

    /// What they say together; `None` while there are none.
    pub(super) fn moments(&self) -> Option<Moments> {
        let mut all = *self.components.first()?;
        for component in &self.components[1..] {
            all.take_in(component);
        }
        Some(Moments {
            t_s: self.t_s,
            offset_m: all.mean.fixed_rows::<3>(0) - self.ins_m,
            covariance_m2: all.covariance.fixed_view::<3, 3>(0, 0).into_owned(),
            covariance: all.covariance,
        })
    }
}

impl Component {
    fn step(&mut self, dt_s: f64) {
        let dt_s = dt_s.max(0.0);
        for axis in 0..2 {
            let (r, v, a) = (axis, 3 + axis, 5 + axis);
            self.mean[r] += dt_s * (self.mean[v] + 0.5 * dt_s * self.mean[a]);
            self.mean[v] += dt_s * self.mean[a];
        }
        let mut recursion = Recursion::from_covariance(self.noise, self.covariance);
        recursion.step(dt_s);
        self.covariance = *recursion.covariance();
    }

    /// Variance of range minus reckoned distance in its eyes, m^2.
    fn variance_m2(&self, observation: &Observation) -> f64 {
        observation.variance_m2(self.noise.position_random_walk)
    }

    /// From the vehicle to the tag: direction and distance.
    fn sight(&self, observation: &Observation) -> (Vector3<f64>, f64) {
        let sight = self.mean.fixed_rows::<3>(0) - observation.ins_m;
        let distance = sight.norm();
        (sight / distance.max(1e-9), distance)
    }

    fn bend(&self, u: &Vector3<f64>, distance: f64) -> Bend {
        let covariance = self.covariance.fixed_view::<3, 3>(0, 0).into_owned();
        Bend::new(&covariance, u, distance)
    }

    /// Three that together are nearly this one, narrower along `direction` of `r`.
    fn split_along(&self, direction: Vector3<f64>) -> [Self; 3] {
        let seen = self.covariance.fixed_columns::<3>(0) * direction;
        let sigma = direction.dot(&seen.fixed_rows::<3>(0)).max(1e-12).sqrt();
        let arm = seen / sigma;
        let covariance = self.covariance - arm * arm.transpose() * (1.0 - NARROWED * NARROWED);
        [-OUTER_PLACE, 0.0, OUTER_PLACE].map(|place| Self {
            mean: self.mean + arm * place,
            covariance,
            noise: self.noise,
            weight: self.weight
                * if place == 0.0 {
                    1.0 - 2.0 * OUTER_WEIGHT
                } else {
                    OUTER_WEIGHT
                },
        })
    }

    /// Takes a range; what of it may be an outlier counts less.
    fn observe(&mut self, observation: &Observation, likelihood: &RangeLikelihood) {
        let (u, distance) = self.sight(observation);
        let bend = self.bend(&u, distance);
        let variance = self.variance_m2(observation) + bend.variance_m2();
        let mut seen = self.covariance.fixed_columns::<3>(0) * u;
        seen += self.covariance.column(BIAS);
        let foretold = u.dot(&seen.fixed_rows::<3>(0)) + seen[BIAS];
        let off = distance + bend.lift_m() + self.mean[BIAS] - observation.range_m;
        let influence = likelihood.influence(off, foretold + variance);
        self.weight *= (-influence.cost).exp();
        if influence.sound < LEAST_SOUND {
            return;
        }
        let variance = variance / influence.sound;
        self.mean -= seen * (off / (foretold + variance));
        let mut recursion = Recursion::from_covariance(self.noise, self.covariance);
        recursion.observe(u, variance.sqrt());
        self.covariance = *recursion.covariance();
    }

    /// How much is lost by merging: weighted squared distance of the means, in the horizontal plane.
    fn merging_cost(&self, other: &Self) -> f64 {
        if self.noise != other.noise {
            return f64::INFINITY;
        }
        let weight = self.weight + other.weight;
        let off: Vector2<f64> = (self.mean - other.mean).fixed_rows::<2>(0).into_owned();
        let horizontal =
            |c: &Self| -> Matrix2<f64> { c.covariance.fixed_view::<2, 2>(0, 0).into_owned() };
        let shared = (horizontal(self) * self.weight + horizontal(other) * other.weight) / weight;
        let distance = shared
            .try_inverse()
            .map_or(f64::INFINITY, |p| off.dot(&(p * off)));
        self.weight * other.weight / weight * distance
    }

    /// Becomes the Gaussian with the moments of both.
    fn take_in(&mut self, other: &Self) {
        let weight = self.weight + other.weight;
        let share = other.weight / weight;
        let off = other.mean - self.mean;
        self.covariance = self.covariance * (1.0 - share)
            + other.covariance * share
            + off * off.transpose() * (share * (1.0 - share));
        self.mean += off * share;
        self.weight = weight;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Dead reckoning that does not err.
    const STILL: InsNoise = InsNoise {
        velocity_random_walk: 0.0,
        acceleration_random_walk: 0.0,
        position_random_walk: 0.0,
        height_random_walk: 0.0,
        height_sigma_m: 0.0,
    };
    const RANGE_SIGMA_M: f64 = 0.05;
    const TAG_SIGMA_M: f64 = 0.6;

    /// Of a tag about the origin, all else known.
    fn prior() -> Component {
        let sigmas = State::from([TAG_SIGMA_M, TAG_SIGMA_M, 1e-4, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6]);
        Component {
            mean: State::zeros(),
            covariance: Covariance::from_diagonal(&sigmas.component_mul(&sigmas)),
            noise: STILL,
            weight: 1.0,
        }
    }

    fn observation(t_s: f64, vehicle_m: Vector3<f64>, tag_m: Vector3<f64>) -> Observation {
        Observation {
            t_s,
            ins_m: vehicle_m,
            range_m: (tag_m - vehicle_m).norm(),
            range_sigma_m: RANGE_SIGMA_M,
            height_sigma_m: 0.0,
            gusts_s: 0.0,
        }
    }

    /// Ranges to a tag at (0.3, 0.5) from a straight path above y = 0, which cannot tell its mirror image.
    fn passing() -> Vec<Observation> {
        let tag_m = Vector3::new(0.3, 0.5, 0.0);
        (0..20)
            .map(|i| {
                let t_s = 0.1 * f64::from(i + 1);
                observation(t_s, Vector3::new(t_s - 1.0, 0.0, 1.0), tag_m)
            })
            .collect()
    }

    /// Mean and covariance by summing over a fine grid of places: x, y, xx, xy, yy.
    fn by_grid(observations: &[Observation]) -> [f64; 5] {
        let places = || (-240..=240).map(|i| 0.01 * f64::from(i));
        let mut sums = [0.0; 6];
        for x in places() {
            for y in places() {
                let tag_m = Vector3::new(x, y, 0.0);
                let prior = (x * x + y * y) / (TAG_SIGMA_M * TAG_SIGMA_M);
                let misfit: f64 = observations
                    .iter()
                    .map(|o| (((tag_m - o.ins_m).norm() - o.range_m) / RANGE_SIGMA_M).powi(2))
                    .sum();
                let weight = (-0.5 * (prior + misfit)).exp();
                for (sum, value) in sums.iter_mut().zip([1.0, x, y, x * x, x * y, y * y]) {
                    *sum += weight * value;
                }
            }
        }
        let [all, x, y, xx, xy, yy] = sums;
        let (x, y) = (x / all, y / all);
        [x, y, xx / all - x * x, xy / all - x * y, yy / all - y * y]
    }

    #[test]
    fn both_sides_of_a_straight_path_stay_as_likely_as_a_sum_over_all_places_says() {
        let noise = NoiseModel {
            outlier_probability: 1e-9,
            ..NoiseModel::data_sheet()
        };
        let observations = passing();
        let mut mixture = Mixture::new();
        let start = observation(0.0, Vector3::new(-1.0, 0.0, 1.0), Vector3::zeros());
        mixture.start(vec![prior()], &start);
        for observation in &observations {
            mixture.observe(observation, &noise);
        }
        let moments = mixture.moments().unwrap();
        let mean_m = moments.offset_m + observations[19].ins_m;
        let c = moments.covariance_m2;
        let ours = [mean_m.x, mean_m.y, c[(0, 0)], c[(0, 1)], c[(1, 1)]];
        let grid = by_grid(&observations);
        for (ours, grid) in ours.iter().zip(grid) {
            // The two sides are a metre apart.
            assert!((ours - grid).abs() < 0.04, "{ours} {grid}");
        }
        assert!(c[(1, 1)].sqrt() > 0.45, "one side was forgotten: {c}");
    }

    #[test]
    fn gaussians_of_different_noise_are_never_merged() {
        let other = Component {
            noise: InsNoise {
                position_random_walk: 0.1,
                ..STILL
            },
            ..prior()
        };
        assert_eq!(prior().merging_cost(&other), f64::INFINITY);
        assert_eq!(prior().merging_cost(&prior()), 0.0);
    }

    #[test]
    fn a_range_that_is_not_a_number_ends_it() {
        let mut mixture = Mixture::new();
        let mut wrong = observation(0.0, Vector3::z(), Vector3::zeros());
        mixture.start(vec![prior()], &wrong);
        (wrong.t_s, wrong.range_m) = (0.1, f64::NAN);
        mixture.observe(&wrong, &NoiseModel::data_sheet());
        assert!(!mixture.is_running() && mixture.moments().is_none());
    }

    proptest! {
        #[test]
        fn splitting_keeps_mean_and_covariance(x in -1.0..1.0f64, y in -1.0..1.0f64) {
            prop_assume!(x.hypot(y) > 0.1);
            let direction = Vector3::new(x, y, 0.0).normalize();
            let whole = prior();
            let [mut sum, middle, high] = whole.split_along(direction);
            sum.take_in(&middle);
            sum.take_in(&high);
            prop_assert!((sum.weight - whole.weight).abs() < 1e-9);
            prop_assert!((sum.mean - whole.mean).norm() < 1e-9);
            // The three leave out 5 % of the variance, as published.
            prop_assert!((sum.covariance - whole.covariance).norm() < 0.06 * whole.covariance.norm());
        }
    }
}
