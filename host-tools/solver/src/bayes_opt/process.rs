//! What is believed about a function after some evaluations.

use nalgebra::SVector;

use super::correlation::Matern52;

/// Added to the diagonal of the correlations: keeps the factor regular where two points nearly
/// coincide. The function's values count as exact to a thousandth of their spread.
const NUGGET: f64 = 1e-6;

/// A Gaussian process over `D` variables, of the order of one, after exact evaluations `y_i` at
/// `x_i`. With correlations `K = k(x_i, x_j) + nugget I = L L^T`:
///
/// ```text
/// a = L^-1 y,  b = L^-1 1
/// m = a.b / b.b                        mean of the process      } where the likelihood of
/// s^2 = |a - m b|^2 / n                its variance             } what was seen is largest
/// v = L^-1 k(x, x_i)
/// mean(x)     = m + v.(a - m b)
/// variance(x) = s^2 [1 - v.v + (1 - v.b)^2 / b.b]
/// log likelihood = -n/2 log s^2 - sum log L_ii + const
/// ```
///
/// The last term of the variance is there because `m` is estimated (Rasmussen and Williams 2006,
/// Eq. 2.42 with an uninformative prior). An evaluation appends one row to `L`, `a` and `b`.
#[derive(Debug, Clone)]
pub struct GaussianProcess<const D: usize> {
    kernel: Matern52<D>,
    points: Vec<SVector<f64, D>>,
    values: Vec<f64>,
    /// `L`, row by row: row `i` starts at `i (i + 1) / 2`.
    factor: Vec<f64>,
    a: Vec<f64>,
    b: Vec<f64>,
    /// Of the row or of `v` that is being computed.
    scratch: Vec<f64>,
    sums: Sums,
}

/// Products that grow with every evaluation.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    aa: f64,
    ab: f64,
    bb: f64,
    log_diagonal: f64,
}

/// What a [`GaussianProcess`] says about one point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prediction {
    /// Expected value.
    pub mean: f64,
    /// Standard deviation.
    pub sigma: f64,
}

/// `v.v`, `v.a` and `v.b` of a point: all that its prediction takes.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Products {
    pub(super) vv: f64,
    pub(super) va: f64,
    pub(super) vb: f64,
}

impl<const D: usize> GaussianProcess<D> {
    /// Nothing seen yet; `length_scales` in units of the points.
    pub fn new(length_scales: &SVector<f64, D>) -> Self {
        Self {
            kernel: Matern52::new(length_scales),
            points: Vec::new(),
            values: Vec::new(),
            factor: Vec::new(),
            a: Vec::new(),
            b: Vec::new(),
            scratch: Vec::new(),
            sums: Sums::default(),
        }
    }

    /// Forgets everything but keeps the memory.
    pub(super) fn restart(&mut self, length_scales: &SVector<f64, D>) {
        self.kernel = Matern52::new(length_scales);
        self.points.clear();
        self.values.clear();
        self.clear_factor();
    }

    /// Looks at the same evaluations with other length scales.
    pub(super) fn rescale(&mut self, length_scales: &SVector<f64, D>) {
        self.kernel = Matern52::new(length_scales);
        self.clear_factor();
        for i in 0..self.points.len() {
            self.append_row(i);
        }
    }

    fn clear_factor(&mut self) {
        self.factor.clear();
        self.a.clear();
        self.b.clear();
        self.sums = Sums::default();
    }

    /// Takes in an evaluation.
    pub fn observe(&mut self, x: SVector<f64, D>, value: f64) {
        self.points.push(x);
        self.values.push(value);
        self.append_row(self.points.len() - 1);
    }

