//! A fixed set of points whose predictions are kept up to date.

use nalgebra::SVector;

use super::improvement::{expected_improvement, improvement_bound};
use super::process::{GaussianProcess, Products};
use super::sequence::EvenSequence;

/// Points spread over the unit box. A new evaluation adds one element to each point's `v = L^-1
/// k(x, x_i)`; computing `v` afresh would cost as many again as there are evaluations.
#[derive(Debug, Clone)]
pub(super) struct Candidates<const D: usize> {
    points: Vec<SVector<f64, D>>,
    /// Elements of `v`: those of evaluation `i` for all candidates in a row, so that the loop over
    /// candidates runs through memory.
    rows: Vec<f64>,
    products: Vec<Products>,
    seen: usize,
}

impl<const D: usize> Candidates<D> {
    pub(super) fn new(count: usize, sequence: &mut EvenSequence<D>) -> Self {
        Self {
            points: (0..count).map(|_| sequence.next_point()).collect(),
            rows: Vec::new(),
            products: vec![Products::default(); count],
            seen: 0,
        }
    }

    /// As if nothing had been evaluated.
    pub(super) fn restart(&mut self) {
        self.rows.clear();
        self.products.fill(Products::default());
        self.seen = 0;
    }

    /// Takes in what the process has seen since the last call.
    pub(super) fn follow(&mut self, process: &GaussianProcess<D>) {
        let count = self.points.len();
        for n in self.seen..process.len() {
            let factor = process.factor_row(n);
            let (a, b) = process.whitened_value(n);
            let start = self.rows.len();
            self.rows
                .extend(self.points.iter().map(|x| process.correlation(x, n)));
            let (before, row) = self.rows.split_at_mut(start);
            for (earlier, l) in before.chunks_exact(count).zip(factor) {
                for (v, e) in row.iter_mut().zip(earlier) {
                    *v -= l * e;
                }
            }
            let reciprocal = 1.0 / factor[n];
            for (v, products) in row.iter_mut().zip(&mut self.products) {
                *v *= reciprocal;
                products.vv += *v * *v;
                products.va += *v * a;
                products.vb += *v * b;
            }
        }
        self.seen = process.len();
    }

    /// The point with the largest expected improvement on `best`, and that improvement.
    pub(super) fn most_promising(
        &self,
        process: &GaussianProcess<D>,
        best: f64,
    ) -> Option<(SVector<f64, D>, f64)> {
        let mut found: Option<(SVector<f64, D>, f64)> = None;
        for (x, products) in self.points.iter().zip(&self.products) {
            let at = process.predict_from(products);
            let so_far = found.map_or(f64::NEG_INFINITY, |(_, promise)| promise);
            if improvement_bound(at.mean, at.sigma, best) > so_far {
                let promise = expected_improvement(at.mean, at.sigma, best);
                if promise > so_far {
                    found = Some((*x, promise));
                }
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector2;

    #[test]
    fn kept_predictions_are_those_computed_afresh() {
        let mut sequence = EvenSequence::<2>::new(3);
        let mut candidates = Candidates::new(50, &mut sequence);
        let mut process = GaussianProcess::new(&Vector2::new(0.3, 0.5));
        for _ in 0..12 {
            let x = sequence.next_point();
            process.observe(x, (7.0 * x.x).cos() * x.y);
            candidates.follow(&process);
            let best = -0.2;
            let (x, promise) = candidates.most_promising(&process, best).unwrap();
            let fresh: Vec<f64> = candidates
                .points
                .iter()
                .map(|x| {
                    let at = process.predict(x);
                    expected_improvement(at.mean, at.sigma, best)
                })
                .collect();
            let largest = fresh.iter().copied().fold(0.0, f64::max);
            assert!((promise - largest).abs() < 1e-9, "{promise} {largest}");
            let at = process.predict(&x);
            let again = expected_improvement(at.mean, at.sigma, best);
            assert!((again - promise).abs() < 1e-9);
        }
    }
}
