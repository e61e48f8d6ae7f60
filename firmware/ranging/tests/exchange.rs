//! The two state machines against each other, through a perfect radio whose
//! frames a test can drop, repeat or change.
#![allow(clippy::unwrap_used, clippy::panic)]

use nova_ranging::exchange::Identity;
use nova_ranging::frame::FrameBuffer;
use nova_ranging::time::{DELAYED_GRID, MODULUS, TICKS_PER_SECOND};
use nova_ranging::{
    Address, Command, DeviceTime, Event, Failure, Frame, Ignored, Initiator, Measurement, Message,
    Outcome, PanId, Responder, Step, Then, Ticks, Timing, When,
};
use proptest::prelude::*;

const PAN: PanId = PanId(0xDECA);
const A: Address = Address(0x000A);
const B: Address = Address(0x000B);
const ANTENNA_DELAY: u64 = 16_436;

fn identity(address: Address) -> Identity {
    Identity { pan: PAN, address }
}

fn timing() -> Timing {
    Timing {
        reply: Ticks::from_us(600),
        listen_after_us: 100,
        answer_timeout_us: 2_000,
        tx_antenna_delay: Ticks::new(ANTENNA_DELAY),
    }
}

/// A clock that runs at `1 + ppm` and showed `start` at true time 0 (ticks).
#[derive(Clone, Copy)]
struct Clock {
    start: u64,
    ppm: f64,
}

impl Clock {
    fn read(&self, t: f64) -> DeviceTime {
        DeviceTime::from_ticks(self.start + (t + t * self.ppm * 1e-6).round() as u64)
    }

    /// True time after `now` at which the clock shows `reading`.
    fn when(&self, reading: DeviceTime, now: f64) -> f64 {
        now + reading.since(self.read(now)).get() as f64 / (1.0 + self.ppm * 1e-6)
    }
}

/// Carries out a send: the true time at which the frame leaves the antenna,
/// and what the sender is told.
fn depart(clock: &Clock, when: When, now: f64) -> (f64, Event<'static>) {
    match when {
        When::Now => {
            let t = now + Ticks::from_us(150).get() as f64;
            (t, Event::Sent { at: clock.read(t) })
        }
        When::At(start) => {
            assert_eq!(start.ticks() % DELAYED_GRID, 0, "off the radio's grid");
            let at = start.after(Ticks::new(ANTENNA_DELAY));
            (clock.when(at, now), Event::Sent { at })
        }
    }
}

fn transmission(step: Step) -> (FrameBuffer, When) {
    match step.command {
        Command::Send { frame, when, .. } => (frame, when),
        other => panic!("expected a transmission, got {other:?}"),
    }
}

/// One undisturbed exchange; what each side measured.
fn exchange(
    initiator: &mut Initiator,
    responder: &mut Responder,
    clock_a: Clock,
    clock_b: Clock,
    tof: f64,
    start: f64,
) -> (Measurement, Measurement) {
    let Command::Send {
        frame: poll,
        when,
        then,
    } = initiator.start(B)
    else {
        panic!("a start must send a poll");
    };
    let for_answer = Then::Listen {
        after_us: 100,
        timeout_us: Some(2_000),
    };
    assert_eq!(then, for_answer);
    let (t, sent) = depart(&clock_a, when, start);
    let step = initiator.on_event(sent);
    assert_eq!(step.command, Command::Wait);

    let t = t + tof;
    let (response, when) = transmission(responder.on_event(Event::Received {
        bytes: &poll,
        at: clock_b.read(t),
    }));
    let (t, sent) = depart(&clock_b, when, t);
    responder.on_event(sent);

    let t = t + tof;
    let (last, when) = transmission(initiator.on_event(Event::Received {
        bytes: &response,
        at: clock_a.read(t),
    }));
    let (t, sent) = depart(&clock_a, when, t);
    initiator.on_event(sent);

    let t = t + tof;
    let (report, when) = transmission(responder.on_event(Event::Received {
        bytes: &last,
        at: clock_b.read(t),
    }));
    let (t, sent) = depart(&clock_b, when, t);
    let at_b = responder.on_event(sent);
    assert_eq!(at_b.command, Command::Wait);

    let t = t + tof;
    let at_a = initiator.on_event(Event::Received {
        bytes: &report,
        at: clock_a.read(t),
    });
    assert_eq!(at_a.command, Command::Idle);
    match (at_a.outcome, at_b.outcome) {
        (Some(Outcome::Measured(a)), Some(Outcome::Measured(b))) => (a, b),
        other => panic!("no range: {other:?}"),
    }
}

