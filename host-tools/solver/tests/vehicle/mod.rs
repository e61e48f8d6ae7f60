//! A vehicle at 1 m/s that does as it is told, its drifting dead reckoning and its noisy ranges. The
//! simulator proper is another crate; here only what is claimed of a navigator alone matters.

use nalgebra::{Rotation2, Vector2, Vector3};
use nova_solver::ins_error::InsNoise;
use nova_solver::navigation::{Action, Command, InsSample, RangeSample};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Time between ranges, seconds.
pub(crate) const TICK_S: f64 = 0.1;

/// Where everything is, and how noisy.
#[derive(Debug, Clone, Copy)]
pub(crate) struct World {
    pub(crate) tag_m: Vector3<f64>,
    pub(crate) start_m: Vector3<f64>,
    pub(crate) guess_m: Vector3<f64>,
    /// Direction from which the errors of dead reckoning are counted, radians.
    pub(crate) heading: f64,
    pub(crate) ins: InsNoise,
    pub(crate) range_sigma_m: f64,
}

impl World {
    /// The paper's set-up: 20 m away, 30 m up, a consumer accelerometer, ranges with 3 cm of noise.
    pub(crate) fn paper() -> Self {
        Self {
            tag_m: Vector3::zeros(),
            start_m: Vector3::new(-12.0, 16.0, 30.0),
            guess_m: Vector3::new(4.0, 3.0, -3.0),
            heading: 0.0,
            ins: InsNoise {
                velocity_random_walk: 7.7e-3,
                acceleration_random_walk: 5e-4,
                position_random_walk: 1e-3,
                height_random_walk: 3e-3,
                height_sigma_m: 0.03,
            },
            range_sigma_m: 0.03,
        }
    }
}

/// What is measured at one moment, and the truth that nobody sees.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Tick {
    pub(crate) ins: InsSample,
    pub(crate) range: RangeSample,
    pub(crate) vehicle_m: Vector3<f64>,
}

/// The vehicle under way.
#[derive(Debug, Clone)]
pub(crate) struct Vehicle {
    world: World,
    rng: ChaCha8Rng,
    ticks: u32,
    place_m: Vector3<f64>,
    /// Error of dead reckoning and of its velocity and acceleration, along and across the heading.
    drift: [Vector2<f64>; 3],
    height_drift_m: f64,
}

impl Vehicle {
    /// At rest at the start; `seed` decides all noise.
    pub(crate) fn new(world: World, seed: u64) -> Self {
        Self {
            world,
            rng: ChaCha8Rng::seed_from_u64(seed),
            ticks: 0,
            place_m: world.start_m,
            drift: [Vector2::zeros(); 3],
            height_drift_m: 0.0,
        }
    }

    /// Follows the command for a tick, by its own dead reckoning; then measures.
    pub(crate) fn obey(&mut self, command: &Command) -> Tick {
        let t_s = TICK_S * f64::from(self.ticks);
        let believed_m = self.place_m + self.error_m() - command.ins_error.at(t_s);
        let to_goal_m = command.waypoint_m - believed_m;
        let velocity = match command.action {
            Action::Hold => Vector3::zeros(),
            Action::Fly => to_goal_m.cap_magnitude(1.0),
            Action::Land => (2.0 * to_goal_m.xy()).cap_magnitude(0.9).push(-0.4),
        };
        self.fly(velocity)
    }

    /// Flies at this velocity, m/s, for a tick; then measures.
    pub(crate) fn fly(&mut self, velocity: Vector3<f64>) -> Tick {
        self.ticks += 1;
        self.place_m += velocity * TICK_S;
        self.drift_on();
        let t_s = TICK_S * f64::from(self.ticks);
        let height_noise_m = self.world.ins.height_sigma_m * self.normal();
        let range_noise_m = self.world.range_sigma_m * self.normal();
        let reckoned_m = self.place_m + self.error_m() + Vector3::z() * height_noise_m;
        let range_m = (self.place_m - self.world.tag_m).norm() + range_noise_m;
        Tick {
            ins: InsSample {
                t_s,
                position_m: reckoned_m,
            },
            range: RangeSample { t_s, range_m },
            vehicle_m: self.place_m,
        }
    }

    /// Error of dead reckoning but for the barometer's white noise.
    fn error_m(&self) -> Vector3<f64> {
        (Rotation2::new(self.world.heading) * self.drift[0]).push(self.height_drift_m)
    }

    /// The model of `ins_error`, by Euler's method.
    fn drift_on(&mut self) {
        let noise = self.world.ins;
        let root = TICK_S.sqrt();
        let strengths = [
            noise.position_random_walk,
            noise.velocity_random_walk,
            noise.acceleration_random_walk,
        ];
        for order in (0..3).rev() {
            let growth = self.drift.get(order + 1).copied().unwrap_or_default() * TICK_S;
            let walk = Vector2::new(self.normal(), self.normal()) * (strengths[order] * root);
            self.drift[order] += growth + walk;
        }
        self.height_drift_m += noise.height_random_walk * root * self.normal();
    }

    fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.rng)
    }
}
