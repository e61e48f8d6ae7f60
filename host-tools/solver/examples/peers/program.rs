//! The controller's quadratic programs, `program reference sight least most low high`; the answer is all
//! solutions one after the other.

use std::error::Error;
use std::time::Instant;

use nalgebra::Vector3;
use nova_solver::tracking::control::{AccelerationBox, nearest_command};

use crate::{Outcome, Problem};

pub(crate) fn run(problem: &Problem) -> Result<Vec<Outcome>, Box<dyn Error>> {
    let [seconds] = problem.one("seconds")?;
    let programs = problem.all::<14>("program")?;
    let outcome = Outcome::of("clarabel", seconds, || {
        let mut times = Vec::with_capacity(programs.len());
        let mut answer = Vec::with_capacity(3 * programs.len());
        for p in &programs {
            let vector = |from: usize| Vector3::new(p[from], p[from + 1], p[from + 2]);
            let limits = AccelerationBox {
                low: vector(8),
                high: vector(11),
            };
            let begin = Instant::now();
            let found = nearest_command(&vector(0), &vector(3), (p[6], p[7]), &limits, &[]);
            times.push(begin.elapsed());
            answer.extend(found.ok_or("a program without solution")?.iter());
        }
        Ok((times, answer))
    })?;
    Ok(vec![outcome])
}