    fn append_row(&mut self, n: usize) {
        let mut row = std::mem::take(&mut self.scratch);
        self.whiten(&self.points[n], n, &mut row);
        let dot = |with: &[f64]| -> f64 { row.iter().zip(with).map(|(r, w)| r * w).sum() };
        let (rr, ra, rb) = (dot(&row), dot(&self.a), dot(&self.b));
        // Positive in exact arithmetic, thanks to the nugget.
        let diagonal = (1.0 + NUGGET - rr).max(0.5 * NUGGET).sqrt();
        let (a, b) = ((self.values[n] - ra) / diagonal, (1.0 - rb) / diagonal);
        self.factor.extend_from_slice(&row);
        self.factor.push(diagonal);
        self.a.push(a);
        self.b.push(b);
        self.sums.aa += a * a;
        self.sums.ab += a * b;
        self.sums.bb += b * b;
        self.sums.log_diagonal += diagonal.ln();
        self.scratch = row;
    }

    /// `v = L^-1 k(x, x_i)` over the first `n` evaluations.
    fn whiten(&self, x: &SVector<f64, D>, n: usize, v: &mut Vec<f64>) {
        v.clear();
        for (i, point) in self.points[..n].iter().enumerate() {
            let row = self.factor_row(i);
            let known: f64 = row.iter().zip(v.iter()).map(|(l, v)| l * v).sum();
            v.push((self.kernel.at(x, point) - known) / row[i]);
        }
    }

    /// How many evaluations it has seen.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether it has seen none.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// What it says about a point; before the first evaluation it knows nothing and says so with an
    /// infinite sigma.
    pub fn predict(&mut self, x: &SVector<f64, D>) -> Prediction {
        let mut v = std::mem::take(&mut self.scratch);
        self.whiten(x, self.points.len(), &mut v);
        let dot = |with: &[f64]| -> f64 { v.iter().zip(with).map(|(v, w)| v * w).sum() };
        let products = Products {
            vv: dot(&v),
            va: dot(&self.a),
            vb: dot(&self.b),
        };
        self.scratch = v;
        self.predict_from(&products)
    }

    /// The same from the products of `v`.
    #[inline]
    pub(super) fn predict_from(&self, products: &Products) -> Prediction {
        if self.is_empty() {
            return Prediction {
                mean: 0.0,
                sigma: f64::INFINITY,
            };
        }
        let (m, variance) = (self.mean(), self.variance());
        let left = 1.0 - products.vb;
        let share = 1.0 - products.vv + left * left / self.sums.bb;
        Prediction {
            mean: m + products.va - m * products.vb,
            sigma: (variance * share).max(0.0).sqrt(),
        }
    }

    /// `m`.
    fn mean(&self) -> f64 {
        self.sums.ab / self.sums.bb
    }

    /// `s^2`.
    fn variance(&self) -> f64 {
        let squares = self.sums.aa - self.mean() * self.sums.ab;
        squares.max(0.0) / self.points.len() as f64
    }

    /// How well the length scales explain what has been seen, up to a constant.
    pub fn log_likelihood(&self) -> f64 {
        // A constant function would have a likelihood without bound.
        let variance = self.variance().max(f64::MIN_POSITIVE);
        -0.5 * self.points.len() as f64 * variance.ln() - self.sums.log_diagonal
    }

    pub(super) fn correlation(&self, x: &SVector<f64, D>, n: usize) -> f64 {
        self.kernel.at(x, &self.points[n])
    }

    /// Row `n` of `L`, its diagonal last.
    pub(super) fn factor_row(&self, n: usize) -> &[f64] {
        let start = n * (n + 1) / 2;
        &self.factor[start..=start + n]
    }

    /// Elements `n` of `a` and `b`.
    pub(super) fn whitened_value(&self, n: usize) -> (f64, f64) {
        (self.a[n], self.b[n])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector, Vector2};

    fn points() -> Vec<Vector2<f64>> {
        (0..9)
            .map(|i| {
                let i = f64::from(i);
                Vector2::new((0.37 * i).fract(), (0.61 * i + 0.2).fract())
            })
            .collect()
    }

    fn value(x: &Vector2<f64>) -> f64 {
        (5.0 * x.x).sin() + x.y * x.y + 4.0
    }

