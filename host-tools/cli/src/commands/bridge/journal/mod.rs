//! A recording of the bridge: all that it is given and says, and how it is played to a bridge again.
//!
//! ```text
//!   /orders  /range  /mavlink/in  /time ──► the bridge ──► /mavlink/out  /estimate      /position /attitude ... (readings of /mavlink/in)
//! ```
//!
//! It goes into the file as it comes, in whole chunks: what a program that is killed leaves can be played but for the last second or so.

mod lines;
mod topics;

use super::core::{Bridge, Given, Orders, Outlet};
use crate::commands::guide::lines::News;
use crate::commands::guide::options::NavigatorOptions;
use crate::commands::guide::pairing::Heard;
use crate::mavlink::inbound::Reading;
use crate::mavlink::outbound::TargetFrame;
use crate::mavlink::stream;
use crate::peer::Peer;
use crate::recording::file::{Place, Player, Recorder};
use anyhow::{Context, Result, anyhow};
use data_encoding::BASE64;
use lines::Estimated;
use mavlink::dialects::common::MavMessage;
use mavlink::{MAVLinkV2MessageRaw, Message};
use nova_solver::navigation::RangeSample;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use topics::TOPICS;

/// What a bridge's recording begins with.
pub(crate) const BEGIN: &str = "/orders";
const RANGE: &str = "/range";
const MAVLINK_IN: &str = "/mavlink/in";
const MAVLINK_OUT: &str = "/mavlink/out";
const TIME: &str = "/time";
const ESTIMATE: &str = "/estimate";

