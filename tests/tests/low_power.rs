//! A tag whose radio sleeps between rounds.
#![allow(clippy::unwrap_used)]

use nova_hal_sim::chip::Consumption;
use nova_hal_sim::{BoardConfig, Mishaps, Motion, SimConfig};
use nova_node::ranging::{Address, PhyProfile};
use nova_node::{NodeConfig, Part};
use nova_tests::{BoardLog, Network};
use nova_wire::{
    Change, Changes, Command, Encoder, MAX_FRAME_LEN, Outcome, Record, Refusal, Setting, Value,
};

const TAG: Address = Address(1);
const ANCHORS: [(Address, [f64; 3]); 3] = [
    (Address(10), [0.0, 0.0, 2.0]),
    (Address(11), [8.0, 0.0, 2.0]),
    (Address(12), [0.0, 9.0, 2.0]),
];
const PLACE: [f64; 3] = [3.0, 2.0, 1.0];
const NOISE_PS: f64 = 100.0;
/// Of a range: 0.7072 of a receive stamp's (docs/air-protocol.md).
const SIGMA_M: f64 = 299_702_547.0 * 1e-12 * NOISE_PS * 0.7072;

fn distance_m(to: u16) -> f64 {
    let (_, anchor) = ANCHORS.iter().find(|(address, _)| address.0 == to).unwrap();
    let squares = anchor.iter().zip(PLACE).map(|(a, b)| (a - b) * (a - b));
    squares.sum::<f64>().sqrt()
}

/// A network of a tag that sleeps and three anchors that answer.
fn network(tag: NodeConfig, mishaps: Mishaps) -> (Network, usize) {
    let mut network = Network::new(SimConfig {
        seed: 31,
        ..SimConfig::default()
    });
    let board = |place: [f64; 3]| BoardConfig {
        motion: Motion::fixed(place),
        rx_noise_ps: NOISE_PS,
        ..BoardConfig::default()
    };
    for (address, place) in ANCHORS {
        let phy = tag.phy;
        let node = NodeConfig {
            phy,
            ..NodeConfig::tag(address)
        };
        network.add(board(place), node).unwrap();
    }
    let tag_board = BoardConfig {
        mishaps,
        ..board(PLACE)
    };
    let tag = network.add(tag_board, tag).unwrap();
    (network, tag)
}

fn sleeper(every_us: u32, phy: PhyProfile) -> NodeConfig {
    let mut config = NodeConfig {
        phy,
        ..NodeConfig::sleeper(TAG)
    };
    if let Part::Initiator {
        period_us, peers, ..
    } = &mut config.part
    {
        *period_us = every_us;
        peers.extend(ANCHORS.iter().map(|&(address, _)| address));
    }
    config
}

fn run(tag: NodeConfig, seconds: f64) -> (BoardLog, Consumption) {
    let (mut network, tag) = network(tag, Mishaps::default());
    network.run_until_s(seconds).unwrap();
    let id = network.id(tag).unwrap();
    let drawn = network.sim().consumption(id).unwrap();
    (network.log(tag).unwrap().clone(), drawn)
}

#[test]
fn the_slower_a_tag_ranges_the_less_its_radio_draws_and_no_range_is_missing() {
    let mut before_ua = f64::INFINITY;
    for (every_us, rounds) in [
        (50_000, 600),
        (100_000, 300),
        (1_000_000, 30),
        (7_000_000, 5),
    ] {
        let (log, drawn) = run(sleeper(every_us, PhyProfile::DEFAULT), 30.0);
        let current_ua = drawn.charge_ua_s / 30.0;
        let asleep = drawn.asleep.as_s_f64() / 30.0;
        println!(
            "every {:>4} ms, three anchors: {} ranges, asleep {:.2} %, {current_ua:.0} uA, {:.0} uA s a round",
            every_us / 1_000,
            log.ranges.len(),
            100.0 * asleep,
            drawn.charge_ua_s / f64::from(rounds)
        );
        let expected = 3 * rounds as usize;
        assert!(
            (expected - 3..=expected).contains(&log.ranges.len()),
            "{:?}",
            log.counters
        );
        assert_eq!(log.counters.late_wakeups + log.counters.silences, 0);
        // Not even when nobody is heard for longer than an awake radio may be silent.
        assert_eq!(log.counters.radio_resets, 0);
        assert!(current_ua < before_ua);
        before_ua = current_ua;
    }
}

#[test]
fn awake_the_same_tag_draws_more_than_five_times_as_much() {
    let sleeping = sleeper(100_000, PhyProfile::DEFAULT);
    let mut awake = sleeping.clone();
    if let Part::Initiator { sleep, .. } = &mut awake.part {
        *sleep = false;
    }
    let [(slept, less), (idled, more)] = [sleeping, awake].map(|config| run(config, 10.0));
    println!(
        "{:.0} uA, {:.0} uA awake",
        less.charge_ua_s / 10.0,
        more.charge_ua_s / 10.0
    );
    assert_eq!(slept.ranges.len(), idled.ranges.len());
    assert!(more.charge_ua_s > 5.0 * less.charge_ua_s);
    assert_eq!(more.asleep.as_fs(), 0);
}