    fn trained(scales: &Vector2<f64>) -> GaussianProcess<2> {
        let mut process = GaussianProcess::new(scales);
        for x in points() {
            process.observe(x, value(&x));
        }
        process
    }

    /// Generalised least squares for the mean, then the textbook's posterior, all with a dense
    /// inverse.
    fn direct(scales: &Vector2<f64>, x: &Vector2<f64>) -> (f64, f64, f64) {
        let points = points();
        let n = points.len();
        let kernel = Matern52::new(scales);
        let correlations = DMatrix::from_fn(n, n, |i, j| {
            kernel.at(&points[i], &points[j]) + if i == j { NUGGET } else { 0.0 }
        });
        let determinant = correlations.determinant();
        let inverse = correlations.try_inverse().unwrap();
        let y = DVector::from_iterator(n, points.iter().map(value));
        let one = DVector::from_element(n, 1.0);
        let k = DVector::from_iterator(n, points.iter().map(|p| kernel.at(x, p)));
        let precision = one.dot(&(&inverse * &one));
        let m = one.dot(&(&inverse * &y)) / precision;
        let centred = &y - &one * m;
        let variance = centred.dot(&(&inverse * &centred)) / n as f64;
        let mean = m + k.dot(&(&inverse * &centred));
        let left = 1.0 - one.dot(&(&inverse * &k));
        let spread = variance * (1.0 - k.dot(&(&inverse * &k)) + left * left / precision);
        let likelihood = -0.5 * n as f64 * variance.ln() - 0.5 * determinant.ln();
        (mean, spread.sqrt(), likelihood)
    }

    #[test]
    fn row_by_row_is_the_direct_formula() {
        let scales = Vector2::new(0.4, 0.7);
        let mut process = trained(&scales);
        for x in [
            Vector2::new(0.1, 0.9),
            Vector2::new(0.55, 0.45),
            Vector2::new(3.0, 3.0),
        ] {
            let (mean, sigma, likelihood) = direct(&scales, &x);
            let found = process.predict(&x);
            assert!((found.mean - mean).abs() < 1e-9, "{found:?} {mean}");
            assert!((found.sigma - sigma).abs() < 1e-8, "{found:?} {sigma}");
            assert!((process.log_likelihood() - likelihood).abs() < 1e-8);
        }
    }

    #[test]
    fn other_length_scales_are_as_if_they_had_been_there_from_the_start() {
        let (first, second) = (Vector2::new(0.4, 0.7), Vector2::new(0.2, 0.3));
        let mut rescaled = trained(&first);
        rescaled.rescale(&second);
        let mut fresh = trained(&second);
        let x = Vector2::new(0.3, 0.3);
        assert_eq!(rescaled.predict(&x), fresh.predict(&x));
        assert_eq!(rescaled.log_likelihood(), fresh.log_likelihood());
    }

    #[test]
    fn what_was_seen_is_known_and_what_is_far_is_not() {
        let mut process = trained(&Vector2::new(0.4, 0.7));
        for x in points() {
            let seen = process.predict(&x);
            assert!((seen.mean - value(&x)).abs() < 1e-3, "{seen:?}");
            assert!(seen.sigma < 2e-3, "{seen:?}");
        }
        assert!(process.predict(&Vector2::new(9.0, 9.0)).sigma > 0.3);
    }

    #[test]
    fn the_same_point_twice_leaves_finite_numbers() {
        let mut process = GaussianProcess::new(&Vector2::new(0.5, 0.5));
        let nothing_known = process.predict(&Vector2::zeros());
        assert_eq!(nothing_known.sigma, f64::INFINITY);
        for _ in 0..5 {
            process.observe(Vector2::new(0.5, 0.5), 2.0);
        }
        let found = process.predict(&Vector2::new(0.6, 0.5));
        assert!((found.mean - 2.0).abs() < 1e-6, "{found:?}");
        assert!(found.sigma.is_finite() && process.log_likelihood().is_finite());
    }
}