fn pair() -> (Initiator, Responder) {
    let mut responder = Responder::new(identity(B), timing());
    assert_eq!(responder.start(), Command::Listen { timeout_us: None });
    (Initiator::new(identity(A), timing()), responder)
}

const TRUE_CLOCK: Clock = Clock { start: 0, ppm: 0.0 };

fn at(ticks: u64) -> DeviceTime {
    DeviceTime::from_ticks(ticks)
}

/// An initiator whose poll has left at tick 0.
fn initiator_awaiting_response() -> Initiator {
    let (mut initiator, _) = pair();
    initiator.start(B);
    initiator.on_event(Event::Sent { at: at(0) });
    initiator
}

/// A frame from `source` in the initiator's first exchange.
fn frame(source: Address, destination: Address, exchange: u8, message: Message) -> FrameBuffer {
    Frame {
        sequence: 1,
        pan: PAN,
        destination,
        source,
        exchange,
        message,
    }
    .encode()
}

#[test]
fn both_sides_measure_the_same_range() {
    let (mut initiator, mut responder) = pair();
    let clock_b = Clock {
        start: 12_345,
        ppm: 15.0,
    };
    let (a, b) = exchange(
        &mut initiator,
        &mut responder,
        TRUE_CLOCK,
        clock_b,
        5_000.0,
        0.0,
    );
    assert_eq!(a.two_way, b.two_way);
    assert_eq!((a.peer, b.peer), (B, A));
    assert!((a.two_way.time_of_flight_ticks - 5_000.0).abs() < 1.0);
    assert!((a.two_way.clock_offset_ppm - 15.0).abs() < 0.1);
}

#[test]
fn a_poll_to_all_is_answered_by_a_node_that_nobody_knows() {
    let (mut initiator, mut responder) = pair();
    let answered = (0..64).any(|k| {
        let Command::Send { frame, .. } = initiator.start(Address::BROADCAST) else {
            panic!("no poll");
        };
        // Each search comes at another time, which decides the lot.
        let step = responder.on_event(Event::Received {
            bytes: &frame,
            at: at(638_976_123 * k),
        });
        matches!(step.command, Command::Send { .. })
    });
    assert!(answered);
}

/// A search by `initiator`, and whether the responder answers.
fn searched(responder: &mut Responder, source: Address, sequence: u8, t: DeviceTime) -> bool {
    let search = Frame {
        sequence,
        pan: PAN,
        destination: Address::BROADCAST,
        source,
        exchange: sequence,
        message: Message::Poll,
    };
    let step = responder.on_event(Event::Received {
        bytes: &search.encode(),
        at: t,
    });
    let answers = matches!(step.command, Command::Send { .. });
    if answers {
        // Back to listening.
        responder.on_event(Event::SendTooLate);
    } else {
        assert_eq!(step.outcome, Some(Outcome::Ignored(Ignored::LeftToOthers)));
    }
    answers
}

#[test]
fn a_search_by_who_knows_the_node_is_left_to_others_for_a_second() {
    let (mut initiator, mut responder) = pair();
    exchange(
        &mut initiator,
        &mut responder,
        TRUE_CLOCK,
        TRUE_CLOCK,
        100.0,
        0.0,
    );
    let at_ms = |ms: u64| at(TICKS_PER_SECOND / 1000 * ms);
    let answers = |responder: &mut Responder, who, from_ms, to_ms| {
        (from_ms..to_ms)
            .step_by(10)
            .filter(|&ms| searched(responder, who, ms as u8 / 2, at_ms(ms)))
            .count()
    };
    assert_eq!(answers(&mut responder, A, 10, 990), 0);
    // Somebody else's searches are another matter, then and later.
    assert!(answers(&mut responder, Address(0x77), 10, 990) > 5);
    assert!(answers(&mut responder, A, 1_010, 2_000) > 5);
}

