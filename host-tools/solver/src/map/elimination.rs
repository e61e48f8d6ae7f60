//! Solves the normal equations of a chain of knots that all see a few common unknowns.
//!
//! The matrix is block tridiagonal with a border: knot `k` (error of dead reckoning, 7 states) is
//! coupled to knot `k + 1` and to the globals (tag and range bias, 4 states), to nothing else. Going
//! along the chain, what is known about the present knot and the globals is one symmetric array
//!
//! ```text
//!          x_k   g    1
//!   x_k  |  .    .    .  |
//!   g    |  .    .    .  |      information in the upper left 11 x 11, gradient in the last column
//!   1    |  .    .    .  |
//! ```
//!
//! and eliminating `x_k` against its coupling to `x_(k+1)` gives the same array for the next knot
//! (a Schur complement). So the work grows with the number of knots, not with its cube, and the last
//! array is the information about the newest knot and the globals, everything else marginalised.

/// States of a knot: position error (3), velocity error (2), acceleration error (2).
pub(super) const KNOT: usize = 7;
/// Common unknowns: tag (3), range bias.
pub(super) const GLOBAL: usize = 4;
/// Knot and globals.
pub(super) const JOINT: usize = KNOT + GLOBAL;
/// The same and the gradient.
const ARRAY: usize = JOINT + 1;
/// Columns of a factor: the next knot, the globals, the gradient.
const COUPLED: usize = KNOT + ARRAY;

/// Information and gradient of one knot and the globals.
#[derive(Debug, Clone, Copy)]
pub(super) struct Array(pub(super) [[f64; ARRAY]; ARRAY]);

/// Coupling between a knot and the next one.
pub(super) type Coupling = [[f64; KNOT]; KNOT];

/// What back-substitution needs of an eliminated knot: rows `[x_k | x_(k+1) | g | 1]` of the upper
/// triangular factor, before division by their pivots.
#[derive(Debug, Clone, Copy)]
pub(super) struct Factor([[f64; COUPLED]; KNOT]);

/// The common part of all solutions: globals and logarithm of the determinant.
#[derive(Debug, Clone, Copy)]
pub(super) struct Last {
    /// Step of the newest knot, then of the globals.
    pub(super) step: [f64; JOINT],
    /// Their covariance.
    pub(super) covariance: nalgebra::SMatrix<f64, JOINT, JOINT>,
    /// Logarithm of the determinant of the whole matrix.
    pub(super) log_determinant: f64,
    /// Decrease of the cost that the quadratic model promises for the whole step.
    pub(super) promised: f64,
}

impl Array {
    /// What eliminated knots have collected: `-|w|^2`.
    pub(super) fn corner(&self) -> f64 {
        self.0[JOINT][JOINT]
    }

    pub(super) fn zeros() -> Self {
        Self([[0.0; ARRAY]; ARRAY])
    }

    /// Adds to the gradient and to the information along `direction` over `[x_k, g]`: a residual
    /// whose derivative is `direction`, with this weight and weighted value.
    pub(super) fn add_diagonal(&mut self, index: usize, information: f64, gradient: f64) {
        self.0[index][index] += information;
        self.0[index][JOINT] += gradient;
    }

    /// Solves for the newest knot and the globals.
    pub(super) fn solve(&self) -> Option<Last> {
        let mut information = nalgebra::SMatrix::<f64, JOINT, JOINT>::zeros();
        let mut gradient = nalgebra::SVector::<f64, JOINT>::zeros();
        for i in 0..JOINT {
            for j in 0..JOINT {
                information[(i, j)] = 0.5 * (self.0[i][j] + self.0[j][i]);
            }
            gradient[i] = self.0[i][JOINT];
        }
        let cholesky = information.cholesky()?;
        let step = -cholesky.solve(&gradient);
        // The corner has collected -|w|^2 of all eliminated knots.
        let promised = 0.5 * (-self.0[JOINT][JOINT] - step.dot(&gradient));
        let log_determinant = 2.0 * cholesky.l_dirty().diagonal().map(f64::ln).sum();
        step.iter().all(|s| s.is_finite()).then(|| Last {
            step: step.into(),
            covariance: cholesky.inverse(),
            log_determinant,
            promised,
        })
    }
}

