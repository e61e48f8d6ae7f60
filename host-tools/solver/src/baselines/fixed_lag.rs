//! The last stretch of a path in the plane, from steps of odometry and ranges to one anchor.
//!
//! Unknown are the horizontal offsets `w_0 .. w_n` of the vehicle from the anchor at the last
//! ranges. With heights `h_i` above the anchor taken as exact, steps `s_i` of odometry and ranges
//! `d_i`, what is minimised is
//!
//! ```text
//! |w_0 - m|^2_A + sum |w_i - w_(i-1) - s_i|^2 / v_i + sum (sqrt(|w_i|^2 + h_i^2) - d_i)^2 / sigma^2
//! ```
//!
//! by Gauss-Newton. The chain is solved from its beginning to its end and back, in 2 x 2 blocks;
//! what falls out at the beginning leaves its information behind as `(m, A)`.

use std::collections::VecDeque;

use nalgebra::{Matrix2, Vector2};

/// Gauss-Newton steps after each range; the path moves by little from one to the next.
const STEPS: usize = 3;

/// A range and how the vehicle got there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Node {
    /// Estimated horizontal offset from the anchor, metres.
    offset_m: Vector2<f64>,
    /// Above the anchor, metres.
    height_m: f64,
    range_m: f64,
    /// Odometry from the node before, metres.
    step_m: Vector2<f64>,
    /// `1 / v`.
    step_weight: f64,
}

/// Information about one node: `1/2 d^T A d + g^T d` for a change `d` of its offset.
#[derive(Debug, Clone, Copy)]
struct Quadratic {
    information: Matrix2<f64>,
    gradient: Vector2<f64>,
}

/// The path's last stretch.
#[derive(Debug, Clone)]
pub(super) struct FixedLag {
    nodes: VecDeque<Node>,
    most_nodes: usize,
    range_weight: f64,
    /// `m` and `A`.
    prior: (Vector2<f64>, Matrix2<f64>),
    covariance: Matrix2<f64>,
    /// Of each node, with all before it eliminated.
    sums: Vec<(Matrix2<f64>, Vector2<f64>)>,
}

impl FixedLag {
    /// At `offset_m` from the anchor, known up to `sigma_m` along each axis, with ranges of
    /// standard deviation `range_sigma_m`.
    pub(super) fn new(
        offset_m: Vector2<f64>,
        sigma_m: f64,
        range_sigma_m: f64,
        most_nodes: usize,
    ) -> Self {
        let most_nodes = most_nodes.max(2);
        Self {
            nodes: VecDeque::with_capacity(most_nodes + 1),
            most_nodes,
            range_weight: range_sigma_m.powi(-2),
            prior: (offset_m, Matrix2::identity() * sigma_m.powi(-2)),
            covariance: Matrix2::identity() * (sigma_m * sigma_m),
            sums: Vec::with_capacity(most_nodes + 1),
        }
    }

    /// The newest offset, metres.
    pub(super) fn offset_m(&self) -> Vector2<f64> {
        self.nodes.back().map_or(self.prior.0, |node| node.offset_m)
    }

    /// Its covariance, m^2.
    pub(super) fn covariance_m2(&self) -> Matrix2<f64> {
        self.covariance
    }

    /// A range, after a step of odometry of variance `step_variance` (m^2, each axis) since the
    /// range before; of the first one the step is the start's affair. Returns false and stays as
    /// it was where the numbers allow no solution.
    pub(super) fn push(
        &mut self,
        step_m: Vector2<f64>,
        step_variance: f64,
        height_m: f64,
        range_m: f64,
    ) -> bool {
        let before = (self.prior, self.covariance);
        let offset_m = self.offset_m() + step_m;
        self.nodes.push_back(Node {
            offset_m,
            height_m,
            range_m,
            step_m,
            step_weight: 1.0 / step_variance,
        });
        if self.solve().is_some() {
            if self.nodes.len() > self.most_nodes {
                self.forget_first();
            }
            true
        } else {
            self.nodes.pop_back();
            (self.prior, self.covariance) = before;
            false
        }
    }

    fn solve(&mut self) -> Option<()> {
        for _ in 0..STEPS {
            self.eliminate()?;
            self.substitute();
        }
        Some(())
    }

