//! The state machines against each other, through a perfect radio whose frames a test can
//! lose, repeat or invent; and one at a time, event by event.
#![allow(clippy::unwrap_used, clippy::panic, clippy::expect_used)]

mod air;

use air::{ANTENNA_DELAY, Air, Clock, PAN, identity, timing};
use nova_ranging::frame::{Answered, Final, FrameBuffer, Poll};
use nova_ranging::time::{DELAYED_GRID, MODULUS, TICKS_PER_SECOND};
use nova_ranging::{
    Address, Command, DeviceTime, Event, Failure, Frame, Ignored, Initiator, MAX_RESPONDERS,
    Measurement, Message, Outcome, PanId, Responder, Step, Ticks, Timing, When,
};
use proptest::prelude::*;

const A: Address = Address(0x000A);
const B: Address = Address(0x000B);
const TRUE_CLOCK: Clock = Clock { start: 0, ppm: 0.0 };
const US: u64 = TICKS_PER_SECOND / 1_000_000;

fn at(ticks: u64) -> DeviceTime {
    DeviceTime::from_ticks(ticks)
}

fn at_us(us: u32) -> DeviceTime {
    at(Ticks::from_us(us).get())
}

fn frame(source: Address, destination: Address, round: u8, message: Message) -> FrameBuffer {
    Frame {
        sequence: 1,
        pan: PAN,
        destination,
        source,
        round,
        message,
    }
    .encode()
}

fn poll_of(named: &[Address], slots: u8) -> Message {
    Message::Poll(Poll {
        reply_us: timing().reply_us,
        slot_us: timing().slot_us,
        slots,
        named: named.iter().copied().collect(),
    })
}

fn measured(outcomes: &[Outcome]) -> Vec<Measurement> {
    outcomes
        .iter()
        .filter_map(|outcome| match outcome {
            Outcome::Measured(measurement) => Some(*measurement),
            _ => None,
        })
        .collect()
}

fn failures(outcomes: &[Outcome]) -> Vec<(Address, Failure)> {
    outcomes
        .iter()
        .filter_map(|outcome| match outcome {
            Outcome::Failed { peer, why } => Some((*peer, *why)),
            _ => None,
        })
        .collect()
}

/// An initiator at 0 and responders at 1000, 2000 ... ticks of flight.
fn cell(responders: usize) -> (Air, Vec<Address>) {
    let mut air = Air::new();
    air.initiator(A, TRUE_CLOCK, 0.0);
    let addresses: Vec<_> = (1..=responders as u16)
        .map(|k| Address(0x100 + k))
        .collect();
    for (k, &address) in addresses.iter().enumerate() {
        let clock = Clock {
            start: 77_777 * k as u64,
            ppm: 15.0 - 5.0 * k as f64,
        };
        air.responder(address, clock, 1_000.0 * (k + 1) as f64);
    }
    (air, addresses)
}

#[test]
fn both_sides_measure_the_same_range() {
    let (mut air, responders) = cell(1);
    let said = air.round(0.0, &responders, 0);
    let [at_a, at_b] = [measured(&said[0])[0], measured(&said[1])[0]];
    assert_eq!(at_a.two_way, at_b.two_way);
    assert_eq!((at_a.peer, at_b.peer), (responders[0], A));
    assert!((at_a.two_way.time_of_flight_ticks - 1_000.0).abs() < 1.1);
    assert!((at_a.two_way.clock_offset_ppm - 15.0).abs() < 0.1);
}

#[test]
fn a_round_measures_all_eight_with_two_frames_each_and_two_more() {
    let (mut air, responders) = cell(MAX_RESPONDERS);
    let said = air.round(0.0, &responders, 0);
    assert_eq!(air.frames, 2 * MAX_RESPONDERS + 2);
    let ranges = measured(&said[0]);
    assert_eq!(ranges.len(), MAX_RESPONDERS);
    for (k, range) in ranges.iter().enumerate() {
        assert_eq!((range.peer, usize::from(range.slot)), (responders[k], k));
        let expected = 1_000.0 * (k + 1) as f64;
        assert!((range.two_way.time_of_flight_ticks - expected).abs() < 1.1);
        assert_eq!(measured(&said[k + 1])[0].two_way, range.two_way);
    }
    assert!(air.all_idle());
}

