//! What boards report beside the range: how well they heard each other.
#![allow(clippy::unwrap_used)]

use nova_hal_sim::{LinkEffect, SimConfig};
use nova_node::NodeConfig;
use nova_node::ranging::Address;
use nova_tests::{BoardLog, Network, board_at};

/// What both boards of a pair, 5 m apart, say in 2 s.
fn pair(ppm: [f64; 2], link: LinkEffect) -> [BoardLog; 2] {
    let mut network = Network::new(SimConfig {
        seed: 4,
        ..SimConfig::default()
    });
    let [ppm_a, ppm_b] = ppm;
    let a = network.add(
        board_at("anchor", 0.0, ppm_a),
        NodeConfig::anchor(Address(1)),
    );
    let b = network.add(board_at("tag", 5.0, ppm_b), NodeConfig::tag(Address(2)));
    let (a, b) = (a.unwrap(), b.unwrap());
    let ids = [a, b].map(|board| network.id(board).unwrap());
    network.sim().set_link_effect(ids[0], ids[1], link);
    network.run_until_s(2.0).unwrap();
    [a, b].map(|board| {
        let log = network.log(board).unwrap().clone();
        assert!(log.ranges.len() > 100, "{:?}", log.counters);
        log
    })
}

#[test]
fn the_carrier_tells_the_same_clock_offset_as_the_time_stamps_on_both_sides() {
    for ppm in [[20.0, -20.0], [-20.0, 20.0], [3.0, 2.5]] {
        for log in pair(ppm, LinkEffect::default()) {
            for range in &log.ranges {
                let carrier = range.quality.unwrap().carrier_offset_ppm;
                let off = (carrier - range.clock_offset_ppm).abs();
                // A stamp's tick in the round of a millisecond is 0.015 ppm.
                assert!(off < 0.02, "{ppm:?}: {carrier} {}", range.clock_offset_ppm);
            }
        }
    }
}

#[test]
fn a_blocked_first_path_shows_in_its_power_and_in_how_late_the_peak_comes() {
    let blocked = LinkEffect {
        first_path_loss_db: 12.0,
        ..LinkEffect::default()
    };
    let [free, free_tag] = pair([1.0, -1.0], LinkEffect::default());
    let [behind, behind_tag] = pair([1.0, -1.0], blocked);
    for (free, behind) in [(free, behind), (free_tag, behind_tag)] {
        for range in &free.ranges {
            let q = range.quality.unwrap();
            assert!(
                (q.rx_power_dbm - q.first_path_power_dbm).abs() < 0.2,
                "{q:?}"
            );
            assert!((0.0..2.0).contains(&q.peak_delay_ns), "{q:?}");
            assert!(
                q.noise > 0 && (64..=128).contains(&q.preamble_count),
                "{q:?}"
            );
        }
        for range in &behind.ranges {
            let q = range.quality.unwrap();
            let weaker_db = q.rx_power_dbm - q.first_path_power_dbm;
            // Figures above -88 dBm grow by 1 / 2.17 of what the power does (user manual, section 4.7.2, figure 22).
            assert!((weaker_db - 12.0 / 2.1667).abs() < 0.2, "{q:?}");
            assert!(q.peak_delay_ns > 4.0, "{q:?}");
        }
    }
}