    /// From the first node to the last: what all before tell about each.
    fn eliminate(&mut self) -> Option<()> {
        self.sums.clear();
        let mut carried: Option<Quadratic> = None;
        for i in 0..self.nodes.len() {
            let mut sum = self.of_node(i);
            if let Some(carried) = carried {
                sum.information += carried.information;
                sum.gradient += carried.gradient;
            }
            if i + 1 < self.nodes.len() {
                let (inverse, gradient, onwards) = self.eliminated(sum, i + 1)?;
                self.sums.push((inverse, gradient));
                carried = Some(onwards);
            } else {
                let inverse = sum.information.cholesky()?.inverse();
                self.covariance = inverse;
                self.sums.push((inverse, sum.gradient));
            }
        }
        Some(())
    }

    /// Eliminates the node before `next`, of which `sum` is known without the step: the inverse of
    /// its information with the step, its gradient likewise, and what it tells about `next`.
    fn eliminated(
        &self,
        sum: Quadratic,
        next: usize,
    ) -> Option<(Matrix2<f64>, Vector2<f64>, Quadratic)> {
        let weight = self.nodes[next].step_weight;
        let pull = self.step_misfit(next) * weight;
        let inverse = (sum.information + Matrix2::identity() * weight)
            .cholesky()?
            .inverse();
        let gradient = sum.gradient - pull;
        let onwards = Quadratic {
            information: Matrix2::identity() * weight - inverse * (weight * weight),
            gradient: pull + inverse * gradient * weight,
        };
        Some((inverse, gradient, onwards))
    }

    /// From the last node back to the first: the changes.
    fn substitute(&mut self) {
        let mut change = Vector2::zeros();
        for i in (0..self.nodes.len()).rev() {
            let weight = self.nodes.get(i + 1).map_or(0.0, |next| next.step_weight);
            let (inverse, gradient) = self.sums[i];
            change = inverse * (change * weight - gradient);
            self.nodes[i].offset_m += change;
        }
    }

    fn forget_first(&mut self) {
        let sum = self.of_node(0);
        let Some((_, _, onwards)) = self.eliminated(sum, 1) else {
            return;
        };
        let Some(cholesky) = onwards.information.cholesky() else {
            return;
        };
        let mean = self.nodes[1].offset_m - cholesky.solve(&onwards.gradient);
        self.prior = (mean, onwards.information);
        self.nodes.pop_front();
    }

    /// What a node's own range tells about it, and the prior about the first.
    fn of_node(&self, i: usize) -> Quadratic {
        let node = &self.nodes[i];
        let distance = node.offset_m.norm().hypot(node.height_m);
        let direction = if distance > 0.0 {
            node.offset_m / distance
        } else {
            Vector2::zeros()
        };
        let pull = (distance - node.range_m) * self.range_weight;
        let mut quadratic = Quadratic {
            information: direction * direction.transpose() * self.range_weight,
            gradient: direction * pull,
        };
        if i == 0 {
            let (mean, information) = self.prior;
            quadratic.information += information;
            quadratic.gradient += information * (node.offset_m - mean);
        }
        quadratic
    }

    fn step_misfit(&self, i: usize) -> Vector2<f64> {
        self.nodes[i].offset_m - self.nodes[i - 1].offset_m - self.nodes[i].step_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    const NEAR: Vector2<f64> = Vector2::new(-20.0, 3.0);
    const SIGMA_M: f64 = 0.1;
    const STEP_VARIANCE: f64 = 0.01;

    fn drive(n: usize, start: Vector2<f64>, seed: u64) -> Vec<(Vector2<f64>, f64, f64)> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut noise = move || -> f64 { StandardNormal.sample(&mut rng) };
        let mut at = start;
        (0..n)
            .map(|i| {
                let t = 0.1 * i as f64;
                let step = Vector2::new(0.1, 0.08 * (0.7 * t).cos());
                at += step;
                let height = 10.0 - 0.05 * t;
                let range = at.norm().hypot(height) + SIGMA_M * noise();
                let wrong = Vector2::new(noise(), noise()) * STEP_VARIANCE.sqrt();
                (step + wrong, height, range)
            })
            .collect()
    }

