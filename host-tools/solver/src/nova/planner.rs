//! DOP-based trajectory planning (paper Sec. IV-B).
//!
//! Candidates `S` lie evenly on a circle around the vehicle, at its height, with radius `d`:
//!
//! ```text
//! d = 1/2 |p_curr^xy - tag^xy|
//! L(p) = lambda |p - tag| / |p_curr - tag| + (1 - lambda) HDOP(P_UAV + {p})            (8)
//! p_next = argmin over S of L(p)
//! ```
//!
//! The paper prints the travel term with 3D norms but says that it runs from 1/2 to 3/2; that holds
//! for horizontal norms, so those are used. The angles are counted from the direction to the tag, so
//! that straight on is among the candidates and the plan turns with the scene. As printed, `lambda`
//! weighs travel; the text around Fig. 14 reads as if it weighed the DOP, which
//! [`LambdaWeighs::Dop`] does.

use std::f64::consts::TAU;

use nalgebra::{Rotation2, Vector3};

use crate::dop::Dop;

/// Which term of Eq. 8 `lambda` multiplies; the other gets `1 - lambda`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum LambdaWeighs {
    /// The travel cost, as Eq. 8 is printed.
    #[default]
    Travel,
    /// The dilution of precision, as Fig. 14 is described.
    Dop,
}

/// Chooses the next waypoint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Planner {
    /// `N`, number of candidates.
    pub candidates: usize,
    /// `lambda`, 0 to 1.
    pub lambda: f64,
    /// What it weighs.
    pub lambda_weighs: LambdaWeighs,
}

/// A candidate and what Eq. 8 says about it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Waypoint {
    /// Where, metres.
    pub position_m: Vector3<f64>,
    /// Normalised travel cost, 1/2 to 3/2.
    pub travel: f64,
    /// HDOP with this place added; `None` where the places still do not span all directions.
    pub hdop: Option<f64>,
    /// `L(p)`; infinite where there is no HDOP.
    pub cost: f64,
}

impl Planner {
    /// The best candidate. `history_m` is where the vehicle has measured from, `current_m` its
    /// place, `tag_m` the estimate.
    ///
    /// Where no candidate has an HDOP, travel alone decides: straight to the tag. Directly over the
    /// tag the circle has no radius and the answer is `current_m` itself.
    pub fn next_waypoint(
        &self,
        history_m: &[Vector3<f64>],
        current_m: Vector3<f64>,
        tag_m: Vector3<f64>,
    ) -> Waypoint {
        let mut places = Vec::with_capacity(history_m.len() + 1);
        places.extend_from_slice(history_m);
        let ahead = 0.5 * (tag_m - current_m).xy();
        let full_distance = 2.0 * ahead.norm();
        let mut best = Waypoint {
            position_m: current_m,
            travel: 1.0,
            hdop: None,
            cost: f64::INFINITY,
        };
        if full_distance <= 0.0 {
            return best;
        }
        for i in 0..self.candidates {
            let turn = Rotation2::new(TAU * i as f64 / self.candidates as f64);
            let offset = turn * ahead;
            let position_m = current_m + Vector3::new(offset.x, offset.y, 0.0);
            let travel = (2.0 * ahead - offset).norm() / full_distance;
            places.push(position_m);
            let hdop = Dop::of(&places, tag_m).map(|dop| dop.hdop);
            places.pop();
            let candidate = Waypoint {
                position_m,
                travel,
                hdop,
                cost: hdop.map_or(f64::INFINITY, |hdop| self.cost(travel, hdop)),
            };
            // Straight on comes first and a tie keeps it.
            if i == 0 || candidate.cost < best.cost {
                best = candidate;
            }
        }
        best
    }

    /// `L(p)`.
    fn cost(&self, travel: f64, hdop: f64) -> f64 {
        let weight = match self.lambda_weighs {
            LambdaWeighs::Travel => self.lambda,
            LambdaWeighs::Dop => 1.0 - self.lambda,
        };
        weight * travel + (1.0 - weight) * hdop
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector2;

    const TAG: Vector3<f64> = Vector3::new(20.0, 0.0, 0.0);

    fn planner(lambda: f64) -> Planner {
        Planner {
            candidates: 24,
            lambda,
            lambda_weighs: LambdaWeighs::Travel,
        }
    }

    fn explored() -> [Vector3<f64>; 3] {
        [
            Vector3::new(0.0, 0.0, 30.0),
            Vector3::new(0.0, 0.0, 29.0),
            Vector3::new(0.0, 5.0, 29.0),
        ]
    }

    #[test]
    fn travel_alone_flies_half_the_way_straight_to_the_tag() {
        let current = Vector3::new(0.0, 5.0, 29.0);
        let next = planner(1.0).next_waypoint(&explored(), current, TAG);
        assert!((next.position_m - Vector3::new(10.0, 2.5, 29.0)).norm() < 1e-12);
        assert!((next.travel - 0.5).abs() < 1e-12);
    }

    #[test]
    fn precision_alone_takes_the_candidate_of_least_hdop() {
        let current = Vector3::new(0.0, 5.0, 29.0);
        let next = planner(0.0).next_waypoint(&explored(), current, TAG);
        let radius = 0.5 * 20f64.hypot(5.0);
        let least = (0..24)
            .filter_map(|i| {
                let angle = (-5f64).atan2(20.0) + TAU * f64::from(i) / 24.0;
                let place = current + Vector3::new(angle.cos(), angle.sin(), 0.0) * radius;
                let mut places = explored().to_vec();
                places.push(place);
                Dop::of(&places, TAG).map(|dop| dop.hdop)
            })
            .fold(f64::INFINITY, f64::min);
        assert!((next.hdop.unwrap() - least).abs() < 1e-9, "{next:?}");
        assert!((0.5..=1.5).contains(&next.travel));
    }

    #[test]
    fn weighing_the_dop_is_weighing_travel_with_the_rest() {
        let current = Vector3::new(0.0, 5.0, 29.0);
        let dop = Planner {
            lambda_weighs: LambdaWeighs::Dop,
            ..planner(0.75)
        };
        let [by_dop, by_travel] =
            [dop, planner(0.25)].map(|planner| planner.next_waypoint(&explored(), current, TAG));
        assert_eq!(by_dop, by_travel);
    }

    #[test]
    fn without_any_hdop_it_flies_straight_on() {
        // One candidate more makes two places: never three directions.
        let current = Vector3::new(0.0, 0.0, 30.0);
        let next = planner(0.7).next_waypoint(&[current], current, TAG);
        assert_eq!(next.hdop, None);
        assert!((next.position_m - Vector3::new(10.0, 0.0, 30.0)).norm() < 1e-12);
    }

    #[test]
    fn over_the_tag_it_stays() {
        let current = TAG + Vector3::new(0.0, 0.0, 30.0);
        let next = planner(0.7).next_waypoint(&explored(), current, TAG);
        assert_eq!(next.position_m, current);
    }

    #[test]
    fn the_plan_turns_and_moves_with_the_scene() {
        let turn = Rotation2::new(1.234);
        let moved = |p: Vector3<f64>| {
            let xy = turn * p.xy() + Vector2::new(100.0, -40.0);
            Vector3::new(xy.x, xy.y, p.z + 7.0)
        };
        let current = Vector3::new(0.0, 5.0, 29.0);
        let here = planner(0.7).next_waypoint(&explored(), current, TAG);
        let there = planner(0.7).next_waypoint(&explored().map(moved), moved(current), moved(TAG));
        assert!((there.position_m - moved(here.position_m)).norm() < 1e-9);
    }
}
