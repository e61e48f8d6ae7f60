//! Differences of distances from what a listener hears, on made rounds.

#![allow(clippy::unwrap_used)] // the helpers below are tests as well

use nalgebra::{Matrix3, Vector3};
use nova_solver::positioning::{
    DifferenceFilter, DifferenceFilterOptions, HeardExchange, HeardFrame, HeardIntervals,
    HeardMessage, ListenedAnchor, ListenedDifference, ListenedRound, Listening, ListeningOptions,
    METRES_PER_TICK, RangeDifference, SideIntervals, TdoaOptions, locate_round,
};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

const TICKS_PER_S: f64 = 63_897_600_000.0;
const CLOCK: u64 = 1 << 40;

/// A crystal: ticks at a true time.
#[derive(Clone, Copy, Debug)]
struct Clock {
    start: u64,
    ppm: f64,
}

impl Clock {
    fn at(self, t_s: f64, noise_ticks: f64) -> u64 {
        let ticks = t_s * TICKS_PER_S * (1.0 + self.ppm * 1e-6) + noise_ticks;
        (self.start + ticks.round() as u64) % CLOCK
    }
}

fn interval(from: u64, to: u64) -> u64 {
    to.wrapping_sub(from) % CLOCK
}

/// What a listener's board says, in order.
#[derive(Clone, Copy, Debug)]
enum Said {
    Frame(HeardFrame),
    Intervals(HeardIntervals),
}

/// Anchors, the first of which initiates, and who listens.
#[derive(Clone, Debug)]
struct Scene {
    anchors_m: Vec<Vector3<f64>>,
    clocks: Vec<Clock>,
    tag_m: Vector3<f64>,
    tag_clock: Clock,
    stamp_noise_ticks: f64,
}

impl Scene {
    fn listening(&self) -> Listening {
        let anchors: Vec<_> = (1..)
            .zip(&self.anchors_m)
            .map(|(address, &position_m)| ListenedAnchor {
                address,
                position_m,
            })
            .collect();
        Listening::new(&anchors, ListeningOptions::default())
    }

    fn truth_m(&self, addresses: [u16; 2]) -> f64 {
        let [a, b] = addresses.map(|n| (self.tag_m - self.anchors_m[usize::from(n) - 1]).norm());
        b - a
    }

    /// One round from `t_s` on: replies after `reply_s`, slots of `slot_s`.
    fn round(
        &self,
        t_s: f64,
        number: u8,
        reply_s: f64,
        slot_s: f64,
        rng: &mut ChaCha8Rng,
    ) -> Vec<Said> {
        let flight =
            |a: &Vector3<f64>, b: &Vector3<f64>| (a - b).norm() / (METRES_PER_TICK * TICKS_PER_S);
        let mut noise = || {
            let noise: f64 = StandardNormal.sample(rng);
            self.stamp_noise_ticks * noise
        };
        let heard = |message, source: usize, destination: u16, sent_s: f64, noise: f64| {
            let at_s = sent_s + flight(&self.anchors_m[source], &self.tag_m);
            Said::Frame(HeardFrame {
                t_s: at_s,
                ticks: self.tag_clock.at(at_s, noise),
                late_m: 0.0,
                source: source as u16 + 1,
                destination,
                message,
                round: number,
            })
        };
        let (initiator, clock) = (&self.anchors_m[0], self.clocks[0]);
        let mut said = vec![heard(HeardMessage::Poll, 0, 0xFFFF, t_s, noise())];
        let last_s = t_s + 2.0 * reply_s + slot_s * self.anchors_m.len() as f64;
        let mut reports = Vec::new();
        let mut halves = Vec::new();
        for k in 1..self.anchors_m.len() {
            let way_s = flight(initiator, &self.anchors_m[k]);
            let own = self.clocks[k];
            let poll = own.at(t_s + way_s, noise());
            let response_s = t_s + way_s + reply_s + slot_s * (k - 1) as f64;
            let response = own.at(response_s, 0.0);
            said.push(heard(HeardMessage::Response, k, 1, response_s, noise()));
            let answered = clock.at(response_s + way_s, noise());
            let intervals = |source, peer, round_ticks, reply_ticks| {
                Said::Intervals(HeardIntervals {
                    source,
                    peer,
                    round: number,
                    intervals: SideIntervals {
                        round_ticks,
                        reply_ticks,
                    },
                })
            };
            let address = k as u16 + 1;
            halves.push(intervals(
                1,
                address,
                interval(clock.at(t_s, 0.0), answered),
                interval(answered, clock.at(last_s, 0.0)),
            ));
            let last = own.at(last_s + way_s, noise());
            let report_s = last_s + reply_s + slot_s * k as f64;
            reports.push(heard(HeardMessage::Other, k, 1, report_s, 0.0));
            reports.push(intervals(
                address,
                1,
                interval(response, last),
                interval(poll, response),
            ));
        }
        said.push(heard(HeardMessage::Final, 0, 0xFFFF, last_s, noise()));
        said.extend(halves);
        said.extend(reports);
        said
    }
}

