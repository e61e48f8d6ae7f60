//! The steps of a localisation, in the frame of the computation.

use nalgebra::{Matrix3, Matrix4, Vector3};

use super::options::{Height, MultilaterationOptions, Noise, RangeBias};
use super::trust::Trust;
use super::{Alternative, Localisation, Residual};
use crate::ambiguity::{self, EXCLUDED_BELOW};
use crate::error::SolveError;
use crate::geometry::{Shape, descending_eigen};
use crate::measurement::RangeMeasurement;
use crate::noise::{self, NoiseFit};
use crate::observability::{self, Observability};
use crate::range_model::{Sample, State, Unknowns, information, jacobian};
use crate::robust_fit::{Fit, Fitter};
use crate::starts;

/// The measurements in the frame of the computation: ordered by time, origin at the middle of the
/// places.
pub(super) struct Frame<'a> {
    options: &'a MultilaterationOptions,
    origin: Vector3<f64>,
    samples: Vec<Sample>,
    /// `order[k]` is the place of sample `k` in the slice that was given.
    order: Vec<usize>,
    pub(super) unknowns: Unknowns,
}

/// A fit to the sound measurements, with what is needed to judge it.
pub(super) struct Solution {
    pub(super) fit: Fit,
    /// Cost of the same place over all samples, outliers included: competitors are compared on
    /// equal terms.
    cost_of_all: f64,
    used: Vec<bool>,
    /// The used samples.
    sound: Vec<Sample>,
    shape: Shape,
    trust: Trust,
    /// Of x, y, z and bias.
    covariance: Matrix4<f64>,
}

impl Solution {
    fn position_covariance(&self) -> Matrix3<f64> {
        self.covariance.fixed_view::<3, 3>(0, 0).into_owned()
    }
}

impl<'a> Frame<'a> {
    pub(super) fn new(
        measurements: &[RangeMeasurement],
        options: &'a MultilaterationOptions,
    ) -> Self {
        let mut order: Vec<usize> = (0..measurements.len()).collect();
        if !measurements.is_sorted_by(|a, b| canonical(a, b).is_le()) {
            order.sort_by(|&i, &j| canonical(&measurements[i], &measurements[j]));
        }
        let n = measurements.len().max(1) as f64;
        let origin = order
            .iter()
            .map(|&i| measurements[i].position_m)
            .sum::<Vector3<f64>>()
            / n;
        let samples: Vec<Sample> = order
            .iter()
            .map(|&i| {
                let m = &measurements[i];
                Sample {
                    position: m.position_m - origin,
                    range: m.range_m,
                    inv_sigma: 1.0 / m.sigma_m,
                }
            })
            .collect();
        let height_free = !matches!(options.height, Height::Known(_));
        let unknowns = match options.bias {
            RangeBias::Known(bias) => Unknowns {
                free: [true, true, height_free, false],
                prior_bias: bias,
                prior_weight: 0.0,
            },
            RangeBias::Estimate {
                prior_m,
                prior_sigma_m,
            } => Unknowns {
                free: [true, true, height_free, true],
                prior_bias: prior_m,
                prior_weight: prior_sigma_m.powi(-2),
            },
        };
        Self {
            options,
            origin,
            samples,
            order,
            unknowns,
        }
    }

