//! Initiators in one air, each a [`Superframe`]: who talks when, with frames that are lost
//! or collide.
#![allow(clippy::unwrap_used, clippy::panic)]

use nova_ranging::exchange::Identity;
use nova_ranging::frame::{Beacon, Grant, Poll};
use nova_ranging::superframe::{Random, Sharing, Superframe, Turn};
use nova_ranging::{Address, Frame, Message, PanId, PhyProfile, Ticks, Timetable, Timing};
use proptest::prelude::*;

const PAN: PanId = PanId(0xDECA);
/// A frame is on the air for so long; it is understood at its end.
const FRAME_US: u64 = 250;
/// From its start to its marker.
const MARKER_US: u64 = 140;

fn timing() -> Timing {
    Timing {
        reply_us: 600,
        slot_us: 600,
        profile: PhyProfile::DEFAULT,
        tx_antenna_delay: Ticks::new(16_456),
    }
}

fn superframe(address: u16, sharing: Sharing, slots: usize, period_us: u32) -> Superframe {
    let identity = Identity {
        pan: PAN,
        address: Address(address),
    };
    Superframe::new(identity, sharing, timing(), slots, period_us)
}

fn frame(source: u16, destination: Address, message: Message) -> Frame {
    Frame {
        sequence: 0,
        pan: PAN,
        destination,
        source: Address(source),
        round: 0,
        message,
    }
}

fn poll(slots: usize) -> Message {
    Message::Poll(Poll {
        reply_us: timing().reply_us,
        slot_us: timing().slot_us,
        slots: slots as u8,
        named: heapless::Vec::new(),
    })
}

fn round_us(slots: usize) -> u64 {
    Timetable::new(&timing(), slots).air_us(&timing()).into()
}

struct Node {
    address: u16,
    machine: Superframe,
    slots: usize,
    period_us: u64,
    wake_us: u64,
    due_us: u64,
    off_us: u64,
    /// Start and end of its rounds.
    rounds: Vec<(u64, u64)>,
    beacons: usize,
}

struct Sent {
    from: usize,
    start_us: u64,
    frame: Frame,
}

struct Cell {
    nodes: Vec<Node>,
    on_air: Vec<Sent>,
    loss: f64,
    random: Random,
}

impl Cell {
    fn new(loss: f64) -> Self {
        Self {
            nodes: Vec::new(),
            on_air: Vec::new(),
            loss,
            random: Random::new(Address(0x5EED)),
        }
    }

    fn add(&mut self, address: u16, sharing: Sharing, slots: usize, period_us: u32, on_us: u64) {
        self.nodes.push(Node {
            address,
            machine: superframe(address, sharing, slots, period_us),
            slots,
            period_us: period_us.into(),
            wake_us: on_us,
            due_us: on_us,
            off_us: u64::MAX,
            rounds: Vec::new(),
            beacons: 0,
        });
    }

    fn run(&mut self, end_us: u64) {
        loop {
            let arrival = self
                .on_air
                .iter()
                .map(|sent| sent.start_us + FRAME_US)
                .min();
            let wake = self.nodes.iter().map(|node| node.wake_us).min().unwrap();
            let now_us = arrival.unwrap_or(u64::MAX).min(wake);
            if now_us > end_us {
                return;
            }
            if arrival == Some(now_us) {
                self.deliver(now_us);
            } else {
                let index = self.nodes.iter().position(|n| n.wake_us == now_us).unwrap();
                self.turn(index, now_us);
            }
        }
    }

    fn turn(&mut self, index: usize, now_us: u64) {
        let node = &mut self.nodes[index];
        if now_us >= node.off_us {
            node.wake_us = u64::MAX;
            return;
        }
        let (destination, message) = match node.machine.turn(now_us, node.due_us) {
            Turn::Wait(until_us) => {
                assert!(until_us > now_us, "a wait of no time would never end");
                node.wake_us = until_us;
                return;
            }
            Turn::Talk { until_us } => {
                node.due_us = (node.due_us + node.period_us).max(now_us);
                let fits = until_us.is_none_or(|us| node.machine.fits(now_us, node.slots, us));
                let end_us = now_us + round_us(if fits { node.slots } else { 1 });
                assert!(until_us.is_none_or(|until_us| end_us <= until_us));
                node.rounds.push((now_us, end_us));
                node.wake_us = end_us;
                (Address::BROADCAST, poll(node.slots))
            }
            Turn::Beacon { beacon, .. } => {
                node.beacons += 1;
                node.wake_us = now_us + FRAME_US + 1;
                (Address::BROADCAST, Message::Beacon(beacon))
            }
            Turn::Join(coordinator) => {
                node.wake_us = now_us + FRAME_US + 1;
                (coordinator, node.machine.join())
            }
        };
        let frame = frame(node.address, destination, message);
        self.on_air.push(Sent {
            from: index,
            start_us: now_us,
            frame,
        });
    }

