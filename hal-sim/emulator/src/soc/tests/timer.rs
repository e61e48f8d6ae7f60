//! Chapter 24.

use proptest::prelude::*;

use super::{Bench, INTENSET};

const TIMER1: u8 = 9;
const TIMER4: u8 = 27;
const START: u16 = 0x000;
const STOP: u16 = 0x004;
const COUNT: u16 = 0x008;
const CLEAR: u16 = 0x00C;
const CAPTURE: u16 = 0x040;
const COMPARE: u16 = 0x140;
const SHORTS: u16 = 0x200;
const MODE: u16 = 0x504;
const BITMODE: u16 = 0x508;
const PRESCALER: u16 = 0x510;
const CC: u16 = 0x540;

/// Cycles of the processor in one of 16 MHz.
const STEP: u64 = 4;

proptest! {
    #[test]
    fn a_compare_comes_after_so_many_steps_of_16_mhz_divided_by_a_power_of_two(
        prescaler in 0..10u32, value in 1..0x1_0000u32, n in 0..6u16,
    ) {
        let mut bench = Bench::new();
        bench.write(TIMER4, PRESCALER, prescaler);
        bench.write(TIMER4, CC + 4 * n, value);
        bench.write(TIMER4, INTENSET, 1 << (16 + n));
        bench.task(TIMER4, START);
        let at = u64::from(value) * (STEP << prescaler);
        bench.until(at - 1);
        prop_assert!(!bench.interrupts(TIMER4));
        bench.until(at);
        prop_assert!(bench.interrupts(TIMER4));
        prop_assert!(bench.take_event(TIMER4, COMPARE + 4 * n));
    }

    #[test]
    fn capture_takes_what_is_counted_and_the_width_wraps_it(
        width in 0..4u32, prescaler in 0..4u32, passed in 0..0x2_0000_0000u64,
    ) {
        let mut bench = Bench::new();
        bench.write(TIMER1, BITMODE, width);
        bench.write(TIMER1, PRESCALER, prescaler);
        bench.task(TIMER1, START);
        // As one look: compares at 0 would be events of their own.
        bench.now = passed;
        bench.task(TIMER1, CAPTURE + 4);
        let counted = passed / (STEP << prescaler);
        let bits = [16, 8, 24, 32][width as usize];
        prop_assert_eq!(u64::from(bench.read(TIMER1, CC + 4)), counted % (1 << bits));
    }

    #[test]
    fn a_counter_counts_tasks_and_no_time(tasks in 1..300u32, pauses in 0..1000u64) {
        let mut bench = Bench::new();
        bench.write(TIMER1, MODE, 1);
        bench.write(TIMER1, BITMODE, 1);
        bench.write(TIMER1, CC, 200);
        bench.task(TIMER1, START);
        for _ in 0..tasks {
            bench.task(TIMER1, COUNT);
            bench.pass(pauses);
        }
        prop_assert_eq!(bench.take_event(TIMER1, COMPARE), tasks >= 200);
        bench.task(TIMER1, CAPTURE + 4);
        prop_assert_eq!(bench.read(TIMER1, CC + 4), tasks % 256);
    }
}

#[test]
fn the_shortcut_to_clear_makes_a_period_and_the_one_to_stop_makes_a_single_shot() {
    let mut bench = Bench::new();
    bench.write(TIMER1, CC, 1000);
    bench.write(TIMER1, PRESCALER, 0);
    bench.write(TIMER1, SHORTS, 1);
    bench.task(TIMER1, START);
    for n in 1..=5 {
        bench.until(n * 1000 * STEP - 1);
        assert!(!bench.take_event(TIMER1, COMPARE), "{n}");
        bench.pass(1);
        assert!(bench.take_event(TIMER1, COMPARE), "{n}");
    }
    bench.write(TIMER1, SHORTS, 1 << 8);
    bench.pass(1000 * STEP);
    assert!(bench.take_event(TIMER1, COMPARE));
    bench.pass(100_000 * STEP);
    assert!(!bench.take_event(TIMER1, COMPARE));
}

#[test]
fn clear_starts_over_and_stop_keeps_the_count() {
    let mut bench = Bench::new();
    bench.write(TIMER1, PRESCALER, 0);
    bench.task(TIMER1, START);
    bench.pass(300 * STEP);
    bench.task(TIMER1, CLEAR);
    bench.pass(20 * STEP);
    bench.task(TIMER1, STOP);
    bench.pass(500 * STEP);
    bench.task(TIMER1, CAPTURE);
    assert_eq!(bench.read(TIMER1, CC), 20);
}
