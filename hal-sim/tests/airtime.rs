//! Frame durations against figures from outside.

#![allow(clippy::unwrap_used)] // in helpers of tests

use nova_hal_sim::airtime::{Airtime, data_bit_ticks, preamble_symbol_ticks};
use nova_hal_sim::phy::{Channel, DataRate, PhyConfig, PreambleLength, Prf, Sfd};
use nova_hal_sim::time::TICKS_PER_S;

fn phy(prf: Prf, symbols: u16, rate: DataRate, sfd: Sfd) -> PhyConfig {
    PhyConfig {
        channel: Channel::Ch5,
        prf,
        preamble_code: 9,
        preamble: PreambleLength::from_symbols(symbols).unwrap(),
        sfd,
        rate,
    }
}

fn ns(ticks: u64) -> f64 {
    ticks as f64 / TICKS_PER_S as f64 * 1e9
}

#[test]
fn symbols_last_what_ieee_802_15_4_says() {
    // Tables 99 and 101 of the 2011 edition.
    assert!((ns(preamble_symbol_ticks(Prf::Mhz16)) - 993.59).abs() < 0.01);
    assert!((ns(preamble_symbol_ticks(Prf::Mhz64)) - 1017.63).abs() < 0.01);
    assert!((ns(data_bit_ticks(DataRate::Kbps110)) - 8205.13).abs() < 0.01);
    assert!((ns(data_bit_ticks(DataRate::Kbps850)) - 1025.64).abs() < 0.01);
    assert!((ns(data_bit_ticks(DataRate::Kbps6800)) - 128.21).abs() < 0.01);
}

#[test]
fn twelve_bytes_at_full_rate_take_178_us() {
    let airtime = Airtime::of(&phy(Prf::Mhz64, 128, DataRate::Kbps6800, Sfd::Standard), 12);
    // 128 + 8 symbols, 21 bits at 850 kbit/s, 96 + 48 bits at 6.8 Mbit/s.
    let expected_us = 136.0 * 1.01763 + 21.0 * 1.02564 + 144.0 * 0.128205;
    assert!((airtime.total_s() * 1e6 - expected_us).abs() < 0.01);
    assert!((airtime.total_s() * 1e6 - 178.4).abs() < 0.1);
}

#[test]
fn slow_frames_have_a_64_symbol_sfd_and_a_slow_header() {
    let sfd = Sfd::Decawave { symbols: 8 };
    let airtime = Airtime::of(&phy(Prf::Mhz64, 1024, DataRate::Kbps110, sfd), 12);
    assert!((ns(airtime.sfd_ticks) - 64.0 * 1017.63).abs() < 1.0);
    assert!((ns(airtime.phr_ticks) - 21.0 * 8205.13).abs() < 1.0);
    // 1088 symbols, 21 + 144 bits of 8.2 us.
    assert!((airtime.total_s() * 1e6 - 2461.0).abs() < 1.0);
}

#[test]
fn every_started_block_of_330_bits_costs_48_parity_bits() {
    let bits = |bytes| {
        let phy = phy(Prf::Mhz64, 128, DataRate::Kbps6800, Sfd::Standard);
        Airtime::of(&phy, bytes).data_ticks / data_bit_ticks(DataRate::Kbps6800)
    };
    assert_eq!(bits(0), 0);
    assert_eq!(bits(41), 328 + 48);
    assert_eq!(bits(42), 336 + 96);
    assert_eq!(bits(127), 1016 + 4 * 48);
}

/// User Manual 7.2.31.2 lists the longest frames that get each boost of smart power; an SFD of 16 symbols at PRF 64 MHz
/// gives exactly these.
#[test]
fn longest_boosted_frames_are_those_of_the_manual() {
    let us = |symbols, sfd_symbols, bytes| {
        let sfd = Sfd::User {
            symbols: sfd_symbols,
        };
        let phy = phy(Prf::Mhz64, symbols, DataRate::Kbps6800, sfd);
        Airtime::of(&phy, bytes).total_s() * 1e6
    };
    for (limit_us, symbols, sfd_symbols, longest) in [
        (125.0, 64, 16, 15),
        (125.0, 64, 12, 19),
        (125.0, 64, 8, 23),
        (250.0, 64, 16, 123),
        (250.0, 128, 16, 67),
        (500.0, 64, 16, 333),
        (500.0, 128, 16, 281),
        (500.0, 256, 16, 166),
    ] {
        assert!(us(symbols, sfd_symbols, longest) < limit_us);
        assert!(us(symbols, sfd_symbols, longest + 1) >= limit_us);
    }
}

#[test]
fn longest_sfd_at_850_kbit_has_16_symbols() {
    let sfd = Sfd::Decawave { symbols: 16 };
    let airtime = Airtime::of(&phy(Prf::Mhz16, 256, DataRate::Kbps850, sfd), 20);
    assert_eq!(airtime.sfd_ticks, 16 * preamble_symbol_ticks(Prf::Mhz16));
}
