//! Levenberg-Marquardt on the normal equations, for a handful of parameters.
//!
//! A problem gives, at a point `x`, its cost `F(x)`, the gradient `g = grad F` and the Gauss-Newton
//! approximation `H` of the second derivatives. One iteration solves
//!
//! ```text
//! (H + lambda diag(H)) step = -g
//! ```
//!
//! and keeps the step if the cost falls. The damping follows Nielsen's rule (Madsen, Nielsen,
//! Tingleff, "Methods for non-linear least squares problems", 2004, sec. 3.2): it shrinks as the
//! quadratic model proves right, and grows faster with each failure. Normal equations lose digits
//! where `H` is nearly singular; with metres and at most a few tens of parameters in `f64` that
//! costs nothing visible, and it needs no storage that grows with the number of measurements.
//! Everything lives on the stack.

use nalgebra::{Cholesky, Const, SMatrix, SVector};

/// Cost and its derivatives at one point.
#[derive(Debug, Clone, Copy)]
pub struct NormalEquations<const N: usize> {
    /// `F(x)`, half the sum of robust squared residuals.
    pub cost: f64,
    /// `grad F(x) = sum w r J`.
    pub gradient: SVector<f64, N>,
    /// `H = sum w J^T J`, symmetric and positive semidefinite.
    pub hessian: SMatrix<f64, N, N>,
}

impl<const N: usize> NormalEquations<N> {
    /// All zero: what sums start from.
    pub fn zeros() -> Self {
        Self {
            cost: 0.0,
            gradient: SVector::zeros(),
            hessian: SMatrix::zeros(),
        }
    }
}

/// A sum of squares to be minimised over `N` parameters.
pub trait LeastSquares<const N: usize> {
    /// Cost and derivatives at `x`.
    fn linearise(&self, x: &SVector<f64, N>) -> NormalEquations<N>;
}

/// When to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LmOptions {
    /// Most evaluations of the problem, accepted or not.
    pub max_evaluations: u32,
    /// Converged once a step promises to lower the cost by less than this (plus one part in 1e14 of
    /// the cost). The cost counts squared sigmas, so 1e-8 leaves the answer within about 1e-4
    /// standard deviations of the minimum.
    pub decrease_tolerance: f64,
    /// Damping to begin with, relative to the diagonal of `H`.
    pub initial_damping: f64,
}

impl Default for LmOptions {
    fn default() -> Self {
        Self {
            max_evaluations: 100,
            decrease_tolerance: 1e-8,
            initial_damping: 1e-4,
        }
    }
}

/// How the iteration ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LmStop {
    /// No further decrease worth having.
    Converged,
    /// The evaluations ran out first; the point is the best seen.
    EvaluationLimit,
    /// The start itself has no finite cost; the point is the start.
    NotFinite,
}

/// Where the iteration ended.
#[derive(Debug, Clone, Copy)]
pub struct LmOutcome<const N: usize> {
    /// The best point seen.
    pub x: SVector<f64, N>,
    /// Cost and derivatives there.
    pub normal: NormalEquations<N>,
    /// Evaluations of the problem spent.
    pub evaluations: u32,
    /// Why it stopped.
    pub stop: LmStop,
}

/// Walks downhill from `start`. Never panics and never returns a point worse than the start.
pub fn minimise<const N: usize>(
    problem: &impl LeastSquares<N>,
    start: SVector<f64, N>,
    options: &LmOptions,
) -> LmOutcome<N> {
    let mut x = start;
    let mut normal = problem.linearise(&x);
    let mut evaluations = 1;
    let outcome = |x, normal, evaluations, stop| LmOutcome {
        x,
        normal,
        evaluations,
        stop,
    };
    if !normal.cost.is_finite() {
        return outcome(x, normal, evaluations, LmStop::NotFinite);
    }

    let mut damping = options.initial_damping;
    let mut growth = 2.0;
    while evaluations < options.max_evaluations {
        let Some(step) = damped_step(&normal, damping) else {
            // Not positive definite at this damping. Once the damping dwarfs H there is no
            // direction left to go.
            damping *= growth;
            growth *= 2.0;
            if damping > 1e12 {
                return outcome(x, normal, evaluations, LmStop::Converged);
            }
            continue;
        };
        // Decrease promised by the quadratic model: -g.s - 1/2 s.H.s.
        let promised = -normal.gradient.dot(&step) - 0.5 * step.dot(&(normal.hessian * step));
        let negligible = promised <= options.decrease_tolerance + 1e-14 * normal.cost;
        let candidate = x + step;
        let at_candidate = problem.linearise(&candidate);
        evaluations += 1;
        let gain = (normal.cost - at_candidate.cost) / promised;
        // The last step may drown in the rounding of the cost and is right all the same.
        let rounding = if negligible {
            1e-13 * (1.0 + normal.cost)
        } else {
            0.0
        };
        if at_candidate.cost < normal.cost + rounding {
            x = candidate;
            normal = at_candidate;
            damping = (damping * (1.0 - (2.0 * gain - 1.0).powi(3)).max(1.0 / 3.0)).max(1e-12);
            growth = 2.0;
        } else {
            damping *= growth;
            growth *= 2.0;
        }
        if negligible {
            return outcome(x, normal, evaluations, LmStop::Converged);
        }
    }
    outcome(x, normal, evaluations, LmStop::EvaluationLimit)
}

