//! Recordings of deliveries as MCAP files: JSON messages, each topic with its JSON Schema, so that common viewers open them.
//!
//! ```text
//!   /begin  /input  /autopilot  /marker  /uwb ──► the filter ──► /estimate          /flight (truth beside estimate)
//! ```
//!
//! Not compressed: the compressions of MCAP are C libraries.

mod schema;
#[cfg(test)]
mod tests;

use crate::error::bad_input;
use crate::files::write_whole;
use anyhow::{Context, Result};
use mcap::io::MessageReader;
use mcap::records::{MessageHeader, Metadata};
use mcap::sans_io::LinearReaderOptions;
use mcap::{WriteOptions, Writer};
use nova_flight::delivery::{Event, Lander, Scenario};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::collections::BTreeMap;
use std::io::{Cursor, Write};
use std::path::Path;

/// A recording that is being made. It is kept in memory until it is whole.
pub(crate) struct Recording {
    writer: Writer<Cursor<Vec<u8>>>,
    channels: BTreeMap<&'static str, u16>,
    sequence: u32,
    /// The first error; nothing is written after it.
    failed: Option<anyhow::Error>,
}

impl Recording {
    /// Begins one; the scenario and the seed go in as metadata.
    pub(crate) fn new(scenario: &Scenario, seed: u64) -> Result<Self> {
        let options = WriteOptions::new().compression(None);
        let mut writer = options.create(Cursor::new(Vec::new()))?;
        let metadata = BTreeMap::from([
            ("scenario".to_owned(), serde_json::to_string(scenario)?),
            ("seed".to_owned(), seed.to_string()),
        ]);
        writer.write_metadata(&Metadata {
            name: "delivery".to_owned(),
            metadata,
        })?;
        let mut channels = BTreeMap::new();
        for topic in schema::TOPICS {
            let text = serde_json::to_vec(&topic.schema())?;
            let schema = writer.add_schema(topic.title, "jsonschema", &text)?;
            let channel = writer.add_channel(schema, topic.name, "json", &BTreeMap::new())?;
            channels.insert(topic.name, channel);
        }
        Ok(Self {
            writer,
            channels,
            sequence: 0,
            failed: None,
        })
    }

    /// Adds a record; an error comes out of [`Self::finish`].
    pub(crate) fn add(&mut self, event: &Event) {
        if self.failed.is_some() {
            return;
        }
        let added = match event {
            Event::Begin(begin) => self.message("/begin", 0.0, begin),
            Event::Input(record) => self.message("/input", record.t_s, record),
            Event::Autopilot(record) => self.message("/autopilot", record.t_s, record),
            Event::Marker(record) => self.message("/marker", record.t_s, record),
            Event::Uwb(record) => self.message("/uwb", record.t_s, record),
            Event::Estimate(record) => self.message("/estimate", record.t_s, record),
            Event::Sample(sample) => self.message("/flight", sample.t_s, sample),
        };
        self.failed = added.err();
    }

    fn message(&mut self, topic: &str, t_s: f64, record: &impl Serialize) -> Result<()> {
        let &channel_id = self
            .channels
            .get(topic)
            .context("a topic without channel")?;
        // Seconds since take-off; the conversion ends at the ends of u64.
        let log_time = (t_s * 1e9).round() as u64;
        let header = MessageHeader {
            channel_id,
            sequence: self.sequence,
            log_time,
            publish_time: log_time,
        };
        self.sequence = self.sequence.wrapping_add(1);
        let text = serde_json::to_vec(record)?;
        Ok(self.writer.write_to_known_channel(&header, &text)?)
    }

    /// Writes the file, whole or not at all.
    pub(crate) fn finish(mut self, path: &Path) -> Result<()> {
        if let Some(error) = self.failed {
            return Err(error.context("the recording"));
        }
        self.writer.finish()?;
        write_whole(path, self.writer.into_inner().into_inner())
    }
}

/// Feeds a recording to its filter again and writes the estimates as JSON lines.
///
/// # Errors
/// `BadInput` that says where and why the recording cannot be replayed; those of `out`.
pub(crate) fn replay(name: &str, bytes: &[u8], out: &mut impl Write) -> Result<()> {
    // CRCs are checked before a chunk's records are: the reader computes with their lengths unchecked.
    let options = LinearReaderOptions::default()
        .with_prevalidate_chunk_crcs(true)
        .with_validate_data_section_crc(true)
        .with_validate_summary_section_crc(true)
        .with_record_length_limit(bytes.len());
    let messages = MessageReader::new_with_options(bytes, options);
    let mut lander: Option<Lander> = None;
    for (number, message) in (1..).zip(messages) {
        let message = message.map_err(|error| {
            bad_input!("{name}: cut or spoilt at message {number}: {error}; record it anew")
        })?;
        let place = Place {
            name,
            number,
            topic: &message.channel.topic,
        };
        let event = match (place.topic, &lander) {
            ("/begin", None) => {
                let begin: nova_flight::delivery::Begin = place.parse(&message.data)?;
                lander = Some(begin.lander().map_err(|fault| place.fault(&fault))?);
                continue;
            }
            ("/begin", Some(_)) => return Err(place.fault(&"a second beginning")),
            ("/input", _) => Event::Input(place.parse(&message.data)?),
            ("/autopilot", _) => Event::Autopilot(place.parse(&message.data)?),
            ("/marker", _) => Event::Marker(place.parse(&message.data)?),
            ("/uwb", _) => Event::Uwb(place.parse(&message.data)?),
            // What the filter said, the truth, and what others have added.
            _ => continue,
        };
        let lander = (lander.as_mut()).ok_or_else(|| {
            place.fault(
                &"comes before /begin; only what nova deliver --record wrote can be replayed",
            )
        })?;
        lander.take(&event).map_err(|fault| place.fault(&fault))?;
        if let Event::Input(input) = event {
            serde_json::to_writer(&mut *out, &lander.estimate(input.t_s))?;
            writeln!(out)?;
        }
    }
    match lander {
        Some(_) => Ok(out.flush()?),
        None => Err(bad_input!(
            "{name}: no delivery in it; only what nova deliver --record wrote can be replayed"
        )),
    }
}

/// Where in a recording.
struct Place<'a> {
    name: &'a str,
    number: u64,
    topic: &'a str,
}

impl Place<'_> {
    fn parse<T: DeserializeOwned>(&self, text: &[u8]) -> Result<T> {
        serde_json::from_slice(text).map_err(|error| self.fault(&error))
    }

    fn fault(&self, what: &dyn std::fmt::Display) -> anyhow::Error {
        let Self {
            name,
            number,
            topic,
        } = self;
        bad_input!("{name}: message {number} ({topic}): {what}")
    }
}
