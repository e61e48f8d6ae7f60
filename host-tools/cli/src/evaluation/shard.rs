//! Pieces of a Monte Carlo run, for many machines: one JSON object a line.
//!
//! The first line says what is flown and which piece it is:
//! `{"nova_shard": 1, "part": "2/8", "seed": .., "trials": .., "version": .., "plan": {..}}`. Each
//! other is one flight: `{"condition": 0, "trial": 9, "result": {..}}`. Trial `i` is in part `k/n`
//! where `i mod n = k - 1`.

use super::plan::Plan;
use crate::error::bad_input;
use crate::files::write_whole;
use anyhow::Result;
use nova_flight::FlightResult;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// The `k`-th of `n` pieces.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub(crate) struct Part {
    k: u64,
    n: u64,
}

impl Part {
    /// The trials of this piece, of so many in all.
    pub(crate) fn trials(self, all: u64) -> Vec<u64> {
        (0..all)
            .filter(|trial| trial % self.n == self.k - 1)
            .collect()
    }
}

impl FromStr for Part {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = |text: &str| text.parse::<u64>().ok();
        let pair = text.split_once('/');
        match pair.and_then(|(k, n)| Some((number(k)?, number(n)?))) {
            Some((k, n)) if (1..=n).contains(&k) => Ok(Self { k, n }),
            _ => Err("not of the form k/n with k from 1 to n".to_owned()),
        }
    }
}

impl TryFrom<String> for Part {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<Part> for String {
    fn from(part: Part) -> Self {
        part.to_string()
    }
}

impl std::fmt::Display for Part {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}/{}", self.k, self.n)
    }
}

/// The first line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Head {
    /// Version of the format.
    nova_shard: u32,
    part: Part,
    seed: u64,
    trials: u64,
    /// Of the program: another may fly otherwise.
    version: String,
    plan: Plan,
}

/// Every other line.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Flight {
    condition: usize,
    trial: u64,
    result: FlightResult,
}

const FORMAT: u32 = 1;

/// A piece of a run.
pub(crate) struct Shard {
    head: Head,
    /// Of each condition, in order of trials.
    results: Vec<Vec<FlightResult>>,
}

/// A run put together.
pub(crate) struct Merged {
    pub(crate) plan: Plan,
    pub(crate) seed: u64,
    /// Of each condition, in order of trials.
    pub(crate) results: Vec<Vec<FlightResult>>,
}

impl Shard {
    /// The results of a part's trials under each condition.
    pub(crate) fn new(
        plan: Plan,
        part: Part,
        seed: u64,
        trials: u64,
        results: Vec<Vec<FlightResult>>,
    ) -> Self {
        let head = Head {
            nova_shard: FORMAT,
            part,
            seed,
            trials,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            plan,
        };
        Self { head, results }
    }

    /// Writes it; an older file of that name is replaced as a whole.
    pub(crate) fn write(self, path: &Path) -> Result<()> {
        let mut text = serde_json::to_string(&self.head)? + "\n";
        let trials = self.head.part.trials(self.head.trials);
        for (condition, results) in self.results.into_iter().enumerate() {
            for (&trial, result) in trials.iter().zip(results) {
                let flight = Flight {
                    condition,
                    trial,
                    result,
                };
                text += &serde_json::to_string(&flight)?;
                text.push('\n');
            }
        }
        write_whole(path, text)
    }