#[test]
fn who_does_not_answer_costs_the_others_nothing() {
    // Frame 3 is the second response.
    let (mut air, responders) = cell(4);
    air.fate = Box::new(|frame, _, to| {
        if (frame, to) == (3, 0) {
            vec![]
        } else {
            vec![0.0]
        }
    });
    let said = air.round(0.0, &responders, 0);
    let peers: Vec<_> = measured(&said[0]).iter().map(|m| m.peer).collect();
    assert_eq!(peers, [responders[0], responders[2], responders[3]]);
    assert_eq!(failures(&said[0]), [(responders[1], Failure::NoResponse)]);
    // It hears that its response was not heard, and takes nobody else's interval.
    assert_eq!(failures(&said[2]), [(A, Failure::NotHeard)]);
    assert!(air.all_idle());
}

#[test]
fn every_single_loss_has_its_cause() {
    // Poll 1, responses 2 and 3, final 4, reports 5 and 6.
    let cases: [(usize, usize, &[Failure], &[Failure]); 6] = [
        (1, 1, &[Failure::NoResponse], &[]),
        (2, 0, &[Failure::NoResponse], &[Failure::NotHeard]),
        (4, 1, &[Failure::NoReport], &[Failure::NoFinal]),
        (5, 0, &[Failure::NoReport], &[]),
        (3, 1, &[], &[]),
        (5, 2, &[], &[]),
    ];
    for (lost, receiver, at_initiator, at_first) in cases {
        let (mut air, responders) = cell(2);
        air.fate = Box::new(move |frame, _, to| {
            if (frame, to) == (lost, receiver) {
                vec![]
            } else {
                vec![0.0]
            }
        });
        let said = air.round(0.0, &responders, 0);
        let causes = |outcomes: &[Outcome]| -> Vec<_> {
            failures(outcomes).into_iter().map(|(_, why)| why).collect()
        };
        assert_eq!(causes(&said[0]), at_initiator, "frame {lost} lost");
        assert_eq!(causes(&said[1]), at_first, "frame {lost} lost");
        assert_eq!(measured(&said[0]).len(), 2 - at_initiator.len());
        assert!(measured(&said[2]).len() == 1 && air.all_idle());
    }
}

#[test]
fn a_round_that_nobody_answers_ends_after_its_time_and_leaves_nobody_waiting() {
    let (mut air, responders) = cell(2);
    air.fate = Box::new(|_, _, to| if to == 0 { vec![] } else { vec![0.0] });
    let said = air.round(0.0, &responders, 0);
    assert_eq!(
        failures(&said[0]),
        [
            (responders[0], Failure::NoResponse),
            (responders[1], Failure::NoResponse)
        ]
    );
    assert_eq!(failures(&said[1]), [(A, Failure::NoFinal)]);
    assert!(air.all_idle());
    air.fate = Box::new(|_, _, _| vec![0.0]);
    let said = air.round(1e9, &responders, 0);
    assert_eq!(measured(&said[0]).len(), 2);
}

#[test]
fn newcomers_are_found_in_open_slots_and_measured_in_the_same_round() {
    let (mut air, responders) = cell(3);
    let mut found = Vec::new();
    for k in 0..200u32 {
        let said = air.round(f64::from(k) * 1e8, &found, 2);
        for measurement in measured(&said[0]) {
            if !found.contains(&measurement.peer) {
                found.push(measurement.peer);
            }
            let k = responders
                .iter()
                .position(|&r| r == measurement.peer)
                .unwrap();
            let expected = 1_000.0 * (k + 1) as f64;
            assert!((measurement.two_way.time_of_flight_ticks - expected).abs() < 1.1);
        }
        assert!(air.all_idle());
    }
    assert_eq!(found.len(), 3);
}

