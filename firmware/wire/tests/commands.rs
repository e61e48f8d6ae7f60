//! Commands through a wire, and docs/wire-format.md about them.
#![allow(clippy::unwrap_used, clippy::panic)]

use nova_wire::settings::{
    Addresses, Fallback, Kind, MAX_ADDRESSES, MAX_SETTINGS, SETTINGS, Setting,
};
use nova_wire::{
    Answer, Change, Changes, Command, CommandDecoder, CommandEvent, Decoder, Encoder, Event,
    MAX_FRAME_LEN, Outcome, Record, Refusal, SettingValue, Trouble, Value,
};
use proptest::prelude::*;

const PAGE: &str = include_str!("../../../docs/wire-format.md");

fn events(bytes: &[u8]) -> Vec<CommandEvent> {
    let mut decoder = CommandDecoder::new();
    bytes.iter().filter_map(|&b| decoder.push(b)).collect()
}

fn framed(sequence: u16, command: &Command) -> Vec<u8> {
    Encoder::starting_at(sequence)
        .encode(command, &mut [0; MAX_FRAME_LEN])
        .unwrap()
        .to_vec()
}

fn change(setting: Setting, value: Value) -> Change {
    Change {
        setting: setting.number(),
        value: Some(value),
    }
}

#[test]
fn a_command_that_sets_everything_to_its_longest_value_fits_a_frame() {
    let longest = SETTINGS.iter().map(|description| {
        let value = match description.kind {
            Kind::Number { most, .. } => Value::Number(most),
            Kind::Identifier { most, .. } => Value::Number(most.into()),
            Kind::OneOf { numbers, .. } => Value::Number(*numbers.last().unwrap()),
            Kind::Word(words) => Value::Number(words.len() as u32 - 1),
            Kind::Addresses { .. } => {
                Value::Addresses(Addresses::new(&[0xFFFD; MAX_ADDRESSES]).unwrap())
            }
        };
        change(description.setting, value)
    });
    let command = Command::Set(longest.collect());
    let read = events(&framed(0, &command));
    assert!(matches!(&read[..], [CommandEvent::Record { record, .. }] if *record == command));
}

#[test]
fn more_changes_than_a_node_takes_are_no_command() {
    let mut changes = Changes::new();
    for _ in 0..MAX_SETTINGS {
        let none = Change {
            setting: 0,
            value: None,
        };
        changes.push(none).unwrap();
    }
    let bytes = framed(0, &Command::Set(changes));
    assert!(matches!(events(&bytes)[..], [CommandEvent::Record { .. }]));
    // One more, as a host with a longer list would send it.
    let mut payload = postcard::to_stdvec(&(
        nova_wire::PROTOCOL_VERSION,
        0_u16,
        1_u32,
        vec![(0_u8, None::<Value>); MAX_SETTINGS + 1],
    ))
    .unwrap();
    let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(&payload);
    payload.extend(crc.to_le_bytes());
    let mut stuffed = vec![0; payload.len() + 2];
    let len = cobs::encode(&payload, &mut stuffed);
    stuffed.truncate(len);
    stuffed.push(0);
    assert_eq!(events(&stuffed), [CommandEvent::Trouble(Trouble::Corrupt)]);
}

#[test]
fn a_host_that_starts_at_another_number_loses_nothing() {
    let bytes = [framed(7, &Command::Get), framed(40_000, &Command::Status)].concat();
    assert!(matches!(
        events(&bytes)[..],
        [
            CommandEvent::Record {
                sequence: 7,
                lost: 0,
                record: Command::Get
            },
            CommandEvent::Record {
                sequence: 40_000,
                lost: 0,
                record: Command::Status
            },
        ]
    ));
}

/// The bytes of the block of this kind on the page.
fn block(kind: &str) -> Vec<u8> {
    let rest = PAGE.split(&format!("```{kind}\n")).nth(1).unwrap();
    rest.split("```")
        .next()
        .unwrap()
        .split_whitespace()
        .map(|word| u8::from_str_radix(word, 16).unwrap())
        .collect()
}

#[test]
fn the_specified_command_is_what_the_encoder_makes_and_its_answer_is_read() {
    let command = Command::Set(
        [
            change(Setting::Part, Value::Number(1)),
            change(
                Setting::Peers,
                Value::Addresses(Addresses::new(&[0x0A1B, 0x0102]).unwrap()),
            ),
            Change {
                setting: Setting::PeriodUs.number(),
                value: None,
            },
        ]
        .into_iter()
        .collect(),
    );
    assert_eq!(block("command"), framed(513, &command));

    let mut decoder = Decoder::new();
    let read: Vec<Event> = (block("answer").into_iter())
        .filter_map(|b| decoder.push(b))
        .collect();
    let refused = Record::Answer(Answer {
        command: 513,
        outcome: Outcome::Refused(Refusal::OutOfRange {
            setting: 4,
            least: 1000,
            most: 60_000_000,
        }),
    });
    assert!(matches!(read[..], [Event::Record { record, .. }] if record == refused));
}