fn tell(listening: &mut Listening, said: &[Said]) -> Vec<ListenedDifference> {
    let mut found = Vec::new();
    let mut take = |round: ListenedRound| found.extend(round.differences);
    for said in said {
        match said {
            Said::Frame(frame) => listening.on_frame(frame, &mut take),
            Said::Intervals(heard) => listening.on_intervals(heard, &mut take),
        }
    }
    found
}

fn clock() -> impl Strategy<Value = Clock> {
    (0..CLOCK, -20.0..20.0f64).prop_map(|(start, ppm)| Clock { start, ppm })
}

fn place() -> impl Strategy<Value = Vector3<f64>> {
    prop::array::uniform3(-50.0..50.0f64).prop_map(Vector3::from)
}

fn scene() -> impl Strategy<Value = Scene> {
    (
        prop::collection::vec((place(), clock()), 2..=9),
        place(),
        clock(),
    )
        .prop_map(|(anchors, tag_m, tag_clock)| Scene {
            anchors_m: anchors.iter().map(|(place, _)| *place).collect(),
            clocks: anchors.iter().map(|(_, clock)| *clock).collect(),
            tag_m,
            tag_clock,
            stamp_noise_ticks: 0.0,
        })
}

fn rng(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

/// Six stamps are rounded by half a tick each, and enter with weights that add up to 3 at most; the initiator's crystal
/// stretches differences of up to 174 m by 20 ppm.
const EXACT_M: f64 = 1.5 * METRES_PER_TICK + 174.0 * 20e-6;

/// A scene whose crystals and places do not matter.
fn plain() -> Scene {
    let clock = |start, ppm| Clock { start, ppm };
    Scene {
        anchors_m: vec![
            Vector3::new(0.0, 0.0, 2.0),
            Vector3::new(8.0, 0.0, 2.5),
            Vector3::new(8.0, 7.0, 2.0),
            Vector3::new(0.0, 7.0, 0.5),
        ],
        clocks: vec![
            clock(CLOCK - 1000, 12.0),
            clock(77, -9.0),
            clock(CLOCK / 2, 3.0),
            clock(5, -18.0),
        ],
        tag_m: Vector3::new(3.0, 2.0, 1.0),
        tag_clock: clock(CLOCK - 30_000_000, 17.0),
        stamp_noise_ticks: 0.0,
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 128, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn differences_are_exact_for_any_places_and_crystals_to_the_tick(
        scene in scene(), reply_s in 100e-6..3e-3f64, slot_s in 100e-6..2e-3f64, t_s in 0.0..20.0f64, number in any::<u8>(),
    ) {
        let mut listening = scene.listening();
        let found = tell(&mut listening, &scene.round(t_s, number, reply_s, slot_s, &mut rng(0)));
        prop_assert_eq!(found.len(), scene.anchors_m.len() - 1);
        for one in found {
            let error = one.difference.difference_m - scene.truth_m(one.addresses);
            prop_assert!(error.abs() < EXACT_M, "{} m", error);
        }
    }

    #[test]
    fn whatever_is_lost_or_comes_twice_what_is_left_is_right_and_the_rest_is_counted(
        seed in any::<u64>(), loss in 0.0..0.6f64, twice in 0.0..0.3f64,
    ) {
        let scene = plain();
        let mut rng = rng(seed);
        let mut listening = scene.listening();
        let mut found = Vec::new();
        let mut given = 0u64;
        for number in 0..40u8 {
            let mut said = Vec::new();
            for one in scene.round(0.05 * f64::from(number), number, 500e-6, 600e-6, &mut rng) {
                if rng.random::<f64>() >= loss {
                    said.push(one);
                    if rng.random::<f64>() < twice {
                        said.push(one);
                    }
                }
            }
            given += 3;
            found.extend(tell(&mut listening, &said));
        }
        listening.finish(|round| found.extend(round.differences));
        for one in &found {
            let error = one.difference.difference_m - scene.truth_m(one.addresses);
            prop_assert!(error.abs() < EXACT_M, "{} m", error);
        }
        let counts = listening.counts();
        prop_assert_eq!(counts.differences, found.len() as u64);
        let rejected: u64 = counts.rejections().iter().map(|(_, count)| count).sum();
        if loss > 0.05 {
            prop_assert!(counts.differences < given);
            prop_assert!(rejected > 0);
        }
        // Nothing that is sound is called impossible.
        prop_assert_eq!(counts.bad_stamps + counts.impossible + counts.other_distance + counts.cut_off, 0);
    }

    #[test]
    fn wild_input_gives_no_panic_and_no_difference_that_cannot_be(
        said in prop::collection::vec((0u8..6, 0u16..6, 0u16..6, 0u8..3, any::<[u64; 2]>(), any::<f64>(), 0u8..4), 0..300),
    ) {
        let scene = plain();
        let mut listening = scene.listening();
        let mut found = Vec::new();
        for (kind, source, peer, round, [a, b], odd, small) in said {
            // Half of the numbers such as intervals have, so that some get far.
            let ticks = |v: u64| if small < 2 { v % 100_000_000 } else { v };
            let frame = |message| HeardFrame {
                t_s: odd, ticks: ticks(a), late_m: if small == 3 { odd } else { 0.0 }, source, destination: peer, message, round,
            };
            let mut take = |round: ListenedRound| found.extend(round.differences);
            match kind {
                0 => listening.on_frame(&frame(HeardMessage::Poll), &mut take),
                1 => listening.on_frame(&frame(HeardMessage::Response), &mut take),
                2 => listening.on_frame(&frame(HeardMessage::Final), &mut take),
                3 => listening.on_frame(&frame(HeardMessage::Other), &mut take),
                _ => listening.on_intervals(&HeardIntervals {
                    source, peer, round, intervals: SideIntervals { round_ticks: ticks(a), reply_ticks: ticks(b) },
                }, &mut take),
            }
        }
        listening.finish(|round| found.extend(round.differences));
        for one in found {
            let [a, b] = one.difference.anchors_m;
            prop_assert!(one.difference.difference_m.abs() <= (b - a).norm() + 1.0);
            prop_assert!(one.difference.sigma_m > 0.0 && one.difference.sigma_m.is_finite());
        }
    }

    #[test]
    fn one_wild_stamp_or_interval_is_counted_and_gives_nothing_wrong_by_metres(
        which in 0usize..4, stamp in 0..CLOCK, other in 0..CLOCK,
    ) {
        let scene = plain();
        let mut listening = scene.listening();
        let mut said = scene.round(1.0, 9, 500e-6, 600e-6, &mut rng(1));
        let mut seen = 0;
        for one in &mut said {
            match one {
                Said::Frame(frame) if frame.message == HeardMessage::Response && which < 2 => {
                    frame.ticks = stamp;
                    seen += 1;
                }
                Said::Intervals(heard) if heard.source != 1 && which >= 2 => {
                    heard.intervals = SideIntervals { round_ticks: stamp, reply_ticks: other };
                    seen += 1;
                }
                _ => {}
            }
        }
        prop_assert_eq!(seen, 3);
        let found = tell(&mut listening, &said);
        let c = listening.counts();
        prop_assert_eq!(c.bad_stamps + c.other_distance + c.impossible + c.differences, 3);
        for one in found {
            let [a, b] = one.difference.anchors_m;
            prop_assert!(one.difference.difference_m.abs() <= (b - a).norm() + 1.0);
        }
    }
}

#[test]
fn sigma_and_what_a_round_shares_are_those_of_the_stamps_noise() {
    let mut scene = plain();
    let stamp_m = 0.03;
    scene.stamp_noise_ticks = stamp_m / METRES_PER_TICK;
    let mut rng = rng(2025);
    let mut listening = scene.listening();
    let (mut squares, mut product, mut given) = ([0.0; 3], 0.0, [0.0; 3]);
    let mut shared = 0.0;
    let rounds = 4000;
    for k in 0..rounds {
        let said = scene.round(0.004 * f64::from(k), k as u8, 500e-6, 600e-6, &mut rng);
        let found = tell(&mut listening, &said);
        assert_eq!(found.len(), 3);
        let errors: Vec<f64> = (found.iter())
            .map(|one| one.difference.difference_m - scene.truth_m(one.addresses))
            .collect();
        for (i, one) in found.iter().enumerate() {
            squares[i] += errors[i] * errors[i] / f64::from(rounds);
            given[i] = one.difference.sigma_m;
        }
        product += errors[0] * errors[2] / f64::from(rounds);
        let [a, b] = [found[0].shared_m, found[2].shared_m];
        shared = a[0] * b[0] + a[1] * b[1];
    }
    for (square, sigma) in squares.iter().zip(given) {
        assert!(
            (square.sqrt() / sigma - 1.0).abs() < 0.05,
            "{square} {sigma}"
        );
        assert!((1.2..1.6).contains(&(sigma / stamp_m)), "{sigma}");
    }
    assert!((product / shared - 1.0).abs() < 0.15, "{product} {shared}");
}

#[test]
fn interleaved_initiators_are_told_apart() {
    let scene = plain();
    let mut other = plain();
    other.anchors_m.rotate_left(1);
    other.clocks.rotate_left(1);
    let mut rng = rng(3);
    let one = scene.round(0.1, 7, 500e-6, 600e-6, &mut rng);
    // Addresses 11 to 14, the same number of the round.
    let two: Vec<Said> = (other.round(0.1001, 7, 500e-6, 600e-6, &mut rng).into_iter())
        .map(|said| match said {
            Said::Frame(frame) => Said::Frame(HeardFrame {
                source: frame.source + 10,
                destination: frame.destination.saturating_add(10),
                ..frame
            }),
            Said::Intervals(heard) => Said::Intervals(HeardIntervals {
                source: heard.source + 10,
                peer: heard.peer + 10,
                ..heard
            }),
        })
        .collect();
    let anchors: Vec<_> = (scene.anchors_m.iter().enumerate())
        .map(|(k, &position_m)| (k as u16 + 1, position_m))
        .chain((other.anchors_m.iter().enumerate()).map(|(k, &p)| (k as u16 + 11, p)))
        .map(|(address, position_m)| ListenedAnchor {
            address,
            position_m,
        })
        .collect();
    let mut listening = Listening::new(&anchors, ListeningOptions::default());
    let mixed: Vec<Said> = one.iter().zip(&two).flat_map(|(a, b)| [*a, *b]).collect();
    let found = tell(&mut listening, &mixed);
    assert_eq!(found.len(), 6);
    for one in found {
        let truth = if one.addresses[0] == 1 {
            scene.truth_m(one.addresses)
        } else {
            other.truth_m(one.addresses.map(|address| address - 10))
        };
        assert!((one.difference.difference_m - truth).abs() < EXACT_M);
    }
}

#[test]
fn anchors_that_are_not_where_the_file_says_are_refused_by_their_own_distance() {
    let scene = plain();
    let mut wrong = scene.clone();
    wrong.anchors_m[2].x += 4.0;
    let mut listening = wrong.listening();
    let found = tell(
        &mut listening,
        &scene.round(0.0, 0, 500e-6, 600e-6, &mut rng(4)),
    );
    assert_eq!(found.len(), 2);
    assert_eq!(listening.counts().other_distance, 1);
}

#[test]
fn late_stamps_are_put_right_where_the_level_is_known() {
    let scene = plain();
    let said: Vec<Said> = (scene.round(0.0, 0, 500e-6, 600e-6, &mut rng(5)).into_iter())
        .map(|said| match said {
            Said::Frame(mut frame) => {
                // Strong ones are early, weak ones late.
                frame.late_m = [-0.1, 0.05, 0.08, 0.02][usize::from(frame.source) - 1];
                let late = (frame.late_m / METRES_PER_TICK).round() as i64;
                frame.ticks = frame.ticks.wrapping_add_signed(late) % CLOCK;
                Said::Frame(frame)
            }
            other => other,
        })
        .collect();
    let mut listening = scene.listening();
    let found = tell(&mut listening, &said);
    assert_eq!(found.len(), 3);
    for one in found {
        let error = one.difference.difference_m - scene.truth_m(one.addresses);
        assert!(error.abs() < EXACT_M + METRES_PER_TICK, "{error}");
    }
}

#[test]
fn a_listener_that_starts_anew_mixes_nothing() {
    let scene = plain();
    let said = scene.round(0.0, 0, 500e-6, 600e-6, &mut rng(6));
    let mut listening = scene.listening();
    assert!(tell(&mut listening, &said[..3]).is_empty());
    listening.restart();
    assert!(tell(&mut listening, &said[3..]).is_empty());
    assert_eq!(listening.counts().cut_off, 1);
    assert!(listening.counts().no_poll > 0);
}

#[test]
fn intervals_beyond_the_clock_are_no_intervals() {
    let sound = SideIntervals {
        round_ticks: 40_000_000,
        reply_ticks: 40_000_000,
    };
    let heard = HeardExchange {
        heard_ticks: [0, 40_000_000, 80_000_000],
        initiator: sound,
        responder: sound,
    };
    assert!(heard.difference().unwrap().difference_m.abs() < 1e-9);
    for spoilt in [
        HeardExchange {
            heard_ticks: [0, 0, 80_000_000],
            ..heard
        },
        HeardExchange {
            heard_ticks: [0, CLOCK, 80_000_000],
            ..heard
        },
        HeardExchange {
            heard_ticks: [0, 90_000_000, 80_000_000],
            ..heard
        },
        HeardExchange {
            responder: SideIntervals {
                round_ticks: CLOCK + 40_000_000,
                ..sound
            },
            ..heard
        },
        HeardExchange {
            responder: SideIntervals {
                round_ticks: 40_100_000,
                ..sound
            },
            ..heard
        },
    ] {
        assert!(spoilt.difference().is_err(), "{spoilt:?}");
    }
}

/// Four anchors in a room, each off by a few centimetres, and who flies among them.
struct Room {
    anchors_m: Vec<Vector3<f64>>,
    offsets_m: Vec<f64>,
}

impl Room {
    fn new(rng: &mut ChaCha8Rng, anchors: usize, offset_sigma_m: f64) -> Self {
        let mut normal = |sigma: f64| {
            let n: f64 = StandardNormal.sample(rng);
            sigma * n
        };
        Self {
            anchors_m: (0..anchors)
                .map(|k| {
                    let side = |bit: usize| if k & bit == 0 { -1.0 } else { 1.0 };
                    let z = 1.6 + 1.3 * side(1) * side(2) * side(4);
                    Vector3::new(6.0 * side(1), 5.0 * side(2), z)
                        + Vector3::new(normal(0.3), normal(0.3), normal(0.1))
                })
                .collect(),
            offsets_m: (0..anchors).map(|_| normal(offset_sigma_m)).collect(),
        }
    }

    /// A round: the first anchor and each of the others, with noise that they share.
    fn round(&self, t_s: f64, tag_m: Vector3<f64>, rng: &mut ChaCha8Rng) -> ListenedRound {
        let mut normal = || -> f64 { StandardNormal.sample(rng) };
        let s = 0.03;
        let shared = [normal(), normal()].map(|n| n * 0.5 * s);
        let range = |k: usize| (tag_m - self.anchors_m[k]).norm() + self.offsets_m[k];
        ListenedRound {
            differences: (1..self.anchors_m.len())
                .map(|k| {
                    let own = s * 1.17;
                    ListenedDifference {
                        t_s,
                        addresses: [1, k as u16 + 1],
                        difference: RangeDifference {
                            anchors_m: [self.anchors_m[0], self.anchors_m[k]],
                            difference_m: range(k) - range(0)
                                + own * normal()
                                + shared[0]
                                + shared[1],
                            sigma_m: (own * own + 0.5 * s * s).sqrt(),
                        },
                        shared_m: [0.5 * s; 2],
                    }
                })
                .collect(),
        }
    }
}

fn flown(t_s: f64) -> Vector3<f64> {
    Vector3::new(
        2.5 * (0.5 * t_s).cos(),
        2.0 * (0.5 * t_s).sin(),
        1.5 + 0.3 * (0.3 * t_s).sin(),
    )
}

/// NEES over 20 s at 20 rounds a second, error and sigma at the end (m), part of all differences set aside.
fn followed(seed: u64, offset_sigma_m: f64, wild: f64, blocked_s: f64) -> ([f64; 3], f64) {
    let mut rng = rng(seed);
    let room = Room::new(&mut rng, 5, offset_sigma_m);
    let start = Vector3::new(0.3, -0.2, 0.2);
    let mut filter = DifferenceFilter::new(
        DifferenceFilterOptions::default(),
        0.0,
        flown(0.0) + start,
        &(Matrix3::identity() * 0.09),
        1.5,
    );
    let (mut sum, mut squares, mut aside, mut count) = (0.0, [0.0; 2], 0, 0.0);
    for k in 1..400 {
        let t_s = 0.05 * f64::from(k);
        let mut round = room.round(t_s, flown(t_s), &mut rng);
        for one in &mut round.differences {
            if rng.random::<f64>() < wild {
                one.difference.difference_m += rng.random_range(-10.0..10.0);
            }
            // One anchor's path is blocked for a while: longer, never shorter.
            if one.addresses[1] == 3 && (6.0..6.0 + blocked_s).contains(&t_s) {
                one.difference.difference_m += 1.5;
            }
        }
        aside += filter.update(&round).set_aside;
        let state = filter.state();
        let error = state.position_m - flown(t_s);
        if t_s > 5.0 {
            sum += error.dot(&(state.covariance_m2.try_inverse().unwrap() * error));
            squares[0] += error.norm_squared();
            squares[1] += state.covariance_m2.trace();
            count += 1.0;
        }
    }
    let [error, sigma] = squares.map(|s| (s / count).sqrt());
    (
        [sum / count, error, sigma],
        f64::from(aside as u32) / (399.0 * 4.0),
    )
}

#[test]
fn a_moving_listener_is_followed_within_its_sigma() {
    let mut sums = [0.0; 3];
    let runs = 60;
    for seed in 0..runs {
        let (of, _) = followed(2025 + seed, 0.1, 0.0, 0.0);
        (0..3).for_each(|i| sums[i] += of[i] / runs as f64);
    }
    let [nees, error, sigma] = sums;
    println!("moving: NEES {nees:.2} of 3, error {error:.3} m, sigma {sigma:.3} m");
    // A run's errors hang together by its anchors' offsets: some 60 independent values of chi-square with 3.
    assert!((1.5..4.5).contains(&nees), "{nees}");
    assert!(
        sigma < 2.0 * error && error < 2.0 * sigma,
        "{error} {sigma}"
    );
}

#[test]
fn wild_and_blocked_differences_are_set_aside_and_hardly_move_the_track() {
    let (mut clean, mut spoilt, mut aside) = (0.0, 0.0, 0.0);
    for seed in 0..20 {
        clean += followed(2025 + seed, 0.05, 0.0, 0.0).0[1] / 20.0;
        let (of, part) = followed(2025 + seed, 0.05, 0.1, 3.0);
        spoilt += of[1] / 20.0;
        aside += part / 20.0;
    }
    println!("moving, spoilt: error {spoilt:.3} m beside {clean:.3}, {aside:.3} set aside");
    assert!(aside > 0.08 && aside < 0.25, "{aside}");
    assert!(spoilt < 1.5 * clean + 0.02, "{spoilt} {clean}");
}

#[test]
fn a_place_from_one_round_is_within_its_sigma() {
    let (mut nees, mut misfit, mut count) = (0.0, 0.0, 0.0);
    for seed in 0..300 {
        let mut rng = rng(2025 + seed);
        let room = Room::new(&mut rng, 6, 0.05);
        let tag = flown(rng.random_range(0.0..12.0));
        let options = TdoaOptions {
            offset_sigma_m: 0.05,
            heights_m: Some([0.0, 3.0]),
            ..TdoaOptions::default()
        };
        let fix = locate_round(&room.round(0.0, tag, &mut rng), &options).unwrap();
        let error = fix.position_m - tag;
        nees += error.dot(&(fix.covariance_m2.try_inverse().unwrap() * error));
        misfit += fix.misfit;
        count += 1.0;
    }
    println!(
        "one round: NEES {:.2} of 3, misfit {:.2} of 2",
        nees / count,
        misfit / count
    );
    // Chi-square with 900 and 600 degrees of freedom: 99.9 % within some 16 %.
    assert!((2.5..3.5).contains(&(nees / count)), "{nees}");
    assert!((1.65..2.35).contains(&(misfit / count)), "{misfit}");
}

#[test]
fn one_round_of_four_anchors_in_a_plane_tells_that_two_places_fit_and_heights_decide() {
    for seed in 0..200 {
        let mut rng = rng(seed);
        let mut room = Room::new(&mut rng, 4, 0.0);
        room.anchors_m.iter_mut().for_each(|a| a.z = 2.5);
        let tag = flown(rng.random_range(0.0..12.0)) - Vector3::new(0.0, 0.0, 0.4);
        let mut exact = room.round(0.0, tag, &mut rng);
        for one in &mut exact.differences {
            let [a, b] = one.difference.anchors_m;
            one.difference.difference_m = (tag - b).norm() - (tag - a).norm();
        }
        let fix = locate_round(&exact, &TdoaOptions::default()).unwrap();
        let other = fix.alternative_m.unwrap();
        let off = (fix.position_m - tag).norm().min((other - tag).norm());
        assert!(off < 1e-3, "{seed}: {off}");
        let apart = (other - fix.position_m).norm_squared();
        assert!(fix.covariance_m2.trace() > apart);
        let below = TdoaOptions {
            heights_m: Some([0.0, 2.45]),
            ..TdoaOptions::default()
        };
        let fix = locate_round(&exact, &below).unwrap();
        assert!((fix.position_m - tag).norm() < 1e-3 && fix.alternative_m.is_none());
    }
}

#[test]
fn a_filter_that_is_wrong_by_metres_comes_back() {
    let mut rng = rng(7);
    let room = Room::new(&mut rng, 5, 0.0);
    let wrong = flown(0.0) + Vector3::new(4.0, -3.0, 0.5);
    let certain = Matrix3::identity() * 1e-4;
    let options = DifferenceFilterOptions::default();
    let mut filter = DifferenceFilter::new(options, 0.0, wrong, &certain, 0.1);
    for k in 1..200 {
        let t_s = 0.05 * f64::from(k);
        filter.update(&room.round(t_s, flown(t_s), &mut rng));
    }
    let error = (filter.state().position_m - flown(199.0 * 0.05)).norm();
    assert!(error < 0.3, "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn the_filter_stays_finite_and_positive_whatever_it_is_told(
        told in prop::collection::vec((0.0..10.0f64, prop::array::uniform6(-20.0..20.0f64), -40.0..40.0f64, any::<f64>(), 0u8..12, any::<[u16; 2]>()), 0..80),
    ) {
        let mut filter = DifferenceFilter::new(
            DifferenceFilterOptions::default(), 0.0, Vector3::zeros(), &Matrix3::identity(), 1.0,
        );
        for (t_s, places, difference_m, odd, kind, addresses) in told {
            let [a, b] = [Vector3::new(places[0], places[1], places[2]), Vector3::new(places[3], places[4], places[5])];
            let one = ListenedDifference {
                t_s: if kind == 0 { odd } else { t_s },
                addresses: addresses.map(|address| if kind < 9 { address % 8 } else { address }),
                difference: RangeDifference {
                    anchors_m: [a, if kind == 1 { a } else { b }],
                    difference_m: if kind == 2 { odd } else { difference_m },
                    sigma_m: if kind == 3 { odd } else { 0.05 },
                },
                shared_m: if kind == 4 { [odd; 2] } else { [0.01; 2] },
            };
            let judged = filter.update(&ListenedRound { differences: vec![one, one] });
            prop_assert_eq!(judged.used + judged.set_aside + judged.refused, 2);
            let state = filter.state();
            prop_assert!(state.position_m.iter().chain(state.velocity.iter()).all(|v| v.is_finite()));
            prop_assert!(state.covariance_m2.symmetric_eigenvalues().min() >= -1e-9);
        }
    }
}