    fn fitter(&self) -> Fitter<'_> {
        Fitter {
            unknowns: &self.unknowns,
            kernel: self.options.kernel,
            noise: self.options.noise,
        }
    }

    fn known_height(&self) -> Option<f64> {
        match self.options.height {
            Height::Known(height) => Some(height - self.origin.z),
            _ => None,
        }
    }

    /// Minima to begin with, the most promising first.
    pub(super) fn first_minima(&self) -> Vec<Fit> {
        let bias = self.unknowns.prior_bias;
        match self.options.initial_guess_m {
            Some(guess) => {
                let mut place = guess - self.origin;
                if let Some(height) = self.known_height() {
                    place.z = height;
                }
                let start = State::new(place.x, place.y, place.z, bias);
                vec![Fit {
                    x: start,
                    cost: f64::INFINITY,
                    scale: f64::INFINITY,
                }]
            }
            None => starts::search(&self.samples, self.known_height(), bias, &self.fitter()),
        }
    }

    /// From a start in the right basin to the final fit: anneal over all samples, set outliers
    /// aside, fit the rest.
    pub(super) fn refine(&self, start: Fit) -> Result<Solution, SolveError> {
        let fitter = self.fitter();
        let mut scratch = Vec::with_capacity(self.samples.len());
        let (mut x, mut scale) = fitter.settle(&self.samples, start.x, &mut scratch);
        let mut used = vec![true; self.samples.len()];
        let mut sound = self.samples.clone();
        // Outliers widen the first scale, so that some pass until the scale has been found without
        // the others.
        for _ in 0..3 {
            let limit = self.options.reject_sigmas * scale;
            let within: Vec<bool> = self
                .samples
                .iter()
                .map(|s| s.whitened(&x).abs() <= limit)
                .collect();
            let enough = within.iter().filter(|sound| **sound).count() >= self.unknowns.count();
            if !enough || within == used {
                break;
            }
            used = within;
            sound.clear();
            sound.extend(
                self.samples
                    .iter()
                    .zip(&used)
                    .filter(|(_, used)| **used)
                    .map(|(s, _)| *s),
            );
            (x, scale) = fitter.settle(&sound, x, &mut scratch);
        }
        let mut fit = fitter.at_scale(&sound, x, scale, 1.0);

        let whitened: Vec<f64> = sound.iter().map(|s| s.whitened(&fit.x)).collect();
        let noise = match self.options.noise {
            Noise::Given => NoiseFit {
                variance_factor: self.options.kernel.gaussian_variance_factor(),
                effective: sound.len() as f64,
            },
            Noise::Estimated => noise::learn(
                &whitened,
                fit.scale,
                self.options.kernel,
                self.unknowns.count(),
            ),
        };
        let shape = Shape::of(sound.iter().map(|s| self.flattened(s.position)))
            .ok_or(SolveError::Diverged)?;
        let reach = sound
            .iter()
            .map(|s| s.range.abs())
            .fold(shape.extents[0], f64::max)
            .max(1.0);
        let total_weight: f64 = sound.iter().map(|s| s.inv_sigma * s.inv_sigma).sum();
        let rejected = self.samples.len() - sound.len();
        let trust = Trust {
            noise,
            systematic: (self.options.systematic_sigma_m.powi(2)
                + bent_by_noise(&sound, fit.scale).powi(2))
                * total_weight,
            outlier_rate: match self.options.noise {
                Noise::Given => 0.0,
                // Laplace's rule of succession.
                Noise::Estimated => (rejected as f64 + 1.0) / (self.samples.len() as f64 + 2.0),
            },
            limit: self.options.reject_sigmas * fit.scale,
            unmeasured_m2: reach * reach,
        };
        let prior_factor = trust.prior_factor(fit.scale);
        if self.unknowns.prior_weight > 0.0 {
            // Now that it is known what the measurements are worth, the prior on the bias gets its
            // due weight.
            fit = fitter.at_scale(&sound, fit.x, fit.scale, prior_factor);
        }
        if !fit.cost.is_finite() {
            return Err(SolveError::Diverged);
        }

        let covariance = self
            .covariance(&sound, &fit.x, &trust)
            .ok_or(SolveError::Diverged)?;
        let cost_of_all = if rejected == 0 {
            fit.cost
        } else {
            fitter.cost(&self.samples, &fit.x, fit.scale, prior_factor)
        };
        Ok(Solution {
            fit,
            cost_of_all,
            used,
            sound,
            shape,
            trust,
            covariance,
        })
    }

    /// Without its height where the node's is known: then only the horizontal shape of the path
    /// matters.
    fn flattened(&self, place: Vector3<f64>) -> Vector3<f64> {
        match self.known_height() {
            Some(height) => Vector3::new(place.x, place.y, height),
            None => place,
        }
    }

    /// `C` of the module's text. A node lies within reach of its ranges, whatever else is unknown:
    /// that knowledge, `1 / unmeasured^2`, keeps the variance of a direction nobody measured finite
    /// and beyond doubt.
    fn covariance(&self, sound: &[Sample], x: &State, trust: &Trust) -> Option<Matrix4<f64>> {
        let factor = trust.variance_factor();
        let mut total = information(sound, x, &self.unknowns) / factor;
        // The second part keeps the matrix invertible in f64 whatever the numbers.
        let floor = 1.0 / trust.unmeasured_m2 + 1e-14 * total.diagonal().max();
        for i in 0..3 {
            total[(i, i)] += floor;
        }
        total[(3, 3)] += self.unknowns.prior_weight;
        self.unknowns.hold_given(&mut total);
        let nominal = total.cholesky()?.inverse();

        let mut covariance = nominal;
        if trust.outlier_rate > 0.0 {
            let mut hidden = Matrix4::zeros();
            for sample in sound {
                let j = jacobian(sample, x, self.unknowns.free);
                let leverage = j.dot(&(nominal * j)) / factor;
                hidden += j * j.transpose() * (trust.hidden_outlier(leverage) / (factor * factor));
            }
            covariance += nominal * hidden * nominal;
        }
        for i in (0..4).filter(|&i| !self.unknowns.free[i]) {
            covariance.row_mut(i).fill(0.0);
            covariance.column_mut(i).fill(0.0);
        }
        Some((covariance + covariance.transpose()) * 0.5)
    }

    /// Other minima over all samples, the lowest first.
    pub(super) fn rivals(&self, solution: &Solution, extra: &[Fit]) -> Vec<Fit> {
        // Bounds on the height serve to choose between mirror images, so those must be known.
        let chooses = matches!(self.options.height, Height::Between { .. });
        if !(self.options.seek_alternatives || chooses) {
            return Vec::new();
        }
        ambiguity::competitors(
            &solution.fit,
            &solution.position_covariance(),
            &solution.shape,
            extra,
            &self.samples,
            &self.fitter(),
            solution.trust.prior_factor(solution.fit.scale),
        )
    }

    /// The lowest rival that beats the solution.
    pub(super) fn better_rival(&self, solution: &Solution, rivals: &[Fit]) -> Option<Fit> {
        let rival = rivals
            .iter()
            .find(|rival| self.allows(&rival.x, solution))?;
        // Mirror images of a flat path differ by rounding only.
        const MARGIN: f64 = 1e-6;
        let beaten =
            rival.cost < solution.cost_of_all - MARGIN || !self.allows(&solution.fit.x, solution);
        beaten.then_some(*rival)
    }

    /// Whether a place agrees with the bounds on the height, give or take three standard
    /// deviations.
    fn allows(&self, x: &State, solution: &Solution) -> bool {
        match self.options.height {
            Height::Between { min_m, max_m } => {
                let height = x.z + self.origin.z;
                let slack = 3.0 * solution.covariance[(2, 2)].sqrt();
                (min_m - slack..=max_m + slack).contains(&height)
            }
            _ => true,
        }
    }

    /// Log-likelihood of a place, up to a constant; see [`crate::ambiguity`].
    fn log_likelihood(&self, x: &State, solution: &Solution) -> f64 {
        let trust = &solution.trust;
        let one_residual =
            solution.fit.scale.powi(2) + trust.systematic / solution.sound.len() as f64;
        let misfit = ambiguity::misfit(&self.samples, x, one_residual.sqrt());
        let prior_misfit = x.w - self.unknowns.prior_bias;
        -0.5 * (misfit * one_residual / trust.variance_factor()
            + self.unknowns.prior_weight * prior_misfit * prior_misfit)
    }

    pub(super) fn conclude(
        &self,
        solution: Solution,
        rivals: &[Fit],
    ) -> Result<Localisation, SolveError> {
        let x = solution.fit.x;
        if !self.allows(&x, &solution) {
            return Err(SolveError::OutsideHeights {
                height_m: x.z + self.origin.z,
            });
        }
        let place = x.xyz();
        let local = solution.position_covariance();
        let height_known = self.known_height().is_some();
        let (mut observability, mut covariance) =
            observability::judge(place, &local, &solution.shape, height_known);

        let mut alternative = None;
        for rival in rivals
            .iter()
            .filter(|rival| self.allows(&rival.x, &solution))
        {
            let log_ratio =
                self.log_likelihood(&x, &solution) - self.log_likelihood(&rival.x, &solution);
            let probability = ambiguity::probability(log_ratio.max(0.0));
            if probability < EXCLUDED_BELOW {
                continue;
            }
            let at_rival = self
                .covariance(&solution.sound, &rival.x, &solution.trust)
                .ok_or(SolveError::Diverged)?;
            let covariance_m2 = at_rival.fixed_view::<3, 3>(0, 0).into_owned();
            covariance = observability::mixture(
                &covariance,
                &covariance_m2,
                rival.x.xyz() - place,
                probability,
            );
            alternative.get_or_insert(Alternative {
                position_m: rival.x.xyz() + self.origin,
                covariance_m2,
                probability,
            });
        }
        if alternative.is_some()
            && matches!(
                observability,
                Observability::Unique | Observability::Weak { .. }
            )
        {
            observability = Observability::Mirror;
        }

        let mut residuals = vec![
            Residual {
                residual_m: 0.0,
                used: false
            };
            self.samples.len()
        ];
        let mut square_sum = 0.0;
        for ((sample, used), index) in self.samples.iter().zip(&solution.used).zip(&self.order) {
            let residual_m = -sample.misfit(&x);
            if *used {
                square_sum += residual_m * residual_m;
            }
            if let Some(slot) = residuals.get_mut(*index) {
                *slot = Residual {
                    residual_m,
                    used: *used,
                };
            }
        }
        let used = solution.sound.len();
        Ok(Localisation {
            position_m: place + self.origin,
            covariance_m2: covariance,
            local_covariance_m2: local,
            sigma_m: covariance
                .diagonal()
                .map(|variance| variance.max(0.0).sqrt()),
            range_bias_m: x.w,
            range_bias_sigma_m: solution.covariance[(3, 3)].max(0.0).sqrt(),
            position_bias_m2: solution.covariance.fixed_view::<3, 1>(0, 3).into_owned(),
            residual_rms_m: (square_sum / used as f64).sqrt(),
            used,
            rejected: self.samples.len() - used,
            effective_measurements: solution.trust.noise.effective,
            residuals,
            alternative,
            observability: observability.moved_by(self.origin),
            condition: condition(&local, solution.trust.unmeasured_m2, height_known),
        })
    }
}

