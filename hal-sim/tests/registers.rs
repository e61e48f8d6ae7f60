//! Registers, reset, clocks and OTP.

mod bench;

use bench::*;
use nova_hal_sim::SimTime;
use nova_hal_sim::chip::{ChipConfig, OtpConfig};

#[test]
fn reset_values_are_those_of_the_manual() {
    let (mut bench, [chip]) = Bench::cold([at(0.0)]);
    assert_eq!(bench.number(chip, 0x00, 0, 4), 0xDECA_0130);
    assert_eq!(bench.number(chip, SYS_CFG, 0, 4), 0x1200);
    assert_eq!(bench.number(chip, TX_FCTRL, 0, 5), 0x0015_400C);
    assert_eq!(bench.number(chip, 0x03, 0, 4), 0xFFFF_FFFF);
    assert_eq!(bench.number(chip, 0x1E, 0, 4), 0x0E08_0222);
    assert_eq!(bench.number(chip, CHAN_CTRL, 0, 4), 0x2104_0055);
    assert_eq!(bench.number(chip, 0x24, 0, 4), 0);
    assert_eq!(bench.number(chip, DRX, 0x02, 2), 0x0001);
    assert_eq!(bench.number(chip, DRX, 0x06, 2), 0x0020);
    assert_eq!(bench.number(chip, DRX, 0x20, 2), 0x1041);
    assert_eq!(bench.number(chip, 0x28, 0x30, 5), 0x88_8888_8888);
    assert_eq!(bench.number(chip, PMSC, 0, 4), 0xF030_0200);
    assert_eq!(bench.number(chip, 0x2E, 0x0806, 1), 0x6C);
    assert_ne!(bench.status(chip) & CPLOCK, 0);
}

#[test]
fn read_only_registers_keep_their_value() {
    let (mut bench, [chip]) = Bench::cold([at(0.0)]);
    bench.write(chip, 0x00, 0, &[0; 4]);
    assert_eq!(bench.number(chip, 0x00, 0, 4), 0xDECA_0130);
    assert_eq!(bench.world.chip_stats(chip).read_only_writes, 1);
}

#[test]
fn reads_beyond_a_register_are_zero_and_counted() {
    let (mut bench, [chip]) = Bench::cold([at(0.0)]);
    bench.write(chip, SYS_MASK, 0, &[0xFF; 4]);
    assert_eq!(bench.number(chip, SYS_MASK, 0, 5), 0xFFFF_FFFF);
    assert_eq!(bench.world.chip_stats(chip).beyond_register, 1);
    assert_eq!(bench.number(chip, 0x02, 0, 2), 0);
    assert_eq!(bench.world.chip_stats(chip).beyond_register, 3);
}

#[test]
fn writes_into_the_middle_of_a_register_change_only_that_part() {
    let (mut bench, [chip]) = Bench::cold([at(0.0)]);
    bench.write(chip, 0x03, 2, &[0xCA, 0xDE]);
    assert_eq!(bench.number(chip, 0x03, 0, 4), 0xDECA_FFFF);
    bench.write(chip, 0x2E, 0x1804, &[0x48, 0x40]);
    assert_eq!(bench.number(chip, 0x2E, 0x1804, 2), 0x4048);
}

#[test]
fn status_bits_are_cleared_by_writing_one() {
    let (mut bench, [chip]) = Bench::cold([at(0.0)]);
    let before = bench.status(chip);
    bench.write(chip, SYS_STATUS, 0, &(CPLOCK as u32).to_le_bytes());
    assert_eq!(bench.status(chip), before & !CPLOCK);
}

#[test]
fn irq_follows_mask_and_polarity() {
    let (mut bench, [chip]) = Bench::cold([at(0.0)]);
    assert!(!bench.world.irq_level(chip));
    bench.write(chip, SYS_MASK, 0, &(CPLOCK as u32).to_le_bytes());
    assert!(bench.world.irq_level(chip));
    assert_eq!(bench.status(chip) & 1, 1);
    bench.write(chip, SYS_CFG, 0, &0x1000u32.to_le_bytes()); // active low
    assert!(!bench.world.irq_level(chip));
    bench.clear_status(chip);
    assert!(bench.world.irq_level(chip));
}

#[test]
fn system_time_moves_in_steps_of_512_ticks() {
    let (mut bench, [chip]) = Bench::ready([at(0.0)]);
    let first = bench.system_time(chip);
    bench.wait_us(1_000);
    let second = bench.system_time(chip);
    assert_eq!((first % 512, second % 512), (0, 0));
    // 1 ms and the 6 bytes of the first read at 2 MHz.
    let expected = (1_000.0 + 24.0) * 63_897.6;
    assert!(((second - first) as f64 - expected).abs() <= 512.0);
}

#[test]
fn event_counters_are_enabled_cleared_and_read_back_as_zero() {
    let (mut bench, [a, b]) = Bench::ready([at(0.0), at(5.0)]);
    bench.exchange(a, b, b"not counted yet");
    assert_eq!(bench.number(a, EVC, 0x16, 2), 0);
    for chip in [a, b] {
        bench.write(chip, EVC, 0, &[1, 0, 0, 0]);
        assert_eq!(bench.number(chip, EVC, 0, 4), 0);
    }
    bench.exchange(a, b, b"counted");
    assert_eq!(bench.number(a, EVC, 0x16, 2), 1);
    assert_eq!(bench.number(b, EVC, 0x08, 2), 1);
    bench.write(a, EVC, 0, &[2, 0, 0, 0]);
    assert_eq!(bench.number(a, EVC, 0x16, 2), 0);
}