/// Eliminates the knot of `here` into `factor`; `next` already holds what is known of the next knot and gets the rest.
/// Logarithm of the knot's determinant; `None` where the matrix is not positive definite.
///
/// A third of all time is spent here; with vectors of four a flight's updates are a tenth faster, and AVX does what SSE does to the
/// last bit.
#[multiversion::multiversion(targets("x86_64+avx+avx2+fma+bmi1+bmi2+lzcnt"))]
pub(super) fn eliminate(
    here: &Array,
    coupling: &Coupling,
    next: &mut Array,
    factor: &mut Factor,
) -> Option<f64> {
    let rows = &mut factor.0;
    for (i, row) in rows.iter_mut().enumerate() {
        row[..KNOT].copy_from_slice(&here.0[i][..KNOT]);
        row[KNOT..2 * KNOT].copy_from_slice(&coupling[i]);
        row[2 * KNOT..].copy_from_slice(&here.0[i][KNOT..]);
    }
    let log_determinant = triangularise(rows)?;
    // What the globals knew before stays, less what the knot takes with it.
    for i in 0..=GLOBAL {
        for j in 0..=GLOBAL {
            next.0[KNOT + i][KNOT + j] += here.0[KNOT + i][KNOT + j];
        }
    }
    for (j, row) in rows.iter().enumerate() {
        let inverse = 1.0 / row[j];
        let tail: &[f64; ARRAY] = tail(row);
        for (i, target) in next.0.iter_mut().enumerate() {
            let factor = tail[i] * inverse;
            for (t, s) in target.iter_mut().zip(tail) {
                *t -= factor * s;
            }
        }
    }
    Some(log_determinant)
}

impl Factor {
    /// To be filled in.
    pub(super) fn zeros() -> Self {
        Self([[0.0; COUPLED]; KNOT])
    }

    /// Step of the eliminated knot from those of the next knot and the globals.
    pub(super) fn back_substitute(
        &self,
        next: &[f64; KNOT],
        globals: &[f64; GLOBAL],
    ) -> [f64; KNOT] {
        let mut x = [0.0; KNOT];
        for i in (0..KNOT).rev() {
            let row = &self.0[i];
            let mut sum = -row[COUPLED - 1];
            for j in i + 1..KNOT {
                sum -= row[j] * x[j];
            }
            for (r, n) in row[KNOT..2 * KNOT].iter().zip(next) {
                sum -= r * n;
            }
            for (r, g) in row[2 * KNOT..2 * KNOT + GLOBAL].iter().zip(globals) {
                sum -= r * g;
            }
            x[i] = sum / row[i];
        }
        x
    }
}

/// Gaussian elimination of the symmetric left block, rows kept unscaled; logarithm of its
/// determinant.
#[inline(always)]
fn triangularise(rows: &mut [[f64; COUPLED]; KNOT]) -> Option<f64> {
    let mut determinant = 1.0;
    for j in 0..KNOT {
        let pivot_row = rows[j];
        let pivot = pivot_row[j];
        if pivot.is_nan() || pivot <= 0.0 {
            return None;
        }
        determinant *= pivot;
        let inverse = 1.0 / pivot;
        for i in j + 1..KNOT {
            let factor = pivot_row[i] * inverse;
            for (value, p) in rows[i].iter_mut().zip(&pivot_row) {
                *value -= factor * p;
            }
        }
    }
    Some(determinant.ln())
}