    fn read(path: &Path) -> Result<Self> {
        let shown = path.display();
        let text = std::fs::read_to_string(path)
            .map_err(|error| bad_input!("{shown}: cannot be read: {error}"))?;
        let mut lines = (1..).zip(text.lines());
        let head: Head = lines
            .next()
            .and_then(|(_, line)| serde_json::from_str(line).ok())
            .filter(|head: &Head| head.nova_shard == FORMAT)
            .ok_or_else(|| {
                bad_input!(
                    "{shown}: line 1: not the beginning of what `nova evaluate --shard` writes"
                )
            })?;
        let trials = head.part.trials(head.trials);
        // The order in which they are written.
        let mut due = (0..head.plan.entries.len())
            .flat_map(|condition| trials.iter().map(move |&trial| (condition, trial)));
        let mut results = vec![Vec::with_capacity(trials.len()); head.plan.entries.len()];
        for (number, line) in lines {
            let flight: Flight = serde_json::from_str(line)
                .map_err(|error| bad_input!("{shown}: line {number}: {error}"))?;
            if due.next() != Some((flight.condition, flight.trial)) {
                return Err(bad_input!(
                    "{shown}: line {number}: trial {} of condition {} is not due here",
                    flight.trial,
                    flight.condition
                ));
            }
            if let Some(row) = results.get_mut(flight.condition) {
                row.push(flight.result);
            }
        }
        match due.count() {
            0 => Ok(Self { head, results }),
            missing => Err(bad_input!(
                "{shown}: {missing} flights are missing at the end: the file has been cut off"
            )),
        }
    }
}

/// Puts all parts of one run together.
pub(crate) fn merge(paths: &[PathBuf]) -> Result<Merged> {
    let mut shards = Vec::new();
    for path in paths {
        shards.push((path, Shard::read(path)?));
    }
    shards.sort_by_key(|(_, shard)| shard.head.part.k);
    let (first_path, first) = shards.first().ok_or_else(|| bad_input!("no shards"))?;
    for (path, shard) in &shards {
        if let Some(what) = difference(&first.head, &shard.head) {
            return Err(bad_input!(
                "{} and {} are of different runs: {what}",
                first_path.display(),
                path.display()
            ));
        }
    }
    let n = first.head.part.n;
    for (a, b) in shards.iter().zip(shards.iter().skip(1)) {
        if a.1.head.part == b.1.head.part {
            return Err(bad_input!(
                "{} and {} are both part {}",
                a.0.display(),
                b.0.display(),
                a.1.head.part
            ));
        }
    }
    let missing: Vec<String> = (1..=n)
        .filter(|k| shards.iter().all(|(_, shard)| shard.head.part.k != *k))
        .map(|k| Part { k, n }.to_string())
        .collect();
    if !missing.is_empty() {
        return Err(bad_input!("missing: part {}", missing.join(", ")));
    }
    let (plan, seed) = (first.head.plan.clone(), first.head.seed);
    let results = (0..plan.entries.len())
        .map(|condition| {
            let mut flights: Vec<(u64, FlightResult)> = shards
                .iter_mut()
                .flat_map(|(_, shard)| {
                    let trials = shard.head.part.trials(shard.head.trials);
                    let row = shard.results.get_mut(condition).map(std::mem::take);
                    trials.into_iter().zip(row.unwrap_or_default())
                })
                .collect();
            flights.sort_by_key(|(trial, _)| *trial);
            flights.into_iter().map(|(_, result)| result).collect()
        })
        .collect();
    Ok(Merged {
        plan,
        seed,
        results,
    })
}

/// In what two heads differ that may not.
fn difference(a: &Head, b: &Head) -> Option<&'static str> {
    [
        (a.version != b.version, "versions of nova"),
        (a.plan != b.plan, "tables"),
        (a.seed != b.seed, "seeds"),
        (a.trials != b.trials, "numbers of trials"),
        (a.part.n != b.part.n, "numbers of parts"),
    ]
    .into_iter()
    .find_map(|(differs, what)| differs.then_some(what))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_hold_every_trial_once() {
        let mut all: Vec<u64> = (1..=3).flat_map(|k| Part { k, n: 3 }.trials(10)).collect();
        assert_eq!(Part { k: 2, n: 3 }.trials(10), [1, 4, 7]);
        all.sort_unstable();
        assert_eq!(all, (0..10).collect::<Vec<_>>());
    }

    #[test]
    fn a_part_is_written_as_it_is_read() {
        assert_eq!("2/8".parse::<Part>().unwrap().to_string(), "2/8");
        for text in ["0/8", "9/8", "2", "2/", "/8", "a/b", "-1/8", "1/0"] {
            assert!(text.parse::<Part>().is_err(), "{text}");
        }
    }
}
