//! Strong signals make ranges short and weak ones long: boards take that off what they report.
#![allow(clippy::unwrap_used)]

use nova_hal_sim::chip::MASK_POWER_DBM;
use nova_hal_sim::phy;
use nova_hal_sim::{BoardConfig, ChannelConfig, Motion, SimConfig};
use nova_node::NodeConfig;
use nova_node::ranging::phy::Channel;
use nova_node::ranging::{Address, PhyProfile};
use nova_tests::{BoardLog, Network};
use nova_wire::Range;

/// Mean of this over the ranges.
fn mean(ranges: &[Range], value: impl Fn(&Range) -> f32) -> f64 {
    let sum: f64 = ranges.iter().map(|range| f64::from(value(range))).sum();
    sum / ranges.len() as f64
}

/// What an anchor and a tag at this distance say in a second.
fn pair(phy: PhyProfile, distance_m: f64) -> [BoardLog; 2] {
    let mut network = Network::new(SimConfig::default());
    let board = |x_m| BoardConfig {
        motion: Motion::fixed([x_m, 0.0, 0.0]),
        ..BoardConfig::default()
    };
    let node = |node: NodeConfig| NodeConfig { phy, ..node };
    let anchor = network.add(board(0.0), node(NodeConfig::anchor(Address(1))));
    let tag = network.add(board(distance_m), node(NodeConfig::tag(Address(2))));
    let boards = [anchor.unwrap(), tag.unwrap()];
    network.run_until_s(1.5).unwrap();
    boards.map(|board| network.log(board).unwrap().clone())
}

/// From application note APS011 for 500 MHz and 900 MHz at PRF 64 MHz: level in dBm, bias in metres.
fn published_m(wide: bool, level_dbm: f64) -> f64 {
    let table_mm: [f64; 18] = if wide {
        [
            -294.0, -266.0, -234.0, -198.0, -150.0, -100.0, -58.0, 0.0, 48.0, 90.0, 126.0, 152.0,
            174.0, 196.0, 232.0, 244.0, 264.0, 284.0,
        ]
    } else {
        [
            -110.0, -105.0, -100.0, -93.0, -82.0, -69.0, -51.0, -27.0, 0.0, 21.0, 35.0, 42.0, 49.0,
            62.0, 71.0, 76.0, 81.0, 86.0,
        ]
    };
    let place = ((-61.0 - level_dbm) / 2.0).clamp(0.0, 17.0);
    let (low, high) = (place.floor() as usize, place.ceil() as usize);
    (table_mm[low] + (table_mm[high] - table_mm[low]) * place.fract()) * 1e-3
}

/// Smart power lets the frames of a pair, between 125 and 250 us long, be so much stronger (TX_POWER, user manual
/// table 20): 0x45 instead of 0x85 on channel 5, 0x71 instead of 0xD1 on channel 7.
fn boost_db(phy: &PhyProfile) -> f64 {
    match phy.channel {
        _ if phy == &PhyProfile::LONG_RANGE => 0.0,
        Channel::Ch7 => 7.5,
        _ => 5.0,
    }
}

#[test]
fn ranges_are_right_from_1_to_100_m_and_without_the_table_would_be_off_by_it() {
    let wide = PhyProfile {
        channel: Channel::Ch7,
        ..PhyProfile::DEFAULT
    };
    for (phy, channel, distances_m) in [
        (
            PhyProfile::DEFAULT,
            phy::Channel::Ch5,
            &[1.0, 2.0, 5.0, 10.0, 30.0][..],
        ),
        (wide, phy::Channel::Ch7, &[1.0, 2.0, 5.0, 10.0, 20.0]),
        (
            PhyProfile::LONG_RANGE,
            phy::Channel::Ch5,
            &[1.0, 3.0, 10.0, 30.0, 100.0],
        ),
    ] {
        for &distance_m in distances_m {
            let loss_db = ChannelConfig::default().path_loss_db(channel, distance_m);
            let level_dbm = MASK_POWER_DBM + boost_db(&phy) - loss_db;
            let expected_m = published_m(channel == phy::Channel::Ch7, level_dbm);
            for (log, side) in pair(phy, distance_m).iter().zip(["anchor", "tag"]) {
                assert!(
                    log.ranges.len() >= 8,
                    "{phy} {distance_m}: {:?}",
                    log.counters
                );
                let off_m = mean(&log.ranges, |r| r.raw_m) - distance_m;
                let stamps_off_m = mean(&log.ranges, |r| r.raw_m + r.bias_m) - distance_m;
                println!(
                    "{phy}, {distance_m:>5} m, {level_dbm:.1} dBm, {side}: {:+.1} mm; without the table {:+.1} mm",
                    off_m * 1e3,
                    stamps_off_m * 1e3
                );
                assert!(off_m.abs() < 0.004, "{phy} {distance_m} m: {off_m}");
                assert!(
                    (stamps_off_m - expected_m).abs() < 0.004,
                    "{phy} {distance_m} m: {stamps_off_m}, not {expected_m}"
                );
            }
        }
    }
}

#[test]
fn what_was_taken_off_follows_from_the_power_in_the_same_record() {
    let [log, _] = pair(PhyProfile::DEFAULT, 4.0);
    for range in &log.ranges {
        // The manual's figures read low above -88 dBm (section 4.7.2, figure 22).
        let reported_dbm = f64::from(range.quality.unwrap().rx_power_dbm);
        let level_dbm = reported_dbm + (reported_dbm + 88.0).max(0.0) * 1.1667;
        let expected_m = published_m(false, level_dbm);
        assert!(
            (f64::from(range.bias_m) - expected_m).abs() < 0.002,
            "{range:?}"
        );
    }
}
