//! The node's side of the line from the host: commands are read here, and
//! settings kept.

use crate::bus::RadioBus;
use crate::config::NodeConfig;
use crate::node::Node;
use crate::settings::{configuration, in_force, refusal};
use crate::store::{Store, StoreError};
use core::ops::Range;
use embedded_hal::delay::DelayNs;
use embedded_hal::digital::OutputPin;
use embedded_storage::nor_flash::NorFlash;
use nova_wire::{
    Answer, Change, Command, CommandDecoder, CommandEvent, Outcome, Record, Refusal, Settings,
    SettingsSource, Trouble,
};

/// Keeps a board's settings in flash and carries out what the host commands.
///
/// ```text
///   bytes ──► CommandDecoder ──► on_command ──► checked, stored ──► Node::reconfigure
///                                    └──► records and an answer
/// ```
pub struct Keeper<F: NorFlash> {
    /// What the board is without any settings.
    board: NodeConfig,
    settings: Settings,
    source: SettingsSource,
    store: Store<F>,
    decoder: CommandDecoder,
}

/// What the board has to do after commands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[must_use]
pub enum Then {
    /// Go on.
    GoOn,
    /// Start anew, once the answer has gone out.
    Reboot,
}

impl<F: NorFlash> Keeper<F> {
    /// Reads the settings of a board that is `board` without any from this part
    /// of `flash`. Settings that cannot be read, or cannot work, are left aside:
    /// the node then works by the defaults, and says so in its boot record.
    ///
    /// # Errors
    /// [`StoreError::Range`].
    pub fn new(board: NodeConfig, flash: F, range: Range<u32>) -> Result<Self, StoreError> {
        let mut store = Store::new(flash, range)?;
        let (mut settings, mut source) = store.load();
        if configuration(&board, &settings).check().is_err() {
            // Good for another firmware, perhaps.
            settings = Settings::new();
            source = SettingsSource::Damaged;
        }
        Ok(Self {
            board,
            settings,
            source,
            store,
            decoder: CommandDecoder::new(),
        })
    }

    /// What the node is to work by.
    pub fn config(&self) -> NodeConfig {
        NodeConfig {
            settings: self.source,
            ..configuration(&self.board, &self.settings)
        }
    }

    /// Takes bytes from the host and carries out the commands in them.
    pub fn on_bytes<B: RadioBus, R: OutputPin, D: DelayNs>(
        &mut self,
        bytes: &[u8],
        node: &mut Node<B, R, D>,
        now_us: u64,
        emit: &mut impl FnMut(&Record),
    ) -> Then {
        let mut then = Then::GoOn;
        for &byte in bytes {
            match self.decoder.push(byte) {
                None => {}
                Some(CommandEvent::Record {
                    sequence, record, ..
                }) => {
                    let wanted = self.on_command(sequence, &record, node, now_us, emit);
                    if wanted == Then::Reboot {
                        then = Then::Reboot;
                    }
                }
                Some(CommandEvent::Trouble(trouble)) => {
                    node.count_bad_command();
                    // Whoever sent it waits for an answer.
                    if let (Trouble::Unknown(_), Some(command)) =
                        (trouble, self.decoder.last_sequence())
                    {
                        let outcome = Outcome::Refused(Refusal::UnknownCommand);
                        emit(&Record::Answer(Answer { command, outcome }));
                    }
                }
            }
        }
        then
    }

    /// Carries out one command, and answers it.
    pub fn on_command<B: RadioBus, R: OutputPin, D: DelayNs>(
        &mut self,
        sequence: u16,
        command: &Command,
        node: &mut Node<B, R, D>,
        now_us: u64,
        emit: &mut impl FnMut(&Record),
    ) -> Then {
        let done = match command {
            Command::Get => {
                in_force(&self.board, &self.settings, node.antenna_delay())
                    .for_each(|value| emit(&Record::Setting(value)));
                Ok(())
            }
            Command::Set(changes) => self
                .changed(changes)
                .and_then(|settings| self.adopt(settings, node, now_us)),
            Command::Reset => self.adopt(Settings::new(), node, now_us),
            Command::Status => {
                emit(&Record::About(node.about()));
                emit(&Record::Status(node.status(now_us)));
                Ok(())
            }
            Command::Reboot => Ok(()),
        };
        let outcome = match done {
            Ok(()) => Outcome::Done,
            Err(refusal) => {
                node.count_refused_command(refusal == Refusal::NotStored);
                Outcome::Refused(refusal)
            }
        };
        emit(&Record::Answer(Answer {
            command: sequence,
            outcome,
        }));
        match command {
            Command::Reboot => Then::Reboot,
            _ => Then::GoOn,
        }
    }

    /// The settings with these changes, all checked.
    fn changed(&self, changes: &[Change]) -> Result<Settings, Refusal> {
        let mut settings = self.settings.clone();
        changes
            .iter()
            .try_for_each(|change| settings.change(change))?;
        configuration(&self.board, &settings)
            .check()
            .map_err(|error| refusal(&error))?;
        Ok(settings)
    }

    /// Stores settings that have been checked, then lets the node work by them:
    /// in this order, so that a host that was told so finds them after a restart.
    fn adopt<B: RadioBus, R: OutputPin, D: DelayNs>(
        &mut self,
        settings: Settings,
        node: &mut Node<B, R, D>,
        now_us: u64,
    ) -> Result<(), Refusal> {
        self.store.save(&settings).map_err(|_| Refusal::NotStored)?;
        let same = settings == self.settings;
        self.settings = settings;
        self.source = SettingsSource::Stored;
        if same {
            return Ok(());
        }
        node.reconfigure(self.config(), now_us)
            .map_err(|error| refusal(&error))
    }
}
