//! SLEEP and DEEPSLEEP: what wakes the chip, what it keeps, what it draws.
#![allow(clippy::unwrap_used)] // in helpers of tests

mod bench;

use bench::*;
use nova_hal_sim::chip::{ChipConfig, OtpConfig};
use nova_hal_sim::world::ChipId;
use nova_hal_sim::{ClockConfig, SimDuration};
use proptest::prelude::*;

const AON: u8 = 0x2C;
const AON_WCFG: usize = 0x00;
const AON_CTRL: usize = 0x02;
const AON_CFG0: usize = 0x06;
const AON_CFG1: usize = 0x0A;
const ONW_LEUI: u16 = 1 << 3;
const ONW_LDC: u16 = 1 << 6;
const ONW_LLDE: u16 = 1 << 11;
const ONW_LLDO: u16 = 1 << 12;
const SAVE: u8 = 1 << 1;
const UPL_CFG: u8 = 1 << 2;
const SLEEP_EN: u8 = 1 << 0;
const WAKE_SPI: u8 = 1 << 2;
const WAKE_CNT: u8 = 1 << 3;
const SLP2INIT: u64 = 1 << 23;
const TX_ANTD: u8 = 0x18;
const LDE_IF: u8 = 0x2E;
const LDE_RXANTD: usize = 0x1804;

fn sleep(bench: &mut Bench, chip: ChipId, on_wake: u16, how: u8) {
    bench.write(chip, AON, AON_WCFG, &on_wake.to_le_bytes());
    bench.write(chip, AON, AON_CFG1, &[0, 0]);
    bench.write(chip, AON, AON_CFG0, &[how]);
    bench.write(chip, AON, AON_CTRL, &[SAVE]);
}

fn select(bench: &mut Bench, chip: ChipId, us: u64) {
    let now = bench.world.now();
    bench.world.spi_select(chip, now);
    bench
        .world
        .spi_deselect(chip, now + SimDuration::from_us(us));
}

fn wake(bench: &mut Bench, chip: ChipId) {
    select(bench, chip, 600);
    bench.wait_us(5_000);
}

fn identifier(bench: &mut Bench, chip: ChipId) -> u64 {
    bench.number(chip, 0x00, 0, 4)
}

#[test]
fn asleep_it_answers_nobody_and_only_a_long_selection_wakes_it() {
    let (mut bench, [a]) = Bench::ready([at(0.0)]);
    sleep(&mut bench, a, ONW_LDC, SLEEP_EN | WAKE_SPI);
    assert_eq!(identifier(&mut bench, a), 0xFFFF_FFFF);
    select(&mut bench, a, 499);
    bench.wait_us(10_000);
    assert_eq!(identifier(&mut bench, a), 0xFFFF_FFFF);
    select(&mut bench, a, 501);
    bench.wait_us(3_000);
    assert_eq!(identifier(&mut bench, a), 0xFFFF_FFFF);
    bench.wait_us(2_000);
    assert_eq!(identifier(&mut bench, a), 0xDECA_0130);
    let status = bench.number(a, SYS_STATUS, 0, 5);
    assert_eq!(status & (SLP2INIT | CPLOCK), SLP2INIT | CPLOCK);
}

#[test]
fn many_short_selections_in_a_row_are_no_long_one() {
    let (mut bench, [a]) = Bench::ready([at(0.0)]);
    sleep(&mut bench, a, ONW_LDC, SLEEP_EN | WAKE_SPI);
    for _ in 0..20 {
        select(&mut bench, a, 90);
    }
    bench.wait_us(10_000);
    assert_eq!(identifier(&mut bench, a), 0xFFFF_FFFF);
}

#[test]
fn without_sleep_enabled_saving_and_uploading_do_not_put_it_to_sleep() {
    let (mut bench, [a]) = Bench::ready([at(0.0)]);
    sleep(&mut bench, a, ONW_LDC, WAKE_SPI);
    bench.write(a, AON, AON_CTRL, &[UPL_CFG]);
    assert_eq!(identifier(&mut bench, a), 0xDECA_0130);
    assert_eq!(bench.world.chip_stats(a).sleeps, 0);
}

#[test]
fn who_forgets_to_clear_smxx_does_not_get_it_back_before_a_reset() {
    let (mut bench, [a]) = Bench::ready([at(0.0)]);
    bench.write(a, AON, AON_CFG0, &[SLEEP_EN | WAKE_SPI]);
    bench.write(a, AON, AON_CTRL, &[SAVE]);
    wake(&mut bench, a);
    assert_eq!(identifier(&mut bench, a), 0xFFFF_FFFF);
    let now = bench.world.now();
    bench.world.set_reset(a, now, true);
    bench.world.set_reset(a, now, false);
    bench.wait_us(5_000);
    assert_eq!(identifier(&mut bench, a), 0xDECA_0130);
}

