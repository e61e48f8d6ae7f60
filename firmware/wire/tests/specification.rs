//! The examples in docs/wire-format.md are what encoder and decoder do.
#![allow(clippy::unwrap_used)]

use nova_wire::{
    Boot, Counters, Decoder, Encoder, Event, Filtered, MAX_FRAME_LEN, PROTOCOL_VERSION, Quality,
    Range, RangeFlags, Record, ResetCause, Role, SettingsSource, Status, Treatment,
};

const PAGE: &str = include_str!("../../../docs/wire-format.md");

/// The bytes of the code blocks of this kind, hexadecimal words at the start
/// of each line.
fn blocks(kind: &str) -> Vec<Vec<u8>> {
    PAGE.split(&format!("```{kind}\n"))
        .skip(1)
        .map(|rest| {
            let block = rest.split("```").next().unwrap();
            block
                .lines()
                .flat_map(|line| {
                    line.split(' ')
                        .map_while(|word| u8::from_str_radix(word, 16).ok())
                        .collect::<Vec<_>>()
                })
                .collect()
        })
        .collect()
}

fn records() -> [Record; 3] {
    [
        Record::Boot(Boot {
            address: 0x0A1B,
            pan: 0xDECA,
            role: Role::Anchor,
            firmware: [0, 1, 0],
            reset_cause: ResetCause::Watchdog,
            settings: SettingsSource::Stored,
        }),
        Record::Range(Range {
            t_us: 1_234_567,
            peer: 0x0102,
            exchange: 200,
            raw_m: 12.5,
            bias_m: -0.0625,
            treatment: Treatment::Accepted,
            filtered: Some(Filtered {
                range_m: 12.25,
                rate_m_per_s: -0.5,
                variance_m2: 0.0625,
            }),
            clock_offset_ppm: -3.0,
            quality: Some(Quality {
                rx_power_dbm: -81.5,
                first_path_power_dbm: -83.25,
                noise: 44,
                preamble_count: 121,
                peak_delay_ns: 1.5,
                carrier_offset_ppm: -3.125,
                nlos_percent: Some(7),
            }),
            flags: RangeFlags::INITIATOR,
        }),
        Record::Status(Status {
            t_us: 10_000_000,
            address: 0x0A1B,
            counters: Counters {
                ranges: 1000,
                no_response: 3,
                unanswered_searches: 16,
                no_final: 0,
                no_report: 2,
                superseded: 0,
                send_too_late: 1,
                send_time_mismatch: 0,
                bad_stamps: 0,
                unexpected_events: 0,
                cut_off: 4,
                damaged_frames: 5,
                foreign_frames: 6,
                others_frames: 7,
                radio_resets: 8,
                bus_errors: 9,
                records_dropped: 300,
                not_heard: 10,
                implausible: 11,
                out_of_time: 12,
                polls_too_fast: 13,
                slots_left_out: 14,
                beacons_left_out: 15,
                silences: 16,
                bad_commands: 1,
                refused_commands: 2,
                settings_discarded: 0,
                flash_errors: 0,
                late_wakeups: 17,
            },
        }),
    ]
}

#[test]
fn the_specified_frames_are_what_the_encoder_makes_and_the_decoder_reads() {
    let frames = blocks("frame");
    assert_eq!(frames.len(), 3);
    let mut encoder = Encoder::new();
    let mut decoder = Decoder::new();
    for (frame, record) in frames.iter().zip(records()) {
        let mut buffer = [0; MAX_FRAME_LEN];
        assert_eq!(encoder.encode(&record, &mut buffer).unwrap(), frame);
        let read: Vec<Event> = frame.iter().filter_map(|&b| decoder.push(b)).collect();
        assert!(matches!(read[..], [Event::Record { record: r, lost: 0, .. }] if r == record));
    }
}

#[test]
fn the_specified_contents_are_those_of_the_frames() {
    let contents: Vec<_> = blocks("text")
        .into_iter()
        .filter(|bytes| bytes.first() == Some(&PROTOCOL_VERSION))
        .collect();
    assert_eq!(contents.len(), 3);
    for (frame, content) in blocks("frame").iter().zip(contents) {
        let mut stuffed = frame[1..frame.len() - 1].to_vec();
        let len = cobs::decode_in_place(&mut stuffed).unwrap();
        assert_eq!(stuffed[..len], content[..]);
    }
}
