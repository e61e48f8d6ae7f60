//! Conversions between true time and device time.

use nova_hal_sim::ClockConfig;
use nova_hal_sim::SimTime;
use nova_hal_sim::clock::{COUNTER_WRAP, DeviceClock, McuClock, Phase};
use nova_hal_sim::time::FS_PER_S;
use proptest::prelude::*;

const FIVE_HOURS_FS: u64 = 5 * 3600 * FS_PER_S;

fn clock(offset_ticks: u64, ppm: f64, drift_ppm_per_s: f64) -> DeviceClock {
    let config = ClockConfig {
        offset_ticks,
        ppm,
        drift_ppm_per_s,
    };
    DeviceClock::new(&config, SimTime::ZERO)
}

#[test]
fn a_perfect_clock_counts_63_897_600_000_ticks_a_second() {
    let clock = clock(0, 0.0, 0.0);
    for s in [1u64, 100, 18_000] {
        let phase = clock.phase_at(SimTime::from_fs(s * FS_PER_S));
        assert_eq!(phase, Phase::from_ticks(i128::from(s) * 63_897_600_000));
    }
}

#[test]
fn ppm_and_drift_add_up_as_their_integral_says() {
    let clock = clock(0, 10.0, 0.01);
    // 10 ppm x 3600 s + 0.01 ppm/s x (3600 s)² / 2 = 100 800 us more than 3600 s.
    let phase = clock.phase_at(SimTime::from_fs(3600 * FS_PER_S));
    let exact_us = 3_600_000_000i128 + 100_800;
    assert_eq!(phase.ticks_rounded(), exact_us * 638_976 / 10);
}

#[test]
fn the_counter_wraps_without_a_jump() {
    let clock = clock(COUNTER_WRAP - 1_000_000, 20.0, 0.0);
    let step_fs = 1_565_004; // about 100 ticks
    let mut last = clock.counter_at(SimTime::ZERO);
    let mut wraps = 0;
    for i in 1..20_000u64 {
        let counter = clock.counter_at(SimTime::from_fs(i * step_fs));
        wraps += u32::from(counter < last);
        let moved = counter.wrapping_sub(last) % COUNTER_WRAP;
        assert!((99..=101).contains(&moved), "{moved} ticks at step {i}");
        last = counter;
    }
    assert_eq!(wraps, 1);
}

proptest! {
    #[test]
    fn device_time_converts_back_to_within_an_eighth_of_a_tick(
        offset in 0..COUNTER_WRAP,
        ppm in -100.0..100.0f64,
        drift in -0.01..0.01f64,
        fs in 0..FIVE_HOURS_FS,
    ) {
        let clock = clock(offset, ppm, drift);
        let phase = clock.phase_at(SimTime::from_fs(fs));
        let back = clock.time_of(phase);
        prop_assert!(back.as_fs().abs_diff(fs) < 15_650 / 8);
        prop_assert!(clock.phase_at(back).since(phase).abs() < 0.125);
    }

    #[test]
    fn device_time_never_runs_backwards(
        ppm in -100.0..100.0f64,
        drift in -0.01..0.01f64,
        fs in 0..FIVE_HOURS_FS,
        later in 100..1_000_000_000_000u64,
    ) {
        let clock = clock(0, ppm, drift);
        let phase = clock.phase_at(SimTime::from_fs(fs));
        prop_assert!(clock.phase_at(SimTime::from_fs(fs + later)) > phase);
    }

    #[test]
    fn the_next_phase_of_a_counter_value_is_within_one_wrap(
        offset in 0..COUNTER_WRAP,
        fs in 0..FIVE_HOURS_FS,
        counter in 0..COUNTER_WRAP,
    ) {
        let clock = clock(offset, 7.0, 0.0);
        let now = SimTime::from_fs(fs);
        let next = clock.next_phase_of(now, counter);
        prop_assert_eq!(next.counter(), counter);
        let ahead = next.since(clock.phase_at(now));
        prop_assert!((0.0..=COUNTER_WRAP as f64).contains(&ahead));
    }

    #[test]
    fn trimming_changes_the_rate_without_a_jump(
        fs in 0..FIVE_HOURS_FS,
        ppm in -30.0..30.0f64,
    ) {
        let mut clock = clock(0, 5.0, 0.001);
        let now = SimTime::from_fs(fs);
        let (before, rate) = (clock.phase_at(now), clock.ppm_at(now));
        clock.shift_rate(now, ppm);
        prop_assert_eq!(clock.phase_at(now), before);
        prop_assert!((clock.ppm_at(now) - rate - ppm).abs() < 1e-9);
    }

    #[test]
    fn the_processor_wakes_when_its_own_clock_says_so(
        us in 0..18_000_000_000u64,
        ppm in -100.0..100.0f64,
    ) {
        let mcu = McuClock::new(SimTime::from_us(5_000), ppm);
        prop_assert_eq!(mcu.us_at(mcu.time_of(us)), us);
    }
}
