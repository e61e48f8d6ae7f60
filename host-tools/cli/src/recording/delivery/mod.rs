//! A delivery: what its filter was told and said.
//!
//! ```text
//!   /begin  /input  /autopilot  /marker  /uwb ──► the filter ──► /estimate          /flight (truth beside estimate)
//! ```

#[cfg(test)]
mod tests;
mod topics;

use super::file::{Place, Player, Recorder};
use crate::files::write_whole;
use anyhow::Result;
use nova_flight::delivery::{Begin, Event, Lander, Scenario};
use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;
use topics::TOPICS;

/// What a delivery's recording begins with.
pub(crate) const BEGIN: &str = "/begin";

/// A recording that is being made. It is kept in memory until it is whole.
pub(crate) struct Recording(Recorder<Vec<u8>>);

impl Recording {
    /// Begins one; the scenario and the seed go in as metadata.
    pub(crate) fn new(scenario: &Scenario, seed: u64) -> Result<Self> {
        let metadata = BTreeMap::from([
            ("scenario".to_owned(), serde_json::to_string(scenario)?),
            ("seed".to_owned(), seed.to_string()),
        ]);
        let mut recorder = Recorder::new(Vec::new(), &TOPICS)?;
        recorder.metadata("delivery", metadata)?;
        Ok(Self(recorder))
    }

    /// Adds a record; an error comes out of [`Self::finish`].
    pub(crate) fn add(&mut self, event: &Event) {
        let recorder = &mut self.0;
        match event {
            Event::Begin(begin) => recorder.message(BEGIN, 0.0, begin),
            Event::Input(record) => recorder.message("/input", record.t_s, record),
            Event::Autopilot(record) => recorder.message("/autopilot", record.t_s, record),
            Event::Marker(record) => recorder.message("/marker", record.t_s, record),
            Event::Uwb(record) => recorder.message("/uwb", record.t_s, record),
            Event::Estimate(record) => recorder.message("/estimate", record.t_s, record),
            Event::Sample(sample) => recorder.message("/flight", sample.t_s, sample),
        }
    }

    /// Writes the file, whole or not at all.
    pub(crate) fn finish(self, path: &Path) -> Result<()> {
        write_whole(path, self.0.finish()?)
    }
}

/// A recorded delivery that is played to its filter again.
pub(crate) struct Flight(Lander);

impl Flight {
    /// From the message that begins it.
    pub(crate) fn begin(place: &Place<'_>, data: &[u8]) -> Result<Self> {
        let begin: Begin = place.parse(data)?;
        begin
            .lander()
            .map(Self)
            .map_err(|fault| place.fault(&fault))
    }
}

impl Player for Flight {
    fn take(&mut self, place: &Place<'_>, data: &[u8], out: &mut dyn Write) -> Result<()> {
        let event = match place.topic {
            BEGIN => return Err(place.fault(&"a second beginning")),
            "/input" => Event::Input(place.parse(data)?),
            "/autopilot" => Event::Autopilot(place.parse(data)?),
            "/marker" => Event::Marker(place.parse(data)?),
            "/uwb" => Event::Uwb(place.parse(data)?),
            // What the filter said, the truth, and what others have added.
            _ => return Ok(()),
        };
        self.0.take(&event).map_err(|fault| place.fault(&fault))?;
        if let Event::Input(input) = event {
            serde_json::to_writer(&mut *out, &self.0.estimate(input.t_s))?;
            writeln!(out)?;
        }
        Ok(())
    }
}
