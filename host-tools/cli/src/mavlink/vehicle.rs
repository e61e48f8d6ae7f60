//! The autopilot at the other end: who it is, its clock, where it has been.
//!
//! ```text
//!            a heartbeat of an autopilot            5 s without one
//!   nobody ────────────────────────────► there ────────────────────► silent
//!                                          ▲                           │
//!                                          └─────── a heartbeat ───────┘
//! ```
//!
//! Datagrams are lost, repeated and overtake each other. A place is believed if it is newer, on the autopilot's own clock, than
//! the last; older ones are counted. Many old ones in a row mean that the autopilot has started again: its clock and its
//! origin are new, and everything that was built upon them has to go.

use super::clock::VehicleClock;
use super::frames::Attitude;
use super::inbound::{Reading, Taken, readings};
use mavlink::MavHeader;
use mavlink::dialects::common::{MavAutopilot, MavMessage};
use nova_solver::navigation::InsSample;
use serde::Serialize;

/// Without a heartbeat for so long a vehicle is silent.
const SILENT_S: f64 = 5.0;
/// An attitude counts for so long.
const ATTITUDE_LIFE_S: f64 = 0.5;
/// So many old places in a row make a restart; a network does not hold so many up.
const RESTART: u32 = 20;
/// Places older than the last by less are no sign of a restart, microseconds.
const LATE_US: u64 = 3_000_000;

/// Which autopilot it is; they differ in what they take.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Kind {
    /// PX4.
    Px4,
    /// ArduPilot.
    ArduPilot,
    /// Another.
    Other,
}

/// Names of a vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub(crate) struct Identity {
    /// MAVLink system.
    pub(crate) system: u8,
    /// MAVLink component.
    pub(crate) component: u8,
    /// Which autopilot.
    pub(crate) kind: Kind,
}

/// What a message meant.
#[derive(Debug, PartialEq)]
pub(crate) enum Heard {
    /// A vehicle is there, for the first time or again.
    Found(Identity),
    /// A new place of the vehicle on our clock.
    Place(InsSample),
    /// The autopilot has started again.
    Restarted,
    /// It asks for our time; the number to repeat in the answer.
    AsksTime { ts1: i64 },
    /// Nothing that anything follows from.
    Nothing,
}

/// What became of messages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub(crate) struct VehicleCounts {
    /// Places taken.
    pub(crate) places: u64,
    /// Places that came too late.
    pub(crate) late: u64,
    /// Messages with numbers that are none.
    pub(crate) not_finite: u64,
    /// Answers to our questions for the time.
    pub(crate) time_answers: u64,
    /// Restarts of the autopilot.
    pub(crate) restarts: u64,
}

/// The vehicle.
#[derive(Default)]
pub(crate) struct Vehicle {
    identity: Option<Identity>,
    heartbeat_s: f64,
    silent: bool,
    clock: VehicleClock,
    attitude: Option<(f64, Attitude)>,
    last: Option<(u64, InsSample)>,
    stale_in_a_row: u32,
    counts: VehicleCounts,
}

impl Vehicle {
    /// Takes a message that has arrived at `now_s`, our clock.
    pub(crate) fn take(&mut self, header: MavHeader, message: &MavMessage, now_s: f64) -> Heard {
        let from = (header.system_id, header.component_id);
        let ours = self.identity.map(|id| (u32::from(id.system), id.component));
        if let MavMessage::HEARTBEAT(beat) = message
            && beat.autopilot != MavAutopilot::MAV_AUTOPILOT_INVALID
            && ours.is_none_or(|ours| ours == from)
        {
            return self.beat(from, beat.autopilot, now_s);
        }
        if ours != Some(from) {
            return Heard::Nothing;
        }
        match message {
            // A question; ours come back with `tc1` filled in.
            MavMessage::TIMESYNC(sync) if sync.tc1 == 0 => Heard::AsksTime { ts1: sync.ts1 },
            MavMessage::TIMESYNC(sync) => {
                if self.clock.answered(sync.tc1, sync.ts1, now_s) {
                    self.counts.time_answers += 1;
                }
                Heard::Nothing
            }
            other => match readings(other) {
                Ok(found) => self.read(&found, now_s),
                Err(_) => {
                    self.counts.not_finite += 1;
                    Heard::Nothing
                }
            },
        }
    }

    /// Who it is.
    pub(crate) fn identity(&self) -> Option<Identity> {
        self.identity
    }

    /// Whether it has just fallen silent; once each time.
    pub(crate) fn fell_silent(&mut self, now_s: f64) -> bool {
        let silent = self.identity.is_some() && now_s - self.heartbeat_s > SILENT_S;
        let news = silent && !self.silent;
        self.silent |= silent;
        news
    }

    /// Its clock.
    pub(crate) fn clock(&mut self) -> &mut VehicleClock {
        &mut self.clock
    }

