//! The command nearest to the reference that keeps all limits (eq. 43-45): a quadratic program, and what
//! is done where it has no solution.
//!
//! The limits are a box (what the vehicle can do, eq. 44, and how fast it may be after the step, eq.
//! 45) and an interval along the line of sight. What the box allows along the line of sight is known
//! without solving anything, so that the program that is handed over always has a solution:
//!
//! | what cannot be kept | what is done |
//! |---|---|
//! | the near bound by anything in the box | full braking: away from the target as hard as the box allows |
//! | near and far bound together | the near bound is kept, as much of the far one as it leaves |
//! | the far bound by anything in the box | full chase: towards the target as hard as the box allows |
//!
//! Walls come after that: only where they forbid what was found, the program is solved with them too. Then
//! clarabel says what has no solution, and in this order is given up: the far bound, the near one (as far away
//! from the target as walls allow), the walls.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus, SupportedConeT,
    ZeroConeT,
};
use nalgebra::Vector3;

use super::barrier::Along;

/// Least and greatest acceleration along each axis, m/s^2.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AccelerationBox {
    /// Least.
    pub low: Vector3<f64>,
    /// Greatest.
    pub high: Vector3<f64>,
}

/// Accelerations `u` with `normal'u <= most`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HalfSpace {
    /// Unit vector.
    pub normal: Vector3<f64>,
    /// m/s^2.
    pub most: f64,
}

impl HalfSpace {
    fn holds(&self, u: &Vector3<f64>) -> bool {
        self.normal.dot(u) <= self.most + 1e-9
    }
}

/// How a command came about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Decision {
    /// The reference keeps all limits but perhaps the box.
    Reference,
    /// The barriers changed the reference.
    Guarded,
    /// Both bounds could not be kept: the near one was.
    FarGivenUp,
    /// The far bound could not be kept: as fast towards the target as possible.
    FullChase,
    /// The near bound could not be kept: as fast away from the target as possible.
    FullBraking,
    /// Near bound and walls contradict each other: as fast away from the target as walls allow.
    Cornered,
    /// The walls cannot be kept by anything: what would be done without them.
    WallsGivenUp,
    /// The quadratic program failed although it has a solution: as `FullBraking`.
    SolverFailed,
}

impl AccelerationBox {
    fn clamp(&self, u: &Vector3<f64>) -> Vector3<f64> {
        u.zip_zip_map(&self.low, &self.high, |u, low, high| u.min(high).max(low))
    }

    /// The place in the box that is farthest along `direction`; where that does not matter, the
    /// nearest to the reference.
    pub(super) fn farthest(
        &self,
        direction: &Vector3<f64>,
        reference: &Vector3<f64>,
    ) -> Vector3<f64> {
        let mut place = self.clamp(reference);
        for axis in 0..3 {
            if direction[axis] > 1e-9 {
                place[axis] = self.high[axis];
            } else if direction[axis] < -1e-9 {
                place[axis] = self.low[axis];
            }
        }
        place
    }
}

/// The command and how it came about.
pub(super) fn command(
    reference: &Vector3<f64>,
    sight: &Vector3<f64>,
    along: Along,
    limits: &AccelerationBox,
) -> (Vector3<f64>, Decision) {
    let clamped = limits.clamp(reference);
    let value = sight.dot(&clamped);
    if value <= along.most && value >= along.least {
        return (clamped, Decision::Reference);
    }
    let away = limits.farthest(&-sight, reference);
    let towards = limits.farthest(sight, reference);
    // A limit that only its corner keeps leaves the solver no inside.
    let slack = 1e-6;
    if along.most <= sight.dot(&away) + slack {
        return (away, Decision::FullBraking);
    }
    if along.least > along.most - slack {
        let solution = nearest_command(reference, sight, (along.most, along.most), limits, &[]);
        return match (solution, along.most >= sight.dot(&towards) - slack) {
            (_, true) => (towards, Decision::FullChase),
            (Some(u), _) => (u, Decision::FarGivenUp),
            (None, _) => (away, Decision::SolverFailed),
        };
    }
    if along.least >= sight.dot(&towards) - slack {
        return (towards, Decision::FullChase);
    }
    match nearest_command(reference, sight, (along.least, along.most), limits, &[]) {
        Some(u) => (u, Decision::Guarded),
        None => (away, Decision::SolverFailed),
    }
}

