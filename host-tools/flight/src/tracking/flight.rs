//! One tracking flight: sighting, tracker, controller, and the vehicle that does as it is told.

use nalgebra::{UnitQuaternion, Vector3};
use nova_solver::kernel::Kernel;
use nova_solver::tracking::control::{Decisions, Wall, chi_square_3, longest_sigma_m};
use nova_solver::tracking::{
    Belief, Counts, Graduation, GraphOptions, Guard, InteractingOptions, InteractingTracker,
    Kernels, StandoffController, StandoffOptions, TargetEkf, TargetGraph, Tilted, Tracker,
    VehicleState,
};
use std::time::Instant;

use super::scene::{Standoff, TrackerSettings, TrackingScene};
use super::sensor::{Seen, SimulatedSensor};
use super::words::{Controller, Estimator};
use crate::error::FlightError;
use crate::streams::{Stream, generator, normal};

/// The true distance is looked at so many times between two commands.
const LOOKS: usize = 10;

/// What is flown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackingTrial<'a> {
    /// The scene; taken as [valid](TrackingScene::validate).
    pub scene: &'a TrackingScene,
    /// Who estimates.
    pub estimator: Estimator,
    /// Who flies; only where the scene has a standoff.
    pub controller: Controller,
    /// The part of bearings that are outliers.
    pub outlier_probability: f64,
    /// Everything random follows from it.
    pub seed: u64,
}

/// A moment of a flight, at a sighting.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackingMoment {
    /// Seconds.
    pub t_s: f64,
    /// Where the target is.
    pub target_m: Vector3<f64>,
    /// Where the vehicle is.
    pub vehicle_m: Vector3<f64>,
    /// Where the target is believed to be.
    pub believed_m: Vector3<f64>,
    /// Where it is by this sighting alone.
    pub seen_m: Option<Vector3<f64>>,
    /// Confidence radius, eq. 29.
    pub radius_m: f64,
    /// The squared error normalised by the covariance; 3 on average where that is honest.
    pub nees: f64,
    /// Whether sight was blocked or the bearing an outlier.
    pub outlier: bool,
    /// The command, m/s^2.
    pub command: Vector3<f64>,
}

/// What a flight was like.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackingResult {
    /// At each sighting.
    pub moments: Vec<TrackingMoment>,
    /// Least and greatest true distance, looked at between sightings too.
    pub distance_m: [f64; 2],
    /// Seconds outside the bounds.
    pub outside_s: f64,
    /// How far outside at most.
    pub worst_outside_m: f64,
    /// Least horizontal distance from the vehicle to a wall; infinite without walls.
    pub least_wall_m: f64,
    /// What became of sightings.
    pub counts: Counts,
    /// How commands came about.
    pub decisions: Decisions,
    /// Computing time of tracker and controller at each sighting, milliseconds.
    pub step_ms: Vec<f64>,
}

impl TrackingResult {
    /// Sum of squared errors of the believed places.
    pub fn square_error_m2(&self) -> f64 {
        let off = |m: &TrackingMoment| (m.believed_m - m.target_m).norm_squared();
        self.moments.iter().map(off).sum()
    }

    /// Sightings at which the true place was inside the confidence radius.
    pub fn inside_radius(&self) -> usize {
        let inside = |m: &&TrackingMoment| (m.believed_m - m.target_m).norm() <= m.radius_m;
        self.moments.iter().filter(inside).count()
    }
}

