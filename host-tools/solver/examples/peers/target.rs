//! A moving target: `prior` of position, velocity and their sigmas, `noise density range bearing
//! kernel`, `sighting t x y z turn range azimuth elevation`.

use std::error::Error;
use std::time::Instant;

use nalgebra::{UnitQuaternion, Vector3};
use nova_solver::Kernel;
use nova_solver::tracking::{
    Bearing, Belief, GraphOptions, Kernels, Range, SensorPose, Sighting, TargetGraph, Tracker,
};

use crate::{Outcome, Problem};

pub(crate) fn run(problem: &Problem) -> Result<Vec<Outcome>, Box<dyn Error>> {
    let [x, y, z, vx, vy, vz, sigma_m, sigma_m_s] = problem.one("prior")?;
    let [density, range_sigma_m, bearing_sigma, kernel] = problem.one("noise")?;
    let [seconds] = problem.one("seconds")?;
    let prior = Belief::about(
        Vector3::new(x, y, z),
        sigma_m,
        Vector3::new(vx, vy, vz),
        sigma_m_s,
    );
    let sightings: Vec<Sighting> = problem
        .all("sighting")?
        .into_iter()
        .map(
            |[t_s, x, y, z, turn, range_m, azimuth, elevation]| Sighting {
                t_s,
                pose: SensorPose::known(
                    Vector3::new(x, y, z),
                    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -turn),
                ),
                range: Some(Range {
                    range_m,
                    sigma_m: range_sigma_m,
                }),
                bearing: Some(Bearing::from_angles(azimuth, elevation, bearing_sigma)),
            },
        )
        .collect();
    let whole = GraphOptions {
        kernels: Kernels {
            range: Kernel::None,
            bearing: Kernel::Cauchy { c: kernel },
        },
        acceleration_density: density,
        window: None,
        tolerance_m: 1e-3,
        ..GraphOptions::robust()
    };
    let exact = GraphOptions {
        tolerance_m: 1e-9,
        rounds: 200,
        ..whole
    };
    let window = GraphOptions {
        window: Some(64),
        ..whole
    };
    // What GTSAM does unless told otherwise.
    let loose = GraphOptions {
        tolerance_m: 0.1,
        ..whole
    };
    let mut outcomes = Vec::new();
    for (name, options) in [
        ("whole", whole),
        ("exact", exact),
        ("window", window),
        ("loose", loose),
    ] {
        outcomes.push(Outcome::of(name, seconds, || {
            let mut graph = TargetGraph::new(prior, options)?;
            let mut times = Vec::with_capacity(sightings.len());
            for sighting in &sightings {
                let begin = Instant::now();
                graph.observe(sighting)?;
                std::hint::black_box(graph.belief());
                times.push(begin.elapsed());
            }
            // With few states everybody is quick.
            times.drain(..times.len() / 2);
            let end = graph.belief();
            Ok((times, end.position_m.as_slice().to_vec()))
        })?);
    }
    Ok(outcomes)
}
