//! What the chip reports about a reception, read back with the User Manual's formulas.

mod bench;

use bench::*;
use nova_hal_sim::chip::{ChipConfig, LevelReport, MASK_POWER_DBM, Quirks};
use nova_hal_sim::phy::Channel;
use nova_hal_sim::world::ChipId;
use nova_hal_sim::{ChannelConfig, LinkEffect};

/// Preamble count corrected by table 18: 8-symbol standard SFD.
fn accumulated(bench: &mut Bench, chip: ChipId) -> f64 {
    let rxpacc = bench.number(chip, RX_FINFO, 0, 4) >> 20;
    assert_eq!(rxpacc, bench.number(chip, DRX, 0x2C, 2));
    (rxpacc - 5) as f64
}

/// Section 4.7.2 at PRF 16 MHz.
fn receive_dbm(bench: &mut Bench, chip: ChipId) -> f64 {
    let n = accumulated(bench, chip);
    let c = bench.number(chip, 0x12, 6, 2) as f64;
    10.0 * (c * 131_072.0 / (n * n)).log10() - 113.77
}

/// What half a unit of CIR_PWR is worth in dB; weak signals at PRF 16 MHz fill only a few bits of it.
fn resolution_db(bench: &mut Bench, chip: ChipId) -> f64 {
    let c = bench.number(chip, 0x12, 6, 2) as f64;
    10.0 * ((c + 0.5) / c).log10()
}

/// Section 4.7.1 at PRF 16 MHz.
fn first_path_dbm(bench: &mut Bench, chip: ChipId) -> f64 {
    let n = accumulated(bench, chip);
    let ampl = [(RX_TIME, 7), (0x12, 2), (0x12, 4)];
    let sum: f64 = ampl
        .iter()
        .map(|(file, offset)| (bench.number(chip, *file, *offset, 2) as f64).powi(2))
        .sum();
    10.0 * (sum / (n * n)).log10() - 113.77
}

/// Power at 6.8 Mbit/s without smart transmit power, which fills the mask on channel 5 at PRF 16 MHz.
fn fill_mask(bench: &mut Bench, chip: ChipId) {
    bench.set_sys_cfg(chip, 1 << 18);
    bench.write(chip, 0x1E, 0, &[0x48; 4]);
}

fn power_at(distance_m: f64) -> f64 {
    MASK_POWER_DBM - ChannelConfig::default().path_loss_db(Channel::Ch5, distance_m)
}

#[test]
fn the_manuals_formulas_give_back_the_power_received() {
    for distance_m in [2.0, 5.0, 12.0, 30.0] {
        let (mut bench, [a, b]) = Bench::ready([at(0.0), at(distance_m)]);
        fill_mask(&mut bench, a);
        assert_ne!(bench.exchange(a, b, b"power") & RXFCG, 0);
        let expected = power_at(distance_m);
        let tolerance_db = 0.01 + resolution_db(&mut bench, b);
        assert!((receive_dbm(&mut bench, b) - expected).abs() < tolerance_db);
        assert!((first_path_dbm(&mut bench, b) - expected).abs() < 0.02);
    }
}

#[test]
fn an_obstructed_first_path_reads_weaker_than_the_whole() {
    let (mut bench, [a, b]) = Bench::ready([at(0.0), at(5.0)]);
    fill_mask(&mut bench, a);
    bench.world.set_link_effect(
        a,
        b,
        LinkEffect {
            first_path_loss_db: 10.0,
            ..LinkEffect::default()
        },
    );
    bench.exchange(a, b, b"power");
    let gap_db = receive_dbm(&mut bench, b) - first_path_dbm(&mut bench, b);
    assert!((gap_db - 10.0).abs() < 0.2, "{gap_db} dB");
}

#[test]
fn the_compressed_report_reads_low_for_strong_signals() {
    let config = ChipConfig {
        quirks: Quirks {
            level_report: LevelReport::Compressed,
            ..Quirks::default()
        },
        ..at(2.0)
    };
    let (mut bench, [a, b]) = Bench::ready([at(0.0), config]);
    fill_mask(&mut bench, a);
    bench.exchange(a, b, b"power");
    let reported = receive_dbm(&mut bench, b);
    assert!(reported < power_at(2.0) - 5.0);
    // The usual correction of drivers brings it back.
    let corrected = reported + (reported + 88.0) * 2.3334;
    assert!((corrected - power_at(2.0)).abs() < 0.3);
}

/// DRX_CAR_INT as a signed number of 21 bits.
fn carrier_integrator(bench: &mut Bench, chip: ChipId) -> i64 {
    let raw = bench.number(chip, DRX, 0x28, 3) as i64;
    assert!(raw < 1 << 21);
    if raw >= 1 << 20 { raw - (1 << 21) } else { raw }
}

#[test]
fn the_carrier_integrator_is_negative_when_the_sender_is_fast() {
    for (sender_ppm, receiver_ppm) in [(10.0, 0.0), (-10.0, 5.0), (0.0, 3.0)] {
        let (mut bench, [a, b]) = Bench::ready([
            with_ppm(at(0.0), sender_ppm),
            with_ppm(at(5.0), receiver_ppm),
        ]);
        bench.exchange(a, b, b"carrier");
        let value = carrier_integrator(&mut bench, b) as f64;
        // Channel 5, 6.8 Mbit/s: 998.4 MHz / 2 / 1024 / 2^17 a unit, 6489.6 MHz carrier.
        let ppm = -value * 998.4e6 / 2.0 / 1024.0 / 131_072.0 / 6_489.6e6 * 1e6;
        assert!((ppm - (sender_ppm - receiver_ppm)).abs() < 0.001, "{ppm}");

        let interval = bench.number(b, 0x13, 0, 4) as f64;
        let offset = bench.number(b, 0x14, 0, 3) as i64 & 0x7_FFFF;
        let offset = if offset >= 1 << 18 {
            offset - (1 << 19)
        } else {
            offset
        };
        let tracked_ppm = -offset as f64 / interval * 1e6;
        assert!((tracked_ppm - ppm).abs() < 0.02, "{tracked_ppm}");
    }
}

#[test]
fn the_accumulator_holds_a_pulse_at_the_first_path_and_noise_before_it() {
    let (mut bench, [a, b]) = Bench::ready([at(0.0), at(5.0)]);
    bench.exchange(a, b, b"impulse");
    let first_path = bench.number(b, RX_TIME, 5, 2) as usize / 64;
    let std_noise = bench.number(b, 0x12, 0, 2) as f64;
    let from = first_path - 40;
    let bytes = bench.read(b, 0x25, from * 4, 1 + 80 * 4); // one dummy byte first
    let magnitude: Vec<f64> = bytes[1..]
        .chunks_exact(4)
        .map(|s| {
            let part = |i| f64::from(i16::from_le_bytes([s[i], s[i + 1]]));
            part(0).hypot(part(2))
        })
        .collect();
    assert!(magnitude[..36].iter().all(|m| *m < 6.0 * std_noise));
    let peak = magnitude.iter().cloned().fold(0.0, f64::max);
    assert!(magnitude[40..44].contains(&peak) && peak > 20.0 * std_noise);
}
