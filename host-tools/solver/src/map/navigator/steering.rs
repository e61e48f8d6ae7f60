//! Where to fly next.

use super::{MapNavigator, NEAREST_M};
use crate::ins_error::InsNoise;
use crate::map::forecast::Forecast;
use crate::map::guidance::{self, AHEAD_M, Approach, CENTRE_BELOW_M};
use crate::map::hypothesis::Hypothesis;
use crate::map::options::Plan;
use crate::navigation::{Action, Command, InsError, Phase};

/// Longest exploration, seconds.
const EXPLORE_S: f64 = 25.0;
/// Height above the first guess that is kept while far from the tag, metres.
const CLEARANCE_M: f64 = 8.0;

/// Path length over that of flying horizontally and then down, less one.
fn overhead(plan: Plan) -> f64 {
    match plan {
        Plan::Careful => 0.04,
        Plan::Fast => -0.2,
    }
}

impl MapNavigator {
    pub(super) fn steer(&mut self, t_s: f64) {
        let (Some(best), Some(ins_m), Some(start)) =
            (self.hypotheses.best(), self.ins_at(t_s), self.start)
        else {
            return;
        };
        let (position_m, velocity_m_s) = best.ins_error();
        // By the best explanation, not by the mean of all: a vehicle between two places that the tag
        // may have learns nothing, one that goes to either does.
        let ins_error = InsError {
            t_s: self.newest().map_or(t_s, |o| o.t_s),
            position_m,
            velocity_m_s,
        };
        let vehicle_m = ins_m - ins_error.at(t_s);
        let tag_m = best.tag_m();
        let offset_m = vehicle_m - tag_m;
        let to_tag = tag_m - start.position_m;
        let whole_m = (to_tag.xy().norm() + to_tag.z.abs()) * (1.0 + overhead(self.options.plan));
        let left_m = whole_m - self.options.speed_m_s * (t_s - start.t_s);
        let vague = self.vague(best);
        let mut approach = Approach {
            offset_m,
            sigma_m: guidance::horizontal_sigma_m(&self.offset_covariance(best)),
            path_left_m: left_m,
            spare_m: vehicle_m.z - self.guess.tag_m.z - CLEARANCE_M,
            landing: self.phase == Phase::Landing && offset_m.z < CENTRE_BELOW_M,
        };
        approach.landing = !vague && approach.may_land();
        let exploring = vague && t_s - start.t_s < EXPLORE_S;
        // Not with a search for other explanations in the same range: an answer is wanted soon.
        let searched = self.newest().is_some_and(|o| o.t_s == self.doubted_s);
        if !(exploring || approach.landing || searched) && self.planner.is_due(t_s) {
            let forecast = self.forecast(best, t_s - start.t_s);
            self.planner.choose(t_s, &forecast, approach);
        }
        self.phase = match () {
            () if approach.landing => Phase::Landing,
            () if offset_m.z < self.planner.shape().gate_m => Phase::Final,
            () => Phase::MidFlight,
        };
        let waypoint_m = if exploring {
            let toward = self.guess.tag_m - start.position_m;
            vehicle_m + guidance::exploration(toward, t_s - start.t_s, approach.spare_m) * AHEAD_M
        } else {
            tag_m + approach.waypoint_m(self.planner.shape())
        };
        self.command = Command {
            id: self.command.id.wrapping_add(1),
            action: if approach.landing {
                Action::Land
            } else {
                Action::Fly
            },
            waypoint_m,
            ins_error,
        };
    }

    /// What can be expected of a flight from here, `flown_s` after its start.
    fn forecast(&self, best: &Hypothesis, flown_s: f64) -> Forecast {
        Forecast {
            ins: InsNoise {
                height_sigma_m: self.height_roughness.sigma(),
                ..best.noise().ins
            },
            covariance: self
                .close
                .map_or_else(|| best.bound_covariance(), |close| close.covariance),
            range_sigma_m: self.newest().map_or(0.0, |newest| newest.range_sigma_m),
            range_rate_hz: self.ranges as f64 / flown_s.max(1.0),
            nearest_m: NEAREST_M,
            speed_m_s: self.options.speed_m_s,
        }
    }
}
