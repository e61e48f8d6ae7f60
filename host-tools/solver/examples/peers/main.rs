//! Our side of `benches/peers`: solves a problem from a file, again and again, and prints times and
//! answers as JSON. The Python side (`benches/peers/run.py`) writes the files, calls this program,
//! solves the same problems and compares.
//!
//! A problem is a text file of lines, each a word and numbers; SI units.

mod joint;
mod map;
mod multilateration;
mod problem;
mod program;
mod target;

use std::error::Error;
use std::time::{Duration, Instant};

use problem::Problem;

/// A method's times and answer.
struct Outcome {
    name: &'static str,
    times: Vec<Duration>,
    answer: Vec<f64>,
}

impl Outcome {
    /// Repeats `solve`, which returns the times it took and its answer, for `seconds`, and at least
    /// three times.
    fn of(
        name: &'static str,
        seconds: f64,
        mut solve: impl FnMut() -> Result<(Vec<Duration>, Vec<f64>), Box<dyn Error>>,
    ) -> Result<Self, Box<dyn Error>> {
        let (_, answer) = solve()?;
        let mut times = Vec::new();
        let begin = Instant::now();
        let mut runs = 0;
        while runs < 3 || begin.elapsed().as_secs_f64() < seconds {
            times.extend(solve()?.0);
            runs += 1;
        }
        Ok(Self {
            name,
            times,
            answer,
        })
    }

    fn json(mut self) -> String {
        self.times.sort();
        let at = |part: f64| {
            let place = (part * (self.times.len() - 1) as f64).round() as usize;
            self.times[place].as_secs_f64() * 1e6
        };
        let mean =
            self.times.iter().sum::<Duration>().as_secs_f64() * 1e6 / self.times.len() as f64;
        format!(
            r#"{{"name": "{}", "median_us": {:.3}, "mean_us": {mean:.3}, "p99_us": {:.3}, "answer": {:?}}}"#,
            self.name,
            at(0.5),
            at(0.99),
            self.answer
        )
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [kind, path] = arguments.as_slice() else {
        return Err("usage: peers multilateration|nova|map|target|program FILE".into());
    };
    let problem = Problem::read(path)?;
    let outcomes = match kind.as_str() {
        "multilateration" => multilateration::run(&problem)?,
        "nova" => joint::run(&problem)?,
        "map" => map::run(&problem)?,
        "target" => target::run(&problem)?,
        "program" => program::run(&problem)?,
        other => return Err(format!("unknown kind of problem: {other}").into()),
    };
    let lines: Vec<String> = outcomes.into_iter().map(Outcome::json).collect();
    println!("[{}]", lines.join(",\n "));
    Ok(())
}
