//! `nova evaluate` and `nova merge`: Monte Carlo tables.

use crate::error::bad_input;
use crate::evaluation::{self, Part, Plan, Report, Shard};
use crate::files::write_whole;
use crate::screen;
use anyhow::Result;
use std::io::Write as _;
use std::path::PathBuf;

/// Flies each condition of a table many times and prints one row a condition.
///
/// Error is the horizontal distance between vehicle and tag at touchdown; overhead the path's length
/// over that of flying horizontally and then vertically, less one; bound the least mean error that
/// any method could have (Cramer-Rao); NEES the squared error normalised by the navigator's own
/// covariance, 2 on average where that is honest. Trial i meets the same first guess and the same
/// noise under every condition. All cores work; except for computing times, figures depend on the
/// seed alone (RAYON_NUM_THREADS sets the number of threads). host-tools/tables holds the tables of
/// the paper; each tells its format on top.
///
/// With --shard k/n only every n-th trial is flown and its results go to --out, for `nova merge`.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  nova evaluate host-tools/tables/map.toml --trials 100 --seed 2025
  nova evaluate host-tools/tables/fig-16.toml --trials 20 --json
  nova evaluate host-tools/tables/map.toml --shard 2/8 --out part-2.jsonl
  nova merge part-*.jsonl --page map.html")]
pub(crate) struct Evaluate {
    /// The table.
    table: PathBuf,
    /// Flights under each condition.
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    trials: u64,
    /// Everything random follows from this number.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Only this piece of the run.
    #[arg(long, value_name = "K/N", requires = "out", conflicts_with_all = ["json", "page"])]
    shard: Option<Part>,
    #[command(flatten)]
    output: Output,
}

/// The table of a run that `nova evaluate --shard` has flown in pieces.
///
/// All pieces of one run are needed, in any order. Except for computing times the table is what one
/// run of the whole would have given.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  nova merge part-*.jsonl
  nova merge part-*.jsonl --json --out map.jsonl")]
pub(crate) struct Merge {
    /// The pieces.
    #[arg(required = true, value_name = "SHARD")]
    shards: Vec<PathBuf>,
    #[command(flatten)]
    output: Output,
}

#[derive(clap::Args)]
struct Output {
    /// One JSON object a condition instead of a table.
    #[arg(long)]
    json: bool,
    /// Write to this file instead of standard output.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Also write a page with the table and the distribution of the errors.
    #[arg(long, value_name = "FILE")]
    page: Option<PathBuf>,
}

impl Evaluate {
    pub(crate) fn run(self) -> Result<()> {
        let plan = Plan::read(&self.table)?;
        let trials: Vec<u64> = match self.shard {
            Some(part) => part.trials(self.trials),
            None => (0..self.trials).collect(),
        };
        let conditions = plan.conditions();
        let flights = trials.len() * conditions.len();
        let bar = screen::progress(flights as u64, self.output.json);
        let results = nova_flight::run(&conditions, &trials, self.seed, |condition| {
            if let Some(entry) = plan.entries.get(condition) {
                bar.set_message(entry.name.clone());
            }
            bar.inc(1);
        });
        bar.finish_and_clear();
        match (self.shard, &self.output.out) {
            (None, _) => self.output.write(&Report::new(plan, self.seed, &results)),
            (Some(part), Some(out)) => {
                Shard::new(plan, part, self.seed, self.trials, results).write(out)
            }
            (Some(_), None) => Err(bad_input!("--shard needs --out FILE")),
        }
    }
}

impl Merge {
    pub(crate) fn run(self) -> Result<()> {
        let merged = evaluation::merge(&self.shards)?;
        self.output
            .write(&Report::new(merged.plan, merged.seed, &merged.results))
    }
}

impl Output {
    fn write(&self, report: &Report) -> Result<()> {
        if let Some(page) = &self.page {
            report.write_page(page)?;
        }
        let text = if self.json {
            report.json()?
        } else {
            report.text()
        };
        match &self.out {
            Some(file) => write_whole(file, text),
            None => Ok(std::io::stdout().write_all(text.as_bytes())?),
        }
    }
}