    /// How far its time may be off from ours, seconds.
    pub(crate) fn clock_doubt_s(&self) -> Option<f64> {
        self.clock.doubt_s()
    }

    /// How it was turned at about that time.
    pub(crate) fn attitude_at(&self, t_s: f64) -> Option<Attitude> {
        let (taken_s, attitude) = self.attitude?;
        ((t_s - taken_s).abs() <= ATTITUDE_LIFE_S).then_some(attitude)
    }

    /// The newest place.
    pub(crate) fn last_place(&self) -> Option<InsSample> {
        self.last.map(|(_, place)| place)
    }

    pub(crate) fn counts(&self) -> VehicleCounts {
        self.counts
    }

    /// Our time of a reading.
    pub(crate) fn time_of(&self, taken: Taken, now_s: f64) -> f64 {
        match taken {
            Taken::Boot(boot_us) => self.clock.ours_s(boot_us),
            Taken::Unknown => now_s,
        }
    }

    fn beat(
        &mut self,
        (system, component): (u32, u8),
        autopilot: MavAutopilot,
        now_s: f64,
    ) -> Heard {
        // 32 bits of MAVLink 2 are not in use yet, and a target has eight.
        let Ok(system) = u8::try_from(system) else {
            return Heard::Nothing;
        };
        self.heartbeat_s = now_s;
        let news = self.identity.is_none() || self.silent;
        self.silent = false;
        let identity = Identity {
            system,
            component,
            kind: match autopilot {
                MavAutopilot::MAV_AUTOPILOT_PX4 => Kind::Px4,
                MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA => Kind::ArduPilot,
                _ => Kind::Other,
            },
        };
        self.identity = Some(identity);
        if news {
            Heard::Found(identity)
        } else {
            Heard::Nothing
        }
    }

    fn read(&mut self, found: &[(Taken, Reading)], now_s: f64) -> Heard {
        for &(taken, reading) in found {
            if let Some(attitude) = reading.attitude() {
                let t_s = self.time_of(taken, now_s);
                if self.attitude.is_none_or(|(last_s, _)| t_s > last_s) {
                    self.attitude = Some((t_s, attitude));
                }
            }
            if let (Reading::Local { position_m, .. }, Taken::Boot(boot_us)) = (reading, taken) {
                return self.place(boot_us, position_m, now_s);
            }
        }
        Heard::Nothing
    }