#[test]
fn the_transmit_antenna_delay_comes_back_wrong_and_the_receivers_right() {
    let (mut bench, [a]) = Bench::ready([at(0.0)]);
    bench.write(a, TX_ANTD, 0, &0x4048u16.to_le_bytes());
    bench.write(a, LDE_IF, LDE_RXANTD, &0x4148u16.to_le_bytes());
    sleep(&mut bench, a, ONW_LDC, SLEEP_EN | WAKE_SPI);
    wake(&mut bench, a);
    assert_eq!(bench.number(a, LDE_IF, LDE_RXANTD, 2), 0x4148);
    assert_eq!(bench.number(a, TX_ANTD, 0, 2), 0x0041);
}

#[test]
fn registers_come_back_only_if_they_were_asked_for() {
    for (on_wake, kept) in [(ONW_LDC, true), (0, false)] {
        let (mut bench, [a]) = Bench::ready([at(0.0)]);
        bench.write(a, CHAN_CTRL, 0, &0x4A48_0055u32.to_le_bytes());
        bench.write(a, SYS_MASK, 0, &0x80u32.to_le_bytes());
        // The transmitter's clock forced on.
        bench.write(a, PMSC, 0, &0xF030_0220u32.to_le_bytes());
        bench.write(a, 0x2B, 0x0E, &[0x6F]);
        sleep(&mut bench, a, on_wake, SLEEP_EN | WAKE_SPI);
        wake(&mut bench, a);
        assert_eq!(bench.number(a, CHAN_CTRL, 0, 4) == 0x4A48_0055, kept);
        assert_eq!(bench.number(a, SYS_MASK, 0, 4) == 0x80, kept);
        // Never.
        assert_eq!(bench.number(a, PMSC, 0, 4), 0xF030_0200);
        assert_eq!(bench.number(a, 0x2B, 0x0E, 1), 0x60);
    }
}

#[test]
fn identifier_tuning_and_microcode_are_loaded_if_they_were_asked_for() {
    let config = || ChipConfig {
        otp: OtpConfig {
            eui: 0x1122_3344_5566_7788,
            ldo_tune: 0x12_3456_789A,
            ..OtpConfig::default()
        },
        ..at(0.0)
    };
    let all = ONW_LDC | ONW_LLDE | ONW_LLDO | ONW_LEUI;
    for (on_wake, loaded) in [(all, true), (ONW_LDC, false)] {
        let (mut bench, [a, b]) = Bench::ready([config(), at(5.0)]);
        sleep(&mut bench, a, on_wake, SLEEP_EN | WAKE_SPI);
        wake(&mut bench, a);
        assert_eq!(bench.number(a, 0x01, 0, 8) == 0x1122_3344_5566_7788, loaded);
        assert_eq!(bench.number(a, 0x28, 0x30, 5) == 0x12_3456_789A, loaded);
        // Without its microcode the receiver never ends a reception.
        bench.write(a, SYS_CTRL, 0, &RXENAB.to_le_bytes());
        bench.wait_us(20);
        bench.write(b, TX_FCTRL, 0, &(0x0015_4000u32 | 12).to_le_bytes());
        bench.write(b, SYS_CTRL, 0, &TXSTRT.to_le_bytes());
        bench.wait_us(2_000);
        let received = bench.number(a, SYS_STATUS, 0, 5) & RXFCG != 0;
        assert_eq!(received, loaded);
    }
}

#[test]
fn the_time_base_starts_anew() {
    let config = ChipConfig {
        clock: ClockConfig {
            offset_ticks: 77 * 512,
            ..ClockConfig::default()
        },
        ..at(0.0)
    };
    let (mut bench, [a]) = Bench::ready([config]);
    bench.wait_us(100_000);
    let before = bench.number(a, SYS_TIME, 0, 5);
    sleep(&mut bench, a, ONW_LDC, SLEEP_EN | WAKE_SPI);
    bench.wait_us(50_000);
    wake(&mut bench, a);
    assert!(bench.number(a, SYS_TIME, 0, 5) < before / 10);
}

