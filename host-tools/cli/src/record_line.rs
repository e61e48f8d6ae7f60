//! A record as a line of JSON, as `nova decode` and `nova listen` print it.

use anyhow::Result;
use nova_wire::{Event, Record, Statistics, Trouble};
use serde::Serialize;
use std::io::Write;

/// One line of output.
#[derive(Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Line<'a> {
    Trouble(&'a str),
    End(&'a Statistics),
    #[serde(untagged)]
    Record {
        sequence: u16,
        #[serde(skip_serializing_if = "is_zero")]
        lost: u16,
        #[serde(flatten)]
        record: &'a Record,
    },
}

fn is_zero(lost: &u16) -> bool {
    *lost == 0
}

impl<'a> From<&'a Event> for Line<'a> {
    fn from(event: &'a Event) -> Self {
        match event {
            Event::Record {
                sequence,
                lost,
                record,
            } => Self::Record {
                sequence: *sequence,
                lost: *lost,
                record,
            },
            Event::Trouble(trouble) => Self::Trouble(match trouble {
                Trouble::Corrupt => "corrupt",
                Trouble::Version(_) => "unknown protocol version",
                Trouble::Unknown(_) => "unknown record",
            }),
        }
    }
}

/// Where and when a line was heard, printed before what it says.
#[derive(Clone, Copy, Default, Serialize)]
pub(crate) struct Heard<'a> {
    /// The source, where there are several.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) source: Option<&'a str>,
    /// Address of the board that says it, once it has told.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) node: Option<u16>,
    /// The host's clock at arrival, seconds since 1970, where the source is live.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) arrival_s: Option<f64>,
}

/// Prints the line.
pub(crate) fn print(out: &mut impl Write, heard: Heard<'_>, line: &Line<'_>) -> Result<()> {
    #[derive(Serialize)]
    struct Whole<'a> {
        #[serde(flatten)]
        heard: Heard<'a>,
        #[serde(flatten)]
        line: &'a Line<'a>,
    }
    serde_json::to_writer(&mut *out, &Whole { heard, line })?;
    Ok(out.write_all(b"\n")?)
}
