//! What the factory wrote into the radio is used: crystal trim, transmit power, antenna delay.
#![allow(clippy::unwrap_used)]

use nova_hal_sim::chip::OtpConfig;
use nova_hal_sim::{BoardConfig, ClockConfig, Motion, SimConfig};
use nova_node::NodeConfig;
use nova_node::ranging::Address;
use nova_tests::{Network, anchor_polling};
use nova_wire::Range;

const DISTANCE_M: f64 = 6.0;

/// Ranges of an anchor to a tag, both boards as `board` makes them.
fn ranges(board: impl Fn(&str) -> BoardConfig) -> Vec<Range> {
    let mut network = Network::new(SimConfig::default());
    let at = |x: f64| Motion::fixed([x, 0.0, 0.0]);
    let a = BoardConfig {
        motion: at(0.0),
        ..board("anchor")
    };
    let b = BoardConfig {
        motion: at(DISTANCE_M),
        ..board("tag")
    };
    let a = network.add(a, anchor_polling(Address(2), 10_000)).unwrap();
    network.add(b, NodeConfig::tag(Address(2))).unwrap();
    network.run_until_s(0.5).unwrap();
    let ranges = network.log(a).unwrap().ranges.clone();
    assert!(ranges.len() > 40);
    ranges
}

fn mean(ranges: &[Range], of: impl Fn(&Range) -> f64) -> f64 {
    ranges.iter().map(of).sum::<f64>() / ranges.len() as f64
}

#[test]
fn the_antenna_delay_of_the_factory_makes_ranges_right() {
    let with = |total_ticks: u16| {
        ranges(|_| BoardConfig {
            tx_antenna_delay_ticks: 16_200.0,
            rx_antenna_delay_ticks: 16_200.0,
            otp: OtpConfig {
                antenna_delay_prf64: total_ticks,
                ..OtpConfig::default()
            },
            ..BoardConfig::default()
        })
    };
    let error = |ranges: &[Range]| mean(ranges, |r| f64::from(r.raw_m)) - DISTANCE_M;
    assert!(error(&with(32_400)).abs() < 0.005);
    // A total one tick longer on both boards: 4.7 mm less.
    assert!((error(&with(32_401)) + 2.0 * 0.5 * 0.004_690).abs() < 0.005);
    let apart_m = error(&with(32_400)) - error(&with(32_401));
    assert!((apart_m - 0.004_690).abs() < 0.001, "{apart_m}");
    // Never written: the uncalibrated figure, 256 ticks too long at four places, half of which counts.
    let uncalibrated = -2.0 * 256.0 * 0.004_690;
    assert!((error(&with(0)) - uncalibrated).abs() < 0.01);
    assert!((error(&with(0xFFFF)) - uncalibrated).abs() < 0.01);
}

#[test]
fn the_transmit_power_of_the_factory_is_used() {
    let level = |word: u32| {
        let mut tx_power = [0; 12];
        // Channel 5, 64 MHz.
        tx_power[9] = word;
        let ranges = ranges(|_| BoardConfig {
            otp: OtpConfig {
                tx_power,
                ..OtpConfig::default()
            },
            ..BoardConfig::default()
        });
        mean(&ranges, |r| f64::from(r.quality.unwrap().rx_power_dbm))
    };
    // Frames of 0.125 to 0.25 ms are sent with the third octet: one coarse step, 2.5 dB, less. Figures above -88 dBm show
    // 1 / 2.17 of that.
    let difference = level(0) - level(0x2565_6585);
    assert!((difference - 2.5 / 2.1667).abs() < 0.1, "{difference} dB");
}

#[test]
fn the_crystal_is_trimmed_as_the_factory_says() {
    let offset = |trim: u8| {
        let ranges = ranges(|name| BoardConfig {
            clock: ClockConfig {
                ppm: if name == "tag" { 6.0 } else { 0.0 },
                ..ClockConfig::default()
            },
            otp: OtpConfig {
                xtal_trim: if name == "tag" { trim } else { 0x10 },
                ..OtpConfig::default()
            },
            ..BoardConfig::default()
        });
        mean(&ranges, |r| f64::from(r.clock_offset_ppm))
    };
    // Four steps of 1.5 ppm, and a crystal that was never trimmed.
    assert!(offset(0x14).abs() < 0.1);
    assert!((offset(0) - 6.0).abs() < 0.1);
}
