//! Boards range among themselves, one board listens: its place comes out, with a sigma that is true.
//! `cargo test -p nova-tests --test listener_places -- --nocapture` prints what docs/survey-and-fusion.md shows.
#![allow(clippy::unwrap_used)]

use nalgebra::Vector3;
use nova_hal_sim::{BoardConfig, ChannelConfig, ClockConfig, LinkEffect, Motion, SimConfig};
use nova_node::ranging::{Address, PhyProfile};
use nova_node::{AntennaDelay, NodeConfig, Part};
use nova_solver::positioning::{
    HeardFrame, HeardIntervals, HeardMessage, ListenedAnchor, ListenedRound, ListenerTrack,
    ListenerTrackOptions, Listening, ListeningCounts, ListeningOptions, RangeDifference,
    SideIntervals, TdoaFix, TdoaOptions, locate_tdoa,
};
use nova_tests::Network;
use nova_wire::{Decoder, Event, Record};

/// Uniform numbers from 0 to 1, repeatable.
struct Lots(u64);

impl Lots {
    fn draw(&mut self) -> f64 {
        // Knuth's multiplier; the upper bits are good.
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.draw()
    }

    /// Nearly Gaussian: the sum of twelve.
    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.draw()).sum::<f64>() - 6.0
    }
}

/// A room of anchors, initiators first.
struct Room {
    network: Network,
    anchors: Vec<ListenedAnchor>,
    listener: usize,
}

/// What an anchor's antenna delay adds to its end of a difference, metres (one sigma).
const OFFSET_M: f64 = 0.1;
const TICKS_PER_M: f64 = 63_897_600_000.0 / 299_702_547.0;

impl Room {
    /// Six anchors in the corners of a room 9 x 7 x 3 m, of which so many initiate rounds with all others.
    fn new(lots: &mut Lots, initiators: usize, motion: Motion, channel: ChannelConfig) -> Self {
        let mut network = Network::new(SimConfig {
            seed: (lots.draw() * 1e9) as u64,
            channel,
        });
        let told = AntennaDelay::UNCALIBRATED;
        let board = |motion: Motion, lots: &mut Lots| {
            // Half of what both delays are off by enters a difference.
            let mut off =
                |told: u16| f64::from(told) + lots.normal() * OFFSET_M * 2f64.sqrt() * TICKS_PER_M;
            BoardConfig {
                motion,
                tx_antenna_delay_ticks: off(told.tx_ticks),
                rx_antenna_delay_ticks: off(told.rx_ticks),
                clock: ClockConfig {
                    offset_ticks: (lots.draw() * (1u64 << 40) as f64) as u64,
                    ppm: lots.between(-15.0, 15.0),
                    drift_ppm_per_s: lots.between(-0.02, 0.02),
                },
                ..BoardConfig::default()
            }
        };
        let mut anchors = Vec::new();
        for k in 0..6u16 {
            let corner = |bit: u16, size: f64| if k & bit == 0 { 0.0 } else { size };
            let place = [
                corner(1, 9.0) + lots.between(-0.5, 0.5),
                corner(2, 7.0) + lots.between(-0.5, 0.5),
                corner(4, 1.4)
                    + [0.4, 2.6, 2.4, 0.5, 1.3, 0.2][usize::from(k)]
                    + lots.between(-0.1, 0.1),
            ];
            let address = k + 1;
            let mut node = NodeConfig::tag(Address(address));
            if usize::from(k) < initiators {
                node = NodeConfig::anchor(Address(address));
                if let Part::Initiator {
                    peers,
                    per_round,
                    period_us,
                    ..
                } = &mut node.part
                {
                    for peer in initiators as u16 + 1..=6 {
                        peers.push(Address(peer)).unwrap();
                    }
                    *per_round = 6 - initiators as u8;
                    *period_us = 25_000;
                }
            }
            network
                .add(board(Motion::fixed(place), lots), node)
                .unwrap();
            anchors.push(ListenedAnchor {
                address,
                position_m: Vector3::from(place),
            });
        }
        let node = NodeConfig::listener(Address(0x33));
        let listener = network.add(board(motion, lots), node).unwrap();
        Self {
            network,
            anchors,
            listener,
        }
    }

