//! Frames through wires that lose, change and add bytes.
#![allow(clippy::unwrap_used, clippy::indexing_slicing)]

use nova_wire::{
    Boot, Counters, Decoder, Encoder, Event, Filtered, MAX_FRAME_LEN, PROTOCOL_VERSION, Quality,
    Range, RangeFlags, Record, ResetCause, Role, SettingsSource, Status, Treatment, Trouble,
};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn range(k: u32) -> Record {
    Record::Range(Range {
        t_us: u64::from(k) * 3_333,
        peer: 0xBEEF,
        exchange: k as u8,
        raw_m: k as f32 * 0.01 - 1.0,
        bias_m: -0.0625,
        treatment: Treatment::Accepted,
        filtered: k.is_multiple_of(3).then_some(Filtered {
            range_m: k as f32 * 0.01,
            rate_m_per_s: 0.25,
            variance_m2: 0.001,
        }),
        clock_offset_ppm: 3.5,
        quality: (!k.is_multiple_of(5)).then_some(Quality {
            rx_power_dbm: -81.5,
            first_path_power_dbm: -83.25,
            noise: 44,
            preamble_count: 121,
            peak_delay_ns: 1.5,
            carrier_offset_ppm: 3.25,
            nlos_percent: k.is_multiple_of(2).then_some((k % 101) as u8),
        }),
        flags: RangeFlags::INITIATOR,
    })
}

fn boot() -> Record {
    Record::Boot(Boot {
        address: 1,
        pan: 0xDECA,
        role: Role::Anchor,
        firmware: [0, 1, 0],
        reset_cause: ResetCause::Watchdog,
        settings: SettingsSource::Stored,
    })
}

fn frames(records: &[Record]) -> Vec<Vec<u8>> {
    let mut encoder = Encoder::new();
    records
        .iter()
        .map(|r| encoder.encode(r, &mut [0; MAX_FRAME_LEN]).unwrap().to_vec())
        .collect()
}

fn decode(decoder: &mut Decoder, bytes: &[u8]) -> Vec<Event> {
    bytes.iter().filter_map(|&b| decoder.push(b)).collect()
}

fn records(events: &[Event]) -> Vec<Record> {
    events
        .iter()
        .filter_map(|e| match e {
            Event::Record { record, .. } => Some(*record),
            Event::Trouble(_) => None,
        })
        .collect()
}

#[test]
fn the_longest_record_fits() {
    let all = u32::MAX;
    let longest = Record::Status(Status {
        t_us: u64::MAX,
        address: u16::MAX,
        counters: Counters {
            ranges: all,
            no_response: all,
            unanswered_searches: all,
            no_final: all,
            no_report: all,
            superseded: all,
            send_too_late: all,
            send_time_mismatch: all,
            bad_stamps: all,
            unexpected_events: all,
            cut_off: all,
            damaged_frames: all,
            foreign_frames: all,
            others_frames: all,
            radio_resets: all,
            bus_errors: all,
            records_dropped: all,
            not_heard: all,
            implausible: all,
            out_of_time: all,
            polls_too_fast: all,
            slots_left_out: all,
            beacons_left_out: all,
            silences: all,
            bad_commands: all,
            refused_commands: all,
            settings_discarded: all,
            flash_errors: all,
            late_wakeups: all,
        },
    });
    let bytes = frames(&[longest]).concat();
    assert_eq!(records(&decode(&mut Decoder::new(), &bytes)), [longest]);
}

#[test]
fn missing_frames_are_counted_and_a_start_is_not_a_loss() {
    let mut sent = frames(&(0..10).map(range).collect::<Vec<_>>());
    sent.drain(3..6);
    sent.extend(frames(&[boot(), range(1)]));
    let mut decoder = Decoder::new();
    let events = decode(&mut decoder, &sent.concat());
    assert!(matches!(
        events[3],
        Event::Record {
            sequence: 6,
            lost: 3,
            ..
        }
    ));
    assert_eq!(decoder.statistics().lost, 3);
    assert_eq!(decoder.statistics().records, 9);
    assert_eq!(decoder.statistics().corrupt, 0);
}

#[test]
fn sequence_numbers_wrap_without_a_loss() {
    let many: Vec<_> = (0..66_000).map(range).collect();
    let mut decoder = Decoder::new();
    decode(&mut decoder, &frames(&many).concat());
    assert_eq!(decoder.statistics().records, 66_000);
    assert_eq!(decoder.statistics().lost, 0);
}

/// A frame around any payload, made without the encoder.
fn frame_around(payload: &[u8]) -> Vec<u8> {
    let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(payload);
    let mut bytes = payload.to_vec();
    bytes.extend(crc.to_le_bytes());
    let mut framed = vec![0];
    let mut stuffed = vec![0; bytes.len() + 2];
    let len = cobs::encode(&bytes, &mut stuffed);
    framed.extend(&stuffed[..len]);
    framed.push(0);
    framed
}

