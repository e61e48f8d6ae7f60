//! The Markov model of dead reckoning's error between two knots, as a term of the cost.
//!
//! `1/2 |x' - F x|^2` weighted by `Q^-1` ([`crate::ins_error`]). The two horizontal axes are alike
//! and independent, so everything is one 3x3 block used twice, and one number for the height.

use super::elimination::{Array, Coupling, JOINT, KNOT};
use crate::ins_error::InsNoise;
use nalgebra::{Matrix3, Vector3};

/// States of one horizontal axis: position, velocity, acceleration.
const AXES: [[usize; 3]; 2] = [[0, 3, 5], [1, 4, 6]];
const HEIGHT: usize = 2;

/// A step of one length under one noise.
#[derive(Debug, Clone, Copy)]
pub(super) struct Transition {
    dt_s: f64,
    /// `F` of one axis.
    step: Matrix3<f64>,
    /// `Q^-1` of one axis.
    weight: Matrix3<f64>,
    /// `Q^-1 F`.
    weight_step: Matrix3<f64>,
    /// `F^T Q^-1 F`.
    step_weight_step: Matrix3<f64>,
    height_weight: f64,
    /// `ln det Q^-1` of all seven states.
    pub(super) log_determinant: f64,
}

impl Transition {
    /// Of length `dt_s`; `None` where the noise is so small that `Q` cannot be inverted.
    pub(super) fn new(noise: &InsNoise, dt_s: f64) -> Option<Self> {
        let step = axis_step(dt_s);
        let cholesky = noise.axis_noise(dt_s).cholesky()?;
        let weight = cholesky.inverse();
        let height_weight = 1.0 / (noise.height_random_walk.powi(2) * dt_s);
        let log_axis = -2.0 * cholesky.l_dirty().diagonal().map(f64::ln).sum();
        let weight_step = weight * step;
        height_weight.is_finite().then(|| Self {
            dt_s,
            step,
            weight,
            weight_step,
            step_weight_step: step.transpose() * weight_step,
            height_weight,
            log_determinant: 2.0 * log_axis + height_weight.ln(),
        })
    }

    /// Its length, seconds.
    pub(super) fn dt_s(&self) -> f64 {
        self.dt_s
    }

    /// Whether it can serve for this length too.
    pub(super) fn fits(&self, dt_s: f64) -> bool {
        (self.dt_s - dt_s).abs() < 1e-9
    }

    /// Adds the term between knots `x` and `next_x` to the normal equations; its cost.
    pub(super) fn add(
        &self,
        x: &[f64; KNOT],
        next_x: &[f64; KNOT],
        here: &mut Array,
        coupling: &mut Coupling,
        next: &mut Array,
    ) -> f64 {
        let mut cost = 0.0;
        for axis in AXES {
            let state = |x: &[f64; KNOT]| Vector3::from(axis.map(|i| x[i]));
            let misfit = state(next_x) - self.step * state(x);
            let pull = self.weight * misfit;
            let back = self.step.transpose() * pull;
            cost += 0.5 * misfit.dot(&pull);
            for (i, &row) in axis.iter().enumerate() {
                here.0[row][JOINT] -= back[i];
                next.0[row][JOINT] += pull[i];
                for (j, &column) in axis.iter().enumerate() {
                    here.0[row][column] += self.step_weight_step[(i, j)];
                    next.0[row][column] += self.weight[(i, j)];
                    coupling[row][column] -= self.weight_step[(j, i)];
                }
            }
        }
        let misfit = next_x[HEIGHT] - x[HEIGHT];
        let pull = self.height_weight * misfit;
        here.add_diagonal(HEIGHT, self.height_weight, -pull);
        next.add_diagonal(HEIGHT, self.height_weight, pull);
        coupling[HEIGHT][HEIGHT] -= self.height_weight;
        cost + 0.5 * misfit * pull
    }
}

/// Where the error will be after `dt_s` if nothing unforeseen happens.
pub(super) fn propagate(x: &[f64; KNOT], dt_s: f64) -> [f64; KNOT] {
    let step = axis_step(dt_s);
    let mut next = *x;
    for axis in AXES {
        let state = step * Vector3::from(axis.map(|i| x[i]));
        for (i, &index) in axis.iter().enumerate() {
            next[index] = state[i];
        }
    }
    next
}

fn axis_step(dt_s: f64) -> Matrix3<f64> {
    Matrix3::new(1.0, dt_s, 0.5 * dt_s * dt_s, 0.0, 1.0, dt_s, 0.0, 0.0, 1.0)
}
