//! A place from ranges: `guess x y z`, `seconds s`, `range t x y z range sigma`.

use std::error::Error;
use std::hint::black_box;
use std::time::Instant;

use nova_solver::kernel::CAUCHY_95;
use nova_solver::multilateration::Noise;
use nova_solver::{Kernel, MultilaterationOptions, RangeMeasurement, multilaterate};

use crate::{Outcome, Problem};

pub(crate) fn run(problem: &Problem) -> Result<Vec<Outcome>, Box<dyn Error>> {
    let log: Vec<_> = problem
        .all("range")?
        .into_iter()
        .map(|[t_s, x, y, z, range_m, sigma_m]| RangeMeasurement {
            t_s,
            position_m: [x, y, z].into(),
            range_m,
            sigma_m,
        })
        .collect();
    let [seconds] = problem.one("seconds")?;
    // What SciPy does and no more: one fit, sigmas as given, nothing set aside.
    let same = MultilaterationOptions {
        initial_guess_m: Some(problem.place("guess")?),
        noise: Noise::Given,
        reject_sigmas: f64::INFINITY,
        seek_alternatives: false,
        ..MultilaterationOptions::default()
    };
    let kernels = [
        ("plain", Kernel::None),
        ("cauchy", Kernel::Cauchy { c: CAUCHY_95 }),
    ];
    kernels
        .into_iter()
        .map(|(name, kernel)| {
            let options = MultilaterationOptions { kernel, ..same };
            Outcome::of(name, seconds, || {
                let begin = Instant::now();
                let found = multilaterate(black_box(&log), black_box(&options));
                let took = begin.elapsed();
                Ok((vec![took], found?.position_m.as_slice().to_vec()))
            })
        })
        .collect()
}
