//! Lines for programs and for logs.

use super::model::{Board, seconds};
use crate::node_address::hex;
use crate::record_line::{Heard, Line, print};
use anyhow::Result;
use nova_wire::{Event, Range, Record, Treatment, Trouble};
use std::io::Write;

/// How lines look.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Format {
    /// For people.
    Text,
    /// One object a record.
    Json,
    /// One line a range.
    Csv,
}

/// Lines, written to `out`.
pub(super) struct Lines<W> {
    out: W,
    format: Format,
    /// Say which source a line is of.
    several: bool,
}

impl<W: Write> Lines<W> {
    pub(super) fn begin(mut out: W, format: Format, several: bool) -> Result<Self> {
        if format == Format::Csv {
            writeln!(
                out,
                "t_s,node,peer,exchange,raw_m,treatment,filtered_m,filtered_sigma_m,rate_m_per_s,\
                 rx_power_dbm,first_path_power_dbm,noise,preamble_count,peak_delay_ns,nlos_percent,\
                 clock_offset_ppm,carrier_offset_ppm,flags,arrival_s"
            )?;
        }
        Ok(Self {
            out,
            format,
            several,
        })
    }

    /// A frame of a board; `arrival_s` where it is live.
    pub(super) fn event(
        &mut self,
        board: &Board,
        event: &Event,
        arrival_s: Option<f64>,
    ) -> Result<()> {
        match (self.format, event) {
            (Format::Json, _) => {
                let heard = Heard {
                    source: self.several.then_some(board.name.as_str()),
                    node: board.address,
                    arrival_s,
                };
                print(&mut self.out, heard, &Line::from(event))
            }
            (
                Format::Csv,
                Event::Record {
                    record: Record::Range(range),
                    ..
                },
            ) => Ok(writeln!(
                self.out,
                "{}",
                comma_separated(board.address, range, arrival_s)
            )?),
            (Format::Csv, _) => Ok(()),
            (Format::Text, _) => Ok(writeln!(self.out, "{}", sentence(board, event))?),
        }
    }

    /// A source is lost or back: for people only.
    pub(super) fn remark(&mut self, remark: &str) -> Result<()> {
        if self.format == Format::Text {
            writeln!(self.out, "{remark}")?;
        }
        Ok(())
    }

    /// The counts of a source that is done with.
    pub(super) fn end(&mut self, board: &Board) -> Result<()> {
        let wire = &board.wire;
        match self.format {
            Format::Csv => Ok(()),
            Format::Json => {
                let heard = Heard {
                    source: self.several.then_some(board.name.as_str()),
                    node: board.address,
                    arrival_s: None,
                };
                print(&mut self.out, heard, &Line::End(wire))
            }
            Format::Text => Ok(writeln!(self.out, "{}", summary(board))?),
        }
    }

    pub(super) fn flush(&mut self) -> Result<()> {
        Ok(self.out.flush()?)
    }
}

/// What a source has brought, in one line.
pub(super) fn summary(board: &Board) -> String {
    let wire = &board.wire;
    format!(
        "{}: {} records, {} lost, {} corrupt, {} unknown, {} bytes",
        board.name, wire.records, wire.lost, wire.corrupt, wire.unknown, wire.bytes
    )
}

fn comma_separated(node: Option<u16>, range: &Range, arrival_s: Option<f64>) -> String {
    let filtered = range.filtered.as_ref();
    let quality = range.quality.as_ref();
    [
        format!("{:.6}", seconds(range.t_us)),
        optional(node),
        range.peer.to_string(),
        range.exchange.to_string(),
        number(Some(range.raw_m)),
        treatment(range.treatment).to_owned(),
        number(filtered.map(|f| f.range_m)),
        number(filtered.map(|f| f.variance_m2.sqrt())),
        number(filtered.map(|f| f.rate_m_per_s)),
        number(quality.map(|q| q.rx_power_dbm)),
        number(quality.map(|q| q.first_path_power_dbm)),
        optional(quality.map(|q| q.noise)),
        optional(quality.map(|q| q.preamble_count)),
        number(quality.map(|q| q.peak_delay_ns)),
        optional(quality.and_then(|q| q.nlos_percent)),
        number(Some(range.clock_offset_ppm)),
        number(quality.map(|q| q.carrier_offset_ppm)),
        range.flags.0.to_string(),
        arrival_s.map(|t| format!("{t:.6}")).unwrap_or_default(),
    ]
    .join(",")
}

/// The word that JSON has for it, too.
fn treatment(treatment: Treatment) -> &'static str {
    match treatment {
        Treatment::NotFiltered => "not_filtered",
        Treatment::Started => "started",
        Treatment::Accepted => "accepted",
        Treatment::DownWeighted => "down_weighted",
        Treatment::RejectedOutlier => "rejected_outlier",
        Treatment::RejectedNlos => "rejected_nlos",
        Treatment::RejectedInvalid => "rejected_invalid",
        Treatment::Reacquired => "reacquired",
    }
}

/// Empty where it is missing, or not a number.
fn number(value: Option<f32>) -> String {
    optional(value.filter(|value| value.is_finite()))
}

fn optional(value: Option<impl ToString>) -> String {
    value.map(|value| value.to_string()).unwrap_or_default()
}

fn sentence(board: &Board, event: &Event) -> String {
    let node = board.address.map_or_else(|| board.name.clone(), hex);
    let (lost, record) = match event {
        Event::Record { lost, record, .. } => (*lost, record),
        Event::Trouble(Trouble::Corrupt) => return format!("{node}: a damaged frame"),
        Event::Trouble(Trouble::Version(version)) => {
            return format!("{node}: a frame of protocol version {version}, not known here");
        }
        Event::Trouble(Trouble::Unknown(record)) => {
            return format!("{node}: a record of kind {record}, not known here");
        }
    };
    let said = match record {
        Record::Range(range) => {
            let mut said = format!(
                "{:.3} s: {:.3} m to {}",
                seconds(range.t_us),
                range.raw_m,
                hex(range.peer)
            );
            if let Some(filtered) = &range.filtered {
                said += &format!(", {:.3} m filtered", filtered.range_m);
            }
            if let Some(quality) = &range.quality {
                said += &format!(", {:.1} dBm", quality.rx_power_dbm);
            }
            said
        }
        Record::Status(status) => format!(
            "{:.3} s: {} ranges so far",
            seconds(status.t_us),
            status.counters.ranges
        ),
        Record::Boot(boot) => format!("started in network {}", hex(boot.pan)),
        Record::About(about) => format!("is in network {}", hex(about.pan)),
        other => format!("{other:?}"),
    };
    match lost {
        0 => format!("{node} {said}"),
        lost => format!("{node} {said}; before it {lost} lost on the line"),
    }
}
