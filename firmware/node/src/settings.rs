//! From settings that people made to a node's configuration, and back.
//!
//! What nobody has set is what the board brings: see [`nova_wire::settings::SETTINGS`].

use crate::config::{AntennaDelay, ConfigError, NodeConfig, Part, SetAntennaDelay};
use nova_ranging::exchange::Identity;
use nova_ranging::phy::{Bitrate, Channel, PhyError, Preamble, Prf};
use nova_ranging::superframe::Sharing;
use nova_ranging::{Address, FilterSettings, PanId, PhyProfile};
use nova_wire::settings::{Addresses, Fallback};
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
                sleep: number(Setting::Sleep) != 0,
            },
            LISTENER => Part::Listener,
            _ => Part::Responder,
        },
        antenna_delay: SetAntennaDelay {
            tx_ticks: set(Setting::TxAntennaDelay)
                .map(cut)
                .or(board.antenna_delay.tx_ticks),
            rx_ticks: set(Setting::RxAntennaDelay)
                .map(cut)
                .or(board.antenna_delay.rx_ticks),
        },
        reply_us: set(Setting::ReplyUs).or(board.reply_us),
        phy: profile(&in_force).unwrap_or(board.phy),
        filter: FilterSettings {
            sigma_m: number(Setting::FilterSigma) as f32 / 1e3,
            nlos_sigma_m: number(Setting::FilterNlosSigma) as f32 / 1e3,
            agility_m2_per_s3: number(Setting::FilterAgility) as f32 / 1e4,
            max_speed_m_per_s: number(Setting::FilterMaxSpeed) as f32 / 1e3,
            ..board.filter
        },
        ..board.clone()
    }
}