    fn deliver(&mut self, now_us: u64) {
        let index = (self.on_air.iter())
            .position(|sent| sent.start_us + FRAME_US == now_us)
            .unwrap();
        let sent = self.on_air.swap_remove(index);
        let at_us = sent.start_us + MARKER_US;
        // A frame that began meanwhile has destroyed this one, and will be heard by nobody.
        let collides = self.on_air.iter().any(|other| other.start_us < now_us);
        for index in 0..self.nodes.len() {
            if index == sent.from {
                self.nodes[index].machine.on_beacon_sent(at_us);
                continue;
            }
            let lost = f64::from(self.random.below(1 << 16)) < self.loss * 65_536.0;
            let node = &mut self.nodes[index];
            let deaf = node
                .rounds
                .last()
                .is_some_and(|&(from_us, to_us)| from_us <= now_us && sent.start_us < to_us);
            if collides {
                node.machine.on_noise(now_us);
            } else if !lost && !deaf {
                node.machine.on_frame(&sent.frame, at_us);
                node.wake_us = node.wake_us.min(now_us + 50);
            }
        }
        if collides {
            self.on_air.clear();
        }
    }

    /// Rounds of different nodes that overlap from `from_us` on, and all rounds from then.
    fn overlaps(&self, from_us: u64) -> (usize, usize) {
        let mut rounds: Vec<_> = (self.nodes.iter())
            .flat_map(|node| node.rounds.iter().copied())
            .filter(|round| round.0 >= from_us)
            .collect();
        rounds.sort_unstable();
        let overlapping = rounds.windows(2).filter(|pair| pair[0].1 > pair[1].0);
        (overlapping.count(), rounds.len())
    }

    fn rounds_between(&self, index: usize, from_us: u64, to_us: u64) -> usize {
        let rounds = &self.nodes[index].rounds;
        rounds
            .iter()
            .filter(|r| (from_us..to_us).contains(&r.0))
            .count()
    }
}

const S: u64 = 1_000_000;

#[test]
fn who_is_alone_talks_when_it_is_due_and_sends_no_beacons() {
    for sharing in [Sharing::Free, Sharing::Polite, Sharing::Elect] {
        let mut cell = Cell::new(0.0);
        cell.add(5, sharing, 1, 10_000, 0);
        cell.run(5 * S);
        assert!(cell.nodes[0].rounds.len().abs_diff(500) <= 1);
        assert_eq!(cell.nodes[0].beacons, 0);
    }
}

#[test]
fn ten_initiators_take_turns_at_their_period() {
    let mut cell = Cell::new(0.01);
    for k in 0..10u16 {
        cell.add(0x20 + k, Sharing::Elect, 1, 100_000, 37_000 * u64::from(k));
    }
    cell.run(30 * S);
    let (overlaps, rounds) = cell.overlaps(10 * S);
    assert_eq!(overlaps, 0, "of {rounds}");
    for index in 0..10 {
        let count = cell.rounds_between(index, 10 * S, 30 * S);
        assert!((198..=201).contains(&count), "{count} rounds of {index}");
    }
    let beacons: Vec<_> = cell.nodes.iter().map(|node| node.beacons > 150).collect();
    assert!(
        beacons[0] && !beacons[1..].contains(&true),
        "the lowest address coordinates"
    );
}

#[test]
fn who_wants_more_than_there_is_gets_a_fair_share() {
    let mut cell = Cell::new(0.01);
    for k in 0..6u16 {
        cell.add(0x20 + k, Sharing::Elect, 2, 10_000, 100 * u64::from(k));
    }
    cell.run(20 * S);
    assert_eq!(cell.overlaps(10 * S).0, 0);
    let counts: Vec<_> = (0..6)
        .map(|k| cell.rounds_between(k, 10 * S, 20 * S))
        .collect();
    let (least, most) = (counts.iter().min().unwrap(), counts.iter().max().unwrap());
    assert!(most - least <= most / 20 && *least > 150, "{counts:?}");
}