    /// What the listener's host makes of it.
    fn heard(&self) -> (Vec<ListenedRound>, ListeningCounts) {
        let phy = PhyProfile::DEFAULT;
        let mut listening = Listening::new(&self.anchors, ListeningOptions::default());
        let (mut rounds, mut decoder) = (Vec::new(), Decoder::new());
        for &byte in &self.network.log(self.listener).unwrap().bytes {
            let Some(Event::Record { record, .. }) = decoder.push(byte) else {
                continue;
            };
            match record {
                Record::Overheard(frame) => {
                    let level_dbm = frame.quality.map_or(f32::NAN, |q| q.rx_power_dbm);
                    let heard = HeardFrame {
                        t_s: frame.t_us as f64 * 1e-6,
                        ticks: frame.at_ticks,
                        late_m: phy.range_bias_m(phy.prf.true_level_dbm(level_dbm)).into(),
                        source: frame.source,
                        destination: frame.destination,
                        message: match frame.message {
                            1 => HeardMessage::Poll,
                            2 => HeardMessage::Response,
                            3 => HeardMessage::Final,
                            _ => HeardMessage::Other,
                        },
                        round: frame.round,
                    };
                    listening.on_frame(&heard, |round| rounds.push(round));
                }
                Record::OverheardInterval(said) => {
                    let heard = HeardIntervals {
                        source: said.source,
                        peer: said.peer,
                        round: said.round,
                        intervals: SideIntervals {
                            round_ticks: said.round_ticks,
                            reply_ticks: said.reply_ticks,
                        },
                    };
                    listening.on_intervals(&heard, |round| rounds.push(round));
                }
                _ => {}
            }
        }
        listening.finish(|round| rounds.push(round));
        (rounds, *listening.counts())
    }
}

fn place(lots: &mut Lots) -> [f64; 3] {
    [
        lots.between(1.5, 7.5),
        lots.between(1.5, 5.5),
        lots.between(0.3, 2.2),
    ]
}

fn differences(rounds: &[ListenedRound]) -> Vec<RangeDifference> {
    (rounds.iter())
        .flat_map(|round| round.differences.iter().map(|one| one.difference))
        .collect()
}

fn locate(rounds: &[ListenedRound]) -> TdoaFix {
    let options = TdoaOptions {
        offset_sigma_m: OFFSET_M,
        ..TdoaOptions::default()
    };
    locate_tdoa(&differences(rounds), &options).unwrap()
}

/// NEES, squared error, trace of the covariance.
fn judged(
    place_m: Vector3<f64>,
    covariance: nalgebra::Matrix3<f64>,
    truth_m: Vector3<f64>,
) -> [f64; 3] {
    let error = place_m - truth_m;
    let nees = error.dot(&(covariance.try_inverse().unwrap() * error));
    [nees, error.norm_squared(), covariance.trace()]
}

fn print(what: &str, sums: [f64; 3], count: f64) -> f64 {
    let [nees, square, variance] = sums.map(|sum| sum / count);
    println!(
        "{what}: NEES {nees:.2} of 3, error {:.3} m, sigma {:.3} m",
        square.sqrt(),
        variance.sqrt()
    );
    nees
}

#[test]
fn a_listener_at_rest_is_placed_within_its_sigma_wherever_it_is() {
    let runs = 40;
    let (mut sums, mut outside) = ([0.0; 3], 0);
    for seed in 0..runs {
        let mut lots = Lots(2025 + seed);
        let truth = place(&mut lots);
        let mut room = Room::new(&mut lots, 1, Motion::fixed(truth), ChannelConfig::default());
        room.network.run_until_s(1.0).unwrap();
        let (rounds, counts) = room.heard();
        // Forty rounds of five responders, but for the first ones, in which they find each other.
        assert!(counts.differences > 150, "{counts:?}");
        let fix = locate(&rounds);
        let of = judged(fix.position_m, fix.covariance_m2, truth.into());
        (0..3).for_each(|i| sums[i] += of[i]);
        outside += u32::from(of[0] > 11.34);
    }
    let nees = print("at rest", sums, runs as f64);
    // 99 % of chi-square with 120 degrees of freedom, over 40. Below it is cautious by Student's tails, never by half.
    assert!((1.5..3.97).contains(&nees), "{nees}");
    // One in a hundred lies outside of 99 %.
    assert!(outside <= 2, "{outside}");
}

