//! Chapters 20 and 21: the port, and events and tasks of its pins.

use proptest::prelude::*;

use super::{Bench, INTENSET, Outward};
use crate::wiring;

const GPIOTE: u8 = 6;
const OUT_TASK: u16 = 0x000;
const SET_TASK: u16 = 0x030;
const CLR_TASK: u16 = 0x060;
const IN: u16 = 0x100;
const PORT: u16 = 0x17C;
const CONFIG: u16 = 0x510;
/// Of the port.
const OUTSET: u16 = 0x508;
const OUTCLR: u16 = 0x50C;
const LEVELS: u16 = 0x510;
const DIRSET: u16 = 0x518;
const PIN_CNF: u16 = 0x700;

const PIN: u8 = wiring::RADIO_INTERRUPT;

impl Bench {
    fn port(&mut self, offset: u16, value: u32) {
        self.soc.write_port(offset, value, self.now).unwrap();
    }

    fn drive(&mut self, high: bool) {
        self.soc.drive_pin(PIN, high, self.now);
    }
}

fn event_channel(channel: u16, pin: u8, polarity: u32) -> (u16, u32) {
    (
        CONFIG + 4 * channel,
        1 | u32::from(pin) << 8 | polarity << 16,
    )
}

proptest! {
    /// POLARITY: 0 none, 1 rising, 2 falling, 3 both.
    #[test]
    fn a_channel_sees_the_edges_that_it_is_set_to(
        polarity in 0..4u32, channel in 0..8u16, levels in prop::collection::vec(any::<bool>(), 1..20),
    ) {
        let mut bench = Bench::new();
        let (register, value) = event_channel(channel, PIN, polarity);
        bench.write(GPIOTE, register, value);
        bench.write(GPIOTE, INTENSET, 1 << channel);
        let mut before = false;
        for level in levels {
            bench.drive(level);
            let edge = match polarity {
                0 => false,
                1 => level && !before,
                2 => before && !level,
                _ => level != before,
            };
            prop_assert_eq!(bench.interrupts(GPIOTE), edge);
            prop_assert_eq!(bench.take_event(GPIOTE, IN + 4 * channel), edge);
            before = level;
        }
    }

    #[test]
    fn the_port_shows_what_is_driven_where_the_input_is_connected(out in any::<u32>(), connected in any::<u32>()) {
        let mut bench = Bench::new();
        // Not the pins that the board drives.
        let free = !wiring::DRIVEN;
        for pin in 0..32u16 {
            // Output; the input buffer's disconnect is bit 1.
            bench.port(PIN_CNF + 4 * pin, 1 | (!connected >> pin & 1) << 1);
        }
        bench.port(OUTSET, out);
        bench.port(OUTCLR, !out);
        prop_assert_eq!(bench.soc.read_port(LEVELS).unwrap() & free, out & connected & free);
    }
}

#[test]
fn sense_makes_one_port_event_for_a_pin_that_stays_high() {
    let mut bench = Bench::new();
    bench.port(PIN_CNF + 4 * u16::from(PIN), 2 << 16);
    bench.drive(true);
    assert!(bench.take_event(GPIOTE, PORT));
    bench.drive(true);
    assert!(!bench.take_event(GPIOTE, PORT));
    bench.drive(false);
    bench.drive(true);
    assert!(bench.take_event(GPIOTE, PORT));
}

#[test]
fn tasks_set_clear_and_toggle_the_pin_of_their_channel() {
    const LIGHT: u8 = 14;
    let mut bench = Bench::new();
    bench.port(DIRSET, 1 << LIGHT);
    // Task mode, toggle, initially high.
    bench.write(
        GPIOTE,
        CONFIG,
        3 | u32::from(LIGHT) << 8 | 3 << 16 | 1 << 20,
    );
    assert!(!bench.soc.gpio.is_pulled_low(LIGHT));
    for (task, is_low) in [
        (OUT_TASK, true),
        (OUT_TASK, false),
        (CLR_TASK, true),
        (CLR_TASK, true),
        (SET_TASK, false),
    ] {
        bench.task(GPIOTE, task);
        assert_eq!(bench.soc.gpio.is_pulled_low(LIGHT), is_low, "{task:#x}");
    }
}

#[test]
fn the_radios_select_and_reset_lines_tell_the_board_their_edges() {
    let (select, reset) = (wiring::RADIO_SELECT, wiring::RADIO_RESET);
    let mut bench = Bench::new();
    bench.port(OUTSET, 1 << select);
    bench.port(DIRSET, 1 << select);
    assert_eq!(bench.told(), [], "it was pulled high before");
    bench.port(OUTCLR, 1 << select);
    bench.port(OUTSET, 1 << select);
    assert_eq!(
        bench.told(),
        [Outward::Select(true), Outward::Select(false)]
    );
    // Low by becoming an output, released by becoming an input again.
    bench.port(DIRSET, 1 << reset);
    bench.port(0x51C, 1 << reset);
    assert_eq!(
        bench.told(),
        [Outward::RadioReset(true), Outward::RadioReset(false)]
    );
}