    fn place(&mut self, boot_us: u64, position_m: [f64; 3], now_s: f64) -> Heard {
        if let Some((last_us, _)) = self.last
            && boot_us <= last_us
        {
            self.counts.late += 1;
            if last_us - boot_us < LATE_US {
                return Heard::Nothing;
            }
            self.stale_in_a_row += 1;
            if self.stale_in_a_row < RESTART {
                return Heard::Nothing;
            }
            self.counts.restarts += 1;
            self.clock = VehicleClock::default();
            self.attitude = None;
            self.last = None;
            self.stale_in_a_row = 0;
            return Heard::Restarted;
        }
        self.stale_in_a_row = 0;
        self.clock.heard(boot_us, now_s);
        let place = InsSample {
            t_s: self.clock.ours_s(boot_us),
            position_m: position_m.into(),
        };
        // A better estimate of the offset may set the clock back a little.
        let late = (self.last_place()).is_some_and(|last| place.t_s <= last.t_s);
        if late {
            self.counts.late += 1;
            return Heard::Nothing;
        }
        if place.validate().is_err() {
            self.counts.not_finite += 1;
            return Heard::Nothing;
        }
        self.counts.places += 1;
        self.last = Some((boot_us, place));
        Heard::Place(place)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use mavlink::dialects::common::{HEARTBEAT_DATA, LOCAL_POSITION_NED_DATA, TIMESYNC_DATA};
    use proptest::prelude::*;

    pub(crate) const AUTOPILOT: MavHeader = MavHeader {
        system_id: 1,
        component_id: 1,
        sequence: 0,
    };

    pub(crate) fn heartbeat(autopilot: MavAutopilot) -> MavMessage {
        MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            autopilot,
            ..HEARTBEAT_DATA::default()
        })
    }

    fn place(boot_ms: u32) -> MavMessage {
        MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
            time_boot_ms: boot_ms,
            x: boot_ms as f32,
            ..LOCAL_POSITION_NED_DATA::default()
        })
    }

    fn found() -> Vehicle {
        let mut vehicle = Vehicle::default();
        let heard = vehicle.take(AUTOPILOT, &heartbeat(MavAutopilot::MAV_AUTOPILOT_PX4), 0.0);
        let identity = Identity {
            system: 1,
            component: 1,
            kind: Kind::Px4,
        };
        assert_eq!(heard, Heard::Found(identity));
        vehicle
    }

    #[test]
    fn nobody_but_the_first_autopilot_is_listened_to() {
        let mut vehicle = Vehicle::default();
        let now = |vehicle: &mut Vehicle, system, message: &MavMessage| {
            let header = MavHeader {
                system_id: system,
                ..AUTOPILOT
            };
            vehicle.take(header, message, 100.0)
        };
        assert_eq!(now(&mut vehicle, 1, &place(5)), Heard::Nothing);
        // A ground station.
        let station = heartbeat(MavAutopilot::MAV_AUTOPILOT_INVALID);
        assert_eq!(now(&mut vehicle, 255, &station), Heard::Nothing);
        let mut vehicle = found();
        let other = heartbeat(MavAutopilot::MAV_AUTOPILOT_PX4);
        assert_eq!(now(&mut vehicle, 2, &other), Heard::Nothing);
        assert_eq!(now(&mut vehicle, 2, &place(5)), Heard::Nothing);
        assert!(matches!(now(&mut vehicle, 1, &place(5)), Heard::Place(_)));
    }

    #[test]
    fn silence_is_told_once_and_so_is_its_end() {
        let mut vehicle = found();
        assert!(!vehicle.fell_silent(4.0));
        assert!(vehicle.fell_silent(6.0));
        assert!(!vehicle.fell_silent(7.0));
        let beat = heartbeat(MavAutopilot::MAV_AUTOPILOT_PX4);
        assert!(matches!(
            vehicle.take(AUTOPILOT, &beat, 8.0),
            Heard::Found(_)
        ));
        assert_eq!(vehicle.take(AUTOPILOT, &beat, 9.0), Heard::Nothing);
        assert!(!vehicle.fell_silent(9.0));
    }

    #[test]
    fn its_questions_for_the_time_are_told_and_its_answers_set_the_clock() {
        let mut vehicle = found();
        let sync = |tc1, ts1| {
            MavMessage::TIMESYNC(TIMESYNC_DATA {
                tc1,
                ts1,
                ..TIMESYNC_DATA::default()
            })
        };
        let heard = vehicle.take(AUTOPILOT, &sync(0, 77), 100.0);
        assert_eq!(heard, Heard::AsksTime { ts1: 77 });
        let ts1 = vehicle.clock().ask(100.0);
        vehicle.take(AUTOPILOT, &sync(20_000_000_000, ts1), 100.004);
        assert_eq!(vehicle.counts().time_answers, 1);
        let Heard::Place(place) = vehicle.take(AUTOPILOT, &place(20_500), 100.6) else {
            panic!();
        };
        // 20 s there were 100.002 s here.
        assert!((place.t_s - 100.502).abs() < 1e-6, "{place:?}");
    }

    #[test]
    fn a_restart_is_told_when_its_new_clock_has_been_heard_often_enough() {
        let mut vehicle = found();
        vehicle.take(AUTOPILOT, &place(3_600_000), 10.0);
        let mut news = Vec::new();
        for k in 0..40 {
            let heard = vehicle.take(AUTOPILOT, &place(1000 + 50 * k), 11.0 + 0.05 * f64::from(k));
            news.push(heard);
        }
        let restart = news.iter().position(|heard| *heard == Heard::Restarted);
        assert_eq!(restart, Some(RESTART as usize - 1));
        assert!(
            news[20..]
                .iter()
                .all(|heard| matches!(heard, Heard::Place(_)))
        );
    }

    proptest! {
        #[test]
        fn places_that_are_lost_repeated_or_overtaken_leave_a_track_in_order(
            // For each place at 20 Hz: copies, and by how much each is held up, milliseconds.
            fates in prop::collection::vec(prop::collection::vec(0..1500u32, 0..3), 10..200),
        ) {
            let mut arrivals: Vec<(u32, u32)> = Vec::new();
            for (k, delays) in (0..).zip(&fates) {
                let boot_ms = 10_000 + 50 * k;
                arrivals.extend(delays.iter().map(|delay| (boot_ms + delay, boot_ms)));
            }
            arrivals.sort_unstable();
            let mut vehicle = found();
            let mut last_s = f64::NEG_INFINITY;
            for &(arrival_ms, boot_ms) in &arrivals {
                let arrival_s = 500.0 + f64::from(arrival_ms) * 1e-3;
                match vehicle.take(AUTOPILOT, &place(boot_ms), arrival_s) {
                    Heard::Place(sample) => {
                        prop_assert!(sample.t_s > last_s);
                        last_s = sample.t_s;
                        // The place is the one that was sent with that time.
                        prop_assert_eq!(sample.position_m.y, f64::from(boot_ms));
                        // Never before it was made, never after it came.
                        prop_assert!(sample.t_s <= arrival_s + 1e-9);
                        prop_assert!(sample.t_s >= 500.0 + f64::from(boot_ms) * 1e-3 - 1e-9);
                    }
                    Heard::Nothing => {}
                    other => prop_assert!(false, "{:?}", other),
                }
            }
            let counts = vehicle.counts();
            prop_assert_eq!(counts.places + counts.late, arrivals.len() as u64);
            prop_assert_eq!(counts.restarts, 0);
        }
    }
}
