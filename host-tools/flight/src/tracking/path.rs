//! How targets move.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::error::FlightError;

/// The target's motion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "motion", deny_unknown_fields)]
pub enum Motion {
    /// A smooth curve: a constant velocity and a sine along each axis.
    Smooth {
        /// Centre of the curve at the start.
        start_m: [f64; 3],
        /// The constant velocity.
        velocity_m_s: [f64; 3],
        /// Amplitudes of the sines.
        amplitude_m: [f64; 3],
        /// Their periods.
        period_s: [f64; 3],
    },
    /// One stage after the other, as somebody walks; after the last the velocity stays.
    Staged {
        /// Where it begins.
        start_m: [f64; 3],
        /// Direction at the start, from east towards north.
        heading_deg: f64,
        /// Speed at the start.
        speed_m_s: f64,
        /// The stages.
        stages: Vec<Stage>,
    },
}

/// A stage of a walk. Accelerations are constant in it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stage {
    /// How long.
    pub for_s: f64,
    /// Change of the speed along the heading, m/s^2; it stops at standstill.
    #[serde(default)]
    pub along: f64,
    /// Turn to the left, degrees a second.
    #[serde(default)]
    pub turn_deg_s: f64,
    /// Vertical acceleration, m/s^2.
    #[serde(default)]
    pub up: f64,
}

/// The target at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moving {
    /// Metres.
    pub position_m: Vector3<f64>,
    /// Metres a second.
    pub velocity_m_s: Vector3<f64>,
}

impl Motion {
    pub(super) fn validate(&self) -> Result<(), FlightError> {
        let bad = |name, value, wanted| {
            Err(FlightError::Setting {
                name,
                value,
                wanted,
            })
        };
        let finite = |values: &[f64]| values.iter().copied().find(|v| !v.is_finite());
        match self {
            Self::Smooth {
                start_m,
                velocity_m_s,
                amplitude_m,
                period_s,
            } => {
                let all = [*start_m, *velocity_m_s, *amplitude_m].concat();
                if let Some(value) = finite(&all) {
                    return bad("target", value, "finite");
                }
                match period_s.iter().find(|p| !(p.is_finite() && **p > 0.0)) {
                    Some(value) => bad("target.period_s", *value, "above 0"),
                    None => Ok(()),
                }
            }
            Self::Staged {
                start_m,
                heading_deg,
                speed_m_s,
                stages,
            } => {
                if let Some(value) = finite(start_m).or(finite(&[*heading_deg])) {
                    return bad("target", value, "finite");
                }
                if !(speed_m_s.is_finite() && *speed_m_s >= 0.0) {
                    return bad("target.speed_m_s", *speed_m_s, "0 or more");
                }
                for stage in stages {
                    if let Some(value) = finite(&[stage.along, stage.turn_deg_s, stage.up]) {
                        return bad("target.stages", value, "finite");
                    }
                    if !(stage.for_s.is_finite() && stage.for_s > 0.0) {
                        return bad("target.stages.for_s", stage.for_s, "above 0");
                    }
                }
                Ok(())
            }
        }
    }

    /// Where it begins.
    pub(super) fn start_m(&self) -> Vector3<f64> {
        match self {
            Self::Smooth { start_m, .. } | Self::Staged { start_m, .. } => Vector3::from(*start_m),
        }
    }

    /// The motion at `count` times, `step_s` apart, from 0.
    pub(super) fn sampled(&self, step_s: f64, count: usize) -> Vec<Moving> {
        match self {
            Self::Smooth {
                start_m,
                velocity_m_s,
                amplitude_m,
                period_s,
            } => (0..count)
                .map(|i| {
                    let t_s = step_s * i as f64;
                    let along = |axis: usize| {
                        let rate = std::f64::consts::TAU / period_s[axis];
                        let (sine, cosine) = (rate * t_s).sin_cos();
                        (
                            start_m[axis] + velocity_m_s[axis] * t_s + amplitude_m[axis] * sine,
                            velocity_m_s[axis] + amplitude_m[axis] * rate * cosine,
                        )
                    };
                    let axes = [0, 1, 2].map(along);
                    Moving {
                        position_m: axes.map(|a| a.0).into(),
                        velocity_m_s: axes.map(|a| a.1).into(),
                    }
                })
                .collect(),
            Self::Staged {
                start_m,
                heading_deg,
                speed_m_s,
                stages,
            } => walk(
                Vector3::from(*start_m),
                heading_deg.to_radians(),
                *speed_m_s,
                stages,
                step_s,
                count,
            ),
        }
    }
}

