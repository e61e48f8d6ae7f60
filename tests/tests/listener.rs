//! What a listener tells its host is enough to find where everybody is.
#![allow(clippy::unwrap_used)]

use nova_hal_sim::{BoardConfig, ClockConfig, Motion, SimConfig};
use nova_node::ranging::Address;
use nova_node::{NodeConfig, Part};
use nova_tests::Network;
use nova_wire::Overheard;

const INITIATOR: [f64; 3] = [0.0, 0.0, 0.0];
const RESPONDER: [f64; 3] = [8.0, 0.0, 0.0];
const LISTENER: [f64; 3] = [3.0, 11.0, 1.0];
const TICKS_PER_M: f64 = 63_897_600_000.0 / 299_702_547.0;
const CLOCK: u64 = 1 << 40;

fn distance_m(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter()
        .zip(b)
        .map(|(a, b)| (a - b).powi(2))
        .sum::<f64>()
        .sqrt()
}

/// The listener's time between two frames, on its own clock.
fn between(a: &Overheard, b: &Overheard) -> f64 {
    (b.at_ticks.wrapping_sub(a.at_ticks) % CLOCK) as f64
}

/// Poll and final give the initiator's clock against the listener's. The response then
/// comes later than the poll by the way to the responder, its reply time, and the way to
/// the listener, less the poll's own way: a difference of distances.
#[test]
fn time_differences_of_arrival_are_those_of_the_places() {
    let mut network = Network::new(SimConfig::default());
    let board = |position, ppm| BoardConfig {
        motion: Motion::fixed(position),
        clock: ClockConfig {
            ppm,
            ..ClockConfig::default()
        },
        ..BoardConfig::default()
    };
    let mut anchor = NodeConfig::anchor(Address(0x0A));
    if let Part::Initiator { peers, .. } = &mut anchor.part {
        peers.push(Address(1)).unwrap();
    }
    network.add(board(INITIATOR, 12.0), anchor).unwrap();
    network
        .add(board(RESPONDER, -9.0), NodeConfig::tag(Address(1)))
        .unwrap();
    let listener = NodeConfig::listener(Address(0x33));
    let listener = network.add(board(LISTENER, 3.0), listener).unwrap();
    network.run_until_s(2.0).unwrap();

    let log = network.log(listener).unwrap();
    assert!(log.ranges.is_empty(), "a listener takes no part");
    let expected_m = distance_m(INITIATOR, RESPONDER) + distance_m(RESPONDER, LISTENER)
        - distance_m(INITIATOR, LISTENER);
    let mut rounds = 0;
    for frames in log.overheard.windows(4) {
        let [poll, response, last, report] = frames else {
            continue;
        };
        if [poll, response, last, report].map(|frame| frame.message) != [1, 2, 3, 4] {
            continue;
        }
        assert!(frames.iter().all(|frame| frame.round == poll.round));
        let of = |source: u16| {
            (log.intervals.iter())
                .find(|i| (i.source, i.round) == (source, poll.round))
                .unwrap()
        };
        let (initiator, responder) = (of(0x0A), of(1));
        let span = (initiator.round_ticks + initiator.reply_ticks) as f64;
        let rate = between(poll, last) / span;
        let responder_span = (responder.round_ticks + responder.reply_ticks) as f64;
        // The responder's clock in the listener's time.
        let reply = responder.reply_ticks as f64 / responder_span * span * rate;
        let difference_m = (between(poll, response) - reply) / TICKS_PER_M;
        assert!(
            (difference_m - expected_m).abs() < 0.02,
            "{difference_m} {expected_m}"
        );
        rounds += 1;
    }
    assert!(rounds > 180, "{rounds}");
}

/// Reports follow each other at once: a listener that made records meanwhile would miss every second one.
#[test]
fn a_listener_hears_every_report_and_tells_all_in_order() {
    for (responders, period_us) in [(2, 10_000), (3, 10_000), (5, 10_000), (8, 20_000)] {
        let mut network = Network::new(SimConfig::default());
        let board = |x: u16| BoardConfig {
            motion: Motion::fixed([f64::from(x), 2.0, 1.0]),
            ..BoardConfig::default()
        };
        let mut anchor = NodeConfig::anchor(Address(0x0A));
        if let Part::Initiator {
            peers,
            per_round,
            period_us: period,
            ..
        } = &mut anchor.part
        {
            peers.extend((1..=responders).map(Address));
            (*per_round, *period) = (responders as u8, period_us);
        }
        network.add(board(0), anchor).unwrap();
        for tag in 1..=responders {
            network
                .add(board(tag), NodeConfig::tag(Address(tag)))
                .unwrap();
        }
        let listener = NodeConfig::listener(Address(0x33));
        let listener = network.add(board(20), listener).unwrap();
        network.run_until_s(2.5).unwrap();

        let log = network.log(listener).unwrap();
        let heard = |message: u8| {
            (log.overheard.iter())
                .filter(|frame| frame.message == message)
                .count()
        };
        let [polls, responses, finals, reports] = [1, 2, 3, 4].map(heard);
        println!(
            "{responders}: {polls} polls, {responses} responses, {finals} finals, {reports} reports"
        );
        assert!(polls as u32 + 2 >= 2_500_000 / period_us, "{polls}");
        let all = usize::from(responders) * polls;
        assert!(100 * responses >= 98 * all && 100 * reports >= 98 * all);
        assert!(100 * finals >= 98 * polls);
        assert_eq!(log.counters.records_dropped, 0);
        let forward = |pair: &[Overheard]| between(&pair[0], &pair[1]) < (CLOCK / 2) as f64;
        assert!(log.overheard.windows(2).all(forward));
        // Of a final an interval for each responder, of a report one.
        let of_reports = log.intervals.iter().filter(|i| i.source != 0x0A).count();
        assert_eq!(of_reports, reports);
        let of_finals = log.intervals.len() - of_reports;
        assert!(100 * of_finals >= 98 * usize::from(responders) * finals);
    }
}