#[test]
fn a_node_that_is_known_leaves_open_slots_to_others_for_a_second() {
    let mut responder = Responder::new(identity(B), timing());
    responder.start();
    let mut answers = |source: Address, named: &[Address], ms: u64, round: u8| {
        let poll = frame(source, Address::BROADCAST, round, poll_of(named, 4));
        let step = responder.on_event(Event::Received {
            bytes: &poll,
            at: at(TICKS_PER_SECOND / 1000 * ms),
        });
        let answers = matches!(step.command, Command::Send { .. });
        if answers {
            // Back to listening.
            responder.on_event(Event::SendTooLate);
        } else {
            assert_eq!(step.outcome, Some(Outcome::Ignored(Ignored::LeftToOthers)));
        }
        answers
    };
    assert!(answers(A, &[B], 0, 0));
    let mut count = |who, from_ms: u64, to_ms| {
        (from_ms..to_ms)
            .step_by(10)
            .filter(|&ms| answers(who, &[], ms, ms as u8 / 2))
            .count()
    };
    assert_eq!(count(A, 10, 990), 0);
    // Somebody else's searches are another matter, then and later.
    assert!(count(Address(0x77), 10, 990) > 5);
    assert!(count(A, 1_010, 2_000) > 5);
}

#[test]
fn of_two_newcomers_in_one_slot_the_one_not_heard_takes_no_range() {
    let mut responder = Responder::new(identity(B), timing());
    responder.start();
    // Named, for the slot; the final then is for somebody else.
    let poll = frame(A, Address::BROADCAST, 1, poll_of(&[B], 1));
    let step = responder.on_event(Event::Received {
        bytes: &poll,
        at: at(0),
    });
    let (_, when) = transmission(step);
    let sent = sent(when);
    responder.on_event(sent);
    let last = Message::Final(Final {
        span: Ticks::from_us(1_240),
        answered: [Answered {
            responder: Address(0x77),
            round: Ticks::from_us(600),
        }]
        .into_iter()
        .collect(),
    });
    let bytes = frame(A, Address::BROADCAST, 1, last);
    let step = responder.on_event(Event::Received {
        bytes: &bytes,
        at: at_us(1_240),
    });
    assert_eq!(
        step.outcome,
        Some(Outcome::Failed {
            peer: A,
            why: Failure::NotHeard
        })
    );
}

#[test]
fn a_poll_that_wants_its_answer_too_soon_is_refused() {
    let slow = Timing {
        reply_us: 900,
        ..timing()
    };
    let mut responder = Responder::new(identity(B), slow);
    responder.start();
    let poll = frame(A, B, 1, poll_of(&[B], 1));
    let step = responder.on_event(Event::Received {
        bytes: &poll,
        at: at(0),
    });
    assert_eq!(step.outcome, Some(Outcome::Ignored(Ignored::TooFast)));
    assert!(responder.is_idle());
}

fn transmission(step: Step) -> (FrameBuffer, When) {
    match step.command {
        Command::Send { frame, when, .. } => (frame, when),
        other => panic!("expected a transmission, got {other:?}"),
    }
}

fn sent(when: When) -> Event<'static> {
    let When::At(start) = when else {
        panic!("answers are sent at a set time")
    };
    Event::Sent {
        at: start.after(Ticks::new(ANTENNA_DELAY)),
    }
}

/// An initiator whose poll to B has left at tick 0.
fn initiator_collecting() -> Initiator {
    let mut initiator = Initiator::new(identity(A), timing());
    initiator.start(&[B], 0);
    initiator.on_event(Event::Sent { at: at(0) });
    initiator
}