/// Flies it.
///
/// # Errors
/// [`FlightError::Solver`] where a part refuses its options; a valid scene has none such.
pub fn track(trial: &TrackingTrial<'_>) -> Result<TrackingResult, FlightError> {
    let scene = trial.scene;
    let step_s = 1.0 / scene.rate_hz;
    let steps = (scene.duration_s * scene.rate_hz).round() as usize;
    let path = scene
        .target
        .sampled(step_s / LOOKS as f64, steps * LOOKS + 1);
    let mut sensor = SimulatedSensor::new(&scene.sensor, trial.outlier_probability, trial.seed);
    let mut vehicle = VehicleState {
        position_m: scene.vehicle.start_m.into(),
        velocity_m_s: scene.vehicle.velocity_m_s.into(),
    };
    let walls = walls(scene);
    let Some(first) = path.first() else {
        return Ok(TrackingResult::empty());
    };
    let prior = prior(scene, first.position_m, first.velocity_m_s, trial.seed);
    let mut tracker = tracker(scene, trial.estimator, prior)?;
    let standoff = scene.standoff.unwrap_or_default();
    let mut controller = controller(scene, &standoff, trial.controller)?;
    let quantile = chi_square_3(1.0 - standoff.risk).sqrt();

    let mut result = TrackingResult::empty();
    result.moments.reserve(steps);
    for (step, looks) in path.chunks_exact(LOOKS).enumerate() {
        let t_s = step_s * step as f64;
        let Some(target) = looks.first() else { break };
        let attitude = attitude(&vehicle, &tracker.belief());
        let Seen { sighting, outlier } =
            sensor.see(t_s, vehicle.position_m, attitude, target.position_m);
        let begin = Instant::now();
        // What is refused is counted by the tracker.
        let _ = tracker.observe(&sighting);
        let belief = tracker.belief();
        let command = controller
            .as_mut()
            .map(|controller| controller.command(&vehicle, &belief));
        result.step_ms.push(begin.elapsed().as_secs_f64() * 1e3);

        let command = command.map_or(Vector3::zeros(), |command| command.acceleration);
        let error = belief.position_m - target.position_m;
        result.moments.push(TrackingMoment {
            t_s,
            target_m: target.position_m,
            vehicle_m: vehicle.position_m,
            believed_m: belief.position_m,
            seen_m: sighting.place_m(),
            radius_m: quantile * longest_sigma_m(&belief),
            nees: (belief.pp.try_inverse())
                .map_or(f64::NAN, |inverse| error.dot(&(inverse * error))),
            outlier,
            command,
        });

        // Constant acceleration until the next command, eq. 1, 2.
        for (look, target) in looks.iter().enumerate() {
            let s = step_s * look as f64 / LOOKS as f64;
            let at = vehicle.position_m + vehicle.velocity_m_s * s + command * (0.5 * s * s);
            let distance = (target.position_m - at).norm();
            result.look(distance, &standoff, step_s / LOOKS as f64);
            for wall in &walls {
                result.least_wall_m = result.least_wall_m.min(wall.away_m(&at).norm());
            }
        }
        vehicle.position_m += vehicle.velocity_m_s * step_s + command * (0.5 * step_s * step_s);
        vehicle.velocity_m_s += command * step_s;
    }
    result.counts = tracker.counts();
    result.decisions = controller.map_or(Decisions::default(), |c| c.decisions());
    Ok(result)
}

impl TrackingResult {
    fn empty() -> Self {
        Self {
            moments: Vec::new(),
            distance_m: [f64::INFINITY, 0.0],
            outside_s: 0.0,
            worst_outside_m: 0.0,
            least_wall_m: f64::INFINITY,
            counts: Counts::default(),
            decisions: Decisions::default(),
            step_ms: Vec::new(),
        }
    }

    fn look(&mut self, distance: f64, standoff: &Standoff, for_s: f64) {
        let [least, most] = &mut self.distance_m;
        *least = least.min(distance);
        *most = most.max(distance);
        let outside = (standoff.least_m - distance).max(distance - standoff.most_m);
        if outside > 0.0 {
            self.outside_s += for_s;
            self.worst_outside_m = self.worst_outside_m.max(outside);
        }
    }
}

/// The first belief, wrong by as much as it says.
fn prior(
    scene: &TrackingScene,
    position_m: Vector3<f64>,
    velocity_m_s: Vector3<f64>,
    seed: u64,
) -> Belief {
    let mut rng = generator(seed, Stream::Guess);
    let mut off = |sigma: f64| Vector3::from_fn(|_, _| sigma * normal(&mut rng));
    let (sp, sv) = (
        scene.tracker.position_sigma_m,
        scene.tracker.velocity_sigma_m_s,
    );
    Belief::about(position_m + off(sp), sp, velocity_m_s + off(sv), sv)
}