#[test]
fn otp_words_are_read_through_the_manual_mode() {
    let otp = OtpConfig {
        antenna_delay_prf16: 16_450,
        antenna_delay_prf64: 16_436,
        xtal_trim: 0x0E,
        eui: 0x1122_3344_5566_7788,
        ..OtpConfig::default()
    };
    let (mut bench, [chip]) = Bench::cold([ChipConfig { otp, ..at(0.0) }]);
    let mut word = |address: u16| {
        bench.write(chip, 0x2D, 4, &address.to_le_bytes());
        bench.write(chip, 0x2D, 6, &[0x03, 0]);
        bench.write(chip, 0x2D, 6, &[0x01, 0]);
        bench.number(chip, 0x2D, 0x0A, 4)
    };
    assert_eq!(word(0x01C), 16_436 << 16 | 16_450);
    assert_eq!(word(0x01E) & 0x1F, 0x0E);
    assert_eq!(word(0x004), 0x8888_8888);
    assert_eq!(word(0x100), 0);
    assert_eq!(bench.number(chip, 0x01, 0, 8), 0x1122_3344_5566_7788);
}

#[test]
fn ldeload_reads_as_set_until_the_microcode_is_loaded() {
    let (mut bench, [chip]) = Bench::cold([at(0.0)]);
    bench.write(chip, PMSC, 0, &[0x01, 0x03]);
    bench.write(chip, 0x2D, 6, &[0x00, 0x80]);
    assert_eq!(bench.number(chip, 0x2D, 6, 2), 0x8000);
    bench.wait_us(150);
    assert_eq!(bench.number(chip, 0x2D, 6, 2), 0);
}

#[test]
fn the_rf_pll_is_locked_only_while_the_radio_is_on() {
    let (mut bench, [chip]) = Bench::ready([at(0.0)]);
    assert_eq!(bench.number(chip, 0x28, 0x2C, 1), 0b0001);
    bench.command(chip, RXENAB);
    assert_eq!(bench.number(chip, 0x28, 0x2C, 1), 0b1001);
    bench.command(chip, TRXOFF);
    assert_eq!(bench.number(chip, 0x28, 0x2C, 1), 0b0001);
}

#[test]
fn more_crystal_trim_slows_the_clock() {
    let (mut bench, [chip]) = Bench::cold([ChipConfig::default()]);
    let now = SimTime::from_ms(10);
    let ppm = |bench: &Bench| bench.world.chip(chip).unwrap().clock().ppm_at(now);
    assert!((ppm(&bench) - 24.0).abs() < 1e-6); // the reset value is no trim at all
    bench.write(chip, 0x2B, 0x0E, &[0x60 | 0x10]);
    assert!(ppm(&bench).abs() < 1e-6);
    bench.write(chip, 0x2B, 0x0E, &[0x60 | 0x14]);
    assert!((ppm(&bench) + 6.0).abs() < 1e-6);
}

#[test]
fn fast_spi_before_the_pll_locks_kills_the_chip_until_reset() {
    let (mut bench, [chip]) = Bench::cold([at(0.0)]);
    // LDE loading runs from the crystal.
    bench.write(chip, PMSC, 0, &[0x01, 0x03]);
    let mut id = [0; 5];
    let now = bench.world.now();
    bench
        .world
        .spi_transaction(chip, now, 8_000_000, &[0; 5], &mut id);
    assert_eq!(bench.number(chip, 0x00, 0, 4), 0xFFFF_FFFF);
    assert_eq!(bench.world.chip_stats(chip).killed_by_fast_spi, 1);

    let now = bench.world.now();
    bench.world.set_reset(chip, now, true);
    bench.wait_us(10);
    let now = bench.world.now();
    bench.world.set_reset(chip, now, false);
    bench.wait_us(5_000);
    assert_eq!(bench.number(chip, 0x00, 0, 4), 0xDECA_0130);
    let now = bench.world.now();
    bench
        .world
        .spi_transaction(chip, now, 8_000_000, &[0; 5], &mut id);
    assert_eq!(id, [0, 0x30, 0x01, 0xCA, 0xDE]);
}

#[test]
fn reset_pin_restores_registers_and_restarts_the_counter() {
    let (mut bench, [chip]) = Bench::ready([at(0.0)]);
    bench.write(chip, 0x03, 0, &[1, 2, 3, 4]);
    let now = bench.world.now();
    bench.world.set_reset(chip, now, true);
    assert_eq!(bench.number(chip, 0x00, 0, 4), 0xFFFF_FFFF);
    let now = bench.world.now();
    bench.world.set_reset(chip, now, false);
    bench.wait_us(2_000);
    assert_eq!(bench.number(chip, 0x03, 0, 4), 0xFFFF_FFFF);
    // INIT began 1 ms after the release; the read's own bits come on top.
    let since_init = bench.system_time(chip) as f64 / 63_897.6;
    assert!((1_000.0..1_100.0).contains(&since_init), "{since_init} us");
}

#[test]
fn soft_reset_restores_registers() {
    let (mut bench, [chip]) = Bench::ready([at(0.0)]);
    bench.write(chip, 0x03, 0, &[1, 2, 3, 4]);
    bench.write(chip, PMSC, 0, &[0x01, 0x03]);
    bench.write(chip, PMSC, 3, &[0x00]);
    bench.write(chip, PMSC, 3, &[0xF0]);
    bench.wait_us(500);
    assert_eq!(bench.number(chip, 0x03, 0, 4), 0xFFFF_FFFF);
    assert_ne!(bench.status(chip) & CPLOCK, 0);
}
