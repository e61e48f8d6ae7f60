//! Flies what a navigator commands.

use crate::settings::Settings;
use nalgebra::{Vector2, Vector3};
use nova_solver::navigation::{Action, Command};

/// A waypoint counts as reached from here, metres.
const ACCEPTANCE_M: f64 = 0.1;
/// Beside a waypoint that has been passed, it counts as reached within so many times that.
const PASSED_BESIDE: f64 = 5.0;
/// Offsets are closed in about this time while landing, seconds.
const CORRECTION_S: f64 = 0.5;
/// Least part of the cruise speed that is spent on going down while landing.
const LEAST_DESCENT: f64 = 0.3;

/// Turns the command in force and the position into a velocity, and notices arrivals.
#[derive(Debug, Clone)]
pub struct Autopilot {
    speed_m_s: f64,
    acceleration_m_s2: f64,
    acceptance_m: f64,
    command: Command,
    /// Where the command in force found the vehicle.
    leg_start_m: Vector3<f64>,
    arrived: bool,
}

impl Autopilot {
    /// An autopilot that begins with `command` at `position_m`.
    pub fn new(settings: &Settings, command: Command, position_m: Vector3<f64>) -> Self {
        let gust_step_m = settings.wind_xy.max(settings.wind_z) * settings.wind_hold_s;
        Self {
            speed_m_s: settings.speed_m_s,
            acceleration_m_s2: settings.acceleration_m_s2,
            acceptance_m: gust_step_m.max(ACCEPTANCE_M),
            command,
            leg_start_m: position_m,
            arrived: false,
        }
    }

    /// Takes the navigator's present command.
    pub fn obey(&mut self, command: Command, position_m: Vector3<f64>) {
        if command.id != self.command.id {
            self.leg_start_m = position_m;
            self.arrived = false;
        }
        self.command = command;
    }

    /// The command in force.
    pub fn command(&self) -> Command {
        self.command
    }

    /// The command's id when its waypoint is reached, once for each.
    ///
    /// Gusts must not keep a vehicle from ever arriving: near enough is also who has passed the
    /// waypoint on the way from where the leg began, not far beside it.
    pub fn arrival(&mut self, position_m: Vector3<f64>) -> Option<u32> {
        if self.arrived || self.command.action != Action::Fly {
            return None;
        }
        let beyond = position_m - self.command.waypoint_m;
        let leg = self.command.waypoint_m - self.leg_start_m;
        let distance_m = beyond.norm();
        let passed = beyond.dot(&leg) >= 0.0 && distance_m <= PASSED_BESIDE * self.acceptance_m;
        self.arrived = passed || distance_m <= self.acceptance_m;
        self.arrived.then_some(self.command.id)
    }

    /// The wanted velocity at this position, m/s.
    pub fn velocity_m_s(&self, position_m: Vector3<f64>) -> Vector3<f64> {
        match self.command.action {
            Action::Hold => self.toward(self.leg_start_m, position_m),
            Action::Fly => self.toward(self.command.waypoint_m, position_m),
            Action::Land => self.down_over(self.command.waypoint_m.xy(), position_m),
        }
    }

    /// Straight to `target_m`, slow enough to stop there.
    fn toward(&self, target_m: Vector3<f64>, position_m: Vector3<f64>) -> Vector3<f64> {
        let offset_m = target_m - position_m;
        let distance_m = offset_m.norm();
        // Half the acceleration is kept for corrections. Very near, where that formula asks for
        // more than a tick can give, speed is proportional to distance.
        let stopping_m_s = (self.acceleration_m_s2 * distance_m).sqrt();
        let closing_m_s = distance_m / (0.5 * CORRECTION_S);
        let speed_m_s = self.speed_m_s.min(stopping_m_s).min(closing_m_s);
        offset_m
            .try_normalize(1e-9)
            .map_or_else(Vector3::zeros, |direction| direction * speed_m_s)
    }