/// The sensor looks where the target is believed to be, and level.
fn attitude(vehicle: &VehicleState, belief: &Belief) -> UnitQuaternion<f64> {
    let ahead = belief.position_m - vehicle.position_m;
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -ahead.y.atan2(ahead.x))
}

fn tracker(
    scene: &TrackingScene,
    estimator: Estimator,
    prior: Belief,
) -> Result<Box<dyn Tracker>, FlightError> {
    let settings = &scene.tracker;
    let kernels = match estimator {
        Estimator::Plain => Kernels {
            range: Kernel::None,
            bearing: Kernel::None,
        },
        _ => Kernels {
            range: settings
                .range_kernel
                .map_or(Kernel::None, |c| Kernel::Cauchy { c }),
            bearing: Kernel::Cauchy {
                c: settings.bearing_kernel,
            },
        },
    };
    let options = GraphOptions {
        kernels,
        acceleration_density: settings.acceleration_density,
        window: Some(settings.window),
        graduation: (estimator == Estimator::Graduated).then(Graduation::default),
        ..GraphOptions::robust()
    };
    let tracker: Box<dyn Tracker> = match estimator {
        Estimator::Ekf => Box::new(TargetEkf::new(prior, settings.acceleration_density)?),
        Estimator::Plain | Estimator::Robust | Estimator::Graduated => {
            Box::new(TargetGraph::new(prior, options)?)
        }
        Estimator::Interacting => Box::new(InteractingTracker::new(prior, interacting(settings))?),
    };
    if settings.tilt_sigma_deg > 0.0 {
        let sigma_rad = settings.tilt_sigma_deg.to_radians();
        return Ok(Box::new(Tilted::new(tracker, sigma_rad)?));
    }
    Ok(tracker)
}

/// Models are switched off by making their beginning a matter of ages.
fn interacting(settings: &TrackerSettings) -> InteractingOptions {
    const NEVER_S: f64 = 1e12;
    let mut options = InteractingOptions::default();
    if !settings.motions {
        options.steady_s = NEVER_S;
        options.steady_density = settings.acceleration_density;
    }
    if !settings.blocked {
        options.blocked_every_s = NEVER_S;
    }
    options
}

fn controller(
    scene: &TrackingScene,
    standoff: &Standoff,
    controller: Controller,
) -> Result<Option<StandoffController>, FlightError> {
    if scene.standoff.is_none() {
        return Ok(None);
    }
    let guard = match controller {
        Controller::Clf => Guard::None,
        Controller::Fixed => Guard::Fixed,
        Controller::Aware => Guard::Covariance,
        Controller::Sampled => Guard::Sampled,
    };
    let options = StandoffOptions {
        standoff_m: standoff.standoff_m,
        least_m: standoff.least_m,
        most_m: standoff.most_m,
        radial: standoff.radial,
        vertical: standoff.vertical,
        tangential: standoff.tangential,
        barrier_rate: standoff.barrier_rate,
        target_acceleration: standoff.target_acceleration,
        acceleration: scene.vehicle.acceleration,
        speed: scene.vehicle.speed,
        risk: standoff.risk,
        step_s: 1.0 / scene.rate_hz,
    };
    let controller = StandoffController::new(guard, options)?;
    Ok(Some(match standoff.wall_clearance_m {
        Some(clearance_m) => controller.between(walls(scene), clearance_m)?,
        None => controller,
    }))
}

fn walls(scene: &TrackingScene) -> Vec<Wall> {
    let wall = |&[x1, y1, x2, y2]: &[f64; 4]| Wall {
        from_m: [x1, y1],
        to_m: [x2, y2],
    };
    scene.sensor.walls_m.iter().map(wall).collect()
}