#[test]
fn a_search_in_mid_exchange_ends_it_whether_answered_or_not() {
    let (_, mut responder) = pair();
    for sequence in 0..64 {
        responder.start();
        let poll = frame(A, B, 200, Message::Poll);
        responder.on_event(Event::Received {
            bytes: &poll,
            at: at(0),
        });
        responder.on_event(Event::Sent { at: at(40_000_000) });
        let search = Frame {
            sequence,
            pan: PAN,
            destination: Address::BROADCAST,
            source: A,
            exchange: sequence,
            message: Message::Poll,
        };
        // A knows this node, so it must leave the search to others.
        let step = responder.on_event(Event::Received {
            bytes: &search.encode(),
            at: at(80_000_000),
        });
        assert_eq!(
            step,
            Step {
                command: Command::Listen { timeout_us: None },
                outcome: Some(Outcome::Failed(Failure::Superseded))
            }
        );
    }
}

#[test]
fn a_frame_from_nobody_makes_no_peer() {
    let (mut initiator, _) = pair();
    initiator.start(Address::BROADCAST);
    initiator.on_event(Event::Sent { at: at(0) });
    let response = frame(Address::BROADCAST, A, 1, Message::Response);
    let step = initiator.on_event(Event::Received {
        bytes: &response,
        at: at(50_000_000),
    });
    assert_eq!(
        step.outcome,
        Some(Outcome::Ignored(Ignored::ForeignNetwork))
    );
}

#[test]
fn whoever_answers_a_poll_to_all_is_the_peer_from_then_on() {
    let (mut initiator, _) = pair();
    initiator.start(Address::BROADCAST);
    initiator.on_event(Event::Sent { at: at(0) });
    let response = frame(Address(0x77), A, 1, Message::Response);
    let (last, _) = transmission(initiator.on_event(Event::Received {
        bytes: &response,
        at: at(50_000_000),
    }));
    assert_eq!(Frame::parse(&last).unwrap().destination, Address(0x77));
}

#[test]
fn silence_ends_each_wait_with_its_cause() {
    let mut initiator = initiator_awaiting_response();
    let step = initiator.on_event(Event::ListenTimeout);
    assert_eq!(
        step,
        Step {
            command: Command::Idle,
            outcome: Some(Outcome::Failed(Failure::NoResponse))
        }
    );

    let mut initiator = initiator_awaiting_response();
    let response = frame(B, A, 1, Message::Response);
    let (_, when) = transmission(initiator.on_event(Event::Received {
        bytes: &response,
        at: at(50_000_000),
    }));
    let (_, sent) = depart(&TRUE_CLOCK, when, 50_000_000.0);
    initiator.on_event(sent);
    let step = initiator.on_event(Event::ListenTimeout);
    assert_eq!(step.outcome, Some(Outcome::Failed(Failure::NoReport)));
    assert!(initiator.is_idle());

    let (mut initiator, mut responder) = pair();
    let Command::Send { frame: poll, .. } = initiator.start(B) else {
        panic!()
    };
    responder.on_event(Event::Received {
        bytes: &poll,
        at: at(0),
    });
    responder.on_event(Event::Sent { at: at(40_000_000) });
    let step = responder.on_event(Event::ListenTimeout);
    assert_eq!(
        step,
        Step {
            command: Command::Listen { timeout_us: None },
            outcome: Some(Outcome::Failed(Failure::NoFinal))
        }
    );
}

#[test]
fn a_late_final_is_given_up() {
    let mut initiator = initiator_awaiting_response();
    let response = frame(B, A, 1, Message::Response);
    initiator.on_event(Event::Received {
        bytes: &response,
        at: at(50_000_000),
    });
    let step = initiator.on_event(Event::SendTooLate);
    assert_eq!(
        step,
        Step {
            command: Command::Idle,
            outcome: Some(Outcome::Failed(Failure::SendTooLate))
        }
    );
}

#[test]
fn a_late_response_sends_the_responder_back_to_listening() {
    let (_, mut responder) = pair();
    let poll = frame(A, B, 1, Message::Poll);
    responder.on_event(Event::Received {
        bytes: &poll,
        at: at(0),
    });
    let step = responder.on_event(Event::SendTooLate);
    assert_eq!(
        step,
        Step {
            command: Command::Listen { timeout_us: None },
            outcome: Some(Outcome::Failed(Failure::SendTooLate))
        }
    );
}

