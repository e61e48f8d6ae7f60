//! What a flight came to.

use crate::recording::Recording;
use crate::settings::Settings;
use crate::uwb::LinkBudget;
use nalgebra::Matrix2;
use nova_solver::bound::{BoundEpoch, BoundModel, Prior, relative_covariance};
use nova_solver::navigation::Estimate;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// An alternative place of the tag must have been nearer to the truth by this to speak of a flip,
/// metres.
const FLIP_M: f64 = 0.5;

/// What a flight came to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FlightResult {
    /// Horizontal distance between vehicle and tag at the end, metres: the paper's navigation error.
    pub error_m: f64,
    /// Whether the flight ended on the ground, and not at the time limit.
    pub landed: bool,
    /// Its duration, seconds.
    pub time_s: f64,
    /// Length of the true path over ground, metres.
    pub path_length_m: f64,
    /// That length over the ideal one, horizontal and then vertical, less 1.
    pub overhead: f64,
    /// Whether the navigator had to choose between two places of the tag and took the wrong one.
    pub flipped: bool,
    /// Least mean error that any method could have had on this path, metres: 0.886 times the root of
    /// the Cramer-Rao bound's horizontal part, the mean length of a round Gaussian.
    pub bound_m: Option<f64>,
    /// Horizontal error of the last estimate squared, normalised by its covariance: 2 on average if
    /// the covariance is honest. `None` from methods without covariance.
    pub nees: Option<f64>,
    /// Computing time of each new estimate, milliseconds. The only part that differs between runs.
    pub update_ms: Vec<f32>,
}

impl FlightResult {
    /// Assesses a flight.
    pub fn of(recording: &Recording, settings: &Settings) -> Self {
        let time_s = recording.end_s();
        Self {
            error_m: (recording.end_m() - recording.scene.tag_m).xy().norm(),
            landed: recording.landed,
            time_s,
            path_length_m: recording.path_length_m,
            overhead: recording.path_length_m / settings.ideal_path_m() - 1.0,
            flipped: flipped(recording),
            bound_m: bound_m(recording, settings),
            nees: nees(recording),
            update_ms: recording.update_ms.clone(),
        }
    }
}

/// Whether the last estimate that had an alternative should have taken that.
fn flipped(recording: &Recording) -> bool {
    let chose = |estimate: &Estimate| {
        let other = Estimate {
            tag_m: estimate.alternative_m?,
            ..*estimate
        };
        let error_m = |estimate| recording.relative_error_m(estimate, estimate.t_s).norm();
        Some(error_m(&other) + FLIP_M < error_m(estimate))
    };
    let mut estimates = recording.estimates.iter().rev();
    estimates
        .find_map(|(_, estimate)| chose(estimate))
        .unwrap_or(false)
}

fn nees(recording: &Recording) -> Option<f64> {
    let (_, estimate) = recording.estimates.last()?;
    let covariance = estimate.relative_covariance_m2?;
    let horizontal: Matrix2<f64> = covariance.fixed_view::<2, 2>(0, 0).into_owned();
    let error = recording.relative_error_m(estimate, estimate.t_s);
    let weighted = horizontal.cholesky()?.solve(&error);
    Some(error.dot(&weighted))
}

fn bound_m(recording: &Recording, settings: &Settings) -> Option<f64> {
    let budget = LinkBudget::new(settings);
    let tag_m = recording.scene.tag_m;
    let epochs: Vec<_> = recording
        .ranges
        .iter()
        .map(|range| {
            let vehicle_m = recording.true_position_m(range.t_s);
            BoundEpoch {
                t_s: range.t_s,
                vehicle_m,
                range_sigma_m: budget.sigma_m(vehicle_m - tag_m),
            }
        })
        .collect();
    let covariance = relative_covariance(&epochs, tag_m, &model(settings), 0.0..recording.end_s());
    let bound_m = 0.5 * PI.sqrt() * (covariance[(0, 0)] + covariance[(1, 1)]).sqrt();
    bound_m.is_finite().then_some(bound_m)
}

