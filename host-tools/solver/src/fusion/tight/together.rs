//! The anchors by themselves: a place from their last ranges alone, to start anew from and to tell when the
//! filter is on the wrong side of their plane.

use nalgebra::{Matrix3, Vector3};

use super::filter::{ANCHORS, Filter, PATIENCE_S, place_anchor};
use crate::multilateration::MultilaterationOptions;
use crate::positioning::{AnchorRange, locate};

/// With a standard deviation beyond this the position is too coarse for single ranges, metres.
const COARSE_M: f64 = 2.0;
/// Ranges this old are solved together with new ones, seconds.
const TOGETHER_S: f64 = 0.15;

impl Filter {
    pub(super) fn coarse(&self) -> bool {
        let variance: f64 = (0..3).map(|i| self.covariance[(i, i)]).sum();
        variance > COARSE_M * COARSE_M
    }

    /// Whether the position is coarse and has waited long enough for five anchors at once.
    pub(super) fn out_of_patience(&self, t_s: f64) -> bool {
        self.coarse() && (self.coarse_since_s).is_some_and(|since_s| t_s - since_s >= PATIENCE_S)
    }

    /// The position that the last ranges of five anchors or more agree on, its covariance, and whether no
    /// other disagrees, from the anchors as they were surveyed: independent of the filter but for its velocity over a moment.
    fn alone(&self, t_s: f64) -> Option<(Vector3<f64>, Matrix3<f64>, bool)> {
        // Of four, one that is blocked does not show.
        const AT_LEAST: usize = 5;
        let velocity = self.state.v;
        let ranges: Vec<AnchorRange> = (self.last_ranges.iter().zip(&self.surveyed))
            .filter_map(|(last, known)| {
                let [then_s, range_m, sigma_m] = (*last)?;
                let age = t_s - then_s;
                (age.abs() <= TOGETHER_S).then_some(AnchorRange {
                    // As if the anchor had moved instead of the vehicle.
                    anchor_m: known.position_m + velocity * age,
                    range_m: (range_m - known.bias_m) / (1.0 + self.options.slope),
                    sigma_m,
                })
            })
            .collect();
        if ranges.len() < AT_LEAST {
            return None;
        }
        let found = locate(&ranges, &MultilaterationOptions::default())
            .ok()?
            .found;
        let sharp = found.covariance_m2.trace() < COARSE_M * COARSE_M;
        let arm = self.state.attitude() * self.options.arms.uwb_m;
        (found.observable() && found.used >= AT_LEAST && sharp).then_some((
            found.position_m - arm,
            found.covariance_m2,
            found.rejected == 0,
        ))
    }

    /// Whether five anchors or more have by themselves said often enough that the vehicle is elsewhere: on
    /// the other side of the anchors' plane, as a rule. Twice where all agreed, four times where one was
    /// set aside.
    pub(super) fn contradicted(&mut self, t_s: f64) -> bool {
        const EVERY_S: f64 = 0.25;
        const STRIKES: u32 = 4;
        /// 99.9 % of chi-square with three degrees of freedom.
        const APART: f64 = 16.27;
        if t_s - self.checked_s < EVERY_S {
            return false;
        }
        let Some((place, covariance, agreed)) = self.alone(t_s) else {
            return false;
        };
        self.checked_s = t_s;
        let apart = place - self.state.p;
        let own = self.covariance.fixed_view::<3, 3>(0, 0).into_owned();
        let s = own + covariance + Matrix3::identity() * 0.1;
        let beyond = (s.cholesky()).is_some_and(|s| apart.dot(&s.solve(&apart)) > APART);
        let weight = if agreed { 2 } else { 1 };
        self.strikes = if beyond { self.strikes + weight } else { 0 };
        self.strikes >= STRIKES
    }

    /// Takes the position from the last ranges of five anchors or more, where they agree on one, and the
    /// anchors as they were surveyed.
    pub(super) fn start_anew(&mut self, t_s: f64) -> bool {
        let Some((place, covariance, agreed)) = self.alone(t_s) else {
            return false;
        };
        self.state.p = place;
        self.forget(0, 3);
        let speed2 = self.state.v.norm_squared() * TOGETHER_S * TOGETHER_S;
        // Five that agree while the sixth does not may be the wrong five.
        let doubt2 = if agreed { 0.01 } else { 1.0 };
        let around = covariance + Matrix3::identity() * (doubt2 + speed2);
        self.covariance.view_mut((0, 0), (3, 3)).copy_from(&around);
        for i in 3..6 {
            self.covariance[(i, i)] += 1.0;
        }
        self.forget(ANCHORS, self.covariance.nrows() - ANCHORS);
        self.anchors.copy_from_slice(&self.surveyed);
        for (k, anchor) in self.surveyed.iter().enumerate() {
            place_anchor(&mut self.covariance, k, anchor);
        }
        self.last_ranges.fill(None);
        self.suspect.fill(false);
        self.set_aside_share = 0.0;
        self.strikes = 0;
        true
    }
}
