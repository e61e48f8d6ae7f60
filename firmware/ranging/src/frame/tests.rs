use super::codec::CHECK;
use super::*;
use crate::time::MODULUS;
use proptest::prelude::*;
use std::vec::Vec;

fn any_message() -> impl Strategy<Value = Message> {
    let ticks = || (0..MODULUS).prop_map(Ticks::new);
    let named = prop::collection::vec(any::<u16>(), 0..=MAX_RESPONDERS);
    let poll = (any::<u16>(), any::<u16>(), named, 0..=MAX_RESPONDERS).prop_map(
        |(reply_us, slot_us, named, open)| {
            Message::Poll(Poll {
                reply_us,
                slot_us,
                slots: (named.len() + open).clamp(1, MAX_RESPONDERS) as u8,
                named: named.into_iter().map(Address).collect(),
            })
        },
    );
    let answered = prop::collection::vec((any::<u16>(), ticks()), 0..=MAX_RESPONDERS);
    let last = (ticks(), answered).prop_map(|(span, answered)| {
        Message::Final(Final {
            span,
            answered: answered
                .into_iter()
                .map(|(responder, round)| Answered {
                    responder: Address(responder),
                    round,
                })
                .collect(),
        })
    });
    let grants = prop::collection::vec((any::<u16>(), any::<u16>()), 0..=MAX_SLOTS);
    let beacon = (any::<u32>(), any::<u16>(), grants).prop_map(|(length_us, join_us, grants)| {
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
    });
    prop_oneof![
        poll,
        Just(Message::Response),
        last,
        (ticks(), ticks()).prop_map(|(round, reply)| Message::Report { round, reply }),
        beacon,
        (any::<u16>(), any::<u32>())
            .prop_map(|(need_us, period_us)| Message::Join { need_us, period_us }),
    ]
}

fn any_frame() -> impl Strategy<Value = Frame> {
    (any::<(u8, u16, u16, u16, u8)>(), any_message()).prop_map(
        |((sequence, pan, destination, source, round), message)| Frame {
            sequence,
            pan: PanId(pan),
            destination: Address(destination),
            source: Address(source),
            round,
            message,
        },
    )
}

fn frame(message: Message) -> Frame {
    Frame {
        sequence: 7,
        pan: PanId(0xDECA),
        destination: Address(0x0102),
        source: Address(0x0A0B),
        round: 9,
        message,
    }
}

#[test]
fn a_poll_is_these_bytes() {
    let poll = frame(Message::Poll(Poll {
        reply_us: 0x0258,
        slot_us: 0x0190,
        slots: 2,
        named: [Address(0x0102)].into_iter().collect(),
    }));
    let bytes = poll.encode();
    assert_eq!(
        bytes[..19],
        [
            0x41, 0x88, 7, 0xCA, 0xDE, 0x02, 0x01, 0x0B, 0x0A, 0xD6, 1, 9, 0x58, 0x02, 0x90, 0x01,
            2, 0x02, 0x01
        ]
    );
    assert_eq!(bytes.len(), len::poll(1));
}

#[test]
fn a_cut_or_stretched_frame_is_refused() {
    let ticks = Ticks::new(123_456_789);
    let answered = Answered {
        responder: Address(3),
        round: ticks,
    };
    for message in [
        Message::Response,
        Message::Report {
            round: ticks,
            reply: ticks,
        },
        Message::Final(Final {
            span: ticks,
            answered: [answered; 3].into_iter().collect(),
        }),
    ] {
        let mut bytes = frame(message).encode().to_vec();
        let len = bytes.len();
        bytes.push(0);
        for cut in (0..len).chain([len + 1]) {
            assert!(Frame::parse(&bytes[..cut]).is_err(), "{cut} of {len}");
        }
    }
}

#[test]
fn the_check_is_crc_16_ibm_3740() {
    assert_eq!(CHECK.checksum(b"123456789"), 0x29B1);
}

/// All errors of three bits and fewer, in a frame of the longest kind. A check sequence is linear: what single
/// wrong bits do to it adds up, and errors are missed whose sum is nothing.
#[test]
fn no_three_wrong_bits_cancel_each_other() {
    let mut none = [0_u8; MAX_FRAME_LEN - CHECK_LEN];
    let right = CHECK.checksum(&none);
    let mut syndromes: std::vec::Vec<u16> = (0..16).map(|bit| 1 << bit).collect();
    for bit in 0..8 * none.len() {
        none[bit / 8] ^= 1 << (bit % 8);
        syndromes.push(CHECK.checksum(&none) ^ right);
        none[bit / 8] ^= 1 << (bit % 8);
    }
    let mut known = std::vec![false; 1 << 16];
    known[0] = true;
    for (place, &first) in syndromes.iter().enumerate() {
        assert!(
            !known[usize::from(first)],
            "bit {place} alone or with another"
        );
        for &second in &syndromes[..place] {
            assert!(!known[usize::from(first ^ second)], "bit {place} with two");
        }
        known[usize::from(first)] = true;
    }
}

#[test]
fn a_poll_with_more_names_than_slots_is_refused() {
    for (slots, named) in [(0, 0), (1, 2), (9, 0)] {
        let poll = frame(Message::Poll(Poll {
            reply_us: 600,
            slot_us: 400,
            slots,
            named: (0..named).map(Address).collect(),
        }));
        assert_eq!(Frame::parse(&poll.encode()), Err(FrameError::Slots));
    }
}

proptest! {
    #[test]
    fn every_frame_survives_the_air(frame in any_frame()) {
        prop_assert_eq!(Frame::parse(&frame.encode()), Ok(frame));
    }

    #[test]
    fn any_bytes_parse_to_themselves_or_an_error(mut bytes: Vec<u8>, ours: bool) {
        if ours && bytes.len() > HEADER_LEN + CHECK_LEN {
            // As far as the check goes it is a frame of ours.
            bytes[..2].copy_from_slice(&FRAME_CONTROL.to_le_bytes());
            bytes[9] = PROTOCOL;
            bytes[10] = 1 + bytes[10] % 6;
            let end = bytes.len() - CHECK_LEN;
            let check = CHECK.checksum(&bytes[..end]).to_le_bytes();
            bytes[end..].copy_from_slice(&check);
        }
        if let Ok(frame) = Frame::parse(&bytes) {
            prop_assert_eq!(&frame.encode()[..], &bytes[..]);
        }
    }

    /// What SPI does to a frame shows, on whichever side it happens.
    #[test]
    fn up_to_three_wrong_bits_are_noticed(frame in any_frame(), at in prop::collection::vec(any::<prop::sample::Index>(), 1..=3)) {
        let good = frame.encode().to_vec();
        let mut bytes = good.clone();
        for index in at {
            let bit = index.index(8 * bytes.len());
            bytes[bit / 8] ^= 1 << (bit % 8);
        }
        prop_assume!(bytes != good);
        prop_assert!(Frame::parse(&bytes).is_err());
    }
}