/// What the bound is told: the noise as it truly is, and of the constants how far off they may be.
fn model(settings: &Settings) -> BoundModel {
    let (r_mean_m, r_sigma_m, z_sigma_m) = settings.first_guess.spread_m();
    let horizontal_m = r_mean_m.hypot(r_sigma_m) / 2f64.sqrt();
    BoundModel {
        ins: settings.ins_noise(),
        prior: Prior {
            tag_sigma_m: [horizontal_m, horizontal_m, z_sigma_m],
            velocity_sigma_m_s: settings.initial_velocity_sigma,
            acceleration_sigma_m_s2: settings
                .initial_bias_sigma
                .hypot(settings.attitude_sigma_rad * nova_solver::ins::GRAVITY_M_S2),
            bias_sigma_m: settings.uwb_bias_m.abs(),
        },
        nlos_probability: settings.nlos_probability,
        nlos_mean_m: settings.nlos_mean_m,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Scene;
    use nalgebra::{Matrix3, Vector3};
    use nova_solver::navigation::{Doubts, InsSample, RangeSample};

    /// Level flight at 1 m/s over the tag at the origin, measured without error, then straight down
    /// 0.3 m beside it.
    fn recording(estimates: Vec<(f64, Estimate)>) -> Recording {
        let settings = Settings::default();
        let truth: Vec<_> = (0..=500)
            .map(|i| {
                let t_s = 0.1 * f64::from(i);
                let east_m = (-20.0 + t_s).min(0.3);
                let height_m = (30.0 - (t_s - 20.3).max(0.0)).max(0.0);
                (t_s, Vector3::new(east_m, 0.0, height_m))
            })
            .collect();
        let ins = truth
            .iter()
            .map(|&(t_s, position_m)| InsSample { t_s, position_m });
        let ranges = truth.iter().map(|&(t_s, position_m)| RangeSample {
            t_s,
            range_m: position_m.norm(),
        });
        Recording {
            scene: Scene::new(&settings, 1),
            ins: ins.collect(),
            ranges: ranges.collect(),
            truth,
            commands: Vec::new(),
            arrivals: Vec::new(),
            estimates,
            phases: Vec::new(),
            update_ms: Vec::new(),
            refused: 0,
            path_length_m: 60.0,
            landed: true,
        }
    }

    fn estimate(tag_m: Vector3<f64>, alternative_m: Option<Vector3<f64>>) -> (f64, Estimate) {
        let estimate = Estimate {
            t_s: 10.0,
            tag_m,
            vehicle_m: Vector3::new(-10.0, 0.0, 30.0),
            relative_covariance_m2: Some(Matrix3::from_diagonal(&Vector3::new(0.04, 0.01, 9.0))),
            alternative_m,
            range_bias_m: None,
            range_sigma_m: None,
            doubts: Doubts::default(),
        };
        (10.0, estimate)
    }

    fn of(estimates: Vec<(f64, Estimate)>) -> FlightResult {
        FlightResult::of(&recording(estimates), &Settings::default())
    }

    #[test]
    fn the_error_is_horizontal_at_the_end_and_the_overhead_over_fifty_metres() {
        let result = of(Vec::new());
        assert!((result.error_m - 0.3).abs() < 1e-12);
        assert!((result.overhead - 0.2).abs() < 1e-12);
        assert_eq!((result.time_s, result.landed), (50.0, true));
        assert_eq!((result.nees, result.flipped), (None, false));
    }

    #[test]
    fn the_normalised_error_is_of_the_horizontal_part_of_the_last_estimate() {
        let elsewhere = estimate(Vector3::new(9.0, 9.0, 9.0), None);
        let last = estimate(Vector3::new(0.4, -0.1, 7.0), None);
        // 0.4^2/0.04 + 0.1^2/0.01
        assert!((of(vec![elsewhere, last]).nees.unwrap() - 5.0).abs() < 1e-9);
    }

    #[test]
    fn a_flip_is_a_last_choice_that_was_clearly_wrong() {
        let (near, far) = (Vector3::new(0.2, 0.0, 0.0), Vector3::new(0.0, 8.0, 0.0));
        let almost = Vector3::new(0.6, 0.0, 0.0);
        for (chosen, other, flipped) in [
            (near, Some(far), false),
            (far, Some(near), true),
            (almost, Some(near), false),
            (far, None, false),
        ] {
            assert_eq!(of(vec![estimate(chosen, other)]).flipped, flipped);
        }
        // Later estimates without an alternative do not undo the choice, later choices do.
        let wrong = estimate(far, Some(near));
        assert!(of(vec![wrong, estimate(far, None)]).flipped);
        assert!(!of(vec![wrong, estimate(near, Some(far))]).flipped);
    }

    #[test]
    fn a_flight_in_one_vertical_plane_leaves_the_guess_beside_it_as_it_was() {
        let flight = recording(Vec::new());
        let bound_m = |uwb_floor_m| {
            let settings = Settings {
                uwb_floor_m,
                ..Settings::default()
            };
            bound_m(&flight, &settings).unwrap()
        };
        // The guess's standard deviation aside, sqrt((5^2 + 2^2)/2), and next to nothing along.
        let aside_m = 0.5 * PI.sqrt() * 14.5f64.sqrt();
        assert!(
            (aside_m..1.2 * aside_m).contains(&bound_m(0.02)),
            "{}",
            bound_m(0.02)
        );
        assert!(bound_m(0.2) > bound_m(0.02));
    }
}