/// The columns of a factor's row beyond its own knot.
fn tail(row: &[f64; COUPLED]) -> &[f64; ARRAY] {
    // The length is right by construction; the fallback can never be seen.
    const NONE: &[f64; ARRAY] = &[0.0; ARRAY];
    row[KNOT..].try_into().unwrap_or(NONE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};
    use proptest::prelude::*;

    /// A random chain as one dense positive definite matrix, with the gradient.
    fn dense(seed: &[f64], knots: usize) -> (DMatrix<f64>, DVector<f64>) {
        let n = knots * KNOT + GLOBAL;
        let mut at = seed.iter().cycle();
        let mut next = || *at.next().unwrap();
        let mut h = DMatrix::zeros(n, n);
        // Each term sees two neighbours and the globals.
        for k in 0..knots - 1 {
            for _ in 0..2 * KNOT + GLOBAL {
                let mut row = DVector::zeros(n);
                for i in 0..2 * KNOT {
                    row[k * KNOT + i] = next();
                }
                for i in 0..GLOBAL {
                    row[knots * KNOT + i] = next();
                }
                h += &row * row.transpose();
            }
        }
        for i in 0..n {
            h[(i, i)] += 0.5;
        }
        let g = DVector::from_fn(n, |_, _| next());
        (h, g)
    }

    proptest! {
        #[test]
        fn elimination_agrees_with_a_dense_solution(seed in prop::collection::vec(-1.0..1.0f64, 97), knots in 2usize..6) {
            let (h, g) = dense(&seed, knots);
            let globals = knots * KNOT;
            let at = |i: usize, k: usize| if i < KNOT { k * KNOT + i } else { globals + i - KNOT };
            let mut array = Array::zeros();
            for i in 0..JOINT {
                for j in 0..JOINT { array.0[i][j] = h[(at(i, 0), at(j, 0))]; }
                array.0[i][JOINT] = g[at(i, 0)];
                array.0[JOINT][i] = g[at(i, 0)];
            }
            let mut factors = Vec::new();
            let mut log_determinant = 0.0;
            for k in 0..knots - 1 {
                let mut coupling = [[0.0; KNOT]; KNOT];
                let mut next = Array::zeros();
                for i in 0..KNOT {
                    for j in 0..KNOT {
                        coupling[i][j] = h[(k * KNOT + i, (k + 1) * KNOT + j)];
                        next.0[i][j] = h[((k + 1) * KNOT + i, (k + 1) * KNOT + j)];
                    }
                    for j in 0..GLOBAL {
                        next.0[i][KNOT + j] = h[((k + 1) * KNOT + i, globals + j)];
                        next.0[KNOT + j][i] = next.0[i][KNOT + j];
                    }
                    next.0[i][JOINT] = g[(k + 1) * KNOT + i];
                    next.0[JOINT][i] = next.0[i][JOINT];
                }
                let mut factor = Factor::zeros();
                let log = eliminate(&array, &coupling, &mut next, &mut factor).unwrap();
                factors.push(factor);
                log_determinant += log;
                array = next;
            }
            let last = array.solve().unwrap();
            let inverse = h.clone().cholesky().unwrap().inverse();
            let step = -&inverse * &g;
            let promised = -0.5 * step.dot(&g);
            prop_assert!((last.promised - promised).abs() < 1e-8 * (1.0 + promised));
            prop_assert!((last.log_determinant + log_determinant - h.determinant().ln()).abs() < 1e-8);
            for i in 0..JOINT {
                prop_assert!((last.step[i] - step[at(i, knots - 1)]).abs() < 1e-8);
                for j in 0..JOINT {
                    prop_assert!((last.covariance[(i, j)] - inverse[(at(i, knots - 1), at(j, knots - 1))]).abs() < 1e-8);
                }
            }
            let mut next: [f64; KNOT] = last.step[..KNOT].try_into().unwrap();
            let g_step: [f64; GLOBAL] = last.step[KNOT..].try_into().unwrap();
            for k in (0..knots - 1).rev() {
                next = factors[k].back_substitute(&next, &g_step);
                for i in 0..KNOT {
                    prop_assert!((next[i] - step[k * KNOT + i]).abs() < 1e-8);
                }
            }
        }
    }
}
