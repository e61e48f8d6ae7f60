//! A conversation with a board: commands, and what it answers.

use crate::error::bad_input;
use crate::source::{Input, Place, Source};
use anyhow::{Result, bail};
use nova_wire::settings::{Description, Kind, Setting};
use nova_wire::{
    Answer, Command, Decoder, Encoder, Event, MAX_FRAME_LEN, Outcome, Record, Refusal,
};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// The longest that a board takes to answer: the erase of a page of its flash (90 ms), a start of its radio,
/// and what waits on the line before the answer.
const PATIENCE: Duration = Duration::from_secs(1);

/// A damaged command is not answered; how often to ask.
const TRIES: u32 = 3;

/// A board that takes commands.
pub(crate) struct Board {
    source: Source,
    encoder: Encoder,
    decoder: Decoder,
}

/// What a board said to a command.
enum Said {
    /// These records, and then that it is done.
    Done(Vec<Record>),
    Refused(Refusal),
    Nothing,
}

impl Board {
    /// Opens the way to the board at `place`.
    ///
    /// # Errors
    /// `place` names nothing that can be opened, or leads to no board.
    pub(crate) fn open(place: &str, baud: u32) -> Result<Self> {
        let place = Place::named(place, baud)?;
        if !matches!(place, Place::Serial { .. } | Place::Tcp(_)) {
            return Err(bad_input!(
                "{place}: no board can be asked there; a serial port or tcp://HOST:PORT leads to one"
            ));
        }
        Ok(Self {
            source: Source::open(place)?,
            encoder: Encoder::starting_at(some_number()),
            decoder: Decoder::new(),
        })
    }

    /// What the board is called in messages.
    pub(crate) fn place(&self) -> &Place {
        self.source.place()
    }

    /// Asks until the board has done it; what it said on the way, in order.
    ///
    /// # Errors
    /// The board refuses, or does not answer.
    pub(crate) fn ask(&mut self, command: &Command) -> Result<Vec<Record>> {
        for _ in 0..TRIES {
            match self.try_once(command)? {
                Said::Done(records) => return Ok(records),
                Said::Refused(refusal) => {
                    return Err(bad_input!("{}: {}", self.place(), explained(&refusal)));
                }
                Said::Nothing => {}
            }
        }
        let place = self.place();
        match self.decoder.statistics() {
            heard if heard.records > 0 => bail!(
                "{place}: the board talks but does not answer: is its receive line connected, and its \
                 firmware not older than this program?"
            ),
            heard if heard.unknown > 0 => bail!(
                "{place}: the board talks another version of the protocol: update its firmware or this program"
            ),
            heard if heard.bytes > 0 => {
                bail!("{place}: what comes is nothing that a board says: is the baud rate right?")
            }
            _ => bail!("{place}: no board answers"),
        }
    }

    fn try_once(&mut self, command: &Command) -> Result<Said> {
        let sequence = self.encoder.next_sequence();
        let mut buffer = [0; MAX_FRAME_LEN];
        let Ok(frame) = self.encoder.encode(command, &mut buffer) else {
            return Err(bad_input!("that is more than fits one command"));
        };
        self.source.send(frame)?;
        let deadline = Instant::now() + PATIENCE;
        let mut said = Vec::new();
        let mut chunk = [0; 4096];
        while Instant::now() < deadline {
            let count = match self.source.read(&mut chunk)? {
                Input::Bytes(count) => count,
                Input::Silence | Input::Back => continue,
                Input::Lost(why) => bail!("{}: lost: {why}", self.place()),
                Input::End => bail!("{}: the other end has closed it", self.place()),
            };
            for &byte in chunk.iter().take(count) {
                let Some(Event::Record { record, .. }) = self.decoder.push(byte) else {
                    continue;
                };
                match record {
                    Record::Answer(Answer { command, outcome }) if command == sequence => {
                        return Ok(match outcome {
                            Outcome::Done => Said::Done(said),
                            Outcome::Refused(refusal) => Said::Refused(refusal),
                        });
                    }
                    record => said.push(record),
                }
            }
        }
        Ok(Said::Nothing)
    }
}

