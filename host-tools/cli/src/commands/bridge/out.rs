//! Where what the bridge says goes: to the autopilot, to whoever reads our lines, into the recording.

use super::core::{Given, Outlet};
use super::counts::{Latency, Quantiles};
use super::journal::Journal;
use super::lines::Lines;
use crate::commands::guide::lines::News;
use crate::mavlink::Link;
use crate::mavlink::inbound::Reading;
use crate::mavlink::stream::Outgoing;
use anyhow::Result;
use mavlink::dialects::common::MavMessage;
use serde::Serialize;
use std::time::Instant;

/// A reading as a line.
#[derive(Serialize)]
struct ReadingLine<'a> {
    t_s: f64,
    reading: &'a Reading,
}

/// Which lines are wanted.
#[derive(Clone, Copy)]
pub(super) struct Told {
    pub(super) news: bool,
    pub(super) readings: bool,
}

/// Where messages and lines go.
pub(super) struct Out<'a> {
    link: &'a Link,
    frames: Outgoing,
    lines: Lines,
    told: Told,
    journal: Option<Journal>,
    /// What became of the recording.
    recorded: Result<()>,
    latency: Latency,
    /// What the bridge works on: when it was given to it, and when it arrived if it is a range.
    given_s: f64,
    arrived: Option<Instant>,
}

/// What was noted on the way.
pub(super) struct Noted {
    pub(super) latency: Option<Quantiles>,
    pub(super) lines_dropped: u64,
    /// What became of the recording.
    pub(super) recorded: Result<()>,
}

impl<'a> Out<'a> {
    pub(super) fn new(
        link: &'a Link,
        frames: Outgoing,
        told: Told,
        journal: Option<Journal>,
    ) -> Self {
        Self {
            link,
            frames,
            lines: Lines::to_stdout(),
            told,
            journal,
            recorded: Ok(()),
            latency: Latency::default(),
            given_s: 0.0,
            arrived: None,
        }
    }

    /// What the bridge is about to take; a range has arrived before.
    pub(super) fn given(&mut self, given: &Given<'_>, now_s: f64, arrived: Option<Instant>) {
        self.given_s = now_s;
        self.arrived = arrived;
        if let Some(journal) = &mut self.journal {
            journal.given(now_s, given);
        }
        // The flight is worth more than its recording.
        if let Some(journal) = self.journal.take_if(|journal| journal.has_failed()) {
            self.recorded = journal.finish();
            if let Err(error) = &self.recorded {
                eprintln!("{error:#}: nothing more is recorded; the bridge goes on");
            }
        }
    }

    /// From now on as this system.
    pub(super) fn join(&mut self, system: u8) {
        self.frames.join(system);
    }

    /// Whether nobody reads our lines any more.
    pub(super) fn has_nobody(&self) -> bool {
        self.lines.have_nobody()
    }

    /// Ends lines and recording.
    ///
    /// # Errors
    /// Why lines could not be written.
    pub(super) fn finish(self) -> Result<Noted> {
        let recorded = match self.journal {
            Some(journal) => journal.finish(),
            None => self.recorded,
        };
        Ok(Noted {
            latency: self.latency.quantiles(),
            lines_dropped: self.lines.finish()?,
            recorded,
        })
    }
}

impl Outlet for Out<'_> {
    fn send(&mut self, message: &MavMessage) -> bool {
        let frame = self.frames.pack(message);
        let sent = self.link.send(frame);
        if let (MavMessage::DISTANCE_SENSOR(_), Some(arrived)) = (message, self.arrived) {
            self.latency.note(arrived.elapsed());
        }
        if let Some(journal) = &mut self.journal {
            journal.said(self.given_s, message, frame, sent);
        }
        sent
    }

    fn news(&mut self, news: &News<'_>) {
        if let Some(journal) = &mut self.journal {
            journal.news(self.given_s, news);
        }
        if self.told.news {
            self.lines.line(news);
        }
    }

    fn reading(&mut self, t_s: f64, reading: &Reading) {
        if let Some(journal) = &mut self.journal {
            journal.reading(self.given_s, t_s, reading);
        }
        if self.told.readings {
            self.lines.line(&ReadingLine { t_s, reading });
        }
    }

    fn tell(&mut self, text: &str) {
        eprintln!("{text}");
    }
}
