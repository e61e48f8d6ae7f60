//! A listener's stream into rounds.

use super::Session;
use super::input::Anchors;
use crate::error::bad_input;
use crate::source::{Input, Place, Source};
use anyhow::Result;
use nova_ranging::PhyProfile;
use nova_ranging::phy::{Channel, Prf};
use nova_solver::positioning::{
    HeardFrame, HeardIntervals, HeardMessage, Listening, ListeningCounts, ListeningOptions,
    SideIntervals,
};
use nova_wire::{Decoder, Event, Overheard, Record, Setting, SettingValue, Value};

/// What a listener's board has said.
pub(super) struct Board {
    decoder: Decoder,
    listening: Listening,
    /// The radio's mode: what levels do to stamps hangs on it.
    phy: PhyProfile,
    /// The network that is listened to: the board's own, or that of the first frame.
    pan: Option<u16>,
    /// Whether the last frame was of another one: intervals follow their frame.
    foreign: bool,
    foreign_frames: u64,
    frames: u64,
    without_level: u64,
    restarts: u64,
    /// When the last frame was, microseconds of the board's clock.
    last_us: u64,
}

impl Board {
    pub(super) fn new(anchors: &Anchors, stamp_sigma_m: f64) -> Self {
        let options = ListeningOptions {
            stamp_sigma_m,
            ..ListeningOptions::default()
        };
        Self {
            decoder: Decoder::new(),
            listening: Listening::new(anchors.listened(), options),
            phy: PhyProfile::DEFAULT,
            pan: None,
            foreign: false,
            foreign_frames: 0,
            frames: 0,
            without_level: 0,
            restarts: 0,
            last_us: 0,
        }
    }

    /// Takes what comes next; false where no more does.
    pub(super) fn read(&mut self, source: &mut Source, session: &mut Session<'_>) -> Result<bool> {
        let mut chunk = [0; 4096];
        let count = match source.read(&mut chunk)? {
            Input::End => return Ok(false),
            Input::Bytes(count) => count,
            Input::Lost(why) => {
                eprintln!("{}: lost, trying again: {why}", source.place());
                0
            }
            Input::Back => {
                eprintln!("{}: heard again", source.place());
                self.restart(session);
                0
            }
            Input::Silence => 0,
        };
        for &byte in chunk.iter().take(count) {
            if let Some(Event::Record { record, .. }) = self.decoder.push(byte) {
                self.take(&record, session);
            }
        }
        Ok(true)
    }

    fn take(&mut self, record: &Record, session: &mut Session<'_>) {
        match record {
            Record::Boot(boot) => {
                self.pan = Some(boot.pan);
                self.restart(session);
            }
            Record::About(about) => self.pan = Some(about.pan),
            Record::Setting(setting) => self.set(setting),
            Record::Overheard(frame) => {
                self.frames += 1;
                self.foreign = *self.pan.get_or_insert(frame.pan) != frame.pan;
                if self.foreign {
                    self.foreign_frames += 1;
                    return;
                }
                // A start that was not heard.
                if frame.t_us + 1_000_000 < self.last_us {
                    self.restart(session);
                }
                self.last_us = frame.t_us;
                let frame = self.frame(frame);
                self.listening
                    .on_frame(&frame, |round| session.on_round(round));
            }
            Record::OverheardInterval(said) if !self.foreign => {
                let heard = HeardIntervals {
                    source: said.source,
                    peer: said.peer,
                    round: said.round,
                    intervals: SideIntervals {
                        round_ticks: said.round_ticks,
                        reply_ticks: said.reply_ticks,
                    },
                };
                self.listening
                    .on_intervals(&heard, |round| session.on_round(round));
            }
            _ => {}
        }
    }

    fn frame(&mut self, frame: &Overheard) -> HeardFrame {
        let level_dbm = frame
            .quality
            .map_or(f32::NAN, |quality| quality.rx_power_dbm);
        self.without_level += u64::from(level_dbm.is_nan());
        let phy = &self.phy;
        HeardFrame {
            t_s: frame.t_us as f64 * 1e-6,
            ticks: frame.at_ticks,
            late_m: phy.range_bias_m(phy.prf.true_level_dbm(level_dbm)).into(),
            source: frame.source,
            destination: frame.destination,
            message: match frame.message {
                1 => HeardMessage::Poll,
                2 => HeardMessage::Response,
                3 => HeardMessage::Final,
                _ => HeardMessage::Other,
            },
            round: frame.round,
        }
    }

    fn set(&mut self, said: &SettingValue) {
        let Value::Number(number) = said.value else {
            return;
        };
        let Ok(number) = u8::try_from(number) else {
            return;
        };
        if said.setting == Setting::PhyChannel.number()
            && let Ok(channel) = Channel::try_from(number)
        {
            self.phy.channel = channel;
        }
        if said.setting == Setting::PhyPrf.number()
            && let Ok(prf) = Prf::try_from(number)
        {
            self.phy.prf = prf;
        }
    }

    fn restart(&mut self, session: &mut Session<'_>) {
        self.restarts += u64::from(self.frames > 0);
        self.last_us = 0;
        self.listening.restart();
        session.restart();
    }

    /// Nothing more comes.
    pub(super) fn end(&mut self, session: &mut Session<'_>) {
        self.listening.finish(|round| session.on_round(round));
    }

    pub(super) fn counts(&self) -> &ListeningCounts {
        self.listening.counts()
    }

    /// Whether there was a listener at all.
    pub(super) fn check(&self, place: &Place) -> Result<()> {
        let statistics = self.decoder.statistics();
        if statistics.records == 0 {
            return Err(bad_input!(
                "{place}: no frame in {} bytes: is this what a board sent?",
                statistics.bytes
            ));
        }
        if self.frames == 0 {
            return Err(bad_input!(
                "{place}: the board overheard nothing in {} records; `nova config set part=listener` makes it listen",
                statistics.records
            ));
        }
        Ok(())
    }

    /// What a reader should know.
    pub(super) fn notes(&self) -> Vec<String> {
        let statistics = self.decoder.statistics();
        [
            (statistics.lost, "records lost between board and host"),
            (statistics.corrupt, "damaged frames from the board"),
            (self.foreign_frames, "frames of another network"),
            (
                self.without_level,
                "frames without a level, their stamps taken as they are",
            ),
            (self.restarts, "times the board started anew"),
        ]
        .iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, what)| format!("{count} {what}"))
        .collect()
    }
}
