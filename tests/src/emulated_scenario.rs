//! Scenarios on emulated boards.
//!
//! What a scenario says of a node goes into the flash of its board first, as a person would put it there: the board is
//! started alone, and told through its serial port.

use crate::emulated::{EmulatedNetwork, Firmware};
use crate::scenario::{Action, Board, BoardRole, Scenario};
use nova_emulator::{BoardConfig, ChipMemory, Image};
use nova_hal_sim::chip::ChipConfig;
use nova_hal_sim::{ChannelConfig, FaultAction};
use nova_wire::settings::Addresses;
use nova_wire::{Change, Changes, Command, Outcome, Record, Setting, Value};
use std::collections::BTreeMap;

/// A board alone has started by then.
const STARTED_S: f64 = 0.05;
/// And has answered by then.
const ANSWERED_S: f64 = 0.25;
/// The words `initiator` and `listener` of the setting `part`, `free` of `sharing`, `on` of `sleep`.
const INITIATOR: u32 = 1;
const LISTENER: u32 = 2;
const FREE: u32 = 0;
const ON: u32 = 1;
/// Period of a low-power tag unless the scenario says otherwise.
const SLEEPER_PERIOD_US: u32 = 100_000;

impl Scenario {
    /// The scenario's boards with their firmware, switched on now. Boards that `foreign` names run its images, to which
    /// nobody can give settings.
    ///
    /// # Errors
    /// What cannot be emulated, or settings that a board refused.
    pub fn emulate(
        &self,
        firmware: &Firmware,
        foreign: &BTreeMap<String, Image>,
    ) -> Result<EmulatedNetwork, String> {
        let mut boards = Vec::new();
        for board in &self.board {
            if let Some(image) = foreign.get(&board.name) {
                boards.push((board.emulated(None)?, image.clone()));
                continue;
            }
            let at = |error: String| format!("{}: {error}", board.name);
            let image = match board.role {
                BoardRole::Anchor => &firmware.anchor,
                BoardRole::Tag | BoardRole::Listener | BoardRole::Sleeper => &firmware.tag,
            };
            let memory = board.provision(image).map_err(at)?;
            boards.push((board.emulated(Some(memory))?, image.clone()));
        }
        let channel = ChannelConfig {
            loss_probability: self.loss_probability,
            ..ChannelConfig::default()
        };
        let mut network =
            EmulatedNetwork::new(self.seed, channel, boards).map_err(|error| error.to_string())?;
        for link in &self.link {
            let [a, b] = &link.between;
            if !network.emulation().set_link_effect(a, b, link.effect()) {
                return Err(format!("there is no {a} or no {b}"));
            }
        }
        for fault in &self.fault {
            let action = match fault.action {
                Action::Drop => FaultAction::Drop,
                Action::Corrupt => FaultAction::Corrupt,
            };
            let frames = fault.frames[0]..fault.frames[1];
            if !network.emulation().add_fault(&fault.from, frames, action) {
                return Err(format!("there is no board called {}", fault.from));
            }
        }
        Ok(network)
    }

    /// Whether emulated boards did what is expected.
    ///
    /// # Errors
    /// All expectations that were not met, one a line.
    pub fn check_emulated(&self, network: &EmulatedNetwork) -> Result<(), String> {
        // What an emulated board's radio draws is not asked.
        self.check_all(|name| network.log(name), |_| None)
    }
}

impl Board {
    fn emulated(&self, memory: Option<ChipMemory>) -> Result<BoardConfig, String> {
        if self.cpu_per_transaction_us.is_some() {
            return Err(format!(
                "{}: cpu_per_transaction_us is for simulated boards: an emulated processor takes the time it takes",
                self.name
            ));
        }
        let simulated = self.hardware();
        Ok(BoardConfig {
            chip: ChipConfig {
                clock: simulated.clock,
                motion: simulated.motion,
                tx_antenna_delay_ticks: simulated.tx_antenna_delay_ticks,
                rx_antenna_delay_ticks: simulated.rx_antenna_delay_ticks,
                rx_noise_ps: simulated.rx_noise_ps,
                otp: simulated.otp,
                timing: simulated.chip_timing,
                quirks: simulated.quirks,
                supply_currents: simulated.supply_currents,
            },
            mcu_ppm: simulated.mcu_ppm,
            boot_delay: simulated.boot_delay,
            memory,
            ..BoardConfig::new(self.name.clone(), [self.address.into(), 0])
        })
    }

    /// Starts the board alone and gives it its settings; what is in its flash then.
    fn provision(&self, image: &Image) -> Result<ChipMemory, String> {
        let alone = vec![(self.emulated(None)?, image.clone())];
        let mut network = EmulatedNetwork::new(0, ChannelConfig::default(), alone)
            .map_err(|error| error.to_string())?;
        network.run_until_s(STARTED_S).map_err(|e| e.to_string())?;
        let command = Command::Set(self.changes()?);
        network
            .command(&self.name, &command)
            .map_err(|error| format!("{error:?}"))?;
        network.run_until_s(ANSWERED_S).map_err(|e| e.to_string())?;
        let said = network.log(&self.name).map(|log| &log.others);
        let mut answers = said
            .into_iter()
            .flatten()
            .filter_map(|record| match record {
                Record::Answer(answer) => Some(answer.outcome),
                _ => None,
            });
        match answers.next() {
            Some(Outcome::Done) => {}
            other => return Err(format!("it did not take its settings: {other:?}")),
        }
        let board = network.emulation().board(&self.name).ok_or("no board")?;
        Ok(board.memory())
    }

    fn changes(&self) -> Result<Changes, String> {
        let number = |setting, value: Option<u32>| value.map(|v| (setting, Value::Number(v)));
        let sleeps = matches!(self.role, BoardRole::Sleeper);
        let part = match self.role {
            BoardRole::Listener => Some(LISTENER),
            BoardRole::Sleeper => Some(INITIATOR),
            BoardRole::Tag | BoardRole::Anchor => None,
        };
        let period_us = self.period_us.or(sleeps.then_some(SLEEPER_PERIOD_US));
        let peers = Addresses::new(&self.peers).ok_or("too many peers")?;
        let wanted = [
            number(Setting::Address, Some(self.address.into())),
            number(Setting::Pan, self.pan.map(u32::from)),
            number(Setting::Part, part),
            number(Setting::Sharing, sleeps.then_some(FREE)),
            number(Setting::Sleep, sleeps.then_some(ON)),
            number(Setting::PeriodUs, period_us),
            number(Setting::PerRound, self.per_round.map(u32::from)),
            number(Setting::ReplyUs, self.reply_us),
            (!self.peers.is_empty()).then_some((Setting::Peers, Value::Addresses(peers))),
        ];
        Ok(wanted
            .into_iter()
            .flatten()
            .map(|(setting, value)| Change {
                setting: setting.number(),
                value: Some(value),
            })
            .collect())
    }
}
