//! Chooses the shape of the flight by what it is expected to tell ([`Forecast`]).

use super::forecast::Forecast;
use super::guidance::{Approach, Shape};

/// Heights of the gate and radii of the helix to choose from, metres.
const GATES_M: [f64; 4] = [3.5, 5.0, 7.0, 10.0];
const RADII_M: [f64; 4] = [0.6, 0.8, 1.2, 1.8];
/// Time between two choices, seconds.
const PAUSE_S: f64 = 1.0;
/// A change must promise to cost less than this part of what the present shape does: turning
/// back and forth is worth nothing.
const WORTH: f64 = 0.95;

/// The shape in force.
#[derive(Debug, Clone)]
pub(super) struct Planner {
    shape: Shape,
    planned_s: f64,
}

impl Planner {
    pub(super) fn new() -> Self {
        Self {
            shape: Shape {
                gate_m: 5.0,
                radius_m: 0.8,
                side: 1.0,
            },
            planned_s: f64::NEG_INFINITY,
        }
    }

    /// The shape in force.
    pub(super) fn shape(&self) -> &Shape {
        &self.shape
    }

    /// Whether it is time to choose again.
    pub(super) fn is_due(&self, t_s: f64) -> bool {
        t_s - self.planned_s >= PAUSE_S
    }

    /// Chooses for a flight that is at `approach`.
    pub(super) fn choose(&mut self, t_s: f64, forecast: &Forecast, approach: Approach) {
        self.planned_s = t_s;
        let mut least_m = WORTH * forecast.cost_m(&self.shape, approach);
        for gate_m in GATES_M {
            for radius_m in RADII_M {
                for side in [1.0, -1.0] {
                    let shape = Shape {
                        gate_m,
                        radius_m,
                        side,
                    };
                    let cost_m = forecast.cost_m(&shape, approach);
                    if cost_m < least_m {
                        (self.shape, least_m) = (shape, cost_m);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bound::{Prior, Recursion};
    use crate::map::NoiseModel;
    use nalgebra::Vector3;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_is_chosen_never_costs_more_than_what_was_in_force(
            x in -10.0..10.0f64, y in -10.0..10.0f64, z in 4.0..25.0f64,
            sigma_m in 0.05..2.0f64, range_sigma_m in 0.02..0.3f64, gusts in 1e-3..0.15f64,
        ) {
            let ins = crate::ins_error::InsNoise {
                position_random_walk: gusts,
                ..NoiseModel::data_sheet().ins
            };
            let prior = Prior {
                tag_sigma_m: [sigma_m; 3],
                velocity_sigma_m_s: 0.02,
                acceleration_sigma_m_s2: 1e-3,
                bias_sigma_m: 0.05,
            };
            let forecast = Forecast {
                ins,
                covariance: *Recursion::new(ins, &prior).covariance(),
                range_sigma_m,
                range_rate_hz: 10.0,
                nearest_m: 0.5,
                speed_m_s: 1.0,
            };
            let approach = Approach {
                offset_m: Vector3::new(x, y, z),
                sigma_m,
                path_left_m: 1.2 * (x.hypot(y) + z),
                spare_m: 0.0,
                landing: false,
            };
            let mut planner = Planner::new();
            let before = forecast.cost_m(planner.shape(), approach);
            prop_assert!(before.is_finite() && before > 0.0);
            planner.choose(3.0, &forecast, approach);
            prop_assert!(forecast.cost_m(planner.shape(), approach) <= before);
            prop_assert!(!planner.is_due(3.5) && planner.is_due(4.0));
        }
    }
}
