//! The tag from the corrected trajectory (paper Eq. 13).
//!
//! ```text
//! f(p) = sum_j 1/L_j sum_{t in T_j} (|p - p_UAV(t)| - D(t))^2          p_tag = argmin f
//! grad f = sum_j 2/L_j sum_t (|p - p_UAV(t)| - D(t)) (p - p_UAV(t)) / |p - p_UAV(t)|
//! ```
//!
//! `L_j` is the length of segment `j`: a segment counts by its length, not by the time spent on it.

use nalgebra::Vector3;

use super::adam::Adam;

/// Sums are formed in so many independent parts, which the compiler turns into vector instructions.
const LANES: usize = 4;
/// Unknowns.
const FEWEST_RANGES: usize = 3;

/// Ranges with the places they were measured from and their weights, column by column.
#[derive(Debug, Clone, Default)]
pub(super) struct TagFit {
    x: Vec<f64>,
    y: Vec<f64>,
    z: Vec<f64>,
    range: Vec<f64>,
    weight: Vec<f64>,
    /// How many of the rows are ranges; the others fill up the last lanes and weigh nothing.
    count: usize,
}

impl TagFit {
    /// Takes `(p_UAV(t), D(t), 1/L_j)` for all ranges, in place of what was there.
    pub(super) fn fill(&mut self, rows: impl Iterator<Item = (Vector3<f64>, f64, f64)>) {
        for column in self.columns() {
            column.clear();
        }
        for row in rows {
            self.push(row);
        }
        self.count = self.range.len();
        while !self.range.len().is_multiple_of(LANES) {
            self.push((Vector3::zeros(), 0.0, 0.0));
        }
    }

    fn columns(&mut self) -> [&mut Vec<f64>; 5] {
        [
            &mut self.x,
            &mut self.y,
            &mut self.z,
            &mut self.range,
            &mut self.weight,
        ]
    }

    fn push(&mut self, (place_m, range_m, weight): (Vector3<f64>, f64, f64)) {
        let row = [place_m.x, place_m.y, place_m.z, range_m, weight];
        for (column, value) in self.columns().into_iter().zip(row) {
            column.push(value);
        }
    }

    /// The minimum that Adam finds from `start_m`. `None` with fewer ranges than unknowns, and where
    /// the descent ended at no better place than it began, as when it diverged.
    pub(super) fn solve(&self, start_m: Vector3<f64>, adam: &Adam) -> Option<Vector3<f64>> {
        if self.count < FEWEST_RANGES {
            return None;
        }
        let end_m = adam.descend(start_m, |p| self.gradient(p));
        (self.loss(&end_m) < self.loss(&start_m)).then_some(end_m)
    }

    /// `f(p)`, metres.
    pub(super) fn loss(&self, p: &Vector3<f64>) -> f64 {
        let mut sum = [0.0; LANES];
        self.sum(p, |lane, residual, weight, _, _| {
            sum[lane] += weight * residual * residual;
        });
        sum.iter().sum()
    }

    /// `grad f`.
    fn gradient(&self, p: &Vector3<f64>) -> Vector3<f64> {
        let mut sum = [[0.0; LANES]; 3];
        self.sum(p, |lane, residual, weight, distance, [dx, dy, dz]| {
            let pull = 2.0 * weight * residual / distance;
            sum[0][lane] += pull * dx;
            sum[1][lane] += pull * dy;
            sum[2][lane] += pull * dz;
        });
        Vector3::from_iterator(sum.iter().map(|lanes| lanes.iter().sum()))
    }

