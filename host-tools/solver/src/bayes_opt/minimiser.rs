//! The search itself.

use nalgebra::SVector;

use super::candidates::Candidates;
use super::improvement::expected_improvement;
use super::process::GaussianProcess;
use super::search_box::SearchBox;
use super::sequence::EvenSequence;

/// Length scales that are tried, in units of the box's edges: a wiggle, a bend, a trend, and next to
/// no influence.
const LENGTH_SCALES: [f64; 4] = [0.15, 0.4, 1.0, 4.0];
/// Steps of the search around the best candidate, in units of the box's edges.
const LOCAL_STEPS: [f64; 3] = [0.1, 0.03, 0.01];

/// How to search.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MinimiserOptions {
    /// Evaluations of the function in all.
    pub evaluations: usize,
    /// How many of them are spread evenly before the process is asked. Starts given by the caller
    /// come on top of these.
    pub spread: usize,
    /// Points at which the expected improvement is compared.
    pub candidates: usize,
    /// Shifts the spread points and the candidates.
    pub seed: u64,
}

impl Default for MinimiserOptions {
    fn default() -> Self {
        Self {
            evaluations: 25,
            spread: 8,
            candidates: 128,
            seed: 0,
        }
    }
}

/// The best point seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Minimum<const D: usize> {
    /// Where.
    pub x: SVector<f64, D>,
    /// The function's value there; infinite if it was finite nowhere.
    pub value: f64,
}

/// Bayesian optimisation over a box. Keeps its memory from one run to the next; the runs themselves
/// know nothing of each other: the same function gives the same minimum.
#[derive(Debug, Clone)]
pub struct BayesianMinimiser<const D: usize> {
    options: MinimiserOptions,
    /// First evaluations, unit box.
    spread: Vec<SVector<f64, D>>,
    candidates: Candidates<D>,
    process: GaussianProcess<D>,
    length_scales: SVector<f64, D>,
}

impl<const D: usize> BayesianMinimiser<D> {
    /// Ready to search.
    pub fn new(options: MinimiserOptions) -> Self {
        let mut sequence = EvenSequence::new(options.seed);
        let length_scales = SVector::repeat(LENGTH_SCALES[1]);
        Self {
            options,
            spread: (0..options.spread).map(|_| sequence.next_point()).collect(),
            candidates: Candidates::new(options.candidates, &mut sequence),
            process: GaussianProcess::new(&length_scales),
            length_scales,
        }
    }

    /// Looks for the minimum of `function` in the box, first at `starts`. A value that is not finite
    /// counts as the largest finite one seen.
    pub fn minimise(
        &mut self,
        search: &SearchBox<D>,
        starts: &[SVector<f64, D>],
        mut function: impl FnMut(&SVector<f64, D>) -> f64,
    ) -> Minimum<D> {
        self.length_scales = SVector::repeat(LENGTH_SCALES[1]);
        self.process.restart(&self.length_scales);
        self.candidates.restart();
        let first = starts.len() + self.spread.len();
        let mut best = Minimum {
            x: search.scaled(&SVector::repeat(0.5)),
            value: f64::INFINITY,
        };
        let mut largest = 0.0_f64;
        let mut next_scaling = first;
        for n in 0..self.options.evaluations {
            let unit = if let Some(start) = starts.get(n) {
                search.unscaled(start)
            } else if let Some(point) = self.spread.get(n - starts.len()) {
                *point
            } else {
                if n >= next_scaling {
                    // Scales settle early; twice as much knowledge may change them.
                    next_scaling = 2 * n.max(1);
                    self.choose_length_scales();
                }
                self.candidates.follow(&self.process);
                self.most_promising(best.value)
            };
            let x = search.scaled(&unit);
            let value = function(&x);
            if value < best.value {
                best = Minimum { x, value };
            }
            if value.is_finite() {
                largest = if n == 0 { value } else { largest.max(value) };
            }
            let seen = if value.is_finite() { value } else { largest };
            self.process.observe(unit, seen);
        }
        best
    }

    /// Largest likelihood, one dimension after the other.
    fn choose_length_scales(&mut self) {
        let mut best = self.process.log_likelihood();
        for dimension in 0..D {
            for scale in LENGTH_SCALES {
                let mut scales = self.length_scales;
                scales[dimension] = scale;
                self.process.rescale(&scales);
                let likelihood = self.process.log_likelihood();
                if likelihood > best {
                    best = likelihood;
                    self.length_scales = scales;
                }
            }
        }
        self.process.rescale(&self.length_scales);
        self.candidates.restart();
    }