#[test]
fn in_every_mode_the_radio_comes_back_as_it_was() {
    for phy in [PhyProfile::LONG_RANGE]
        .into_iter()
        .chain(PhyProfile::all().step_by(11))
    {
        let (log, drawn) = run(sleeper(500_000, phy), 6.0);
        assert!(log.ranges.len() >= 30, "{phy}: {:?}", log.counters);
        assert_eq!(log.counters.radio_resets, 0, "{phy}");
        assert!(drawn.asleep.as_s_f64() > 3.0, "{phy}");
        for range in &log.ranges {
            let off_m = f64::from(range.raw_m) - distance_m(range.peer);
            assert!(off_m.abs() < 5.0 * SIGMA_M, "{phy}: {off_m} m");
            // Crystals without error: a trim that is lost would show as 24 ppm.
            assert!(range.clock_offset_ppm.abs() < 1.0, "{phy}: {range:?}");
        }
    }
}

#[test]
fn a_tag_that_knows_nobody_finds_its_anchors_and_sleeps_all_the_same() {
    let (log, drawn) = run(NodeConfig::sleeper(TAG), 20.0);
    for (anchor, _) in ANCHORS {
        let of_it = || log.ranges.iter().filter(|range| range.peer == anchor.0);
        let first_us = of_it().map(|range| range.t_us).min();
        println!("{anchor:?} found after {first_us:?} us");
        // Two unknown ones may collide in an open slot: 10 s are for that.
        let late = of_it().filter(|range| range.t_us > 10_000_000).count();
        assert!((95..=100).contains(&late), "{anchor:?}: {late} in 10 s");
    }
    assert!(drawn.asleep.as_s_f64() > 0.85 * 20.0);
}

#[test]
fn bit_errors_brown_outs_and_deaf_receivers_make_no_wrong_range_and_no_end() {
    let mishaps = Mishaps {
        spi_bit_error: 2e-6,
        brown_outs_per_s: 0.2,
        stuck_receivers_per_s: 0.1,
        ..Mishaps::default()
    };
    let (mut network, tag) = network(sleeper(50_000, PhyProfile::DEFAULT), mishaps);
    network.run_until_s(120.0).unwrap();
    network.sim().end_mishaps();
    network.run_until_s(150.0).unwrap();
    let log = network.log(tag).unwrap();
    println!("{} ranges, {:?}", log.ranges.len(), log.counters);
    assert!(log.counters.radio_resets > 10, "{:?}", log.counters);
    for range in &log.ranges {
        let off_m = f64::from(range.raw_m) - distance_m(range.peer);
        let trusted = range.flags.0 & 1 == 0
            && !matches!(
                range.treatment,
                nova_wire::Treatment::RejectedOutlier | nova_wire::Treatment::RejectedNlos
            );
        assert!(
            off_m.abs() < 5.0 * SIGMA_M || !trusted,
            "{range:?}: {off_m} m"
        );
    }
    // What went wrong in the end took at most two seconds to get over.
    let after = log.ranges.iter().filter(|range| range.t_us > 140_000_000);
    assert!(after.count() >= 3 * 195);
}

#[test]
fn a_host_sends_a_tag_to_sleep_but_not_one_that_has_to_listen() {
    let mut config = sleeper(100_000, PhyProfile::DEFAULT);
    if let Part::Initiator { sleep, .. } = &mut config.part {
        *sleep = false;
    }
    let (mut network, tag) = network(config, Mishaps::default());
    network.run_until_s(2.0).unwrap();
    let id = network.id(tag).unwrap();
    let mut host = Encoder::new();
    let mut set = |network: &mut Network, values: &[(Setting, u32)]| {
        let changes = values.iter().map(|&(setting, number)| Change {
            setting: setting.number(),
            value: Some(Value::Number(number)),
        });
        let changes: Changes = changes.collect();
        let mut buffer = [0; MAX_FRAME_LEN];
        let bytes = host.encode(&Command::Set(changes), &mut buffer).unwrap();
        network.sim().uart_send(id, bytes);
        let until_s = network.sim().now().as_s_f64() + 2.0;
        network.run_until_s(until_s).unwrap();
        let log = network.log(tag).unwrap();
        let answer = log.others.iter().rev().find_map(|record| match record {
            Record::Answer(answer) => Some(answer.outcome),
            _ => None,
        });
        answer.unwrap()
    };
    let refused = set(&mut network, &[(Setting::Sleep, 1), (Setting::Sharing, 2)]);
    let conflict = Refusal::Conflict {
        setting: Setting::Sleep.number(),
        with: Setting::Sharing.number(),
    };
    assert_eq!(refused, Outcome::Refused(conflict));
    assert_eq!(network.sim().consumption(id).unwrap().asleep.as_fs(), 0);
    assert_eq!(set(&mut network, &[(Setting::Sleep, 1)]), Outcome::Done);
    let asleep_s = network.sim().consumption(id).unwrap().asleep.as_s_f64();
    assert!(asleep_s > 1.6, "{asleep_s} of 2 s");
    // It is told to stay awake while it sleeps.
    assert_eq!(set(&mut network, &[(Setting::Sleep, 0)]), Outcome::Done);
    let now_s = network.sim().consumption(id).unwrap().asleep.as_s_f64();
    assert!(now_s - asleep_s < 0.1);
    let last_us = network.log(tag).unwrap().ranges.last().unwrap().t_us;
    assert!(last_us > 7_500_000);
}
