//! The MAP navigator in the air: dead reckoning drifts, ranges are noisy, the vehicle flies where it
//! is told to and comes down beside the tag.
//!
//! `cargo run -p nova-solver --example navigator`

use std::error::Error;

use nalgebra::{Vector2, Vector3};
use nova_solver::map::{MapNavigator, MapOptions};
use nova_solver::navigation::{Action, Command, FirstGuess, InsSample, Navigator, RangeSample};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

const TAG: Vector3<f64> = Vector3::new(18.0, 7.0, 0.5);
const TICK_S: f64 = 0.1;

fn main() -> Result<(), Box<dyn Error>> {
    // Somebody said where the tag is, and was off by 6 m.
    let guess = FirstGuess {
        tag_m: TAG + Vector3::new(3.0, -4.0, 3.0),
    };
    let mut navigator = MapNavigator::new(guess, MapOptions::default());
    let mut vehicle = Vehicle::new(Vector3::new(0.0, 0.0, 30.0));

    println!(
        "time    tag                      sigma   off by  phase      to                     doubts"
    );
    for tick in 0..1200_u32 {
        let (ins, range) = vehicle.measure();
        navigator.on_ins(ins)?;
        navigator.on_range(range)?;
        if tick % 40 == 39 {
            report(&navigator, vehicle.place_m);
        }
        if !vehicle.obey(&navigator.command()) {
            break;
        }
    }
    println!(
        "down {:.2} m from the tag",
        (vehicle.place_m - TAG).xy().norm()
    );
    Ok(())
}

/// The navigation frame is dead reckoning's, so what counts is the way from the vehicle to the tag.
fn report(navigator: &MapNavigator, vehicle_m: Vector3<f64>) {
    let Some(estimate) = navigator.estimate() else {
        return println!("nothing known yet");
    };
    let sigma_m = estimate
        .relative_covariance_m2
        .map_or(f64::NAN, |c| c.trace().sqrt());
    let off_m = (estimate.tag_m - estimate.vehicle_m) - (TAG - vehicle_m);
    let [x, y, z] = estimate.tag_m.into();
    let [to_x, to_y, to_z] = navigator.command().waypoint_m.into();
    let mut doubts = Vec::new();
    doubts.extend(estimate.doubts.weak_geometry.then_some("weak geometry"));
    doubts.extend(estimate.doubts.ambiguous.then_some("ambiguous"));
    println!(
        "{:4.1} s  {x:6.2} {y:6.2} {z:6.2} m  {sigma_m:6.2} m  {:5.2} m  {:9}  {to_x:6.2} {to_y:6.2} {to_z:6.2} m  {}",
        estimate.t_s,
        off_m.norm(),
        format!("{:?}", navigator.phase()),
        doubts.join(", "),
    );
}

/// Follows commands at 1 m/s; its accelerometer adds noise that integrates to a drift.
struct Vehicle {
    t_s: f64,
    place_m: Vector3<f64>,
    drift_m: Vector2<f64>,
    drift_m_s: Vector2<f64>,
    rng: ChaCha8Rng,
}

impl Vehicle {
    fn new(place_m: Vector3<f64>) -> Self {
        let rng = ChaCha8Rng::seed_from_u64(1);
        Self {
            t_s: 0.0,
            place_m,
            drift_m: Vector2::zeros(),
            drift_m_s: Vector2::zeros(),
            rng,
        }
    }

    /// Dead reckoning and range, both with 3 cm of noise (dead reckoning in height alone).
    fn measure(&mut self) -> (InsSample, RangeSample) {
        let height_m = 0.03 * self.normal();
        let position_m = self.place_m + self.drift_m.push(height_m);
        let range_m = (self.place_m - TAG).norm() + 0.03 * self.normal();
        (
            InsSample {
                t_s: self.t_s,
                position_m,
            },
            RangeSample {
                t_s: self.t_s,
                range_m,
            },
        )
    }

    /// Flies for a tick; false once it is on the ground.
    fn obey(&mut self, command: &Command) -> bool {
        // All it knows of its place is dead reckoning, less what the navigator says that is off by.
        let reckoned_m = self.place_m + self.drift_m.push(0.0);
        let to_goal_m = command.waypoint_m - (reckoned_m - command.ins_error.at(self.t_s));
        let velocity_m_s = match command.action {
            Action::Hold => Vector3::zeros(),
            Action::Fly => to_goal_m.cap_magnitude(1.0),
            Action::Land => (2.0 * to_goal_m.xy()).cap_magnitude(0.9).push(-0.4),
        };
        self.t_s += TICK_S;
        self.place_m += velocity_m_s * TICK_S;
        let walk = Vector2::new(self.normal(), self.normal());
        self.drift_m_s += walk * (7.7e-3 * TICK_S.sqrt());
        self.drift_m += self.drift_m_s * TICK_S;
        self.place_m.z > TAG.z
    }

    fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.rng)
    }
}