#[test]
fn who_is_slower_than_the_superframe_leaves_some_out() {
    let mut cell = Cell::new(0.0);
    cell.add(0x20, Sharing::Elect, 1, 50_000, 0);
    cell.add(0x21, Sharing::Elect, 1, 200_000, 1_000);
    cell.run(24 * S);
    let counts = [0, 1].map(|k| cell.rounds_between(k, 4 * S, 24 * S));
    assert!(counts[0].abs_diff(400) <= 4, "{counts:?}");
    assert!(counts[1].abs_diff(100) <= 2, "{counts:?}");
}

#[test]
fn a_late_joiner_has_its_slot_within_a_second() {
    let mut cell = Cell::new(0.01);
    cell.add(0x20, Sharing::Elect, 1, 100_000, 0);
    cell.add(0x21, Sharing::Elect, 1, 100_000, 3_000);
    cell.add(0x10, Sharing::Elect, 1, 100_000, 10 * S);
    cell.run(30 * S);
    assert!(cell.rounds_between(2, 11 * S, 30 * S) >= 185);
    assert_eq!(cell.overlaps(11 * S).0, 0);
    assert_eq!(
        cell.nodes[2].beacons, 0,
        "who finds a coordinator does not become one"
    );
}

#[test]
fn a_coordinator_that_goes_is_replaced() {
    let mut cell = Cell::new(0.0);
    for k in 0..4u16 {
        cell.add(0x20 + k, Sharing::Elect, 1, 50_000, 5_000 * u64::from(k));
    }
    cell.nodes[0].off_us = 10 * S;
    cell.run(30 * S);
    assert_eq!(cell.overlaps(20 * S).0, 0);
    for index in 1..4 {
        assert!(cell.rounds_between(index, 20 * S, 30 * S) >= 197);
    }
    assert!(cell.nodes[1].beacons > 100);
}

#[test]
fn of_two_coordinators_the_higher_address_gives_way() {
    let mut cell = Cell::new(0.0);
    cell.add(0x20, Sharing::Coordinate, 1, 50_000, 0);
    cell.add(0x21, Sharing::Coordinate, 1, 50_000, 20_000);
    cell.run(20 * S);
    assert!(cell.nodes[0].beacons > 390 && cell.nodes[1].beacons < 5);
    let count = cell.rounds_between(1, 2 * S, 20 * S);
    assert!(count >= 355, "{count}");
}

#[test]
fn a_round_of_another_network_is_waited_for() {
    let mut polite = superframe(0x20, Sharing::Polite, 1, 10_000);
    let mut stranger = frame(0x20, Address::BROADCAST, poll(4));
    stranger.pan = PanId(0x1234);
    polite.on_frame(&stranger, 1_000);
    let Turn::Wait(until_us) = polite.turn(1_100, 0) else {
        panic!("talks into another's round");
    };
    // Its end, time to take it in, and up to a millisecond.
    let end_us = 1_200 + u64::from(Timetable::new(&timing(), 4).end_us(&timing(), 4));
    assert!((end_us..=end_us + 1_000).contains(&until_us));
    assert_eq!(polite.turn(until_us, 0), Turn::Talk { until_us: None });
    // A node that does not listen does not care.
    let mut free = superframe(0x20, Sharing::Free, 1, 10_000);
    free.on_frame(&stranger, 1_000);
    assert_eq!(free.turn(1_100, 0), Turn::Talk { until_us: None });
}