    /// Gauss-Newton on one dense matrix over the whole path: offsets and covariance of the last.
    fn dense(
        log: &[(Vector2<f64>, f64, f64)],
        start: Vector2<f64>,
        sigma: f64,
    ) -> (Vector2<f64>, Matrix2<f64>) {
        let n = log.len();
        let mut x = DVector::<f64>::zeros(2 * n);
        let mut at = start;
        for (i, (step, _, _)) in log.iter().enumerate() {
            at += if i == 0 { Vector2::zeros() } else { *step };
            x.fixed_rows_mut::<2>(2 * i).copy_from(&at);
        }
        let mut information = DMatrix::<f64>::zeros(2 * n, 2 * n);
        for _ in 0..20 {
            let mut rows = Vec::new();
            let mut residuals = Vec::new();
            for (i, (step, height, range)) in log.iter().enumerate() {
                let w = Vector2::new(x[2 * i], x[2 * i + 1]);
                for axis in 0..2 {
                    let mut row = DVector::zeros(2 * n);
                    let (scale, misfit) = if i == 0 {
                        (1.0 / sigma, w[axis] - start[axis])
                    } else {
                        row[2 * i - 2 + axis] = -1.0 / STEP_VARIANCE.sqrt();
                        let before = x[2 * i - 2 + axis];
                        (1.0 / STEP_VARIANCE.sqrt(), w[axis] - before - step[axis])
                    };
                    row[2 * i + axis] = scale;
                    rows.push(row);
                    residuals.push(misfit * scale);
                }
                let distance = w.norm().hypot(*height);
                let mut row = DVector::zeros(2 * n);
                row[2 * i] = w.x / distance / SIGMA_M;
                row[2 * i + 1] = w.y / distance / SIGMA_M;
                rows.push(row);
                residuals.push((distance - range) / SIGMA_M);
            }
            let j = DMatrix::from_columns(&rows).transpose();
            information = j.transpose() * &j;
            x -= information
                .clone()
                .cholesky()
                .unwrap()
                .solve(&(j.transpose() * DVector::from_vec(residuals)));
        }
        let covariance = information.try_inverse().unwrap();
        let last = 2 * n - 2;
        (
            x.fixed_rows::<2>(last).into_owned(),
            covariance.fixed_view::<2, 2>(last, last).into_owned(),
        )
    }

    fn run(log: &[(Vector2<f64>, f64, f64)], start: Vector2<f64>, most_nodes: usize) -> FixedLag {
        let mut path = FixedLag::new(start, 0.3, SIGMA_M, most_nodes);
        for (i, (step, height, range)) in log.iter().enumerate() {
            let step = if i == 0 { Vector2::zeros() } else { *step };
            assert!(path.push(step, STEP_VARIANCE, *height, *range));
        }
        path
    }

    #[test]
    fn without_forgetting_it_is_least_squares_over_the_whole_path() {
        let log = drive(60, NEAR, 1);
        let path = run(&log, NEAR, 100);
        let (offset, covariance) = dense(&log, NEAR, 0.3);
        assert!((path.offset_m() - offset).norm() < 1e-6);
        assert!((path.covariance_m2() - covariance).norm() < 1e-4 * covariance.norm());
    }

    #[test]
    fn what_is_forgotten_leaves_its_information_behind() {
        // So far away that nothing is curved, it does not matter where a range was linearised.
        let start = Vector2::new(-3e6, 4e6);
        let log = drive(150, start, 2);
        let (offset, covariance) = dense(&log, start, 0.3);
        let path = run(&log, start, 20);
        assert!((path.offset_m() - offset).norm() < 1e-6);
        assert!((path.covariance_m2() - covariance).norm() < 1e-6 * covariance.norm());
    }

    #[test]
    fn on_top_of_the_anchor_nothing_breaks() {
        let mut path = FixedLag::new(Vector2::zeros(), 0.1, 0.1, 10);
        for _ in 0..50 {
            assert!(path.push(Vector2::zeros(), 0.01, 0.0, 0.05));
        }
        assert!(path.offset_m().iter().all(|c| c.is_finite()));
        assert!(path.covariance_m2().cholesky().is_some());
    }
}
