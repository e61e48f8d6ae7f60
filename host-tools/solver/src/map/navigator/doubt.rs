//! How sure the best explanation is, and the search for others.

use super::{MapNavigator, YOUNG_S, vehicle_m};
use crate::map::hypothesis::Hypothesis;
use crate::navigation::Phase;
use nalgebra::{Matrix3, Vector3};

/// How often other explanations are looked for, seconds: in the beginning, and later.
const OFTEN_S: f64 = 0.5;
const SELDOM_S: f64 = 1.0;
/// The runner-up counts as a competitor within this cost of the best.
const COMPETES: f64 = 7.0;
/// The tag's place is vague while a sigma, or the distance to a rival, exceeds this part of the
/// distance.
const VAGUE_SHARE: f64 = 0.06;
/// Not less than this, metres.
const VAGUE_FROM_M: f64 = 0.7;
/// Gusts beyond this are questioned while the tag's place is vague, m/sqrt(s).
const STRONG_GUSTS: f64 = 0.05;
/// Height below which every range leads to an update, metres.
const LOW_M: f64 = 8.0;

impl MapNavigator {
    /// Looks for other explanations, often at first and now and then later.
    pub(super) fn doubt(&mut self) {
        let (Some(record), Some(start)) = (&self.record, self.start) else {
            return;
        };
        let newest_s = record.knot_times_s().last().copied().unwrap_or(start.t_s);
        let low = self.low();
        let pause_s = if low || newest_s - start.t_s < YOUNG_S {
            OFTEN_S
        } else {
            SELDOM_S
        };
        if newest_s - self.doubted_s < pause_s {
            return;
        }
        self.doubted_s = newest_s;
        self.doubts = self.doubts.wrapping_add(1);
        let vague = self.hypotheses.best().is_some_and(|best| self.vague(best));
        let elsewhere_m = self.elsewhere_m().filter(|_| low);
        // Strong gusts make any place as good as another, and while it is vague nothing tunes them.
        let gusty = self.noise().ins.position_random_walk > STRONG_GUSTS;
        if vague && gusty {
            self.hypotheses.try_calm(record, &mut self.factors);
        }
        if let Some(elsewhere_m) = elsewhere_m {
            self.hypotheses
                .try_offset(|_| elsewhere_m, record, &mut self.factors);
        }
        // Far away the tag may be elsewhere; near it, the vehicle; near a phantom, both.
        let turn = match (low, vague) {
            (false, _) => self.doubts % 3,
            (true, false) => 3 + self.doubts % 3,
            (true, true) => self.doubts % 6,
        };
        match turn {
            0 => self.hypotheses.try_image(record, &mut self.factors),
            1 => self.hypotheses.try_fresh(record, &mut self.factors),
            2 => self
                .hypotheses
                .try_direction(self.doubts / 3, record, &mut self.factors),
            3 => self.hypotheses.try_anew(record, &mut self.factors),
            _ => self
                .hypotheses
                .try_offset(|seen_m| -seen_m, record, &mut self.factors),
        }
    }

    /// Where the mixture sees the tag, if the best explanation is stuck in a minimum far from there.
    fn elsewhere_m(&self) -> Option<Vector3<f64>> {
        let (best, newest, close) = (self.hypotheses.best()?, self.newest()?, self.close?);
        let seen_m = best.tag_m() - vehicle_m(best, newest);
        ((close.offset_m - seen_m).norm() > VAGUE_FROM_M).then_some(close.offset_m)
    }

    /// Whether flying at the best explanation would be flying at a phantom.
    pub(super) fn vague(&self, best: &Hypothesis) -> bool {
        let limit_m = self
            .newest()
            .map_or(0.0, |o| VAGUE_SHARE * (best.tag_m() - o.ins_m).norm())
            .max(VAGUE_FROM_M);
        let variance = self.offset_covariance(best).symmetric_eigenvalues().max();
        let wide = variance > limit_m * limit_m;
        // The mixture's width holds the rivals.
        if self.close.is_some() {
            return wide;
        }
        let rival = self
            .rival(best)
            .is_some_and(|rival| rival.distance_m(best) > limit_m);
        rival || wide
    }

    /// Covariance of the way from vehicle to tag.
    pub(super) fn offset_covariance(&self, best: &Hypothesis) -> Matrix3<f64> {
        self.close
            .map_or_else(|| best.relative_covariance(), |close| close.covariance_m2)
    }

    pub(super) fn low(&self) -> bool {
        let (Some(best), Some(newest)) = (self.hypotheses.best(), self.newest()) else {
            return false;
        };
        self.phase != Phase::Initial && vehicle_m(best, newest).z - best.tag_m().z < LOW_M
    }

    /// The runner-up, if it competes with the best.
    pub(super) fn rival(&self, best: &Hypothesis) -> Option<&Hypothesis> {
        self.hypotheses
            .second()
            .filter(|second| second.score() - best.score() < COMPETES)
    }
}
