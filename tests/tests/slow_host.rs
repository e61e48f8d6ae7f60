//! A host that reads too slowly, or not at all for a while.
#![allow(clippy::unwrap_used)]

use nova_hal_sim::{BoardConfig, Motion, SimConfig, SimDuration};
use nova_node::NodeConfig;
use nova_node::ranging::Address;
use nova_tests::Network;

const STALL_FROM_S: f64 = 2.0;
const STALL_S: f64 = 2.0;

/// Of two seconds without a read the board keeps what fits into its 4 kB: the ranges of the last third of a second
/// and more.
#[test]
fn after_a_stall_the_host_gets_the_newest_records_and_the_board_says_how_many_are_missing() {
    let mut network = Network::new(SimConfig::default());
    let board = |x: f64| BoardConfig {
        motion: Motion::fixed([x, 0.0, 0.0]),
        ..BoardConfig::default()
    };
    let a = network
        .add(board(0.0), NodeConfig::anchor(Address(1)))
        .unwrap();
    network
        .add(board(5.0), NodeConfig::tag(Address(2)))
        .unwrap();
    network.run_until_s(STALL_FROM_S).unwrap();
    let id = network.id(a).unwrap();
    let until = network.sim().now() + SimDuration::from_s_f64(STALL_S);
    network.sim().stall_uart(id, until);
    network.run_until_s(STALL_FROM_S + STALL_S + 2.0).unwrap();

    let log = network.log(a).unwrap();
    let times_s: Vec<f64> = log.ranges.iter().map(|r| r.t_us as f64 * 1e-6).collect();
    assert!(times_s.is_sorted(), "records out of order");
    let between = |from: f64, to: f64| times_s.iter().filter(|&&t| (from..to).contains(&t)).count();
    let end_s = STALL_FROM_S + STALL_S;
    // All of before, once the tag was found; the last of the stall without a gap; and all of after.
    let before = between(STALL_FROM_S - 1.0, STALL_FROM_S - 0.1);
    assert!(
        (89..=91).contains(&before),
        "{before}, from {:.2} s on",
        times_s[0]
    );
    assert_eq!(between(STALL_FROM_S + 0.1, end_s - 1.0), 0);
    let newest = between(end_s - 0.3, end_s);
    assert!((29..=31).contains(&newest), "{newest}");
    let after = between(end_s, end_s + 1.9);
    assert!((189..=191).contains(&after), "{after}");
    let counters = log.counters;
    assert!(counters.records_dropped > 100, "{counters:?}");
    assert_eq!(log.wire.lost, u64::from(counters.records_dropped));
    assert_eq!(log.wire.corrupt, 0);
    // Ranging itself has not noticed.
    assert_eq!(counters.no_response + counters.no_report, 0);
}
