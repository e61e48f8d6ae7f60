//! From settings that people made to a node's configuration, and back.
//!
//! What nobody has set is what the board brings: see [`nova_wire::settings::SETTINGS`].

use crate::config::{AntennaDelay, ConfigError, NodeConfig, Part, SetAntennaDelay};
use nova_ranging::exchange::Identity;
use nova_ranging::superframe::Sharing;
use nova_ranging::{Address, PanId};
use nova_wire::settings::Fallback;
use nova_wire::{Refusal, Setting, SettingValue, Settings, Value};

/// Numbers of [`Setting::Part`].
const RESPONDER: u32 = 0;
const INITIATOR: u32 = 1;
const LISTENER: u32 = 2;

/// What the numbers of [`Setting::Sharing`] mean.
const SHARING: [Sharing; 4] = [
    Sharing::Free,
    Sharing::Polite,
    Sharing::Elect,
    Sharing::Coordinate,
];

/// What a node with these settings works by, on a board that brings `board`.
pub(crate) fn configuration(board: &NodeConfig, settings: &Settings) -> NodeConfig {
    let in_force = InForce {
        board,
        settings,
        radio: AntennaDelay::UNCALIBRATED,
    };
    let number = |setting| in_force.number(setting);
    // Settings are checked against their ranges before they get here, so that
    // nothing is cut off.
    let cut = |number: u32| number as u16;
    let short = |setting| cut(number(setting));
    // What is found out or computed unless it is set.
    let set = |setting| match settings.get(setting) {
        Some(Value::Number(number)) => Some(number),
        _ => None,
    };
    NodeConfig {
        identity: Identity {
            pan: PanId(short(Setting::Pan)),
            address: Address(short(Setting::Address)),
        },
        part: match number(Setting::Part) {
            INITIATOR => Part::Initiator {
                period_us: number(Setting::PeriodUs),
                per_round: number(Setting::PerRound) as u8,
                peers: in_force.peers(),
                sharing: (SHARING.get(number(Setting::Sharing) as usize).copied())
                    .unwrap_or_default(),
            },
            LISTENER => Part::Listener,
            _ => Part::Responder,
        },
        antenna_delay: SetAntennaDelay {
            tx_ticks: set(Setting::TxAntennaDelay).map(cut).or(board.antenna_delay.tx_ticks),
            rx_ticks: set(Setting::RxAntennaDelay).map(cut).or(board.antenna_delay.rx_ticks),
        },
        reply_us: set(Setting::ReplyUs).or(board.reply_us),
        ..board.clone()
    }
}

/// All settings as the node works by them. `radio`: the antenna delays that the radio was told.
pub(crate) fn in_force<'a>(
    board: &'a NodeConfig,
    settings: &'a Settings,
    radio: AntennaDelay,
) -> impl Iterator<Item = SettingValue> + 'a {
    let in_force = InForce {
        board,
        settings,
        radio,
    };
    nova_wire::settings::SETTINGS
        .iter()
        .map(move |description| SettingValue {
            setting: description.setting.number(),
            value: in_force.value(description.setting),
            set: settings.get(description.setting).is_some(),
        })
}

/// What the host is told about settings that cannot work together.
pub(crate) fn refusal(error: &ConfigError) -> Refusal {
    match error {
        &ConfigError::ReplyTime { least, most, .. } => Refusal::OutOfRange {
            setting: Setting::ReplyUs.number(),
            least,
            most,
        },
    }
}

struct InForce<'a> {
    board: &'a NodeConfig,
    settings: &'a Settings,
    /// What the radio was told.
    radio: AntennaDelay,
}

