//! Maximum a posteriori over a flight: `guess x y z`, `seconds s`, `noise velocity acceleration
//! position height floor slope outliers`, `prior horizontal vertical bias velocity acceleration`,
//! `sample t x y z range`.

use std::error::Error;
use std::time::Instant;

use nova_solver::ins_error::InsNoise;
use nova_solver::map::{MapNavigator, MapOptions, NoiseModel};
use nova_solver::navigation::{FirstGuess, InsSample, Navigator, RangeSample};

use crate::{Outcome, Problem};

pub(crate) fn run(problem: &Problem) -> Result<Vec<Outcome>, Box<dyn Error>> {
    let tag_m = problem.place("guess")?;
    let [seconds] = problem.one("seconds")?;
    let samples = problem.all("sample")?;
    let options = options(problem)?;
    let fly = || -> Result<_, Box<dyn Error>> {
        let mut navigator = MapNavigator::new(FirstGuess { tag_m }, options);
        let mut times = Vec::new();
        for [t_s, x, y, z, range_m] in &samples {
            let position_m = [*x, *y, *z].into();
            let updates = navigator.updates();
            let begin = Instant::now();
            navigator.on_ins(InsSample {
                t_s: *t_s,
                position_m,
            })?;
            navigator.on_range(RangeSample {
                t_s: *t_s,
                range_m: *range_m,
            })?;
            let took = begin.elapsed();
            if navigator.updates() > updates {
                times.push(took);
            }
        }
        let end = navigator.estimate().ok_or("no estimate")?;
        Ok((times, (end.tag_m - end.vehicle_m).as_slice().to_vec()))
    };
    Ok(vec![Outcome::of("map", seconds, fly)?])
}

/// The noise as given: the Python side does not learn it either.
fn options(problem: &Problem) -> Result<MapOptions, Box<dyn Error>> {
    let [
        velocity,
        acceleration,
        position,
        height,
        range_sigma,
        outliers,
    ] = problem.one("noise")?;
    let [
        horizontal,
        vertical,
        bias,
        start_velocity,
        start_acceleration,
    ] = problem.one("prior")?;
    Ok(MapOptions {
        noise: NoiseModel {
            ins: InsNoise {
                velocity_random_walk: velocity,
                acceleration_random_walk: acceleration,
                position_random_walk: position,
                height_random_walk: height,
                height_sigma_m: 0.0,
            },
            range_sigma_m: range_sigma,
            outlier_probability: outliers,
        },
        adapt_noise: false,
        guess_sigma_horizontal_m: horizontal,
        guess_sigma_vertical_m: vertical,
        bias_sigma_m: bias,
        initial_velocity_sigma: start_velocity,
        initial_acceleration_sigma: start_acceleration,
        ..MapOptions::default()
    })
}