/// A responder that has answered A's poll of round 1, received at tick 0.
fn responder_awaiting_final() -> Responder {
    let mut responder = Responder::new(identity(B), timing());
    responder.start();
    let poll = frame(A, B, 1, poll_of(&[B], 1));
    let (_, when) = transmission(responder.on_event(Event::Received {
        bytes: &poll,
        at: at(0),
    }));
    let step = responder.on_event(sent(when));
    assert_eq!(step.command, Command::Wait);
    responder
}

fn response() -> FrameBuffer {
    frame(B, A, 1, Message::Response)
}

fn final_of(round_us: u32, span_us: u32) -> Message {
    Message::Final(Final {
        span: Ticks::from_us(span_us),
        answered: [Answered {
            responder: B,
            round: Ticks::from_us(round_us),
        }]
        .into_iter()
        .collect(),
    })
}

#[test]
fn a_late_final_is_given_up() {
    let mut initiator = initiator_collecting();
    initiator.on_event(Event::Received {
        bytes: &response(),
        at: at_us(600),
    });
    let step = initiator.on_event(Event::SendTooLate);
    let failed = Outcome::Failed {
        peer: Address::BROADCAST,
        why: Failure::SendTooLate,
    };
    assert_eq!(
        step,
        Step {
            command: Command::Idle,
            outcome: Some(failed)
        }
    );
}

#[test]
fn a_late_response_sends_the_responder_back_to_listening() {
    let mut responder = Responder::new(identity(B), timing());
    responder.start();
    let poll = frame(A, B, 1, poll_of(&[B], 1));
    responder.on_event(Event::Received {
        bytes: &poll,
        at: at(0),
    });
    let step = responder.on_event(Event::SendTooLate);
    let failed = Outcome::Failed {
        peer: A,
        why: Failure::SendTooLate,
    };
    assert_eq!(step.outcome, Some(failed));
    assert_eq!(step.command, Command::Listen { until: None });
}

#[test]
fn a_frame_that_left_at_another_time_than_told_gives_no_range() {
    let mismatch = |step: Step| {
        matches!(
            step.outcome,
            Some(Outcome::Failed {
                why: Failure::SendTimeMismatch,
                ..
            })
        )
    };
    let off = |when| {
        let Event::Sent { at } = sent(when) else {
            panic!()
        };
        Event::Sent {
            at: at.after(Ticks::new(1)),
        }
    };
    let mut initiator = initiator_collecting();
    let (_, when) = transmission(initiator.on_event(Event::Received {
        bytes: &response(),
        at: at_us(600),
    }));
    assert!(mismatch(initiator.on_event(off(when))));

    let mut responder = Responder::new(identity(B), timing());
    responder.start();
    let poll = frame(A, B, 1, poll_of(&[B], 1));
    let (_, when) = transmission(responder.on_event(Event::Received {
        bytes: &poll,
        at: at(0),
    }));
    assert!(mismatch(responder.on_event(off(when))));

    let mut responder = responder_awaiting_final();
    let last = frame(A, B, 1, final_of(600, 1_240));
    let (_, when) = transmission(responder.on_event(Event::Received {
        bytes: &last,
        at: at_us(1_240),
    }));
    assert!(mismatch(responder.on_event(off(when))));
    assert!(responder.is_idle());
}