/// A command that keeps walls as well.
pub(super) fn command_between_walls(
    reference: &Vector3<f64>,
    sight: &Vector3<f64>,
    along: Along,
    limits: &AccelerationBox,
    walls: &[HalfSpace],
) -> (Vector3<f64>, Decision) {
    let (without, decision) = command(reference, sight, along, limits);
    if walls.iter().all(|wall| wall.holds(&without)) {
        return (without, decision);
    }
    let solve = |reference: &Vector3<f64>, least: f64, most: f64| {
        nearest_command(reference, sight, (least, most), limits, walls)
    };
    let free = (f64::NEG_INFINITY, f64::INFINITY);
    if along.least < along.most
        && let Some(u) = solve(reference, along.least, along.most)
    {
        return (u, Decision::Guarded);
    }
    if let Some(u) = solve(reference, free.0, along.most) {
        return (u, Decision::FarGivenUp);
    }
    let away = limits.farthest(&-sight, reference);
    match solve(&away, free.0, free.1) {
        Some(u) => (u, Decision::Cornered),
        None => (without, Decision::WallsGivenUp),
    }
}

/// The quadratic program itself: the acceleration nearest to `reference` in the box, with its part along
/// `sight` (a unit vector) between `least` and `most` (an equation where both are one, nothing where
/// infinite) and in all of the half-spaces. `None` where clarabel finds none.
pub fn nearest_command(
    reference: &Vector3<f64>,
    sight: &Vector3<f64>,
    (least, most): (f64, f64),
    limits: &AccelerationBox,
    walls: &[HalfSpace],
) -> Option<Vector3<f64>> {
    let n = sight;
    let objective = CscMatrix::identity(3);
    let linear = [-reference.x, -reference.y, -reference.z];
    let equal = least == most;
    let mut rows = Vec::with_capacity(8 + walls.len());
    let mut sides = Vec::with_capacity(8 + walls.len());
    if most.is_finite() {
        rows.push([n.x, n.y, n.z]);
        sides.push(most);
    }
    if !equal && least.is_finite() {
        rows.push([-n.x, -n.y, -n.z]);
        sides.push(-least);
    }
    for axis in 0..3 {
        let mut unit = [0.0; 3];
        unit[axis] = 1.0;
        rows.push(unit);
        sides.push(limits.high[axis]);
        unit[axis] = -1.0;
        rows.push(unit);
        sides.push(-limits.low[axis]);
    }
    for wall in walls {
        rows.push([wall.normal.x, wall.normal.y, wall.normal.z]);
        sides.push(wall.most);
    }
    let equations = usize::from(equal);
    let cones: [SupportedConeT<f64>; 2] = [
        ZeroConeT(equations),
        NonnegativeConeT(rows.len() - equations),
    ];
    let settings = DefaultSettings {
        verbose: false,
        presolve_enable: false,
        // Three variables: another two iterations are nothing beside the set-up.
        tol_gap_abs: 1e-12,
        tol_gap_rel: 1e-12,
        tol_feas: 1e-12,
        ..DefaultSettings::default()
    };
    let rows = CscMatrix::from(rows.iter());
    let mut solver =
        DefaultSolver::new(&objective, &linear, &rows, &sides, &cones, settings).ok()?;
    solver.solve();
    let solved = matches!(
        solver.solution.status,
        SolverStatus::Solved | SolverStatus::AlmostSolved
    );
    let u = Vector3::from_iterator(solver.solution.x.iter().copied());
    (solved && u.iter().all(|c| c.is_finite())).then(|| limits.clamp(&u))
}