impl InForce<'_> {
    fn value(&self, setting: Setting) -> Value {
        self.settings
            .get(setting)
            .unwrap_or_else(|| self.default(setting))
    }

    fn number(&self, setting: Setting) -> u32 {
        match self.value(setting) {
            Value::Number(number) => number,
            // Neither passes the check of a number's setting nor is its default.
            Value::Addresses(_) => 0,
        }
    }

    fn peers(&self) -> heapless::Vec<Address, { crate::MAX_PEERS }> {
        match self.value(Setting::Peers) {
            Value::Addresses(list) => list.as_slice().iter().map(|&a| Address(a)).collect(),
            Value::Number(_) => heapless::Vec::new(),
        }
    }

    /// What the setting is when nobody has set it.
    fn default(&self, setting: Setting) -> Value {
        if let Fallback::Value(value) = setting.description().default {
            return value;
        }
        let board = self.board;
        Value::Number(match setting {
            Setting::Address => board.identity.address.0.into(),
            Setting::Part => match board.part {
                Part::Responder => RESPONDER,
                Part::Initiator { .. } => INITIATOR,
                Part::Listener => LISTENER,
            },
            Setting::TxAntennaDelay => board.antenna_delay.or(self.radio).tx_ticks.into(),
            Setting::RxAntennaDelay => board.antenna_delay.or(self.radio).rx_ticks.into(),
            Setting::ReplyUs => configuration(board, self.settings).reply_us(),
            // Their defaults stand in the list.
            Setting::Pan
            | Setting::Peers
            | Setting::PeriodUs
            | Setting::PerRound
            | Setting::Sharing => 0,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nova_ranging::PhyProfile;
    use nova_wire::Change;
    use nova_wire::settings::{Addresses, Kind, MAX_ADDRESSES, SETTINGS};

    const RADIO: AntennaDelay = AntennaDelay::UNCALIBRATED;

    fn boards() -> [NodeConfig; 3] {
        [
            NodeConfig::tag(Address(7)),
            NodeConfig::anchor(Address(9)),
            NodeConfig::listener(Address(11)),
        ]
    }

    #[test]
    fn a_board_that_nobody_has_set_up_works_by_its_own_configuration() {
        for board in boards() {
            assert_eq!(configuration(&board, &Settings::new()), board);
        }
    }

    #[test]
    fn the_ranges_in_the_list_are_those_that_the_node_checks() {
        assert_eq!(MAX_ADDRESSES, crate::MAX_PEERS);
        let Kind::Number { least, most, .. } = Setting::ReplyUs.description().kind else {
            panic!("a reply time is a number");
        };
        assert_eq!(most, NodeConfig::MAX_REPLY_US);
        // What works at least depends on the mode: the list has the least of all.
        let shortest = PhyProfile::all().map(|phy| {
            let board = NodeConfig {
                phy,
                reply_us: Some(0),
                ..NodeConfig::tag(Address(1))
            };
            match board.check() {
                Err(ConfigError::ReplyTime { least, .. }) => least,
                other => panic!("{other:?}"),
            }
        });
        assert_eq!(Some(least), shortest.min());
    }

    #[test]
    fn every_setting_comes_back_as_it_was_set_and_changes_the_configuration() {
        for board in boards() {
            for description in SETTINGS {
                let setting = description.setting;
                let old = InForce {
                    board: &board,
                    settings: &Settings::new(),
                    radio: RADIO,
                }
                .value(setting);
                let value = match old {
                    Value::Number(number) => match description.kind {
                        Kind::Word(words) => Value::Number((number + 1) % words.len() as u32),
                        _ => Value::Number(number + 1),
                    },
                    Value::Addresses(_) => Value::Addresses(Addresses::new(&[3, 4]).unwrap()),
                };
                let mut settings = Settings::new();
                let change = Change {
                    setting: setting.number(),
                    value: Some(value),
                };
                settings.change(&change).unwrap();
                let told = in_force(&board, &settings, RADIO).nth(setting as usize);
                assert_eq!(
                    told,
                    Some(SettingValue {
                        setting: setting.number(),
                        value,
                        set: true
                    })
                );
                // Only initiators have peers and a period.
                let idle = !matches!(board.part, Part::Initiator { .. })
                    && matches!(
                        setting,
                        Setting::Peers | Setting::PeriodUs | Setting::PerRound | Setting::Sharing
                    );
                assert_eq!(configuration(&board, &settings) == board, idle);
            }
        }
    }
}
