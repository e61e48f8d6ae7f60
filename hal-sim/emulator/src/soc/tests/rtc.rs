//! Chapter 25.

use proptest::prelude::*;

use super::{Bench, Cycles, INTENSET};

const RTC0: u8 = 11;
const RTC1: u8 = 17;
const START: u16 = 0x000;
const STOP: u16 = 0x004;
const CLEAR: u16 = 0x008;
const TRIGGER_OVERFLOW: u16 = 0x00C;
const TICK: u16 = 0x100;
const OVERFLOW: u16 = 0x104;
const COMPARE: u16 = 0x140;
const EVTENSET: u16 = 0x344;
const COUNTER: u16 = 0x504;
const PRESCALER: u16 = 0x508;
const CC: u16 = 0x540;

/// The first cycle at which `ticks` of 32 768 Hz / `divider` have passed.
fn cycles(ticks: u64, divider: u64) -> Cycles {
    (ticks * divider * 64_000_000).div_ceil(32_768)
}

proptest! {
    #[test]
    fn a_compare_comes_in_the_cycle_in_which_the_counter_gets_there_and_none_earlier(
        prescaler in 0..4096u32, value in 1..0x100_0000u32, n in 0..4u16, began in 0..1_000_000u64,
    ) {
        let mut bench = Bench::new();
        bench.until(began);
        bench.write(RTC1, PRESCALER, prescaler);
        bench.write(RTC1, CC + 4 * n, value);
        bench.write(RTC1, INTENSET, 1 << (16 + n));
        bench.task(RTC1, START);
        let at = began + cycles(value.into(), u64::from(prescaler) + 1);
        bench.until(at - 1);
        prop_assert!(!bench.interrupts(RTC1));
        prop_assert_eq!(bench.read(RTC1, COUNTER), value - 1);
        bench.until(at);
        prop_assert!(bench.interrupts(RTC1));
        prop_assert_eq!(bench.read(RTC1, COUNTER), value);
        prop_assert!(bench.take_event(RTC1, COMPARE + 4 * n));
        prop_assert!(!bench.interrupts(RTC1), "a level that follows the event");
    }

    #[test]
    fn a_counter_that_was_stopped_goes_on_where_it_was(before in 0..5000u64, pause in 0..5000u64, after in 0..5000u64) {
        let mut bench = Bench::new();
        bench.task(RTC1, START);
        bench.pass(cycles(before, 1));
        bench.task(RTC1, STOP);
        bench.pass(cycles(pause, 1));
        prop_assert_eq!(u64::from(bench.read(RTC1, COUNTER)), before);
        bench.task(RTC1, START);
        bench.pass(cycles(after, 1));
        prop_assert_eq!(u64::from(bench.read(RTC1, COUNTER)), before + after);
    }
}

#[test]
fn a_compare_with_what_the_counter_shows_already_waits_for_the_next_round() {
    let mut bench = Bench::new();
    bench.write(RTC1, EVTENSET, 1 << 16);
    bench.task(RTC1, START);
    bench.until(cycles(100, 1));
    bench.write(RTC1, CC, 100);
    bench.until(cycles(100 + (1 << 24), 1) - 1);
    assert!(!bench.take_event(RTC1, COMPARE));
    bench.pass(1);
    assert!(bench.take_event(RTC1, COMPARE));
}

#[test]
fn an_event_that_nothing_asks_for_does_not_come() {
    let mut bench = Bench::new();
    bench.write(RTC1, CC, 10);
    bench.task(RTC1, START);
    bench.until(cycles(20, 1));
    assert!(!bench.take_event(RTC1, COMPARE));
    assert!(!bench.take_event(RTC1, TICK));
}

#[test]
fn the_counter_overflows_sixteen_ticks_after_it_was_told_to_near_that() {
    let mut bench = Bench::new();
    bench.write(RTC1, EVTENSET, 0b11);
    bench.task(RTC1, START);
    bench.task(RTC1, TRIGGER_OVERFLOW);
    assert_eq!(bench.read(RTC1, COUNTER), 0xFF_FFF0);
    bench.until(cycles(16, 1) - 1);
    assert!(bench.take_event(RTC1, TICK));
    assert!(!bench.take_event(RTC1, OVERFLOW));
    bench.pass(1);
    assert!(bench.take_event(RTC1, TICK) && bench.take_event(RTC1, OVERFLOW));
    assert_eq!(bench.read(RTC1, COUNTER), 0);
}

#[test]
fn clear_sets_the_counter_to_zero_while_it_runs() {
    let mut bench = Bench::new();
    bench.task(RTC1, START);
    bench.until(cycles(1234, 1));
    bench.task(RTC1, CLEAR);
    assert_eq!(bench.read(RTC1, COUNTER), 0);
    bench.pass(cycles(7, 1));
    assert_eq!(bench.read(RTC1, COUNTER), 7);
}

#[test]
fn the_prescaler_of_a_running_counter_and_a_fourth_compare_of_rtc0_are_refused() {
    let mut bench = Bench::new();
    assert!(bench.try_write(RTC0, CC + 12, 1).is_err());
    bench.write(RTC1, CC + 12, 1);
    bench.task(RTC1, START);
    assert!(bench.try_write(RTC1, PRESCALER, 1).is_err());
}