/// Where this program's commands begin to count: not where those of the program before it do, whose answers
/// may still come.
fn some_number() -> u16 {
    let nanos = SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .map_or(0, |now| now.subsec_nanos());
    (nanos >> 8) as u16
}

/// A refusal as a sentence.
pub(crate) fn explained(refusal: &Refusal) -> String {
    let known = |number: u8| Setting::from_number(number).map(Setting::description);
    let name = |number: u8| match known(number) {
        Some(description) => description.name.to_owned(),
        None => format!("setting {number}"),
    };
    match *refusal {
        Refusal::UnknownCommand => {
            "the board does not know this command: its firmware is older than this program"
                .to_owned()
        }
        Refusal::UnknownSetting { setting } => format!(
            "{}: the board has no such setting: its firmware is older than this program",
            name(setting)
        ),
        Refusal::WrongKind { setting } | Refusal::NotOffered { setting } => {
            let allowed = known(setting).map_or_else(String::new, |d| format!("; {}", allowed(d)));
            format!(
                "{}: not a value that the board knows{allowed}",
                name(setting)
            )
        }
        Refusal::OutOfRange {
            setting,
            least,
            most,
        } => match known(setting).map(|description| description.kind) {
            Some(Kind::Number { unit, .. }) => format!(
                "{}: must lie between {least} and {most} {unit}",
                name(setting)
            )
            .trim_end()
            .to_owned(),
            Some(Kind::Identifier { .. } | Kind::Addresses { .. }) => format!(
                "{}: must lie between 0x{least:04X} and 0x{most:04X}",
                name(setting)
            ),
            _ => format!("{}: must lie between {least} and {most}", name(setting)),
        },
        Refusal::Conflict { setting, with } => {
            format!("{} cannot work with this {}", name(setting), name(with))
        }
        Refusal::NotStored => {
            "the board's flash did not take the settings; it goes on with the old ones. \
                               Is its supply above 2.8 V?"
                .to_owned()
        }
    }
}

/// What a setting can be, in words.
pub(crate) fn allowed(description: &Description) -> String {
    match description.kind {
        Kind::Number { least, most, unit } => {
            format!("{least} to {most} {unit}").trim_end().to_owned()
        }
        Kind::Identifier { least, most } => format!("0x{least:04X} to 0x{most:04X}"),
        Kind::OneOf { numbers, unit } => {
            let numbers: Vec<String> = numbers.iter().map(u32::to_string).collect();
            format!("{} {unit}", numbers.join(" or "))
                .trim_end()
                .to_owned()
        }
        Kind::Word(words) => words.join(" or "),
        Kind::Addresses { most } => {
            format!("up to {most} addresses, none twice, as [0x0A1B, 0x0102]")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_refusal_names_the_setting_and_what_is_allowed() {
        let setting = Setting::PeriodUs.number();
        let cases = [
            (
                Refusal::OutOfRange {
                    setting,
                    least: 1_000,
                    most: 60_000_000,
                },
                "period_us: must lie between 1000 and 60000000 us",
            ),
            (
                Refusal::OutOfRange {
                    setting: Setting::Pan.number(),
                    least: 0,
                    most: 0xFFFE,
                },
                "pan: must lie between 0x0000 and 0xFFFE",
            ),
            (
                Refusal::NotOffered {
                    setting: Setting::Part.number(),
                },
                "part: not a value that the board knows; responder or initiator or listener",
            ),
            (
                Refusal::UnknownSetting { setting: 200 },
                "setting 200: the board has no such setting: its firmware is older than this program",
            ),
        ];
        for (refusal, sentence) in cases {
            assert_eq!(explained(&refusal), sentence);
        }
    }
}