    /// Down, sideways corrections first.
    fn down_over(&self, target_m: Vector2<f64>, position_m: Vector3<f64>) -> Vector3<f64> {
        let sideways = ((target_m - position_m.xy()) / CORRECTION_S).cap_magnitude(self.speed_m_s);
        let left_m_s = (self.speed_m_s.powi(2) - sideways.norm_squared())
            .max(0.0)
            .sqrt();
        sideways.push(-left_m_s.max(LEAST_DESCENT * self.speed_m_s))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nova_solver::navigation::InsError;

    fn command(id: u32, action: Action, waypoint_m: Vector3<f64>) -> Command {
        Command {
            id,
            action,
            waypoint_m,
            ins_error: InsError::none(),
        }
    }

    fn autopilot(action: Action, waypoint_m: Vector3<f64>) -> Autopilot {
        Autopilot::new(
            &Settings::default(),
            command(0, action, waypoint_m),
            Vector3::zeros(),
        )
    }

    fn east(m: f64) -> Vector3<f64> {
        Vector3::new(m, 0.0, 0.0)
    }

    #[test]
    fn arrival_is_told_once_a_command() {
        let mut autopilot = autopilot(Action::Fly, east(10.0));
        assert_eq!(autopilot.arrival(east(9.85)), None);
        assert_eq!(autopilot.arrival(east(9.95)), Some(0));
        assert_eq!(autopilot.arrival(east(10.0)), None);
        autopilot.obey(command(1, Action::Fly, east(10.0)), east(10.0));
        assert_eq!(autopilot.arrival(east(10.0)), Some(1));
    }

    #[test]
    fn passing_the_waypoint_is_arriving_unless_far_beside_it() {
        let beyond = |beside_m: f64| Vector3::new(10.02, beside_m, 0.0);
        assert_eq!(
            autopilot(Action::Fly, east(10.0)).arrival(beyond(0.3)),
            Some(0)
        );
        assert_eq!(
            autopilot(Action::Fly, east(10.0)).arrival(beyond(3.0)),
            None
        );
    }

    #[test]
    fn a_moved_waypoint_of_the_same_command_is_flown_to() {
        let mut autopilot = autopilot(Action::Fly, east(10.0));
        autopilot.obey(
            command(0, Action::Fly, Vector3::new(0.0, 5.0, 0.0)),
            east(1.0),
        );
        let velocity = autopilot.velocity_m_s(east(0.0));
        assert!((velocity - Vector3::new(0.0, 1.0, 0.0)).norm() < 1e-12);
    }

    #[test]
    fn it_cruises_straight_and_slows_down_before_the_waypoint() {
        let autopilot = autopilot(Action::Fly, east(10.0));
        assert!((autopilot.velocity_m_s(east(0.0)) - east(1.0)).norm() < 1e-12);
        // It could stop within what is left even at half the acceleration it has.
        for left_m in [0.4, 0.2, 0.05, 0.01] {
            let speed = autopilot.velocity_m_s(east(10.0 - left_m)).norm();
            assert!(speed > 0.0 && speed * speed <= 2.0 * 1.0 * left_m + 1e-12);
        }
        assert_eq!(autopilot.velocity_m_s(east(10.0)).norm(), 0.0);
    }

    #[test]
    fn landing_corrects_sideways_first_and_always_goes_down() {
        let autopilot = autopilot(Action::Land, east(0.0));
        let at = |offset_m: f64| autopilot.velocity_m_s(Vector3::new(offset_m, 0.0, 8.0));
        assert!((at(0.0) - Vector3::new(0.0, 0.0, -1.0)).norm() < 1e-12);
        let near = at(0.3);
        assert!((near.x + 0.6).abs() < 1e-12 && (near.norm() - 1.0).abs() < 1e-12);
        let far = at(20.0);
        assert!((far - Vector3::new(-1.0, 0.0, -0.3)).norm() < 1e-12);
    }

    #[test]
    fn holding_stays_where_the_command_found_it() {
        let mut autopilot = autopilot(Action::Fly, east(10.0));
        autopilot.obey(command(1, Action::Hold, east(99.0)), east(3.0));
        assert_eq!(autopilot.velocity_m_s(east(3.0)).norm(), 0.0);
        assert!(autopilot.velocity_m_s(east(4.0)).x < 0.0);
        assert_eq!(autopilot.arrival(east(99.0)), None);
    }
}
