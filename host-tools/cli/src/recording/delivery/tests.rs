#![allow(clippy::unwrap_used)]

use super::*;
use crate::recording::file::play;
use crate::recording::schema::check::every_message_fits_its_schema;
use mcap::{MessageStream, Writer};
use nova_flight::delivery::{FilterKind, deliver};
use proptest::prelude::*;
use std::io::Cursor;
use std::sync::OnceLock;

/// A short flight, or its beginning, as a file; and what its filter said.
struct Made {
    file: Vec<u8>,
    said: Vec<u8>,
}

fn make(filter: FilterKind, until_s: f64) -> Made {
    let scenario = Scenario {
        height_m: 12.0,
        radius_m: 2.0,
        distance_m: 20.0,
        filter,
        return_trip: false,
        ..Scenario::default()
    };
    let mut recording = Recording::new(&scenario, 8000).unwrap();
    let mut said = Vec::new();
    deliver(&scenario, 8000, |event| {
        let t_s = match event {
            Event::Input(record) => record.t_s,
            Event::Estimate(record) => record.t_s,
            Event::Autopilot(record) => record.t_s,
            Event::Marker(record) => record.t_s,
            Event::Uwb(record) => record.t_s,
            Event::Begin(_) | Event::Sample(_) => 0.0,
        };
        if t_s > until_s {
            return;
        }
        recording.add(event);
        if let Event::Estimate(estimate) = event {
            serde_json::to_writer(&mut said, estimate).unwrap();
            said.push(b'\n');
        }
    })
    .unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.mcap");
    recording.finish(&path).unwrap();
    Made {
        file: std::fs::read(path).unwrap(),
        said,
    }
}

fn short() -> &'static Made {
    static MADE: OnceLock<Made> = OnceLock::new();
    MADE.get_or_init(|| make(FilterKind::ErrorState, 1.0))
}

fn replayed(bytes: &[u8]) -> Result<Vec<u8>> {
    let mut out = Vec::new();
    let begin = |place: &Place<'_>, data: &[u8]| {
        let flight = Flight::begin(place, data)?;
        Ok(Some(Box::new(flight) as Box<dyn Player>))
    };
    play("flight.mcap", bytes, begin, &mut out).map(|()| out)
}

#[test]
fn a_replay_says_what_the_flight_said_byte_for_byte_with_either_filter() {
    for filter in [FilterKind::ErrorState, FilterKind::Paper] {
        let made = make(filter, f64::INFINITY);
        let lines = made.said.iter().filter(|byte| **byte == b'\n').count();
        assert!(lines > 1000, "{lines}");
        let messages = MessageStream::new(&made.file).unwrap();
        let topics: Vec<String> = messages.map(|m| m.unwrap().channel.topic.clone()).collect();
        for topic in TOPICS {
            assert!(topics.iter().any(|t| t == topic.name), "{}", topic.name);
        }
        assert!(replayed(&made.file).unwrap() == made.said);
    }
}

#[test]
fn messages_have_the_fields_of_their_schemas() {
    every_message_fits_its_schema(&make(FilterKind::ErrorState, f64::INFINITY).file);
}

#[test]
fn another_programs_recording_is_told_from_ours() {
    let mut writer = Writer::new(Cursor::new(Vec::new())).unwrap();
    writer.finish().unwrap();
    let error = replayed(&writer.into_inner().into_inner()).unwrap_err();
    assert!(error.to_string().contains("nothing in it"), "{error}");
}

proptest! {
    #[test]
    fn a_cut_recording_is_an_error(part in 0.0..1.0f64) {
        let file = &short().file;
        let cut = (part * file.len() as f64) as usize;
        let error = replayed(&file[..cut]).unwrap_err();
        prop_assert!(error.downcast_ref::<crate::error::BadInput>().is_some(), "{error:?}");
    }

    #[test]
    fn a_spoilt_byte_is_an_error_or_was_no_part_of_the_flight(part in 0.0..1.0f64, flip in 1..=255u8) {
        let made = short();
        let mut file = made.file.clone();
        let at = (part * file.len() as f64) as usize;
        file[at] ^= flip;
        match replayed(&file) {
            Ok(said) => prop_assert!(said == made.said),
            Err(error) => prop_assert!(error.downcast_ref::<crate::error::BadInput>().is_some(), "{error:?}"),
        }
    }
}
