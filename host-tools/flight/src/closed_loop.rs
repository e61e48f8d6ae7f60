//! The closed loop: vehicle, sensors, navigator, autopilot.
//!
//! ```text
//!   wind ──► vehicle ──► accelerometer, barometer ──► INS ──┐
//!               ▲    └─► ranges ────────────────────────────┼──► navigator ──► command
//!               │                                           │                    │
//!               └──── autopilot ◄── position (truth or INS less its error) ◄─────┘
//! ```
//!
//! Each tick measures, tells the navigator, and then moves the vehicle on to the next tick.

use crate::autopilot::Autopilot;
use crate::barometer::Barometer;
use crate::imu::Imu;
use crate::recording::Recording;
use crate::scene::Scene;
use crate::settings::{Pilot, Settings};
use crate::uwb::RangeSource;
use crate::vehicle::Vehicle;
use crate::wind::Wind;
use nalgebra::Vector3;
use nova_solver::ins::Ins;
use nova_solver::navigation::{InputFault, Navigator, RangeSample};

/// Flies `navigator` from the scene's start until touchdown or the time limit. `settings` are taken
/// as valid.
pub(crate) fn run(
    scene: &Scene,
    settings: &Settings,
    seed: u64,
    navigator: &mut dyn Navigator,
    ranges: &mut dyn RangeSource,
) -> Recording {
    let mut flight = ClosedLoop::new(scene, settings, seed, navigator, ranges);
    let ticks = (settings.time_limit_s * settings.imu_rate_hz) as u64;
    for tick in 0..ticks {
        flight.sense(tick);
        if flight.fly(tick) {
            break;
        }
    }
    flight.recording
}

struct ClosedLoop<'a> {
    settings: &'a Settings,
    navigator: &'a mut dyn Navigator,
    ranges: &'a mut dyn RangeSource,
    vehicle: Vehicle,
    wind: Wind,
    imu: Imu,
    barometer: Barometer,
    ins: Ins,
    autopilot: Autopilot,
    recording: Recording,
}

impl<'a> ClosedLoop<'a> {
    fn new(
        scene: &Scene,
        settings: &'a Settings,
        seed: u64,
        navigator: &'a mut dyn Navigator,
        ranges: &'a mut dyn RangeSource,
    ) -> Self {
        let imu = Imu::new(settings, seed);
        let command = navigator.command();
        Self {
            vehicle: Vehicle::hovering(scene.start_m, settings.acceleration_m_s2),
            wind: Wind::new(settings, seed),
            barometer: Barometer::new(settings, seed),
            ins: Ins::new(0.0, scene.start_m, imu.velocity_error_m_s()),
            autopilot: Autopilot::new(settings, command, scene.start_m),
            imu,
            recording: Recording {
                scene: *scene,
                truth: Vec::new(),
                ins: Vec::new(),
                ranges: Vec::new(),
                commands: vec![(0.0, command)],
                arrivals: Vec::new(),
                estimates: Vec::new(),
                phases: vec![(0.0, navigator.phase())],
                update_ms: Vec::new(),
                refused: 0,
                path_length_m: 0.0,
                landed: false,
            },
            settings,
            navigator,
            ranges,
        }
    }

    /// Measures what is due at this tick and tells the navigator.
    fn sense(&mut self, tick: u64) {
        let t_s = self.time_s(tick);
        if self.due(tick, self.settings.baro_rate_hz) {
            let height_m = self.barometer.read(self.vehicle.position_m.z);
            let taken = self.ins.on_height(height_m);
            self.recording.note(taken);
        }
        if self.due(tick, self.settings.uwb_rate_hz) {
            self.measure_range(t_s);
        }
        let position_m = self.feedback_m(t_s);
        if let Some(id) = self.autopilot.arrival(position_m) {
            self.recording
                .arrivals
                .push((t_s, self.autopilot.command()));
            self.tell(t_s, |navigator| {
                navigator.on_arrival(id);
                Ok(())
            });
        }
    }

    fn measure_range(&mut self, t_s: f64) {
        let vehicle_m = self.vehicle.position_m;
        self.recording.truth.push((t_s, vehicle_m));
        let sample = self.ins.sample();
        self.recording.ins.push(sample);
        let taken = self.navigator.on_ins(sample);
        self.recording.note(taken);
        let tag_m = self.recording.scene.tag_m;
        if let Some(range_m) = self.ranges.range(t_s, vehicle_m, tag_m) {
            let sample = RangeSample { t_s, range_m };
            self.recording.ranges.push(sample);
            self.tell(t_s, |navigator| navigator.on_range(sample));
        }
    }

    /// Calls the navigator and takes its orders.
    fn tell(&mut self, t_s: f64, call: impl FnOnce(&mut dyn Navigator) -> Result<(), InputFault>) {
        let recording = &mut self.recording;
        recording.call(t_s, self.navigator, call);
        let phase = self.navigator.phase();
        if recording
            .phases
            .last()
            .is_none_or(|&(_, last)| last != phase)
        {
            recording.phases.push((t_s, phase));
        }
        let command = self.navigator.command();
        if command != self.autopilot.command() {
            recording.commands.push((t_s, command));
            let position_m = self.feedback_m(t_s);
            self.autopilot.obey(command, position_m);
        }
    }

    /// Moves on to the next tick; whether the vehicle has come to the ground.
    fn fly(&mut self, tick: u64) -> bool {
        let (t_s, next_s) = (self.time_s(tick), self.time_s(tick + 1));
        let dt_s = self.settings.tick_s();
        let wanted = self.autopilot.velocity_m_s(self.feedback_m(t_s));
        let before_m = self.vehicle.position_m;
        let wind = self.wind.velocity_m_s(t_s);
        let acceleration = self.vehicle.step(wanted, wind, dt_s);
        let felt = if self.settings.wind_seen {
            acceleration.own_m_s2 + acceleration.wind_m_s2
        } else {
            acceleration.own_m_s2
        };
        let taken = self.ins.on_acceleration(next_s, self.imu.read(felt));
        self.recording.note(taken);
        self.account(before_m, t_s, next_s)
    }

    /// Path length, touchdown and the last recorded position.
    fn account(&mut self, before_m: Vector3<f64>, t_s: f64, next_s: f64) -> bool {
        let after_m = self.vehicle.position_m;
        let ground_m = self.recording.scene.tag_m.z;
        let landed = after_m.z <= ground_m;
        let part = if landed {
            (before_m.z - ground_m) / (before_m.z - after_m.z)
        } else {
            1.0
        };
        let end_m = before_m.lerp(&after_m, part);
        self.recording.path_length_m += (end_m - before_m).norm();
        self.recording.landed = landed;
        let end_s = t_s + part * (next_s - t_s);
        if landed || next_s >= self.settings.time_limit_s {
            self.recording.truth.push((end_s, end_m));
        }
        landed
    }

    /// The position that the autopilot steers by.
    fn feedback_m(&self, t_s: f64) -> Vector3<f64> {
        match self.settings.pilot {
            Pilot::Follow => self.vehicle.position_m,
            Pilot::SelfNav => {
                self.ins.sample().position_m - self.autopilot.command().ins_error.at(t_s)
            }
        }
    }

    fn time_s(&self, tick: u64) -> f64 {
        tick as f64 / self.settings.imu_rate_hz
    }

    /// Whether something done at this rate is due at this tick.
    fn due(&self, tick: u64, rate_hz: f64) -> bool {
        let done = |tick: u64| (tick as f64 * rate_hz / self.settings.imu_rate_hz) as u64;
        tick == 0 || done(tick) > done(tick - 1)
    }
}
