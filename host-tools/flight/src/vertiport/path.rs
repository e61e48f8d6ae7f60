//! Where the drone flies.

use nalgebra::Vector3;

/// The paper's Fig. 7.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Route {
    /// North, then back south, along the street.
    NorthSouth,
    /// North only.
    North,
    /// In from the south, round the intersection, up and down.
    Loop,
}

/// The vehicle at a moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// Seconds.
    pub t_s: f64,
    /// ENU, metres.
    pub position_m: Vector3<f64>,
    /// m/s.
    pub velocity: Vector3<f64>,
    /// m/s^2, until the next moment.
    pub acceleration: Vector3<f64>,
}

/// Time between moments, seconds: the rate of the inertial sensor, 100 Hz.
pub(super) const STEP_S: f64 = 0.01;
const SPEED: f64 = 2.5;
const MOST_ACCELERATION: f64 = 1.5;
/// At rest before it leaves, seconds.
const WAIT_S: f64 = 5.0;

impl Route {
    /// All, in the paper's order.
    pub const ALL: [Self; 3] = [Self::NorthSouth, Self::North, Self::Loop];

    fn waypoints(self) -> Vec<Vector3<f64>> {
        let at = Vector3::new;
        // Nobody flies along a ruled line.
        let north = [
            at(0.0, -35.0, 10.0),
            at(0.4, -12.0, 10.4),
            at(-0.3, 6.0, 9.8),
            at(0.2, 35.0, 10.2),
        ];
        match self {
            Self::North => north.to_vec(),
            Self::NorthSouth => {
                let back = [
                    at(-0.4, 8.0, 10.3),
                    at(0.3, -10.0, 9.7),
                    at(0.0, -35.0, 10.0),
                ];
                north.into_iter().chain(back).collect()
            }
            Self::Loop => {
                let mut points = vec![at(0.0, -35.0, 10.0), at(0.0, -10.0, 10.0)];
                for height in [10.0, 14.0, 7.0] {
                    points.extend([
                        at(7.0, -9.0, height),
                        at(8.0, 8.0, height + 2.0),
                        at(-7.0, 9.0, height),
                        at(-8.0, -7.0, height - 2.0),
                    ]);
                }
                points.extend([at(0.0, 0.0, 12.0), at(0.0, 10.0, 10.0)]);
                points
            }
        }
    }
}

/// The flight of a drone that goes from waypoint to waypoint with bounded speed and acceleration. Each
/// moment follows from the one before by its acceleration exactly.
pub fn path(route: Route) -> Vec<Moment> {
    let waypoints = route.waypoints();
    let Some(first) = waypoints.first() else {
        return Vec::new();
    };
    let (mut p, mut v) = (*first, Vector3::zeros());
    let mut target = 1;
    let mut moments = Vec::new();
    // Ten minutes at most: a bound for the loop, several times the longest route.
    for k in 0..60_000 {
        let t_s = f64::from(k) * STEP_S;
        let goal = waypoints.get(target).copied();
        let to_goal = goal.map_or_else(Vector3::zeros, |goal| goal - p);
        let wanted = if t_s < WAIT_S {
            Vector3::zeros()
        } else {
            let slow = (2.0 * MOST_ACCELERATION * 0.4 * to_goal.norm()).sqrt();
            to_goal.try_normalize(1e-9).unwrap_or_else(Vector3::zeros) * SPEED.min(slow)
        };
        let a = ((wanted - v) * 2.0).cap_magnitude(MOST_ACCELERATION);
        moments.push(Moment {
            t_s,
            position_m: p,
            velocity: v,
            acceleration: a,
        });
        p += v * STEP_S + a * (0.5 * STEP_S * STEP_S);
        v += a * STEP_S;
        if t_s >= WAIT_S && to_goal.norm() < 1.5 {
            target += 1;
            if target >= waypoints.len() {
                break;
            }
        }
    }
    moments
}
