//! How often nodes range, with SPI at 8 MHz and the processor's time charged as on the board
//! (`nova_node::cost`, docs/air-time.md).
#![allow(clippy::unwrap_used)]

use nova_hal_sim::SimConfig;
use nova_node::NodeConfig;
use nova_node::ranging::Address;
use nova_node::ranging::phy::{Bitrate, PhyProfile, Preamble};
use nova_tests::{BoardLog, Network, anchor_polling, board_at};

const SECONDS: f64 = 4.0;
/// The radios start, and the first status comes.
const SETTLING_S: f64 = 0.1;
const DISTANCE_M: f64 = 7.0;

/// An initiator that polls one responder every `period_us`; what it says, and both counters.
fn pair(phy: PhyProfile, period_us: u32) -> (BoardLog, BoardLog) {
    pair_for(SECONDS, phy, period_us)
}

fn pair_for(seconds: f64, phy: PhyProfile, period_us: u32) -> (BoardLog, BoardLog) {
    let mut network = Network::new(SimConfig {
        seed: 5,
        ..SimConfig::default()
    });
    let anchor = NodeConfig {
        phy,
        ..anchor_polling(Address(2), period_us)
    };
    let tag = NodeConfig {
        phy,
        ..NodeConfig::tag(Address(2))
    };
    let a = network.add(board_at("anchor", 0.0, 12.0), anchor).unwrap();
    let b = network.add(board_at("tag", DISTANCE_M, -9.0), tag).unwrap();
    network.run_until_s(SETTLING_S + seconds).unwrap();
    (
        network.log(a).unwrap().clone(),
        network.log(b).unwrap().clone(),
    )
}

/// Ranges a second once both run.
fn rate(log: &BoardLog) -> f64 {
    let from = (SETTLING_S * 1e6) as u64;
    log.ranges.iter().filter(|r| r.t_us >= from).count() as f64 / SECONDS
}

fn worst_error_m(log: &BoardLog) -> f64 {
    let errors = log
        .ranges
        .iter()
        .map(|r| (f64::from(r.raw_m) - DISTANCE_M).abs());
    errors.fold(0.0, f64::max)
}

#[test]
fn one_pair_ranges_400_times_a_second() {
    let (anchor, tag) = pair(PhyProfile::DEFAULT, 2_500);
    let rate = rate(&anchor);
    println!("asked for 400 a second: {rate:.1}");
    assert!(rate >= 396.0, "{rate} a second");
    assert!(worst_error_m(&anchor) < 0.005);
    for counters in [anchor.counters, tag.counters] {
        assert_eq!(counters.send_too_late, 0);
        assert_eq!(counters.radio_resets, 0);
        assert_eq!(counters.records_dropped, 0);
    }
}

/// The floor below which a change has made ranging too slow.
#[test]
fn one_pair_that_does_not_pause_ranges_more_than_300_times_a_second() {
    let (anchor, tag) = pair(PhyProfile::DEFAULT, 1);
    let rate = rate(&anchor);
    println!("without pause: {rate:.1} a second");
    assert!(rate >= 300.0, "{rate} a second");
    assert_eq!(anchor.counters.no_response + tag.counters.no_final, 0);
}

/// A status record, and a look whether the radio is still set up: nowhere but behind a frame whose answer takes
/// its time do they cost nothing.
#[test]
fn what_is_due_once_a_second_costs_no_range() {
    for period_us in [1, 2_500, 3_001, 9_973] {
        let (anchor, tag) = pair_for(60.0, PhyProfile::DEFAULT, period_us);
        for c in [anchor.counters, tag.counters] {
            let failed = [c.send_too_late, c.no_response, c.no_final, c.no_report];
            assert_eq!(failed, [0; 4], "every {period_us} us");
        }
        assert!(anchor.counters.ranges > 5_000);
    }
}

#[test]
fn every_mode_of_the_radio_ranges() {
    for phy in PhyProfile::all() {
        // Without its pauses: the slowest mode takes 50 ms an exchange.
        let (anchor, tag) = pair(phy, 200_000);
        let rate = rate(&anchor);
        assert!((4.5..5.5).contains(&rate), "{phy}: {rate} a second");
        // At 6.8 Mbit/s and with 64 symbols frames are shorter or longer than 125 us, and smart power sends the shorter
        // ones stronger: a node that corrects by what it received does not know at which level the other did.
        let limit_m = if (phy.bitrate, phy.preamble) == (Bitrate::Kbps6800, Preamble::Symbols64) {
            0.025
        } else {
            0.005
        };
        assert!(
            worst_error_m(&anchor) < limit_m,
            "{phy}: {} m",
            worst_error_m(&anchor)
        );
        assert_eq!(tag.counters.no_final, 0, "{phy}");
        for counters in [anchor.counters, tag.counters] {
            assert_eq!(counters.radio_resets, 0, "{phy}");
        }
    }
}
