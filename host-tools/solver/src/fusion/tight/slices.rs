//! A coarse position cut into slices, each a filter of its own.
//!
//! Along the direction `e` in which the position is known worst, `N(0, 1)` becomes a sum of narrower ones
//! (Alspach and Sorenson, "Nonlinear Bayesian estimation using Gaussian sum approximations", IEEE TAC 17,
//! 1972); all that is correlated with the position, GNSS's error above all, goes along:
//!
//! ```text
//! d = P e / sqrt(e^T P e),   x_j = x + m_j d,   P_j = P - (1 - k^2) d d^T,   w_j ~ exp(-m_j^2 / (2 (1 - k^2)))
//! w_j <- w_j N(innovation; 0, S_j)                     with every range and GNSS position
//! ```
//!
//! Slices without weight are dropped; two that have found the same place become one.

use nalgebra::{Matrix3, SymmetricEigen, Vector3};

use super::filter::Filter;
use crate::fusion::Navigation;

/// Most slices.
const MOST: usize = 15;
/// Slices are about this far apart, metres.
const APART_M: f64 = 2.0;
/// The cut reaches so many standard deviations to each side.
const REACH: f64 = 2.4;
/// A slice less likely than the best by this factor is dropped (logarithm).
const HOPELESS: f64 = -12.0;
/// Two within this Mahalanobis distance squared are one.
const SAME: f64 = 1.0;

/// One filter or several, with logarithms of weights; never empty.
#[derive(Debug, Clone)]
pub(super) struct Slices {
    first: Filter,
    first_weight: f64,
    others: Vec<(Filter, f64)>,
}

impl Slices {
    pub(super) fn one(filter: Filter) -> Self {
        Self {
            first: filter,
            first_weight: 0.0,
            others: Vec::new(),
        }
    }

    /// The filter of most weight: it is kept in front.
    pub(super) fn likeliest(&self) -> &Filter {
        &self.first
    }

    /// Does something to all; returns what it gave for the likeliest.
    pub(super) fn all<T>(&mut self, mut act: impl FnMut(&mut Filter) -> T) -> T {
        for (filter, _) in &mut self.others {
            act(filter);
        }
        act(&mut self.first)
    }

    /// Gives all a measurement, whose log-likelihood weighs them; returns what it gave for the likeliest.
    pub(super) fn weigh<T>(&mut self, mut act: impl FnMut(&mut Filter) -> (T, f64)) -> T {
        let (said, likelihood) = act(&mut self.first);
        if self.others.is_empty() {
            return said;
        }
        self.first_weight += likelihood;
        for (filter, weight) in &mut self.others {
            *weight += act(filter).1;
        }
        self.settle();
        said
    }

    /// The likeliest to the front, the hopeless out, the same together.
    fn settle(&mut self) {
        for (filter, weight) in &mut self.others {
            if *weight > self.first_weight {
                std::mem::swap(&mut self.first, filter);
                std::mem::swap(&mut self.first_weight, weight);
            }
        }
        let best = std::mem::take(&mut self.first_weight);
        let mut kept: Vec<(Filter, f64)> = Vec::with_capacity(self.others.len());
        for (filter, weight) in self.others.drain(..) {
            let weight = weight - best;
            if weight.is_nan() || weight <= HOPELESS {
                continue;
            }
            if same(&self.first, &filter) {
                continue;
            }
            match kept.iter_mut().find(|(other, _)| same(other, &filter)) {
                Some((_, other)) => *other = other.max(weight),
                None => kept.push((filter, weight)),
            }
        }
        self.others = kept;
    }

    /// Cuts a single filter that has waited in vain for five anchors at once.
    pub(super) fn cut_where_coarse(&mut self, t_s: f64) {
        if !self.others.is_empty() || !self.first.out_of_patience(t_s) {
            return;
        }
        let position: Matrix3<f64> = (self.first.covariance.fixed_view::<3, 3>(0, 0)).into_owned();
        if !position.iter().all(|v| v.is_finite()) {
            return;
        }
        let eigen = SymmetricEigen::new(position);
        let worst = eigen.eigenvalues.imax();
        let (variance, e) = (eigen.eigenvalues[worst], eigen.eigenvectors.column(worst));
        if variance <= APART_M * APART_M {
            return;
        }
        let sigma = variance.sqrt();
        let half = ((REACH * sigma / APART_M).ceil() as usize).clamp(1, MOST / 2);
        let step = REACH / half as f64;
        let narrow2 = (step * step).min(0.9);
        let mut d = self.first.covariance.columns(0, 3) * e;
        d /= sigma;
        let whole = self.first.clone();
        for j in (0..=2 * half).filter(|j| *j != half) {
            let m = (j as f64 - half as f64) * step;
            let mut slice = whole.clone();
            slice.shift(&d, m, narrow2);
            (self.others).push((slice, -0.5 * m * m / (1.0 - narrow2)));
        }
        self.first.shift(&d, 0.0, narrow2);
        self.first_weight = 0.0;
    }

    /// The likeliest's position; the covariance is about it, over all.
    pub(super) fn navigation(&self) -> Navigation {
        let mut said = self.first.navigation();
        let (mut total, mut spread) = (1.0, said.covariance_m2);
        for (filter, weight) in &self.others {
            let other = filter.navigation();
            let (w, d) = (
                (weight - self.first_weight).exp(),
                other.position_m - said.position_m,
            );
            total += w;
            spread += (other.covariance_m2 + d * d.transpose()) * w;
        }
        said.covariance_m2 = spread / total;
        said
    }
}

/// Whether two have found the same place.
fn same(one: &Filter, other: &Filter) -> bool {
    if one.coarse() || other.coarse() {
        return false;
    }
    let (one, other) = (one.navigation(), other.navigation());
    let d: Vector3<f64> = one.position_m - other.position_m;
    let s = one.covariance_m2 + other.covariance_m2;
    s.cholesky().is_some_and(|s| d.dot(&s.solve(&d)) < SAME)
}