#[test]
fn records_and_versions_from_the_future_are_skipped_and_counted() {
    let mut decoder = Decoder::new();
    // Our version, sequence 0, variant 40, some content.
    let events = decode(
        &mut decoder,
        &frame_around(&[PROTOCOL_VERSION, 0, 40, 1, 2, 3]),
    );
    assert_eq!(events, [Event::Trouble(Trouble::Unknown(40))]);
    let next = PROTOCOL_VERSION + 1;
    let events = decode(&mut decoder, &frame_around(&[next, 1, 0, 9]));
    assert_eq!(events, [Event::Trouble(Trouble::Version(next))]);
    assert_eq!(decoder.statistics().unknown, 2);
    // An unknown record still has a number: nothing is missing after it.
    assert_eq!(decoder.statistics().lost, 0);
}

#[test]
fn all_record_numbers_up_to_the_last_are_known() {
    let trouble = |variant: u8| {
        let mut decoder = Decoder::new();
        decode(&mut decoder, &frame_around(&[PROTOCOL_VERSION, 0, variant]))
    };
    // Known numbers with nothing behind them are records cut short.
    for known in 0..=8 {
        assert_eq!(trouble(known), [Event::Trouble(Trouble::Corrupt)]);
    }
    assert_eq!(trouble(9), [Event::Trouble(Trouble::Unknown(9))]);
}

#[test]
fn a_capture_that_ends_inside_a_frame_says_so() {
    let bytes = frames(&[range(1), range(2)]).concat();
    let mut decoder = Decoder::new();
    decode(&mut decoder, &bytes[..bytes.len() - 5]);
    assert_eq!(decoder.finish(), Some(Event::Trouble(Trouble::Corrupt)));
    assert_eq!(decoder.finish(), None);
}

/// 10,000 frames, each with its fate: a flipped bit or several, cut short,
/// garbage behind it, or left alone. No wrong record comes out and every frame
/// that was left alone does.
#[test]
fn no_damage_makes_a_wrong_record_or_hides_a_good_one() {
    let mut rng = ChaCha8Rng::seed_from_u64(20_261_122);
    let sent: Vec<_> = (0..10_000).map(range).collect();
    let mut stream = Vec::new();
    let mut whole = Vec::new();
    for (record, mut frame) in sent.iter().zip(frames(&sent)) {
        match rng.random_range(0..5) {
            0 => {
                for _ in 0..rng.random_range(1..=4) {
                    let bit = rng.random_range(0..frame.len() * 8);
                    frame[bit / 8] ^= 1 << (bit % 8);
                }
            }
            1 => frame.truncate(rng.random_range(0..frame.len() - 1)),
            2 => {
                let n = rng.random_range(1..600);
                frame.extend((0..n).map(|_| rng.random::<u8>()));
                whole.push(*record);
            }
            _ => whole.push(*record),
        }
        stream.extend(frame);
    }
    let mut decoder = Decoder::new();
    let got = records(&decode(&mut decoder, &stream));
    // Flipped bits that undo each other, or hit only the zero bytes around a
    // frame, leave it readable: such frames may come out as well, unchanged.
    let mut due = sent.iter();
    for record in &got {
        assert!(due.any(|s| s == record), "a record nobody sent: {record:?}");
    }
    let mut found = got.iter();
    for record in &whole {
        assert!(found.any(|g| g == record), "a good frame was missed");
    }
    println!(
        "{} of {} frames left alone, {} records found, {:?}",
        whole.len(),
        sent.len(),
        got.len(),
        decoder.statistics()
    );
}

#[test]
fn every_single_flipped_bit_is_noticed() {
    let sent = [range(7), range(8), range(9)];
    let frames = frames(&sent);
    let victim = 1;
    for bit in 0..frames[victim].len() * 8 {
        let mut damaged = frames.clone();
        damaged[victim][bit / 8] ^= 1 << (bit % 8);
        let got = records(&decode(&mut Decoder::new(), &damaged.concat()));
        assert!(
            got.contains(&sent[0]) && got.contains(&sent[2]),
            "bit {bit}"
        );
        assert!(got.iter().all(|r| sent.contains(r)), "bit {bit}");
    }
}

proptest! {
    #[test]
    fn any_bytes_are_taken_without_panic(bytes: Vec<u8>) {
        let mut decoder = Decoder::new();
        for &b in &bytes {
            decoder.push(b);
        }
        decoder.finish();
        prop_assert_eq!(decoder.statistics().bytes, bytes.len() as u64);
    }

    /// A reader that missed the beginning finds all frames that come whole.
    #[test]
    fn a_reader_may_start_anywhere(skip in 0usize..200) {
        let sent: Vec<_> = (0..8).map(range).collect();
        let bytes = frames(&sent).concat();
        let got = records(&decode(&mut Decoder::new(), &bytes[skip.min(bytes.len())..]));
        prop_assert!(sent.ends_with(&got));
        prop_assert!(got.len() + 1 + skip / 30 >= sent.len());
    }
}