#[test]
fn a_final_that_left_at_another_time_than_it_says_gives_no_range() {
    let mut initiator = initiator_awaiting_response();
    let response = frame(B, A, 1, Message::Response);
    let (_, when) = transmission(initiator.on_event(Event::Received {
        bytes: &response,
        at: at(50_000_000),
    }));
    let When::At(start) = when else {
        panic!("a final is sent at a set time")
    };
    let step = initiator.on_event(Event::Sent {
        at: start.after(Ticks::new(ANTENNA_DELAY + 1)),
    });
    assert_eq!(
        step.outcome,
        Some(Outcome::Failed(Failure::SendTimeMismatch))
    );
}

#[test]
fn frames_of_strangers_change_nothing() {
    let response = |source, destination, exchange, pan| {
        Frame {
            sequence: 1,
            pan,
            destination,
            source,
            exchange,
            message: Message::Response,
        }
        .encode()
    };
    let cases = [
        (response(B, A, 1, PanId(0x1234)), Ignored::ForeignNetwork),
        (response(B, Address(0x55), 1, PAN), Ignored::ForOthers),
        (response(Address(0x66), A, 1, PAN), Ignored::WrongPeer),
        (response(B, A, 2, PAN), Ignored::WrongExchange),
        (frame(B, A, 1, Message::Poll), Ignored::OutOfTurn),
    ];
    for (bytes, why) in cases {
        let mut initiator = initiator_awaiting_response();
        let step = initiator.on_event(Event::Received {
            bytes: &bytes,
            at: at(9),
        });
        assert_eq!(
            step,
            Step {
                command: Command::KeepListening,
                outcome: Some(Outcome::Ignored(why))
            }
        );
        // The exchange is unharmed.
        let good = frame(B, A, 1, Message::Response);
        transmission(initiator.on_event(Event::Received {
            bytes: &good,
            at: at(50_000_000),
        }));
    }
    let mut initiator = initiator_awaiting_response();
    let step = initiator.on_event(Event::Received {
        bytes: b"not ours",
        at: at(9),
    });
    assert!(matches!(
        step.outcome,
        Some(Outcome::Ignored(Ignored::NotOurs(_)))
    ));
}

#[test]
fn a_third_node_cannot_end_the_responders_exchange() {
    let (_, mut responder) = pair();
    responder.on_event(Event::Received {
        bytes: &frame(A, B, 1, Message::Poll),
        at: at(0),
    });
    responder.on_event(Event::Sent { at: at(40_000_000) });
    let ticks = Ticks::new(1);
    for intruder in [
        frame(Address(0x99), B, 1, Message::Poll),
        frame(
            Address(0x99),
            B,
            1,
            Message::Final {
                round: ticks,
                reply: ticks,
            },
        ),
    ] {
        let step = responder.on_event(Event::Received {
            bytes: &intruder,
            at: at(41_000_000),
        });
        assert_eq!(step.outcome, Some(Outcome::Ignored(Ignored::WrongPeer)));
    }
}

#[test]
fn a_repeated_poll_is_passed_over_and_a_new_one_starts_again() {
    let (_, mut responder) = pair();
    let poll = |exchange| frame(A, B, exchange, Message::Poll);
    responder.on_event(Event::Received {
        bytes: &poll(1),
        at: at(0),
    });
    responder.on_event(Event::Sent { at: at(40_000_000) });
    let step = responder.on_event(Event::Received {
        bytes: &poll(1),
        at: at(41_000_000),
    });
    assert_eq!(step.outcome, Some(Outcome::Ignored(Ignored::OutOfTurn)));
    let step = responder.on_event(Event::Received {
        bytes: &poll(2),
        at: at(42_000_000),
    });
    assert_eq!(step.outcome, Some(Outcome::Failed(Failure::Superseded)));
    assert!(matches!(step.command, Command::Send { .. }));
}

