//! Keeping a distance to a target that is only believed to be somewhere (eq. 29-45).
//!
//! ```text
//! Belief ----> Relative ----> reference (control Lyapunov function) ---\
//!    |            |                                                     quadratic program --> acceleration
//!    `-> radius --+---------> bounds along the line of sight (barriers) /
//! ```

mod barrier;
mod options;
mod program;
mod relative;
mod walls;

use nalgebra::Vector3;

pub use options::{Guard, StandoffOptions};
pub use program::{AccelerationBox, Decision, HalfSpace, nearest_command};
pub use relative::{VehicleState, chi_square_3, longest_sigma_m};
pub use walls::Wall;

use super::motion::Belief;
use crate::error::SolveError;
use barrier::Along;
use relative::Relative;

/// A vehicle's controller that keeps its distance to a target.
#[derive(Debug, Clone)]
pub struct StandoffController {
    options: StandoffOptions,
    guard: Guard,
    quantile: f64,
    walls: Vec<Wall>,
    clearance_m: f64,
    /// Room for what walls leave, so that commands take nothing from the heap for it.
    left: Vec<HalfSpace>,
    decisions: Decisions,
}

/// How many commands came about how.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Decisions {
    /// [`Decision::Reference`]
    pub reference: u64,
    /// [`Decision::Guarded`]
    pub guarded: u64,
    /// [`Decision::FarGivenUp`]
    pub far_given_up: u64,
    /// [`Decision::FullChase`]
    pub full_chase: u64,
    /// [`Decision::FullBraking`]
    pub full_braking: u64,
    /// [`Decision::Cornered`]
    pub cornered: u64,
    /// [`Decision::WallsGivenUp`]
    pub walls_given_up: u64,
    /// [`Decision::SolverFailed`]
    pub solver_failed: u64,
}

impl Decisions {
    fn note(&mut self, decision: Decision) {
        let count = match decision {
            Decision::Reference => &mut self.reference,
            Decision::Guarded => &mut self.guarded,
            Decision::FarGivenUp => &mut self.far_given_up,
            Decision::FullChase => &mut self.full_chase,
            Decision::FullBraking => &mut self.full_braking,
            Decision::Cornered => &mut self.cornered,
            Decision::WallsGivenUp => &mut self.walls_given_up,
            Decision::SolverFailed => &mut self.solver_failed,
        };
        *count += 1;
    }

    /// Commands at which not all limits could be kept.
    pub fn infeasible(&self) -> u64 {
        self.far_given_up
            + self.full_chase
            + self.full_braking
            + self.cornered
            + self.walls_given_up
            + self.solver_failed
    }
}

/// What the vehicle is to do until the next command.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StandoffCommand {
    /// Acceleration, m/s^2.
    pub acceleration: Vector3<f64>,
    /// Confidence radius of the target's place, eq. 29.
    pub radius_m: f64,
    /// How it came about.
    pub decision: Decision,
}

impl StandoffController {
    /// A controller with these options.
    ///
    /// # Errors
    /// [`SolveError::BadOption`] where one cannot be meant.
    pub fn new(guard: Guard, options: StandoffOptions) -> Result<Self, SolveError> {
        options.check()?;
        Ok(Self {
            options,
            guard,
            quantile: chi_square_3(1.0 - options.risk),
            walls: Vec::new(),
            clearance_m: 0.0,
            left: Vec::new(),
            decisions: Decisions::default(),
        })
    }

    /// The same, keeping so far away from walls, metres.
    ///
    /// # Errors
    /// [`SolveError::BadOption`] where a wall or the clearance cannot be meant.
    pub fn between(mut self, walls: Vec<Wall>, clearance_m: f64) -> Result<Self, SolveError> {
        let bad = |name, why| Err(SolveError::BadOption { name, why });
        if !walls.iter().all(Wall::is_finite) {
            return bad("walls", "not finite");
        }
        if !(clearance_m.is_finite() && clearance_m >= 0.0) {
            return bad("clearance_m", "negative or not finite");
        }
        self.left.reserve(walls.len());
        self.walls = walls;
        self.clearance_m = clearance_m;
        Ok(self)
    }

    /// The command for the step that begins now; the belief is of now.
    pub fn command(&mut self, vehicle: &VehicleState, belief: &Belief) -> StandoffCommand {
        let o = &self.options;
        let seen = Relative::new(vehicle, belief);
        let radius_m = self.quantile.sqrt() * longest_sigma_m(belief);
        let aware = matches!(self.guard, Guard::Covariance | Guard::Sampled);
        let margin_m = if aware { radius_m } else { 0.0 };
        let reference = reference(o, &seen, margin_m);
        let along = match self.guard {
            Guard::None => Along {
                least: f64::NEG_INFINITY,
                most: f64::INFINITY,
            },
            Guard::Fixed | Guard::Covariance => barrier::at_the_sample(o, &seen, margin_m),
            Guard::Sampled => barrier::over_the_step(o, &seen, margin_m),
        };
        let limits = limits(o, vehicle);
        self.left.clear();
        self.left.extend(
            self.walls
                .iter()
                .filter_map(|wall| walls::limit(o, wall, self.clearance_m, vehicle, &limits)),
        );
        let (acceleration, decision) =
            program::command_between_walls(&reference, &seen.sight, along, &limits, &self.left);
        self.decisions.note(decision);
        StandoffCommand {
            acceleration,
            radius_m,
            decision,
        }
    }

    /// How commands came about so far.
    pub fn decisions(&self) -> Decisions {
        self.decisions
    }
}

/// What the control Lyapunov function asks for (eq. 33-36), with dead zones of this width.
fn reference(o: &StandoffOptions, seen: &Relative, margin_m: f64) -> Vector3<f64> {
    let dead = |error: f64| (error.abs() - margin_m).max(0.0) * error.signum();
    let distance = dead(seen.distance_m - o.standoff_m);
    let [above, climb] = seen.above;
    seen.sight * (o.radial[0] * distance + o.radial[1] * seen.radial)
        + seen.tangential * o.tangential
        - Vector3::z() * (o.vertical[0] * dead(above) + o.vertical[1] * climb)
}

/// What the vehicle can do in this step (eq. 44, 45). One that is too fast already slows down as much
/// as it can.
fn limits(o: &StandoffOptions, vehicle: &VehicleState) -> AccelerationBox {
    let reach = |edge: f64, v: f64| ((edge - v) / o.step_s).clamp(-o.acceleration, o.acceleration);
    AccelerationBox {
        low: vehicle.velocity_m_s.map(|v| reach(-o.speed, v)),
        high: vehicle.velocity_m_s.map(|v| reach(o.speed, v)),
    }
}

#[cfg(test)]
mod tests;