#[test]
fn frames_of_strangers_change_nothing() {
    let other_pan = |message| {
        Frame {
            sequence: 1,
            pan: PanId(0x1234),
            destination: A,
            source: B,
            round: 1,
            message,
        }
        .encode()
    };
    let cases = [
        (other_pan(Message::Response), Ignored::ForeignNetwork),
        (frame(A, A, 1, Message::Response), Ignored::ForeignNetwork),
        (
            frame(Address::BROADCAST, A, 1, Message::Response),
            Ignored::ForeignNetwork,
        ),
        (
            frame(B, Address(0x55), 1, Message::Response),
            Ignored::ForOthers,
        ),
        (
            frame(Address(0x66), A, 1, Message::Response),
            Ignored::WrongPeer,
        ),
        (frame(B, A, 2, Message::Response), Ignored::WrongRound),
        (frame(B, A, 1, poll_of(&[A], 1)), Ignored::OutOfTurn),
    ];
    for (bytes, why) in cases {
        let mut initiator = initiator_collecting();
        let step = initiator.on_event(Event::Received {
            bytes: &bytes,
            at: at_us(600),
        });
        let passed_over = Step {
            command: Command::KeepListening,
            outcome: Some(Outcome::Ignored(why)),
        };
        assert_eq!(step, passed_over);
        // The round is unharmed.
        transmission(initiator.on_event(Event::Received {
            bytes: &response(),
            at: at_us(600),
        }));
    }
    let step = initiator_collecting().on_event(Event::Received {
        bytes: b"not ours",
        at: at(9),
    });
    assert!(matches!(
        step.outcome,
        Some(Outcome::Ignored(Ignored::NotOurs(_)))
    ));
}

#[test]
fn a_response_at_another_time_than_due_is_none() {
    for late_us in [0, 500, 597, 613, 700, 1_000, 4_000] {
        let mut initiator = initiator_collecting();
        let step = initiator.on_event(Event::Received {
            bytes: &response(),
            at: at_us(late_us),
        });
        assert_eq!(
            step.outcome,
            Some(Outcome::Ignored(Ignored::OutOfTime)),
            "{late_us} us"
        );
    }
}

#[test]
fn a_final_or_report_at_another_time_than_due_is_none() {
    for us in [1_000, 1_238, 1_243, 2_000] {
        let step = responder_awaiting_final().on_event(Event::Received {
            bytes: &frame(A, B, 1, final_of(600, 1_240)),
            at: at_us(us),
        });
        assert_eq!(
            step.outcome,
            Some(Outcome::Ignored(Ignored::OutOfTime)),
            "{us} us"
        );
    }
    let mut initiator = initiator_collecting();
    let (_, when) = transmission(initiator.on_event(Event::Received {
        bytes: &response(),
        at: at_us(600),
    }));
    initiator.on_event(sent(when));
    let report = Message::Report {
        round: Ticks::from_us(640),
        reply: Ticks::from_us(600),
    };
    let step = initiator.on_event(Event::Received {
        bytes: &frame(B, A, 1, report),
        at: at_us(1_900),
    });
    assert_eq!(step.outcome, Some(Outcome::Ignored(Ignored::OutOfTime)));
}

#[test]
fn a_third_node_cannot_end_the_responders_round() {
    let mut responder = responder_awaiting_final();
    let stranger = Address(0x99);
    for intruder in [
        frame(stranger, B, 1, poll_of(&[B], 1)),
        frame(stranger, B, 1, final_of(600, 1_240)),
    ] {
        let step = responder.on_event(Event::Received {
            bytes: &intruder,
            at: at_us(1_240),
        });
        assert_eq!(step.outcome, Some(Outcome::Ignored(Ignored::WrongPeer)));
    }
}

#[test]
fn a_repeated_poll_is_passed_over_and_a_new_one_starts_again() {
    let mut responder = responder_awaiting_final();
    let poll = |round| frame(A, B, round, poll_of(&[B], 1));
    let step = responder.on_event(Event::Received {
        bytes: &poll(1),
        at: at_us(700),
    });
    assert_eq!(step.outcome, Some(Outcome::Ignored(Ignored::OutOfTurn)));
    let step = responder.on_event(Event::Received {
        bytes: &poll(2),
        at: at_us(800),
    });
    assert_eq!(
        step.outcome,
        Some(Outcome::Failed {
            peer: A,
            why: Failure::Superseded
        })
    );
    assert!(matches!(step.command, Command::Send { .. }));
}