/// Largest over smallest variance of the free coordinates.
fn condition(local: &Matrix3<f64>, unmeasured_m2: f64, height_known: bool) -> f64 {
    let (variances, _) = descending_eigen(*local);
    let smallest = if height_known {
        variances[1]
    } else {
        variances[2]
    };
    let ratio = variances[0] / smallest;
    if variances[0] > 0.5 * unmeasured_m2 || !(0.0..1e13).contains(&ratio) {
        f64::INFINITY
    } else {
        ratio
    }
}

/// Order by time; where times are equal by place and range, so that no trace of the order in which
/// they were given remains.
fn canonical(a: &RangeMeasurement, b: &RangeMeasurement) -> std::cmp::Ordering {
    let key = |m: &RangeMeasurement| {
        [
            m.t_s,
            m.position_m.x,
            m.position_m.y,
            m.position_m.z,
            m.range_m,
            m.sigma_m,
        ]
    };
    key(a)
        .iter()
        .zip(&key(b))
        .map(|(a, b)| a.total_cmp(b))
        .find(|order| order.is_ne())
        .unwrap_or(std::cmp::Ordering::Equal)
}

/// How far errors of the places themselves can bend the ranges, in metres.
///
/// A place that is off by `e` across the line of sight is `e^2 / 2R` too far
/// away: an error with a mean, which no number of measurements averages out and
/// which can make a mirror image fit better. The spread of the residuals bounds
/// `e`; two directions lie across.
fn bent_by_noise(sound: &[Sample], scale: f64) -> f64 {
    let n = sound.len().max(1) as f64;
    let variance = scale * scale * sound.iter().map(|s| s.inv_sigma.powi(-2)).sum::<f64>() / n;
    let reach = sound.iter().map(|s| s.range.abs()).sum::<f64>() / n;
    if reach > 0.0 { variance / reach } else { 0.0 }
}