#[test]
fn a_repeated_final_gives_no_second_range() {
    let (mut initiator, mut responder) = pair();
    exchange(
        &mut initiator,
        &mut responder,
        TRUE_CLOCK,
        TRUE_CLOCK,
        100.0,
        0.0,
    );
    let again = frame(
        A,
        B,
        1,
        Message::Final {
            round: Ticks::new(5),
            reply: Ticks::new(5),
        },
    );
    let step = responder.on_event(Event::Received {
        bytes: &again,
        at: at(1),
    });
    assert_eq!(
        step,
        Step {
            command: Command::KeepListening,
            outcome: Some(Outcome::Ignored(Ignored::OutOfTurn))
        }
    );
}

#[test]
fn intervals_that_contradict_each_other_give_no_range() {
    let (_, mut responder) = pair();
    responder.on_event(Event::Received {
        bytes: &frame(A, B, 1, Message::Poll),
        at: at(0),
    });
    responder.on_event(Event::Sent { at: at(40_000_000) });
    let lie = Message::Final {
        round: Ticks::new(40_000_000),
        reply: Ticks::new(90_000_000),
    };
    transmission(responder.on_event(Event::Received {
        bytes: &frame(A, B, 1, lie),
        at: at(80_000_000),
    }));
    let step = responder.on_event(Event::Sent { at: at(90_000_000) });
    assert!(matches!(
        step.outcome,
        Some(Outcome::Failed(Failure::Tof(_)))
    ));
}

proptest! {
    /// Whatever two clocks show and however they drift, both sides measure
    /// the time of flight, exchange after exchange and across wraps.
    #[test]
    fn every_undisturbed_exchange_gives_the_range(
        start_a in 0..MODULUS, start_b in 0..MODULUS,
        ppm_a in -20.0..20.0f64, ppm_b in -20.0..20.0f64,
        tof in 0.0..30_000.0f64,
    ) {
        let (mut initiator, mut responder) = pair();
        let (a, b) = (Clock { start: start_a, ppm: ppm_a }, Clock { start: start_b, ppm: ppm_b });
        for k in 0..20u32 {
            let start = f64::from(k) * TICKS_PER_SECOND as f64;
            let (m, n) = exchange(&mut initiator, &mut responder, a, b, tof, start);
            prop_assert_eq!(m.two_way, n.two_way);
            let expected = tof * (1.0 + (ppm_a + ppm_b) / 2.0 * 1e-6);
            prop_assert!((m.two_way.time_of_flight_ticks - expected).abs() < 1.1);
        }
    }

    /// No sequence of events, sensible or not, panics or gets stuck: silence
    /// (or a send that never happened) leads both machines back to rest.
    #[test]
    fn no_sequence_of_events_gets_stuck(events in prop::collection::vec(any_event(), 0..60)) {
        let (mut initiator, mut responder) = pair();
        initiator.start(B);
        for event in &events {
            let event = event.as_event();
            initiator.on_event(event);
            responder.on_event(event);
        }
        for end in [Event::SendTooLate, Event::ListenTimeout] {
            initiator.on_event(end);
            responder.on_event(end);
        }
        prop_assert!(initiator.is_idle() && responder.is_idle());
        exchange(&mut initiator, &mut responder, TRUE_CLOCK, TRUE_CLOCK, 100.0, 0.0);
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

fn any_event() -> impl Strategy<Value = OwnedEvent> {
    let message = prop_oneof![
        Just(Message::Poll),
        Just(Message::Response),
        (0..MODULUS, 0..MODULUS).prop_map(|(r, d)| Message::Final {
            round: Ticks::new(r),
            reply: Ticks::new(d)
        }),
        (0..MODULUS, 0..MODULUS).prop_map(|(r, d)| Message::Report {
            round: Ticks::new(r),
            reply: Ticks::new(d)
        }),
    ];
    let address = || prop_oneof![Just(A), Just(B), Just(Address::BROADCAST), Just(Address(7))];
    let frames =
        (address(), address(), 0..3u8, message).prop_map(|(s, d, e, m)| frame(s, d, e, m).to_vec());
    prop_oneof![
        (0..MODULUS).prop_map(OwnedEvent::Sent),
        Just(OwnedEvent::SendTooLate),
        (frames, 0..MODULUS).prop_map(|(f, t)| OwnedEvent::Received(f, t)),
        (prop::collection::vec(any::<u8>(), 0..30), 0..MODULUS)
            .prop_map(|(f, t)| OwnedEvent::Received(f, t)),
        Just(OwnedEvent::ListenTimeout),
    ]
}