#[test]
fn a_repeated_final_gives_no_second_range() {
    let (mut air, responders) = cell(1);
    air.fate = Box::new(|_, _, _| vec![0.0, 5_000.0 * US as f64, 9_000.0 * US as f64]);
    let said = air.round(0.0, &responders, 0);
    assert_eq!((measured(&said[0]).len(), measured(&said[1]).len()), (1, 1));
}

#[test]
fn intervals_that_contradict_each_other_give_no_range() {
    for (round_us, span_us, why) in [
        (600, 1_300, "clocks"),
        (560, 1_240, "less than nothing"),
        (640, 1_240, "too far"),
    ] {
        let mut responder = responder_awaiting_final();
        let (_, when) = transmission(responder.on_event(Event::Received {
            bytes: &frame(A, B, 1, final_of(round_us, span_us)),
            at: at_us(1_240),
        }));
        let step = responder.on_event(sent(when));
        assert!(
            matches!(
                step.outcome,
                Some(Outcome::Failed {
                    why: Failure::Tof(_) | Failure::Implausible,
                    ..
                })
            ),
            "{why}: {:?}",
            step.outcome
        );
    }
}

/// What may happen to a frame beside arriving, and what else is in the air.
#[derive(Clone, Debug)]
struct Trouble {
    lost: Vec<(usize, usize)>,
    repeated: Vec<(usize, f64)>,
    invented: Vec<(f64, usize, Vec<u8>)>,
}

fn any_trouble() -> impl Strategy<Value = Trouble> {
    // An echo nearer than 12 us whose original is lost cannot be told from it.
    let late = 12.0 * US as f64..4_000.0 * US as f64;
    (
        prop::collection::vec((1..12usize, 0..5usize), 0..3),
        prop::collection::vec((1..12usize, late), 0..3),
        prop::collection::vec((0.0..5_000.0 * US as f64, 0..5usize, any_frame()), 0..6),
    )
        .prop_map(|(lost, repeated, invented)| Trouble {
            lost,
            repeated,
            invented,
        })
}

