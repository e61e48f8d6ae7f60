//! Many deliveries.

use super::flight::{DeliveryResult, deliver};
use super::scenario::{Scenario, ScenarioFault};
use crate::statistics::mean;
use crate::streams::trial_seed;
use rayon::prelude::*;
use serde::Serialize;

/// What many deliveries came to.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DeliveryRow {
    /// How many were flown.
    pub trials: usize,
    /// How many came down at the goal.
    pub landed: usize,
    /// How many of all came down on the platform.
    pub on_platform: usize,
    /// How many packages were delivered.
    pub delivered: usize,
    /// Mean distance from the centre at touchdown, metres.
    pub off_centre_m: Option<f64>,
    /// Standard deviation of that, metres.
    pub off_centre_spread_m: Option<f64>,
    /// Largest, metres.
    pub off_centre_most_m: Option<f64>,
    /// Mean horizontal error of the estimate at touchdown, metres.
    pub estimate_error_m: Option<f64>,
}

/// Flies `trials` deliveries on all cores; the same numbers whatever their number. `done` is called after each.
///
/// # Errors
/// [`ScenarioFault`] where it cannot be flown.
pub fn deliver_many(
    scenario: &Scenario,
    trials: u64,
    base_seed: u64,
    done: impl Fn() + Sync,
) -> Result<(DeliveryRow, Vec<DeliveryResult>), ScenarioFault> {
    let results: Vec<DeliveryResult> = (0..trials)
        .into_par_iter()
        .map(|trial| {
            let result = deliver(scenario, trial_seed(base_seed, trial), |_| ());
            done();
            result
        })
        .collect::<Result<_, _>>()?;
    let off: Vec<f64> = results.iter().filter_map(|r| r.off_centre_m).collect();
    let errors: Vec<f64> = results.iter().filter_map(|r| r.estimate_error_m).collect();
    let mean_m = mean(&off);
    let row = DeliveryRow {
        trials: results.len(),
        landed: off.len(),
        on_platform: results.iter().filter(|r| r.on_platform).count(),
        delivered: results.iter().filter(|r| r.delivered).count(),
        off_centre_m: mean_m,
        off_centre_spread_m: mean_m.and_then(|mean_m| {
            let squares: f64 = off.iter().map(|o| (o - mean_m).powi(2)).sum();
            (off.len() > 1).then(|| (squares / (off.len() - 1) as f64).sqrt())
        }),
        off_centre_most_m: off.iter().copied().reduce(f64::max),
        estimate_error_m: mean(&errors),
    };
    Ok((row, results))
}