/// Solves `(H + damping diag(H)) step = -g`; `None` where the matrix is not positive definite.
fn damped_step<const N: usize>(
    normal: &NormalEquations<N>,
    damping: f64,
) -> Option<SVector<f64, N>> {
    let mut damped = normal.hessian;
    // A parameter without any information (a zero on the diagonal) would stay singular under
    // Marquardt's scaling.
    let floor = 1e-12 * normal.hessian.diagonal().max();
    for i in 0..N {
        let diagonal = normal.hessian[(i, i)];
        damped[(i, i)] = diagonal + damping * diagonal.max(floor);
    }
    let step = Cholesky::<f64, Const<N>>::new(damped)?.solve(&(-normal.gradient));
    step.iter().all(|s| s.is_finite()).then_some(step)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix2, Vector2};

    /// Rosenbrock's valley as least squares: r = (10 (y - x^2), 1 - x), minimum at (1, 1).
    struct Rosenbrock;
    impl LeastSquares<2> for Rosenbrock {
        fn linearise(&self, p: &Vector2<f64>) -> NormalEquations<2> {
            let r = Vector2::new(10.0 * (p.y - p.x * p.x), 1.0 - p.x);
            let j = Matrix2::new(-20.0 * p.x, 10.0, -1.0, 0.0);
            NormalEquations {
                cost: 0.5 * r.norm_squared(),
                gradient: j.transpose() * r,
                hessian: j.transpose() * j,
            }
        }
    }

    /// Only the first of two parameters is ever measured.
    struct HalfBlind;
    impl LeastSquares<2> for HalfBlind {
        fn linearise(&self, p: &Vector2<f64>) -> NormalEquations<2> {
            let r = p.x - 3.0;
            NormalEquations {
                cost: 0.5 * r * r,
                gradient: Vector2::new(r, 0.0),
                hessian: Matrix2::new(1.0, 0.0, 0.0, 0.0),
            }
        }
    }

    struct NotANumber;
    impl LeastSquares<1> for NotANumber {
        fn linearise(&self, _: &SVector<f64, 1>) -> NormalEquations<1> {
            NormalEquations {
                cost: f64::NAN,
                ..NormalEquations::zeros()
            }
        }
    }

    #[test]
    fn finds_the_bottom_of_rosenbrocks_valley() {
        let options = LmOptions {
            decrease_tolerance: 1e-18,
            ..LmOptions::default()
        };
        let end = minimise(&Rosenbrock, Vector2::new(-1.2, 1.0), &options);
        assert_eq!(end.stop, LmStop::Converged);
        assert!((end.x - Vector2::new(1.0, 1.0)).norm() < 1e-9, "{}", end.x);
    }

    #[test]
    fn parameter_without_information_stays_where_it_was() {
        let end = minimise(&HalfBlind, Vector2::new(0.0, 7.0), &LmOptions::default());
        assert_eq!(end.stop, LmStop::Converged);
        assert!((end.x.x - 3.0).abs() < 1e-9);
        assert_eq!(end.x.y, 7.0);
    }

    #[test]
    fn nan_cost_is_an_outcome_not_a_panic() {
        let end = minimise(
            &NotANumber,
            SVector::<f64, 1>::zeros(),
            &LmOptions::default(),
        );
        assert_eq!(end.stop, LmStop::NotFinite);
    }

    #[test]
    fn evaluation_limit_is_kept_and_said() {
        let options = LmOptions {
            max_evaluations: 3,
            ..LmOptions::default()
        };
        let end = minimise(&Rosenbrock, Vector2::new(-1.2, 1.0), &options);
        assert_eq!((end.stop, end.evaluations), (LmStop::EvaluationLimit, 3));
    }
}