    /// Hands out lane, residual, weight, distance and offset of every range.
    #[inline(always)]
    fn sum(&self, p: &Vector3<f64>, mut term: impl FnMut(usize, f64, f64, f64, [f64; 3])) {
        let rows = self
            .x
            .chunks_exact(LANES)
            .zip(self.y.chunks_exact(LANES))
            .zip(self.z.chunks_exact(LANES))
            .zip(self.range.chunks_exact(LANES))
            .zip(self.weight.chunks_exact(LANES));
        for ((((x, y), z), range), weight) in rows {
            for lane in 0..LANES {
                let (dx, dy, dz) = (p.x - x[lane], p.y - y[lane], p.z - z[lane]);
                // At the very place of measurement the direction is undefined; the tiny number
                // makes it zero.
                let distance = (dx * dx + dy * dy + dz * dz + 1e-24).sqrt();
                term(
                    lane,
                    distance - range[lane],
                    weight[lane],
                    distance,
                    [dx, dy, dz],
                );
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TAG: Vector3<f64> = Vector3::new(4.0, -3.0, 0.5);
    const ADAM: Adam = Adam {
        learning_rate: 0.1,
        iterations: 500,
        velocity: [0.1, 30.0],
    };

    fn filled(rows: &[(Vector3<f64>, f64, f64)]) -> TagFit {
        let mut fit = TagFit::default();
        fit.fill(rows.iter().copied());
        fit
    }

    /// Exact ranges from an L-shaped path that also descends.
    fn exact(count: u32) -> Vec<(Vector3<f64>, f64, f64)> {
        (0..count)
            .map(|i| {
                let s = f64::from(i) / f64::from(count.max(1));
                let place = if s < 0.5 {
                    Vector3::new(20.0 * s, 0.0, 20.0)
                } else {
                    Vector3::new(10.0, 20.0 * s - 10.0, 30.0 - 20.0 * s)
                };
                (place, (place - TAG).norm(), 0.2)
            })
            .collect()
    }

    #[test]
    fn exact_ranges_give_the_tag_back() {
        let found = filled(&exact(101)).solve(TAG + Vector3::new(3.0, -4.0, 2.0), &ADAM);
        assert!((found.unwrap() - TAG).norm() < 0.02, "{found:?}");
    }

    #[test]
    fn gradient_is_the_finite_difference_of_the_loss() {
        let fit = filled(&exact(33));
        let p = Vector3::new(1.0, 2.0, 3.0);
        let gradient = fit.gradient(&p);
        for i in 0..3 {
            let mut step = Vector3::zeros();
            step[i] = 1e-6;
            let slope = (fit.loss(&(p + step)) - fit.loss(&(p - step))) / 2e-6;
            assert!((slope - gradient[i]).abs() < 1e-5 * gradient.norm(), "{i}");
        }
    }

    #[test]
    fn loss_is_equation_13_written_out() {
        let rows = exact(7);
        let p = Vector3::new(1.0, 2.0, 3.0);
        let expected: f64 = rows
            .iter()
            .map(|(place, range, weight)| weight * ((p - place).norm() - range).powi(2))
            .sum();
        assert!((filled(&rows).loss(&p) - expected).abs() < 1e-12 * expected);
    }

    #[test]
    fn a_leg_hovered_over_ten_times_counts_once_when_weighed_so() {
        let once: Vec<_> = exact(40)
            .into_iter()
            .map(|(p, r, w)| (p, r + 0.1, w))
            .collect();
        let mut tenfold = once.clone();
        for row in once.iter().take(20) {
            tenfold.extend([(row.0, row.1, row.2 / 10.0); 10]);
        }
        tenfold.drain(..20);
        let p = Vector3::new(1.0, 2.0, 3.0);
        let (a, b) = (filled(&once).loss(&p), filled(&tenfold).loss(&p));
        assert!((a - b).abs() < 1e-9 * a);
    }

    #[test]
    fn too_few_ranges_give_nothing() {
        assert_eq!(filled(&exact(2)).solve(Vector3::zeros(), &ADAM), None);
        assert_eq!(filled(&[]).solve(Vector3::zeros(), &ADAM), None);
    }

    #[test]
    fn a_descent_that_diverges_gives_nothing() {
        let wild = Adam {
            learning_rate: 1e9,
            ..ADAM
        };
        assert_eq!(filled(&exact(40)).solve(TAG, &wild), None);
        let endless = Adam {
            learning_rate: f64::INFINITY,
            ..ADAM
        };
        assert_eq!(filled(&exact(40)).solve(Vector3::zeros(), &endless), None);
    }

    #[test]
    fn starting_at_a_place_of_measurement_is_no_trouble() {
        let rows = exact(40);
        let found = filled(&rows).solve(rows[3].0, &ADAM);
        assert!(found.is_some_and(|p| p.iter().all(|c| c.is_finite())));
    }
}