proptest! {
    /// Whatever the clocks show and however they drift, all sides measure the time of
    /// flight, round after round and across wraps.
    #[test]
    fn every_undisturbed_round_gives_all_ranges(
        clocks in prop::collection::vec((0..MODULUS, -20.0..20.0f64), 2..=9),
        unit in 0.0..30_000.0f64,
    ) {
        let mut air = Air::new();
        let mut named = Vec::new();
        for (k, &(start, ppm)) in clocks.iter().enumerate() {
            let clock = Clock { start, ppm };
            if k == 0 {
                air.initiator(A, clock, 0.0);
            } else {
                named.push(Address(0x100 + k as u16));
                air.responder(named[k - 1], clock, unit * k as f64);
            }
        }
        for round in 0..4u32 {
            let said = air.round(f64::from(round) * 6.0 * TICKS_PER_SECOND as f64, &named, 0);
            let ranges = measured(&said[0]);
            prop_assert_eq!(ranges.len(), named.len());
            for (k, range) in ranges.iter().enumerate() {
                let flight = unit * (k + 1) as f64;
                let expected = flight * (1.0 + (clocks[0].1 + clocks[k + 1].1) / 2.0 * 1e-6);
                prop_assert!((range.two_way.time_of_flight_ticks - expected).abs() < 1.2);
                prop_assert_eq!(measured(&said[k + 1])[0].two_way, range.two_way);
            }
        }
    }

    /// However slow an initiator is, all its responders range; the air looks that nothing is
    /// sent later than its command says.
    #[test]
    fn a_slow_initiator_gets_all_its_ranges(
        reply_us in 600..=30_000u16,
        slot_us in 400..=30_000u16,
        responders in 1..=8usize,
    ) {
        let mut air = Air::new();
        air.initiator_with(Timing { reply_us, slot_us, ..timing() }, A, TRUE_CLOCK, 0.0);
        let named: Vec<_> = (1..=responders as u16).map(Address).collect();
        for (k, &address) in named.iter().enumerate() {
            air.responder(address, Clock { start: 0, ppm: 18.0 - 4.0 * k as f64 }, 500.0);
        }
        let said = air.round(0.0, &named, 0);
        prop_assert_eq!(measured(&said[0]).len(), responders);
        prop_assert!(failures(&said[0]).is_empty());
        prop_assert!(air.all_idle());
    }

    /// Any poll is refused, too fast or too slow, or answered as far ahead as it says.
    #[test]
    fn a_poll_is_answered_at_its_time_or_refused(
        (reply_us, slot_us) in (any::<u16>(), any::<u16>()),
        (slots, own) in (1..=8u8).prop_flat_map(|slots| (Just(slots), 0..slots)),
        start in 0..MODULUS,
    ) {
        let mut responder = Responder::new(identity(B), timing());
        responder.start();
        let named = (0..=own).map(|k| if k == own { B } else { Address(0x100 + u16::from(k)) });
        let message = Message::Poll(Poll { reply_us, slot_us, slots, named: named.collect() });
        let step = responder.on_event(Event::Received {
            bytes: &frame(A, Address::BROADCAST, 1, message),
            at: at(start),
        });
        let response_us = |slot: u8| u32::from(reply_us) + u32::from(slot) * u32::from(slot_us);
        let refused = if reply_us < timing().reply_us {
            Some(Outcome::Ignored(Ignored::TooFast))
        } else if response_us(slots - 1) > 240_000 {
            Some(Outcome::Ignored(Ignored::TooSlow))
        } else {
            None
        };
        prop_assert_eq!(step.outcome, refused);
        prop_assert_eq!(responder.is_idle(), refused.is_some());
        match step.command {
            Command::Send { when: When::At(when), ahead_us, .. } => {
                prop_assert!(refused.is_none());
                prop_assert_eq!(ahead_us, response_us(own));
                let ahead = when.after(Ticks::new(ANTENNA_DELAY)).since(at(start));
                let early = Ticks::from_us(ahead_us).get() - ahead.get();
                prop_assert!(early < DELAYED_GRID, "{} ticks early", early);
            }
            command => prop_assert!(refused.is_some(), "{:?}", command),
        }
    }

    /// Frames lost, repeated, and made up by strangers or by members of other rounds: a
    /// range is right or there is none, and afterwards everybody is well.
    #[test]
    fn no_trouble_in_the_air_makes_a_wrong_range(trouble in any_trouble()) {
        let (mut air, responders) = cell(4);
        let Trouble { lost, repeated, invented } = trouble;
        air.fate = Box::new(move |frame, _, to| {
            let mut fate: Vec<f64> = repeated
                .iter()
                .filter(|(which, _)| *which == frame)
                .map(|(_, late)| *late)
                .collect();
            if !lost.contains(&(frame, to)) {
                fate.push(0.0);
            }
            fate
        });
        for (t, node, bytes) in &invented {
            air.invent(*t, *node, bytes);
        }
        let check = |said: &[Vec<Outcome>]| {
            for (node, outcomes) in said.iter().enumerate() {
                for range in measured(outcomes) {
                    let k = responders.iter().position(|&r| r == range.peer);
                    let k = k.unwrap_or(node.wrapping_sub(1));
                    let expected = 1_000.0 * (k + 1) as f64;
                    assert!((range.two_way.time_of_flight_ticks - expected).abs() < 1.2,
                        "{range:?} instead of {expected}");
                }
            }
        };
        check(&air.round(0.0, &responders, 0));
        prop_assert!(air.all_idle());
        air.fate = Box::new(|_, _, _| vec![0.0]);
        let said = air.round(1e9, &responders, 0);
        check(&said);
        prop_assert_eq!(measured(&said[0]).len(), 4);
    }

    /// No sequence of events, sensible or not, panics or gets stuck: silence
    /// (or a send that never happened) leads both machines back to rest.
    #[test]
    fn no_sequence_of_events_gets_stuck(events in prop::collection::vec(any_event(), 0..60)) {
        let mut initiator = Initiator::new(identity(A), timing());
        let mut responder = Responder::new(identity(B), timing());
        initiator.start(&[B, Address(7)], 1);
        for event in &events {
            let event = event.as_event();
            initiator.on_event(event);
            responder.on_event(event);
        }
        for _ in 0..=MAX_RESPONDERS {
            for end in [Event::SendTooLate, Event::ListenTimeout] {
                initiator.on_event(end);
                responder.on_event(end);
            }
        }
        prop_assert!(initiator.is_idle() && responder.is_idle());
    }
}

