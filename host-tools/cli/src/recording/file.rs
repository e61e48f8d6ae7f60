//! MCAP files: JSON messages, each topic with its JSON Schema, so that common viewers open them.
//!
//! Not compressed: the compressions of MCAP are C libraries.

use super::schema::Topic;
use crate::error::bad_input;
use anyhow::{Context, Result};
use mcap::io::MessageReader;
use mcap::records::{MessageHeader, Metadata};
use mcap::sans_io::LinearReaderOptions;
use mcap::write::NoSeek;
use mcap::{WriteOptions, Writer};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::collections::BTreeMap;
use std::io::Write;

/// A recording that is being made.
pub(crate) struct Recorder<W: Write> {
    writer: Writer<NoSeek<W>>,
    channels: BTreeMap<&'static str, u16>,
    sequence: u32,
    /// The first error; nothing is written after it.
    failed: Option<anyhow::Error>,
}

impl<W: Write> Recorder<W> {
    /// Begins one with these topics.
    pub(crate) fn new(to: W, topics: &'static [Topic]) -> Result<Self> {
        /// What a program that is killed leaves behind ends with a whole chunk: small ones lose little.
        const CHUNK_BYTES: u64 = 1 << 16;
        let options = WriteOptions::new()
            .compression(None)
            .chunk_size(Some(CHUNK_BYTES))
            .disable_seeking(true);
        let mut writer = options.create(NoSeek::new(to))?;
        let mut channels = BTreeMap::new();
        for topic in topics {
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

    /// Adds what is of no time.
    pub(crate) fn metadata(
        &mut self,
        name: &str,
        metadata: BTreeMap<String, String>,
    ) -> Result<()> {
        let name = name.to_owned();
        Ok(self.writer.write_metadata(&Metadata { name, metadata })?)
    }

    /// Adds a message at `t_s`, seconds; an error comes out of [`Self::finish`].
    pub(crate) fn message(&mut self, topic: &str, t_s: f64, record: &impl Serialize) {
        if self.failed.is_none() {
            self.failed = self.write(topic, t_s, record).err();
        }
    }

    fn write(&mut self, topic: &str, t_s: f64, record: &impl Serialize) -> Result<()> {
        let &channel_id = (self.channels.get(topic)).context("a topic without channel")?;
        // The conversion ends at the ends of u64.
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

    /// Whether something could not be written; nothing is any more.
    pub(crate) fn has_failed(&self) -> bool {
        self.failed.is_some()
    }

    /// What it was written to, once all is written.
    pub(crate) fn finish(mut self) -> Result<W> {
        if let Some(error) = self.failed {
            return Err(error);
        }
        self.writer.finish()?;
        Ok(self.writer.into_inner().into_inner())
    }
}

/// What takes a recording's messages again, and prints what it says to them.
pub(crate) trait Player {
    /// Takes a message.
    ///
    /// # Errors
    /// `BadInput` that says where and why it cannot be taken; those of `out`.
    fn take(&mut self, place: &Place<'_>, data: &[u8], out: &mut dyn Write) -> Result<()>;
}

/// Plays a recording to what `begin` makes of the message that it begins with.
///
/// # Errors
/// `BadInput` that says where and why the recording cannot be played; those of `out`.
pub(crate) fn play(
    name: &str,
    bytes: &[u8],
    begin: impl Fn(&Place<'_>, &[u8]) -> Result<Option<Box<dyn Player>>>,
    out: &mut impl Write,
) -> Result<()> {
    // CRCs are checked before a chunk's records are: the reader computes with their lengths unchecked.
    let options = LinearReaderOptions::default()
        .with_prevalidate_chunk_crcs(true)
        .with_validate_data_section_crc(true)
        .with_validate_summary_section_crc(true)
        .with_record_length_limit(bytes.len());
    let messages = MessageReader::new_with_options(bytes, options);
    let mut player: Option<Box<dyn Player>> = None;
    for (number, message) in (1..).zip(messages) {
        let message = message.map_err(|error| {
            bad_input!("{name}: cut or spoilt at message {number}: {error}; record it anew")
        })?;
        let place = Place {
            name,
            number,
            topic: &message.channel.topic,
        };
        match &mut player {
            Some(player) => player.take(&place, &message.data, out)?,
            None => player = begin(&place, &message.data)?,
        }
    }
    match player {
        Some(_) => Ok(out.flush()?),
        None => Err(bad_input!("{name}: nothing in it that could be replayed")),
    }
}

/// Where in a recording.
pub(crate) struct Place<'a> {
    name: &'a str,
    number: u64,
    pub(crate) topic: &'a str,
}

impl Place<'_> {
    /// What a message holds.
    pub(crate) fn parse<T: DeserializeOwned>(&self, text: &[u8]) -> Result<T> {
        serde_json::from_slice(text).map_err(|error| self.fault(&error))
    }

    /// What is wrong here.
    pub(crate) fn fault(&self, what: &dyn std::fmt::Display) -> anyhow::Error {
        let Self {
            name,
            number,
            topic,
        } = self;
        bad_input!("{name}: message {number} ({topic}): {what}")
    }
}