#[test]
fn the_sleep_counter_wakes_it_alone_and_costs_20_times_deep_sleep() {
    let (mut bench, [a, b]) = Bench::ready([at(0.0), at(1.0)]);
    let drawn = |bench: &Bench, chip| bench.world.consumption(chip).unwrap().charge_ua_s;
    for (chip, how, counter) in [(a, SLEEP_EN | WAKE_CNT, 1), (b, SLEEP_EN | WAKE_SPI, 0)] {
        bench.write(chip, AON, AON_CFG1, &[counter, 0]);
        // Two counts of 4096 cycles of some 10 kHz.
        bench.write(chip, AON, AON_CFG0, &[how, 0, 2, 0]);
        bench.write(chip, AON, AON_CTRL, &[SAVE]);
    }
    let before = [drawn(&bench, a), drawn(&bench, b)];
    bench.wait_us(800_000);
    let spent = [drawn(&bench, a) - before[0], drawn(&bench, b) - before[1]];
    assert!(
        (spent[0] - 0.8).abs() < 1e-6 && (spent[1] - 0.04).abs() < 1e-6,
        "{spent:?}"
    );
    bench.wait_us(30_000);
    assert_eq!(identifier(&mut bench, a), 0xDECA_0130);
    assert_eq!(identifier(&mut bench, b), 0xFFFF_FFFF);
}

#[test]
fn charge_is_current_times_time_in_each_state() {
    let (mut bench, [a]) = Bench::ready([at(0.0)]);
    let before = bench.world.consumption(a).unwrap();
    bench.wait_us(10_000);
    let idle = bench.world.consumption(a).unwrap();
    assert!((idle.charge_ua_s - before.charge_ua_s - 180.0).abs() < 1e-6);
    bench.write(a, SYS_CTRL, 0, &RXENAB.to_le_bytes());
    let start = bench.world.consumption(a).unwrap();
    bench.wait_us(10_000);
    let listened = bench.world.consumption(a).unwrap();
    assert!((listened.charge_ua_s - start.charge_ua_s - 1_180.0).abs() < 1e-6);
    let time = listened.receiving.as_s_f64() - start.receiving.as_s_f64();
    assert!((time - 0.01).abs() < 1e-9);
}

#[derive(Debug, Clone)]
enum Step {
    Sleep(u16, u8),
    Upload,
    Select(u64),
    Wait(u64),
    Reset,
    Write(u8, u32),
    Receive,
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    let file = prop::sample::select(vec![SYS_CFG, CHAN_CTRL, SYS_MASK, AON]);
    let step = prop_oneof![
        (any::<u16>(), any::<u8>()).prop_map(|(on_wake, how)| Step::Sleep(on_wake, how)),
        Just(Step::Upload),
        (1u64..1_500).prop_map(Step::Select),
        (1u64..8_000).prop_map(Step::Wait),
        Just(Step::Reset),
        (file, any::<u32>()).prop_map(|(file, value)| Step::Write(file, value)),
        Just(Step::Receive),
    ];
    prop::collection::vec(step, 1..60)
}

proptest! {
    /// Whatever is written and however it is woken: a reset brings it back, charge never falls, and no time is
    /// counted twice.
    #[test]
    fn no_sequence_leaves_it_where_a_reset_does_not_help(steps in steps()) {
        let (mut bench, [a]) = Bench::ready([at(0.0)]);
        let mut last = bench.world.consumption(a).unwrap();
        for step in steps {
            match step {
                Step::Sleep(on_wake, how) => sleep(&mut bench, a, on_wake, how),
                Step::Upload => bench.write(a, AON, AON_CTRL, &[UPL_CFG]),
                Step::Select(us) => select(&mut bench, a, us),
                Step::Wait(us) => bench.wait_us(us),
                Step::Reset => {
                    let now = bench.world.now();
                    bench.world.brown_out(a, now);
                }
                Step::Write(file, value) => bench.write(a, file, 0, &value.to_le_bytes()),
                Step::Receive => bench.write(a, SYS_CTRL, 0, &RXENAB.to_le_bytes()),
            }
            let now = bench.world.consumption(a).unwrap();
            prop_assert!(now.charge_ua_s >= last.charge_ua_s);
            let parts = now.asleep.as_s_f64() + now.transmitting.as_s_f64() + now.receiving.as_s_f64();
            prop_assert!(parts <= bench.world.now().as_s_f64() + 1e-12);
            last = now;
        }
        let now = bench.world.now();
        bench.world.brown_out(a, now);
        bench.wait_us(5_000);
        prop_assert_eq!(identifier(&mut bench, a), 0xDECA_0130);
        prop_assert_eq!(bench.number(a, CHAN_CTRL, 0, 4), 0x2104_0055);
    }
}