#[test]
fn two_initiators_that_take_turns_are_told_apart() {
    let mut lots = Lots(8001);
    let truth = place(&mut lots);
    let mut room = Room::new(&mut lots, 2, Motion::fixed(truth), ChannelConfig::default());
    room.network.run_until_s(2.0).unwrap();
    let (rounds, counts) = room.heard();
    for initiator in [1, 2] {
        let of = rounds.iter().flat_map(|round| &round.differences);
        let count = of.filter(|one| one.addresses[0] == initiator).count();
        assert!(count > 200, "{initiator}: {count}, {counts:?}");
    }
    let fix = locate(&rounds);
    let [nees, square, _] = judged(fix.position_m, fix.covariance_m2, truth.into());
    assert!(nees < 11.34 && square.sqrt() < 0.5, "{nees} {square}");
}

#[test]
fn blocked_paths_and_damaged_frames_do_not_take_the_place_with_them() {
    let runs = 20;
    let (mut sums, mut outliers, mut blocked_ones) = ([0.0; 3], 0, 0);
    for seed in 0..runs {
        let mut lots = Lots(2025 + seed);
        let truth = place(&mut lots);
        let channel = ChannelConfig {
            loss_probability: 0.05,
            corrupt_probability: 0.02,
            repeat_probability: 0.02,
            ..ChannelConfig::default()
        };
        let mut room = Room::new(&mut lots, 1, Motion::fixed(truth), channel);
        // The third anchor is behind somebody for the first third.
        let (anchor, listener) = (
            room.network.id(2).unwrap(),
            room.network.id(room.listener).unwrap(),
        );
        let blocked = LinkEffect {
            extra_delay_ps: 5000.0,
            loss_db: 5.0,
            first_path_loss_db: 6.0,
        };
        room.network
            .sim()
            .set_link_effect(anchor, listener, blocked);
        room.network.run_until_s(0.5).unwrap();
        room.network
            .sim()
            .set_link_effect(anchor, listener, LinkEffect::default());
        room.network.run_until_s(1.5).unwrap();
        let (rounds, counts) = room.heard();
        let lost = counts.no_poll + counts.no_final + counts.no_response + counts.no_report;
        assert!(counts.differences > 120 && lost > 20, "{counts:?}");
        let fix = locate(&rounds);
        outliers += fix.outliers;
        let all = rounds.iter().flat_map(|round| &round.differences);
        blocked_ones += all
            .filter(|one| one.t_s < 0.5 && one.addresses[1] == 3)
            .count();
        let of = judged(fix.position_m, fix.covariance_m2, truth.into());
        (0..3).for_each(|i| sums[i] += of[i]);
    }
    let nees = print("blocked and damaged", sums, runs as f64);
    println!("{outliers} outliers, {blocked_ones} blocked");
    // 99 % of chi-square with 60 degrees of freedom, over 20.
    assert!(nees < 4.42, "{nees}");
    assert!(blocked_ones > 4 * runs as usize, "{blocked_ones}");
    assert!(
        10 * outliers > 9 * blocked_ones,
        "{outliers} {blocked_ones}"
    );
}

#[test]
fn a_moving_listener_is_followed_within_its_sigma() {
    let runs = 20;
    let (mut sums, mut count) = ([0.0; 3], 0.0);
    for seed in 0..runs {
        let mut lots = Lots(2025 + seed);
        let [x, y, z] = place(&mut lots);
        let at = move |t_s: f64| {
            let a = 0.8 * t_s;
            [
                x + 1.2 * a.cos(),
                y + 1.2 * a.sin(),
                z + 0.2 * (0.7 * t_s).sin(),
            ]
        };
        let mut room = Room::new(&mut lots, 1, Motion::path(at), ChannelConfig::default());
        room.network.run_until_s(6.0).unwrap();
        let (rounds, _) = room.heard();
        let mut track = ListenerTrack::new(ListenerTrackOptions::default());
        for round in rounds {
            track.on_round(round);
            if let Some(state) = track.state().filter(|state| state.t_s > 2.0) {
                let truth = Vector3::from(at(state.t_s));
                let of = judged(state.position_m, state.covariance_m2, truth);
                (0..3).for_each(|i| sums[i] += of[i]);
                count += 1.0;
            }
        }
    }
    assert!(count > 100.0 * runs as f64, "{count}");
    let nees = print("moving", sums, count);
    // The offsets of a run hang together, so that it counts once: 99 % of chi-square with 60 degrees of freedom, over 20.
    assert!((1.0..4.42).contains(&nees), "{nees}");
}