/// Mode of the radio. There is one for each number that the list allows.
fn profile(in_force: &InForce<'_>) -> Result<PhyProfile, PhyError> {
    let number = |setting| in_force.number(setting);
    Ok(PhyProfile {
        channel: Channel::try_from(number(Setting::PhyChannel) as u8)?,
        bitrate: Bitrate::try_from(number(Setting::PhyBitrate))?,
        prf: Prf::try_from(number(Setting::PhyPrf) as u8)?,
        preamble: Preamble::try_from(number(Setting::PhyPreamble) as u16)?,
    })
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
        // Each is allowed for itself, or the list would have refused it.
        ConfigError::Phy(_) => Refusal::Conflict {
            setting: Setting::PhyPreamble.number(),
            with: Setting::PhyBitrate.number(),
        },
        ConfigError::SleepListens => Refusal::Conflict {
            setting: Setting::Sleep.number(),
            with: Setting::Sharing.number(),
        },
        ConfigError::Filter(_) => Refusal::Conflict {
            setting: Setting::FilterNlosSigma.number(),
            with: Setting::FilterSigma.number(),
        },
        ConfigError::OwnPeer(_) => Refusal::Conflict {
            setting: Setting::Peers.number(),
            with: Setting::Address.number(),
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

    /// What the setting is when nobody has set it: what the board brings; what the list says where the board
    /// has no such thing, as a responder has no period.
    fn default(&self, setting: Setting) -> Value {
        let board = self.board;
        let listed = match setting.description().default {
            Fallback::Value(value) => value,
            Fallback::Board(_) => Value::Number(0),
        };
        let polling = match &board.part {
            Part::Initiator {
                period_us,
                per_round,
                peers,
                sharing,
                sleep,
            } => Some((*period_us, *per_round, peers, *sharing, *sleep)),
            Part::Responder | Part::Listener => None,
        };
        let filter = &board.filter;
        let delays = board.antenna_delay.or(self.radio);
        let number = match (setting, polling) {
            (Setting::Address, _) => board.identity.address.0.into(),
            (Setting::Pan, _) => board.identity.pan.0.into(),
            (Setting::Part, _) => match board.part {
                Part::Responder => RESPONDER,
                Part::Initiator { .. } => INITIATOR,
                Part::Listener => LISTENER,
            },
            (Setting::Peers, Some((_, _, peers, ..))) => {
                let list: heapless::Vec<u16, { crate::MAX_PEERS }> =
                    peers.iter().map(|peer| peer.0).collect();
                return Addresses::new(&list).map_or(listed, Value::Addresses);
            }
            (Setting::PeriodUs, Some((period_us, ..))) => period_us,
            (Setting::PerRound, Some((_, per_round, ..))) => per_round.into(),
            (Setting::Sleep, Some((.., sleep))) => sleep.into(),
            (Setting::Sharing, Some((.., sharing, _))) => (SHARING.iter())
                .zip(0_u32..)
                .find(|&(known, _)| *known == sharing)
                .map_or(0, |(_, number)| number),
            (
                Setting::Peers
                | Setting::PeriodUs
                | Setting::PerRound
                | Setting::Sharing
                | Setting::Sleep,
                None,
            ) => return listed,
            (Setting::TxAntennaDelay, _) => delays.tx_ticks.into(),
            (Setting::RxAntennaDelay, _) => delays.rx_ticks.into(),
            (Setting::ReplyUs, _) => configuration(board, self.settings).reply_us(),
            (Setting::PhyChannel, _) => board.phy.channel.number().into(),
            (Setting::PhyBitrate, _) => board.phy.bitrate.kbps(),
            (Setting::PhyPrf, _) => board.phy.prf.mhz().into(),
            (Setting::PhyPreamble, _) => board.phy.preamble.symbols().into(),
            (Setting::FilterSigma, _) => whole(filter.sigma_m, 1e3),
            (Setting::FilterNlosSigma, _) => whole(filter.nlos_sigma_m, 1e3),
            (Setting::FilterAgility, _) => whole(filter.agility_m2_per_s3, 1e4),
            (Setting::FilterMaxSpeed, _) => whole(filter.max_speed_m_per_s, 1e3),
        };
        Value::Number(number)
    }
}

/// How many of the setting's units, of which there are `per_unit` in one of SI.
fn whole(value: f32, per_unit: f32) -> u32 {
    // A conversion saturates.
    (value * per_unit + 0.5) as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use nova_wire::Change;
    use nova_wire::settings::{Kind, MAX_ADDRESSES, SETTINGS};

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
    fn the_defaults_in_the_list_are_those_that_boards_bring() {
        for board in boards() {
            for value in in_force(&board, &Settings::new(), RADIO) {
                let setting = Setting::from_number(value.setting).unwrap();
                assert!(!value.set);
                assert_eq!(setting.check(&value.value), Ok(()));
                if let Fallback::Value(listed) = setting.description().default {
                    assert_eq!(value.value, listed, "{}", setting.description().name);
                }
            }
        }
    }

    #[test]
    fn what_a_board_brings_beside_the_usual_stays_unless_it_is_set() {
        let peers = [Address(3), Address(4)].into_iter().collect();
        let board = NodeConfig {
            identity: Identity {
                pan: PanId(7),
                address: Address(9),
            },
            part: Part::Initiator {
                period_us: 2_500,
                per_round: 2,
                peers,
                sharing: Sharing::Polite,
                sleep: false,
            },
            phy: PhyProfile::LONG_RANGE,
            reply_us: Some(9_000),
            ..NodeConfig::anchor(Address(9))
        };
        assert_eq!(configuration(&board, &Settings::new()), board);
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
    fn every_number_in_the_list_is_a_mode_of_the_radio_and_every_mode_is_in_the_list() {
        for phy in PhyProfile::all() {
            let mut settings = Settings::new();
            for (setting, number) in [
                (Setting::PhyChannel, phy.channel.number().into()),
                (Setting::PhyBitrate, phy.bitrate.kbps()),
                (Setting::PhyPrf, phy.prf.mhz().into()),
                (Setting::PhyPreamble, phy.preamble.symbols().into()),
            ] {
                let change = Change {
                    setting: setting.number(),
                    value: Some(Value::Number(number)),
                };
                settings.change(&change).unwrap();
            }
            let board = NodeConfig::tag(Address(1));
            assert_eq!(configuration(&board, &settings).phy, phy);
        }
        let numbers = |setting: Setting| match setting.description().kind {
            Kind::OneOf { numbers, .. } => numbers.len(),
            other => panic!("{other:?}"),
        };
        assert_eq!(numbers(Setting::PhyChannel), Channel::ALL.len());
        assert_eq!(numbers(Setting::PhyBitrate), Bitrate::ALL.len());
        assert_eq!(numbers(Setting::PhyPrf), Prf::ALL.len());
        assert_eq!(numbers(Setting::PhyPreamble), Preamble::ALL.len());
    }

    #[test]
    fn settings_of_the_filter_that_the_list_allows_work_unless_they_contradict_each_other() {
        let check = |values: [u32; 4]| {
            let mut settings = Settings::new();
            let places = [
                Setting::FilterSigma,
                Setting::FilterNlosSigma,
                Setting::FilterAgility,
                Setting::FilterMaxSpeed,
            ];
            for (setting, value) in places.into_iter().zip(values) {
                let change = Change {
                    setting: setting.number(),
                    value: Some(Value::Number(value)),
                };
                settings.change(&change).unwrap();
            }
            let config = configuration(&NodeConfig::anchor(Address(1)), &settings);
            config.check().map_err(|error| refusal(&error))
        };
        assert_eq!(check([1, 1, 1, 100]), Ok(()));
        assert_eq!(check([10_000, 100_000, 100_000_000, 1_000_000]), Ok(()));
        assert_eq!(
            check([50, 49, 10_000, 15_000]),
            Err(Refusal::Conflict {
                setting: 15,
                with: 14
            })
        );
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
                        Kind::OneOf { numbers, .. } => {
                            Value::Number(*numbers.iter().find(|&&n| n != number).unwrap())
                        }
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
                        Setting::Peers
                            | Setting::PeriodUs
                            | Setting::PerRound
                            | Setting::Sharing
                            | Setting::Sleep
                    );
                assert_eq!(configuration(&board, &settings) == board, idle);
            }
        }
    }
}