    /// The best candidate, moved along the axes while that promises more.
    fn most_promising(&mut self, best: f64) -> SVector<f64, D> {
        let middle = SVector::repeat(0.5);
        let Some((mut x, mut promise)) = self.candidates.most_promising(&self.process, best) else {
            return middle;
        };
        for step in LOCAL_STEPS {
            for axis in 0..D {
                for signed in [step, -step] {
                    let mut other = x;
                    other[axis] = (other[axis] + signed).clamp(0.0, 1.0);
                    let at = self.process.predict(&other);
                    let promised = expected_improvement(at.mean, at.sigma, best);
                    if promised > promise {
                        (x, promise) = (other, promised);
                    }
                }
            }
        }
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Vector2, Vector3};
    use std::f64::consts::PI;

    /// Three minima of 0.397887 (Branin 1972).
    fn branin(x: &Vector2<f64>) -> f64 {
        let (x1, x2) = (x.x, x.y);
        let valley = x2 - 5.1 / (4.0 * PI * PI) * x1 * x1 + 5.0 / PI * x1 - 6.0;
        valley * valley + 10.0 * (1.0 - 1.0 / (8.0 * PI)) * x1.cos() + 10.0
    }

    fn branin_box() -> SearchBox<2> {
        SearchBox::new(Vector2::new(-5.0, 0.0), Vector2::new(10.0, 15.0)).unwrap()
    }

    fn minimiser<const D: usize>(evaluations: usize, seed: u64) -> BayesianMinimiser<D> {
        BayesianMinimiser::new(MinimiserOptions {
            evaluations,
            seed,
            ..MinimiserOptions::default()
        })
    }

    #[test]
    fn branins_minimum_is_found_within_forty_evaluations_from_every_seed() {
        let mut worst = f64::NEG_INFINITY;
        for seed in 0..20 {
            let found = minimiser(40, seed).minimise(&branin_box(), &[], branin);
            worst = worst.max(found.value);
        }
        assert!(worst < 0.397_887 + 0.05, "{worst}");
    }

    #[test]
    fn it_beats_evenly_spread_points() {
        let mut wins = 0;
        for seed in 0..20 {
            let mut sequence = EvenSequence::new(seed);
            let spread = (0..25)
                .map(|_| branin(&branin_box().scaled(&sequence.next_point())))
                .fold(f64::INFINITY, f64::min);
            let found = minimiser(25, seed).minimise(&branin_box(), &[], branin);
            wins += u32::from(found.value < spread);
        }
        assert!(wins >= 18, "{wins} of 20");
    }

    #[test]
    fn a_dimension_without_influence_costs_little() {
        let search = SearchBox::new(Vector3::zeros(), Vector3::repeat(1.0)).unwrap();
        let bowl = |x: &Vector3<f64>| (x.x - 0.2).powi(2) + (x.z - 0.8).powi(2);
        for seed in 0..20 {
            let found = minimiser(25, seed).minimise(&search, &[], bowl);
            assert!(found.value < 5e-3, "{seed}: {found:?}");
        }
    }

    #[test]
    fn exactly_as_many_evaluations_as_asked_all_within_the_box() {
        for evaluations in [0, 1, 5, 25] {
            let mut count = 0;
            let found = minimiser(evaluations, 1).minimise(&branin_box(), &[], |x| {
                count += 1;
                assert!((-5.0..=10.0).contains(&x.x) && (0.0..=15.0).contains(&x.y));
                branin(x)
            });
            assert_eq!(count, evaluations);
            assert_eq!(found.value.is_finite(), evaluations > 0);
        }
    }

    #[test]
    fn a_start_is_tried_first_and_never_lost() {
        let start = Vector2::new(PI, 2.275);
        let mut first = None;
        let found = minimiser(10, 1).minimise(&branin_box(), &[start], |x| {
            first.get_or_insert(*x);
            branin(x)
        });
        assert!((first.unwrap() - start).norm() < 1e-12);
        assert!(found.value <= branin(&start) + 1e-12);
    }

    #[test]
    fn a_second_run_finds_the_same() {
        let mut minimiser = minimiser(25, 5);
        let first = minimiser.minimise(&branin_box(), &[], branin);
        minimiser.minimise(&branin_box(), &[], |x| x.norm());
        assert_eq!(minimiser.minimise(&branin_box(), &[], branin), first);
    }

    #[test]
    fn values_that_are_not_numbers_are_avoided() {
        let found = minimiser(25, 2).minimise(&branin_box(), &[], |x| {
            if x.x < 0.0 { f64::NAN } else { branin(x) }
        });
        assert!(found.x.x >= 0.0 && found.value < 2.0, "{found:?}");
        let nowhere = minimiser(25, 2).minimise(&branin_box(), &[], |_| f64::NAN);
        assert!(nowhere.value.is_infinite() && nowhere.x.iter().all(|c| c.is_finite()));
    }

    #[test]
    fn a_constant_function_is_no_trouble() {
        let found = minimiser(25, 2).minimise(&branin_box(), &[], |_| 3.0);
        assert_eq!(found.value, 3.0);
    }
}