/// [`Orders`], and when the bridge began.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Begin {
    at_s: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    peer: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    frame: Option<TargetFrame>,
    most_sigma_m: f64,
    fly: bool,
    rate_hz: f32,
    navigator: NavigatorOptions,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RangeLine {
    at_s: f64,
    t_s: f64,
    node: String,
    range_m: f64,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct InLine {
    at_s: f64,
    name: String,
    frame: String,
}

#[derive(Serialize)]
struct OutLine<'a> {
    at_s: f64,
    name: &'a str,
    frame: String,
    sent: bool,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct TimeLine {
    at_s: f64,
}

/// A recording that is being made.
pub(super) struct Journal {
    name: String,
    recorder: Recorder<BufWriter<File>>,
}

impl Journal {
    /// Begins one, for a bridge that begins with these orders at `at_s`.
    pub(super) fn begin(path: &Path, orders: &Orders, at_s: f64) -> Result<Self> {
        let name = path.display().to_string();
        let cannot = || format!("{name}: cannot be written");
        let file = File::create(path).with_context(cannot)?;
        let mut recorder = Recorder::new(BufWriter::new(file), &TOPICS).with_context(cannot)?;
        let begin = Begin {
            at_s,
            peer: orders.only.as_ref().map(Peer::to_string),
            frame: orders.frame,
            most_sigma_m: orders.most_sigma_m,
            fly: orders.fly,
            rate_hz: orders.rate_hz,
            navigator: orders.navigator.clone(),
        };
        recorder.message(BEGIN, at_s, &begin);
        Ok(Self { name, recorder })
    }

    /// What the bridge is given.
    pub(super) fn given(&mut self, at_s: f64, given: &Given<'_>) {
        match given {
            Given::Range(heard) => {
                let range = RangeLine {
                    at_s,
                    t_s: heard.range.t_s,
                    node: heard.peer.to_string(),
                    range_m: heard.range.range_m,
                };
                self.recorder.message(RANGE, at_s, &range);
            }
            Given::Message(header, message) => {
                let mut frame = MAVLinkV2MessageRaw::new();
                frame.serialize_message(*header, *message);
                let message = InLine {
                    at_s,
                    name: message.message_name().to_owned(),
                    frame: BASE64.encode(frame.raw_bytes()),
                };
                self.recorder.message(MAVLINK_IN, at_s, &message);
            }
            Given::Time => self.recorder.message(TIME, at_s, &TimeLine { at_s }),
        }
    }

    /// What the bridge says to the autopilot, and whether it went out.
    pub(super) fn said(&mut self, at_s: f64, message: &MavMessage, frame: &[u8], sent: bool) {
        let message = OutLine {
            at_s,
            name: message.message_name(),
            frame: BASE64.encode(frame),
            sent,
        };
        self.recorder.message(MAVLINK_OUT, at_s, &message);
    }

    /// What a navigator says.
    pub(super) fn news(&mut self, at_s: f64, news: &News<'_>) {
        self.recorder.message(ESTIMATE, at_s, &Estimated::of(news));
    }

    /// What the autopilot says, for viewers.
    pub(super) fn reading(&mut self, at_s: f64, t_s: f64, reading: &Reading) {
        let (topic, line) = lines::reading(t_s, reading);
        self.recorder.message(topic, at_s, &line);
    }

    /// Whether something could not be written; nothing is any more.
    pub(super) fn has_failed(&self) -> bool {
        self.recorder.has_failed()
    }

    /// Ends the file.
    pub(super) fn finish(self) -> Result<()> {
        let finish = |recorder: Recorder<BufWriter<File>>| {
            recorder.finish()?.flush()?;
            anyhow::Ok(())
        };
        // As text: the pipe that broke is not that of our lines, which would be no error.
        finish(self.recorder)
            .map_err(|error| anyhow!("{}: cannot be written: {error:#}", self.name))
    }
}

/// A bridge that is given once more what another was given.
pub(crate) struct Again(Bridge);

impl Again {
    /// From the message that begins the recording.
    pub(crate) fn begin(place: &Place<'_>, data: &[u8]) -> Result<Self> {
        let begin: Begin = place.parse(data)?;
        let orders = Orders {
            only: begin.peer.as_deref().map(Peer::from),
            frame: begin.frame,
            most_sigma_m: begin.most_sigma_m,
            fly: begin.fly,
            rate_hz: begin.rate_hz,
            news: true,
            readings: false,
            navigator: begin.navigator,
        };
        orders.check().map_err(|error| place.fault(&error))?;
        Ok(Self(Bridge::new(orders, begin.at_s)))
    }
}

impl Player for Again {
    fn take(&mut self, place: &Place<'_>, data: &[u8], out: &mut dyn Write) -> Result<()> {
        let mut said = Said { out, trouble: None };
        match place.topic {
            BEGIN => return Err(place.fault(&"a second beginning")),
            RANGE => {
                let RangeLine {
                    at_s,
                    t_s,
                    node,
                    range_m,
                } = place.parse(data)?;
                let heard = Heard {
                    peer: Peer::from(node.as_str()),
                    range: RangeSample { t_s, range_m },
                };
                self.0.take(Given::Range(heard), at_s, &mut said);
            }
            MAVLINK_IN => {
                let InLine { at_s, frame, .. } = place.parse(data)?;
                let frame = BASE64.decode(frame.as_bytes());
                let frame = frame.map_err(|error| place.fault(&error))?;
                let (header, message) = stream::one(&frame).map_err(|error| place.fault(&error))?;
                self.0
                    .take(Given::Message(header, &message), at_s, &mut said);
            }
            TIME => {
                let TimeLine { at_s } = place.parse(data)?;
                self.0.take(Given::Time, at_s, &mut said);
            }
            // What the bridge said, and what others have added.
            _ => {}
        }
        said.trouble.map_or(Ok(()), Err)
    }
}

/// Where what the bridge says goes when it is played: only the estimates are printed.
struct Said<'a> {
    out: &'a mut dyn Write,
    trouble: Option<anyhow::Error>,
}

impl Outlet for Said<'_> {
    fn send(&mut self, _: &MavMessage) -> bool {
        true
    }

    fn news(&mut self, news: &News<'_>) {
        let written = serde_json::to_writer(&mut *self.out, &Estimated::of(news))
            .map_err(anyhow::Error::from)
            .and_then(|()| Ok(writeln!(self.out)?));
        if let Err(error) = written {
            self.trouble.get_or_insert(error);
        }
    }

    fn reading(&mut self, _: f64, _: &Reading) {}

    fn tell(&mut self, _: &str) {}
}