#[test]
fn a_slot_that_another_network_uses_up_is_left_out_and_counted() {
    let mut member = superframe(0x20, Sharing::Elect, 1, 100_000);
    let grant = Grant {
        owner: Address(0x20),
        length_us: 5_000,
    };
    let beacon = Beacon {
        length_us: 100_000,
        join_us: 0,
        grants: [grant].into_iter().collect(),
    };
    member.on_frame(
        &frame(1, Address::BROADCAST, Message::Beacon(beacon)),
        10_000,
    );
    let Turn::Wait(slot_us) = member.turn(10_400, 0) else {
        panic!("the slot has not begun");
    };
    let mut stranger = frame(0x33, Address::BROADCAST, poll(4));
    stranger.pan = PanId(0x1234);
    member.on_frame(&stranger, slot_us - 10);
    let Turn::Wait(next_us) = member.turn(slot_us, 0) else {
        panic!("talks into another's round");
    };
    let Turn::Wait(again_us) = member.turn(next_us.min(slot_us + 4_000), 0) else {
        panic!("talks beyond its slot");
    };
    assert_eq!(again_us, slot_us + 100_000);
    assert_eq!(member.take_left_out().slots, 1);
    assert!(matches!(member.turn(again_us, 0), Turn::Talk { .. }));
}

#[test]
fn beacons_of_other_networks_and_impossible_ones_are_not_followed() {
    let beacon = |length_us, slot_us| {
        Message::Beacon(Beacon {
            length_us,
            join_us: 2_000,
            grants: [Grant {
                owner: Address(0x20),
                length_us: slot_us,
            }]
            .into_iter()
            .collect(),
        })
    };
    let mut elect = superframe(0x20, Sharing::Elect, 1, 10_000);
    let mut stranger = frame(1, Address::BROADCAST, beacon(50_000, 5_000));
    stranger.pan = PanId(0x1234);
    elect.on_frame(&stranger, 0);
    elect.on_frame(&frame(1, Address::BROADCAST, beacon(5_000, 5_000)), 0);
    elect.on_frame(&frame(1, Address::BROADCAST, beacon(0, 0)), 0);
    assert_eq!(elect.turn(500, 0), Turn::Talk { until_us: None });
}

proptest! {
    /// Whatever is heard and whenever the node is asked: no panic, no wait of no time,
    /// and a talk within a slot ends in it.
    #[test]
    fn any_frames_at_any_time_leave_it_sane(
        frames in prop::collection::vec((any_frame(), 0..2_000_000u64), 0..40),
        sharing in prop_oneof![
            Just(Sharing::Free), Just(Sharing::Polite), Just(Sharing::Elect), Just(Sharing::Coordinate)
        ],
        period_us in 1u32..=u32::MAX,
    ) {
        let mut node = superframe(0x20, sharing, 2, period_us);
        let (mut now_us, mut due_us) = (0u64, 0u64);
        for (frame, after_us) in frames {
            now_us += after_us;
            node.on_frame(&frame, now_us);
            for _ in 0..4 {
                match node.turn(now_us, due_us) {
                    Turn::Wait(until_us) => {
                        prop_assert!(until_us > now_us);
                        now_us = until_us.min(now_us + 100_000);
                    }
                    Turn::Talk { until_us } => {
                        let end_us = now_us + round_us(1);
                        prop_assert!(until_us.is_none_or(|until_us| end_us <= until_us));
                        now_us = end_us;
                        due_us = (due_us + u64::from(period_us)).max(now_us);
                    }
                    Turn::Beacon { .. } => node.on_beacon_sent(now_us + 200),
                    Turn::Join(_) => now_us += 300,
                }
            }
        }
    }
}

fn any_frame() -> impl Strategy<Value = Frame> {
    let grants = prop::collection::vec((0x1E..0x23u16, any::<u16>()), 0..24);
    let message = prop_oneof![
        (1..=8usize).prop_map(poll),
        (any::<u32>(), any::<u16>(), grants).prop_map(|(length_us, join_us, grants)| {
            Message::Beacon(Beacon {
                length_us,
                join_us,
                grants: grants
                    .into_iter()
                    .map(|(owner, length_us)| Grant {
                        owner: Address(owner),
                        length_us,
                    })
                    .collect(),
            })
        }),
        (any::<u16>(), any::<u32>())
            .prop_map(|(need_us, period_us)| Message::Join { need_us, period_us }),
        Just(Message::Response),
    ];
    let destination = prop_oneof![Just(Address(0x20)), Just(Address::BROADCAST)];
    (0x1E..0x23u16, destination, message, any::<bool>()).prop_map(
        |(source, destination, message, foreign)| {
            let mut frame = frame(source, destination, message);
            if foreign {
                frame.pan = PanId(0x1234);
            }
            frame
        },
    )
}