#[derive(Clone, Debug)]
enum OwnedEvent {
    Sent(u64),
    SendTooLate,
    Received(Vec<u8>, u64),
    ListenTimeout,
}

impl OwnedEvent {
    fn as_event(&self) -> Event<'_> {
        match self {
            Self::Sent(t) => Event::Sent { at: at(*t) },
            Self::SendTooLate => Event::SendTooLate,
            Self::Received(bytes, t) => Event::Received { bytes, at: at(*t) },
            Self::ListenTimeout => Event::ListenTimeout,
        }
    }
}

/// Frames of this protocol that no machine in a round has just sent: of other networks,
/// other rounds, or nodes that have no part in it.
fn any_frame() -> impl Strategy<Value = Vec<u8>> {
    let ticks = || (0..MODULUS).prop_map(Ticks::new);
    let message = prop_oneof![
        (0..=8u8).prop_map(|n| poll_of(
            &(0..u16::from(n))
                .map(|k| Address(0x100 + k))
                .collect::<Vec<_>>(),
            n.max(1),
        )),
        Just(Message::Response),
        (ticks(), ticks()).prop_map(|(span, round)| Message::Final(Final {
            span,
            answered: (1..=4)
                .map(|k| Answered {
                    responder: Address(0x100 + k),
                    round
                })
                .collect(),
        })),
        (ticks(), ticks()).prop_map(|(round, reply)| Message::Report { round, reply }),
    ];
    let strangers = prop_oneof![
        // Another network, where everybody is called the same.
        (0x100..0x105u16, Just(0x1234), 0..3u8),
        // Nodes without a part.
        (0x200..0x205u16, Just(PAN.0), 0..3u8),
        // Ourselves, long ago.
        (0x100..0x105u16, Just(PAN.0), 90..250u8),
    ];
    let destination = prop_oneof![Just(A), Just(Address(0x102)), Just(Address::BROADCAST)];
    (strangers, destination, message).prop_map(|((source, pan, round), destination, message)| {
        Frame {
            sequence: 1,
            pan: PanId(pan),
            destination,
            source: Address(source),
            round,
            message,
        }
        .encode()
        .to_vec()
    })
}

fn any_event() -> impl Strategy<Value = OwnedEvent> {
    let address = || prop_oneof![Just(A), Just(B), Just(Address::BROADCAST), Just(Address(7))];
    let ours = (address(), address(), 0..3u8, any_frame()).prop_map(|(s, d, round, bytes)| {
        let message = Frame::parse(&bytes).unwrap().message;
        frame(s, d, round, message).to_vec()
    });
    prop_oneof![
        (0..MODULUS).prop_map(OwnedEvent::Sent),
        Just(OwnedEvent::SendTooLate),
        (ours, 0..MODULUS).prop_map(|(f, t)| OwnedEvent::Received(f, t)),
        (any_frame(), 0..MODULUS).prop_map(|(f, t)| OwnedEvent::Received(f, t)),
        (prop::collection::vec(any::<u8>(), 0..30), 0..MODULUS)
            .prop_map(|(f, t)| OwnedEvent::Received(f, t)),
        Just(OwnedEvent::ListenTimeout),
    ]
}
