//! What the four lights of the DEV board tell. docs/hardware.md has the table for users.

use core::mem::replace;

use embassy_nrf::Peri;
use embassy_nrf::gpio::{Level, Output, OutputDrive, Pin};
use nova_wire::{Counters, Record};

use crate::pins::LedPins;
use crate::pulse::Pulse;

/// How often the green light flashes, in microseconds; the radio loop passes at least as often.
const HEARTBEAT_US: u64 = 1_000_000;

/// A light and the flash it shows.
struct Led {
    /// Active low.
    pin: Output<'static>,
    pulse: Pulse,
}

impl Led {
    fn new(pin: Peri<'static, impl Pin>) -> Self {
        Self {
            pin: Output::new(pin, Level::High, OutputDrive::Standard),
            pulse: Pulse::new(),
        }
    }

    /// Shows what is due at `now_us`; returns when that changes.
    fn update(&mut self, now_us: u64) -> Option<u64> {
        self.pin.set_level(Level::from(!self.pulse.is_lit(now_us)));
        self.pulse.next_change_us()
    }
}

/// The four lights.
pub(crate) struct Leds {
    /// The radio loop runs: once a second.
    alive: Led,
    /// An exchange gave a range.
    range: Led,
    /// In the last second an exchange or the radio failed.
    failure: Led,
    /// In the last second the serial line was too slow and records were dropped.
    dropped: Led,
    heartbeat_us: u64,
    failures: u32,
    records_dropped: u32,
}

impl Leds {
    /// All dark.
    pub(crate) fn new(pins: LedPins) -> Self {
        Self {
            alive: Led::new(pins.green),
            range: Led::new(pins.blue),
            failure: Led::new(pins.red_right),
            dropped: Led::new(pins.red_left),
            heartbeat_us: 0,
            failures: 0,
            records_dropped: 0,
        }
    }

    /// Takes in what `record` says; shown by the next [`Leds::update`]. Failures show once a second, when
    /// the status comes.
    pub(crate) fn note(&mut self, record: &Record, now_us: u64) {
        match record {
            Record::Range(_) => self.range.pulse.trigger(now_us),
            Record::Status(status) => {
                let failures = failures(&status.counters);
                if failures != replace(&mut self.failures, failures) {
                    self.failure.pulse.trigger(now_us);
                }
                let dropped = status.counters.records_dropped;
                if dropped != replace(&mut self.records_dropped, dropped) {
                    self.dropped.pulse.trigger(now_us);
                }
            }
            _ => {}
        }
    }

    /// Brings the lights up to `now_us`; returns when that has to be done again.
    pub(crate) fn update(&mut self, now_us: u64) -> u64 {
        if now_us >= self.heartbeat_us {
            self.heartbeat_us = now_us + HEARTBEAT_US;
            self.alive.pulse.trigger(now_us);
        }
        let leds = [
            &mut self.alive,
            &mut self.range,
            &mut self.failure,
            &mut self.dropped,
        ];
        leds.into_iter()
            .filter_map(|led| led.update(now_us))
            .fold(self.heartbeat_us, u64::min)
    }
}

/// Exchanges and transfers that went wrong. Frames of others are none of our failures.
fn failures(counters: &Counters) -> u32 {
    [
        counters.no_response,
        counters.no_final,
        counters.no_report,
        counters.send_too_late,
        counters.send_time_mismatch,
        counters.bad_stamps,
        counters.unexpected_events,
        counters.radio_resets,
        counters.bus_errors,
    ]
    .into_iter()
    .fold(0, u32::wrapping_add)
}