/// A row of the page's table of settings.
fn row(description: &nova_wire::settings::Description) -> String {
    let what = match description.kind {
        Kind::Number { least, most, unit } => format!("{least} to {most} {unit}"),
        Kind::Identifier { least, most } => format!("0x{least:04X} to 0x{most:04X}"),
        Kind::OneOf { numbers, unit } => {
            let numbers: Vec<String> = numbers.iter().map(u32::to_string).collect();
            format!("{} {unit}", numbers.join(", "))
        }
        Kind::Word(words) => (0..)
            .zip(words)
            .map(|(place, word)| format!("{place} {word}"))
            .collect::<Vec<_>>()
            .join(", "),
        Kind::Addresses { most } => {
            format!("up to {most} addresses, 0x0001 to 0xFFFD each, none twice")
        }
    };
    let default = match (description.default, description.kind) {
        (Fallback::Board(how), _) => how.to_owned(),
        (Fallback::Value(Value::Number(number)), Kind::Identifier { .. }) => {
            format!("0x{number:04X}")
        }
        (Fallback::Value(Value::Number(number)), _) => number.to_string(),
        (Fallback::Value(Value::Addresses(_)), _) => "none".to_owned(),
    };
    format!(
        "| {} | `{}` | {} | {default} | {} |",
        description.setting.number(),
        description.name,
        what.trim_end(),
        description.meaning
    )
}

#[test]
fn the_page_lists_the_settings_as_they_are() {
    let rows: Vec<String> = SETTINGS.iter().map(row).collect();
    let table = rows.join("\n") + "\n\n";
    assert!(PAGE.contains(&table), "the page should say:\n{table}");
}

fn any_value() -> impl Strategy<Value = Value> {
    prop_oneof![
        any::<u32>().prop_map(Value::Number),
        prop::collection::vec(any::<u16>(), 0..=MAX_ADDRESSES)
            .prop_map(|list| Value::Addresses(Addresses::new(&list).unwrap())),
    ]
}

proptest! {
    #[test]
    fn what_a_host_sends_is_what_a_node_reads(
        sequence: u16,
        changes in prop::collection::vec((any::<u8>(), prop::option::of(any_value())), 0..=4),
    ) {
        let changes = changes.into_iter().map(|(setting, value)| Change { setting, value });
        let command = Command::Set(changes.collect());
        let read = events(&framed(sequence, &command));
        prop_assert_eq!(read, [CommandEvent::Record { sequence, lost: 0, record: command }]);
    }

    #[test]
    fn what_a_node_answers_is_what_a_host_reads(setting: u8, value in any_value(), set: bool) {
        let record = Record::Setting(SettingValue { setting, value, set });
        let mut decoder = Decoder::new();
        let mut buffer = [0; MAX_FRAME_LEN];
        let bytes = Encoder::new().encode(&record, &mut buffer).unwrap();
        let read: Vec<Event> = bytes.iter().filter_map(|&b| decoder.push(b)).collect();
        prop_assert_eq!(read, [Event::Record { sequence: 0, lost: 0, record }]);
    }

    /// Damage that its check sequence does not show would set settings: none
    /// gets through in any number of flipped bits that CRC-32 is sure to notice.
    #[test]
    fn damage_makes_no_command(
        sequence: u16, number: u32, bits in prop::collection::btree_set(0_usize..120, 1..=3),
    ) {
        let command = Command::Set(core::iter::once(change(Setting::Pan, Value::Number(number))).collect());
        let mut bytes = framed(sequence, &command);
        let inner = bytes.len() - 2;
        for bit in bits {
            let bit = bit % (inner * 8);
            bytes[1 + bit / 8] ^= 1 << (bit % 8);
        }
        for event in events(&bytes) {
            if let CommandEvent::Record { record, .. } = event {
                prop_assert_eq!(record, command.clone());
            }
        }
    }

    #[test]
    fn any_bytes_are_taken_without_panic(bytes: Vec<u8>) {
        for event in events(&bytes) {
            if let CommandEvent::Record { record: Command::Set(changes), .. } = event {
                prop_assert!(changes.len() <= MAX_SETTINGS);
            }
        }
    }
}
