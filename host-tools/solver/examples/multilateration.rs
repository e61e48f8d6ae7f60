//! A place from ranges alone: what a path can tell, and what it cannot.
//!
//! `cargo run -p nova-solver --example multilateration`

use nalgebra::Vector3;
use nova_solver::multilateration::Height;
use nova_solver::{MultilaterationOptions, RangeMeasurement, SolveError, multilaterate};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

const TAG: Vector3<f64> = Vector3::new(12.0, -5.0, 0.5);

fn main() -> Result<(), SolveError> {
    let winding =
        |s: f64| Vector3::new(20.0 * s, 6.0 * (9.0 * s).sin(), 8.0 + 4.0 * (7.0 * s).cos());
    let level = |s: f64| Vector3::new(20.0 * s, 6.0 * (9.0 * s).sin(), 8.0);
    let straight = |s: f64| Vector3::new(20.0 * s, 2.0 * s, 8.0);
    let anywhere = MultilaterationOptions::default();
    // The tag lies on the ground, or at most on a table.
    let low = MultilaterationOptions {
        height: Height::Between {
            min_m: -1.0,
            max_m: 2.0,
        },
        ..anywhere
    };

    println!(
        "path                    place                   sigma   off by  used  verdict   or else"
    );
    show("winding", &measured(winding), &anywhere)?;
    show("level", &measured(level), &anywhere)?;
    show("level, tag known low", &measured(level), &low)?;
    show("straight", &measured(straight), &anywhere)?;
    let mut obstructed = measured(winding);
    obstructed
        .iter_mut()
        .step_by(9)
        .for_each(|m| m.range_m += 4.0);
    show("winding, obstructed", &obstructed, &anywhere)
}

/// 200 ranges with 5 cm of noise along a path, `s` from 0 to 1.
fn measured(path: impl Fn(f64) -> Vector3<f64>) -> Vec<RangeMeasurement> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    (0..200)
        .map(|i| {
            let position_m = path(f64::from(i) / 200.0);
            let noise: f64 = StandardNormal.sample(&mut rng);
            let range_m = (TAG - position_m).norm() + 0.05 * noise;
            RangeMeasurement {
                t_s: 0.1 * f64::from(i),
                position_m,
                range_m,
                sigma_m: 0.05,
            }
        })
        .collect()
}

fn show(
    path: &str,
    log: &[RangeMeasurement],
    options: &MultilaterationOptions,
) -> Result<(), SolveError> {
    let found = multilaterate(log, options)?;
    let [x, y, z] = found.position_m.into();
    let other = found.alternative.map_or(String::new(), |other| {
        let [x, y, z] = other.position_m.into();
        format!(
            "{x:.2} {y:.2} {z:.2} m, probability {:.2}",
            other.probability
        )
    });
    let verdict = format!("{:?}", found.observability);
    println!(
        "{path:22}  {x:6.2} {y:6.2} {z:6.2} m  {:6.2}  {:6.2}  {:4}  {:8}  {other}",
        found.covariance_m2.trace().sqrt(),
        (found.position_m - TAG).norm(),
        found.used,
        verdict.split(' ').next().unwrap_or_default(),
    );
    Ok(())
}
