//! Figures of many tracking flights.

use nova_solver::tracking::control::chi_square_3;
use rayon::prelude::*;
use serde::Serialize;

use super::flight::{TrackingResult, TrackingTrial, track};
use super::scene::TrackingScene;
use super::words::{Controller, Estimator};
use crate::error::FlightError;
use crate::streams::trial_seed;

/// Figures of flights of one kind.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TrackingRow {
    /// Who estimated.
    pub estimator: Estimator,
    /// Who flew; none where the vehicle's path was given.
    pub controller: Option<Controller>,
    /// The part of bearings that were outliers.
    pub outlier_probability: f64,
    /// Flights.
    pub trials: usize,
    /// Root mean square error of the believed place, over all sightings of all flights.
    pub rmse_m: f64,
    /// The largest error.
    pub max_error_m: f64,
    /// Part of sightings at which the true place was within the confidence radius.
    pub inside_radius: f64,
    /// Mean confidence radius, and the largest.
    pub radius_m: [f64; 2],
    /// Parts of sightings at which it was within the ellipsoids of 50, 80 and 95 %: as many, where the
    /// covariance is honest.
    pub inside_ellipsoids: [f64; 3],
    /// Mean of the squared error normalised by the covariance; 3 where that is honest.
    pub nees: f64,
    /// Least and greatest true distance of all flights.
    pub distance_m: [f64; 2],
    /// Flights that left the bounds at any time.
    pub left_bounds: usize,
    /// Seconds outside the bounds, a flight.
    pub outside_s: f64,
    /// How far outside at most.
    pub worst_outside_m: f64,
    /// Root mean square command, m/s^2.
    pub command_rms: f64,
    /// Least distance to a wall of all flights; none where there are no walls.
    pub least_wall_m: Option<f64>,
    /// Commands at which not all limits could be kept: the far bound given up for the near one, full
    /// chase, full braking, the near bound given up for a wall, walls given up, failures of the solver.
    pub infeasible: [u64; 6],
    /// Commands.
    pub commands: u64,
    /// Sightings that were refused.
    pub refused: u64,
    /// Computing time of tracker and controller, milliseconds: median and 99 % point. It differs from
    /// run to run.
    pub step_ms: [f64; 2],
}

/// Flies the trials 0 to `trials` under each condition, on all cores. Trial `i` meets the same noise
/// under all of them. `done` is called after every flight.
///
/// # Errors
/// As [`track`].
pub fn track_many(
    scene: &TrackingScene,
    conditions: &[(Estimator, Controller, f64)],
    trials: u64,
    base_seed: u64,
    done: impl Fn() + Sync,
) -> Result<Vec<TrackingRow>, FlightError> {
    conditions
        .iter()
        .map(|&(estimator, controller, outlier_probability)| {
            let results = (0..trials)
                .into_par_iter()
                .map(|trial| {
                    let result = track(&TrackingTrial {
                        scene,
                        estimator,
                        controller,
                        outlier_probability,
                        seed: trial_seed(base_seed, trial),
                    });
                    done();
                    result
                })
                .collect::<Result<Vec<_>, _>>()?;
            let controller = scene.standoff.map(|_| controller);
            Ok(TrackingRow::of(
                estimator,
                controller,
                outlier_probability,
                &results,
            ))
        })
        .collect()
}

impl TrackingRow {
    /// Figures of these flights.
    pub fn of(
        estimator: Estimator,
        controller: Option<Controller>,
        outlier_probability: f64,
        results: &[TrackingResult],
    ) -> Self {
        let moments = || results.iter().flat_map(|result| &result.moments);
        let count = moments().count().max(1) as f64;
        let flights = results.len().max(1) as f64;
        let most = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, f64::max);
        let sum = |count: fn(&TrackingResult) -> u64| results.iter().map(count).sum::<u64>();
        let mut times: Vec<f64> = results.iter().flat_map(|r| &r.step_ms).copied().collect();
        times.sort_by(f64::total_cmp);
        let time = |part: f64| {
            let place = (part * times.len().saturating_sub(1) as f64).round() as usize;
            times.get(place).copied().unwrap_or(0.0)
        };
        Self {
            estimator,
            controller,
            outlier_probability,
            trials: results.len(),
            rmse_m: (results
                .iter()
                .map(TrackingResult::square_error_m2)
                .sum::<f64>()
                / count)
                .sqrt(),
            max_error_m: most(&mut moments().map(|m| (m.believed_m - m.target_m).norm())),
            inside_radius: results
                .iter()
                .map(TrackingResult::inside_radius)
                .sum::<usize>() as f64
                / count,
            radius_m: [
                moments().map(|m| m.radius_m).sum::<f64>() / count,
                most(&mut moments().map(|m| m.radius_m)),
            ],
            inside_ellipsoids: [0.5, 0.8, 0.95].map(|part| {
                let quantile = chi_square_3(part);
                moments().filter(|m| m.nees <= quantile).count() as f64 / count
            }),
            nees: moments().map(|m| m.nees).sum::<f64>() / count,
            distance_m: [
                results
                    .iter()
                    .map(|r| r.distance_m[0])
                    .fold(f64::INFINITY, f64::min),
                most(&mut results.iter().map(|r| r.distance_m[1])),
            ],
            left_bounds: results.iter().filter(|r| r.outside_s > 0.0).count(),
            outside_s: results.iter().map(|r| r.outside_s).sum::<f64>() / flights,
            worst_outside_m: most(&mut results.iter().map(|r| r.worst_outside_m)),
            command_rms: (moments().map(|m| m.command.norm_squared()).sum::<f64>() / count).sqrt(),
            least_wall_m: results
                .iter()
                .map(|r| r.least_wall_m)
                .reduce(f64::min)
                .filter(|least| least.is_finite()),
            infeasible: [
                sum(|r| r.decisions.far_given_up),
                sum(|r| r.decisions.full_chase),
                sum(|r| r.decisions.full_braking),
                sum(|r| r.decisions.cornered),
                sum(|r| r.decisions.walls_given_up),
                sum(|r| r.decisions.solver_failed),
            ],
            commands: results.iter().map(|r| r.moments.len() as u64).sum(),
            refused: sum(|r| r.counts.refused()),
            step_ms: [time(0.5), time(0.99)],
        }
    }
}