/// Integrates a walk with the midpoint of each step.
fn walk(
    mut at: Vector3<f64>,
    mut heading: f64,
    mut speed: f64,
    stages: &[Stage],
    step_s: f64,
    count: usize,
) -> Vec<Moving> {
    let mut climb = 0.0;
    let mut left = stages.iter().copied();
    let mut stage = left.next();
    let mut spent = 0.0;
    let mut out = Vec::with_capacity(count);
    for _ in 0..count {
        let (sine, cosine) = heading.sin_cos();
        let velocity_m_s = Vector3::new(speed * cosine, speed * sine, climb);
        out.push(Moving {
            position_m: at,
            velocity_m_s,
        });
        while let Some(now) = stage
            && spent >= now.for_s - 0.5 * step_s
        {
            spent -= now.for_s;
            stage = left.next();
        }
        let (along, turn, up) = stage.map_or((0.0, 0.0, 0.0), |s| {
            (s.along, s.turn_deg_s.to_radians(), s.up)
        });
        let faster = (speed + along * step_s).max(0.0);
        let middle = heading + 0.5 * turn * step_s;
        let mean = 0.5 * (speed + faster);
        at += Vector3::new(
            mean * middle.cos(),
            mean * middle.sin(),
            climb + 0.5 * up * step_s,
        ) * step_s;
        heading += turn * step_s;
        climb += up * step_s;
        speed = faster;
        spent += step_s;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn most_acceleration(path: &[Moving], step_s: f64) -> f64 {
        path.windows(2)
            .map(|w| (w[1].velocity_m_s - w[0].velocity_m_s).norm() / step_s)
            .fold(0.0, f64::max)
    }

    #[test]
    fn a_quarter_turn_at_a_constant_speed_ends_where_the_arc_does() {
        let motion = Motion::Staged {
            start_m: [0.0; 3],
            heading_deg: 0.0,
            speed_m_s: 1.0,
            stages: vec![Stage {
                for_s: 2.0,
                along: 0.0,
                turn_deg_s: 45.0,
                up: 0.0,
            }],
        };
        motion.validate().unwrap();
        let path = motion.sampled(0.005, 401);
        let radius = 1.0 / 45.0_f64.to_radians();
        let end = path[400].position_m;
        assert!(
            (end - Vector3::new(radius, radius, 0.0)).norm() < 1e-4,
            "{end}"
        );
        assert!((most_acceleration(&path, 0.005) - 1.0 / radius).abs() < 1e-3);
    }

    #[test]
    fn braking_ends_at_standstill() {
        let motion = Motion::Staged {
            start_m: [0.0; 3],
            heading_deg: 90.0,
            speed_m_s: 2.0,
            stages: vec![Stage {
                for_s: 5.0,
                along: -2.0,
                turn_deg_s: 0.0,
                up: 0.0,
            }],
        };
        let path = motion.sampled(0.01, 500);
        assert!((path[499].position_m - Vector3::new(0.0, 1.0, 0.0)).norm() < 1e-9);
        assert_eq!(path[499].velocity_m_s.norm(), 0.0);
    }

    #[test]
    fn velocities_are_the_slopes_of_a_smooth_path() {
        let motion = Motion::Smooth {
            start_m: [1.0, 2.0, 3.0],
            velocity_m_s: [0.5, 0.0, 0.0],
            amplitude_m: [1.0, 2.0, 0.5],
            period_s: [9.0, 11.0, 7.0],
        };
        let path = motion.sampled(0.01, 1000);
        for three in path.windows(3) {
            let slope = (three[2].position_m - three[0].position_m) / 0.02;
            assert!((slope - three[1].velocity_m_s).norm() < 1e-4);
        }
    }
}
