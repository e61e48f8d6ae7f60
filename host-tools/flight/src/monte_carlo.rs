//! Many flights on all cores.

use crate::flight::{Trial, fly, fly_shown};
use crate::methods::Method;
use crate::outcome::FlightResult;
use crate::settings::Settings;
use crate::streams::trial_seed;
use rayon::prelude::*;

/// What all trials of one row of a table have in common.
#[derive(Debug, Clone, PartialEq)]
pub struct Condition {
    /// Who navigates.
    pub method: Method,
    /// Who flies instead, while `method` is only shown what is measured; see [`fly_shown`].
    pub flown_by: Option<Method>,
    /// Everything else; taken as [valid](Settings::validate).
    pub settings: Settings,
}

impl Condition {
    fn fly(&self, seed: u64) -> FlightResult {
        let trial = |method| Trial {
            method,
            settings: self.settings.clone(),
            seed,
        };
        match self.flown_by {
            None => fly(&trial(self.method)),
            Some(pilot) => fly_shown(&trial(pilot), self.method),
        }
    }
}

/// Flies the trials with these numbers under each condition: one vector a condition, in order of
/// `trials`. `done` is called after every flight, from any thread, with the index of its
/// condition.
///
/// Trial `i` has the seed [`trial_seed`]`(base_seed, i)` under every condition, so that conditions
/// meet the same first guesses and noises, and differences between them are not chance. Results do
/// not depend on the number of threads, computing times aside.
pub fn run(
    conditions: &[Condition],
    trials: &[u64],
    base_seed: u64,
    done: impl Fn(usize) + Sync,
) -> Vec<Vec<FlightResult>> {
    let flights: Vec<(usize, u64)> = (0..conditions.len())
        .flat_map(|index| trials.iter().map(move |&trial| (index, trial)))
        .collect();
    let results: Vec<(usize, FlightResult)> = flights
        .into_par_iter()
        // Flights differ a lot in length: no thread should be left with a long tail of them.
        .with_max_len(1)
        .filter_map(|(index, number)| {
            let condition = conditions.get(index)?;
            let result = condition.fly(trial_seed(base_seed, number));
            done(index);
            Some((index, result))
        })
        .collect();
    let mut sorted = vec![Vec::with_capacity(trials.len()); conditions.len()];
    for (index, result) in results {
        if let Some(row) = sorted.get_mut(index) {
            row.push(result);
        }
    }
    sorted
}
