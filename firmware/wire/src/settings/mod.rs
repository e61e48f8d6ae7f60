//! What can be set on a node, and what has been.

mod table;
mod value;

pub use table::{COUNT, Description, Fallback, Kind, NODE_ADDRESSES, SETTINGS, Setting};
pub use value::{Addresses, MAX_ADDRESSES, Value};

use crate::Refusal;
use serde::{Deserialize, Serialize};

/// Most settings that one command can change. A fixed number, so that nodes
/// with fewer settings can read the commands of hosts with more, and refuse
/// them by name.
pub const MAX_SETTINGS: usize = 20;

const _: () = assert!(COUNT <= MAX_SETTINGS, "one command changes all settings");

/// A change of one setting.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Change {
    /// The [number](Setting::number) of the setting.
    pub setting: u8,
    /// Its new value; the default if none.
    pub value: Option<Value>,
}

/// What a setting is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SettingValue {
    /// The [number](Setting::number) of the setting.
    pub setting: u8,
    /// What the node works by.
    pub value: Value,
    /// Whether that was set, or is the default.
    pub set: bool,
}

/// The settings that have been set; each within its range.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Settings {
    values: [Option<Value>; COUNT],
}

impl Default for Settings {
    fn default() -> Self {
        Self::new()
    }
}

impl Settings {
    /// Nothing set.
    pub const fn new() -> Self {
        Self {
            values: [None; COUNT],
        }
    }

    /// What a setting was set to, if it was.
    pub fn get(&self, setting: Setting) -> Option<Value> {
        self.values.get(setting as usize).copied().flatten()
    }

    /// Makes one change.
    ///
    /// # Errors
    /// What is wrong with it; nothing is changed then. Whether settings go
    /// together is not looked at here.
    pub fn change(&mut self, change: &Change) -> Result<(), Refusal> {
        let unknown = Refusal::UnknownSetting {
            setting: change.setting,
        };
        let setting = Setting::from_number(change.setting).ok_or(unknown)?;
        if let Some(value) = &change.value {
            setting.check(value)?;
        }
        let place = self.values.get_mut(setting as usize).ok_or(unknown)?;
        *place = change.value;
        Ok(())
    }

    /// Changes that lead from nothing set to here.
    pub fn changes(&self) -> impl Iterator<Item = Change> + '_ {
        (0_u8..)
            .zip(&self.values)
            .filter(|(_, value)| value.is_some())
            .map(|(setting, &value)| Change { setting, value })
    }
}

impl Setting {
    /// Whether the setting can have this value.
    ///
    /// # Errors
    /// What is allowed instead.
    pub fn check(self, value: &Value) -> Result<(), Refusal> {
        let setting = self.number();
        match (self.description().kind, value) {
            (Kind::Number { least, most, .. }, Value::Number(number)) => {
                self.within(least, most, *number)
            }
            (Kind::Identifier { least, most }, Value::Number(number)) => {
                self.within(least.into(), most.into(), *number)
            }
            (Kind::OneOf { numbers, .. }, Value::Number(number)) => (numbers.contains(number))
                .then_some(())
                .ok_or(Refusal::NotOffered { setting }),
            (Kind::Word(words), Value::Number(number)) => {
                let known = usize::try_from(*number).is_ok_and(|place| place < words.len());
                known.then_some(()).ok_or(Refusal::NotOffered { setting })
            }
            (Kind::Addresses { .. }, Value::Addresses(addresses)) => {
                let (least, most) = (*NODE_ADDRESSES.start(), *NODE_ADDRESSES.end());
                let list = addresses.as_slice();
                list.iter()
                    .try_for_each(|&a| self.within(least.into(), most.into(), a.into()))?;
                // A node answers in one slot of a round.
                let twice = (1..)
                    .zip(list)
                    .any(|(rest, a)| list.iter().skip(rest).any(|b| a == b));
                (!twice)
                    .then_some(())
                    .ok_or(Refusal::NotOffered { setting })
            }
            _ => Err(Refusal::WrongKind { setting }),
        }
    }

    fn within(self, least: u32, most: u32, number: u32) -> Result<(), Refusal> {
        if (least..=most).contains(&number) {
            Ok(())
        } else {
            Err(Refusal::OutOfRange {
                setting: self.number(),
                least,
                most,
            })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    #[test]
    fn the_list_is_in_the_order_of_the_numbers_and_names_are_unique() {
        for (place, description) in SETTINGS.iter().enumerate() {
            assert_eq!(usize::from(description.setting.number()), place);
            assert_eq!(
                Setting::from_name(description.name),
                Some(description.setting)
            );
            assert_eq!(description.setting.description().name, description.name);
        }
    }

    #[test]
    fn defaults_are_allowed_values() {
        for description in SETTINGS {
            if let Fallback::Value(value) = description.default {
                assert_eq!(
                    description.setting.check(&value),
                    Ok(()),
                    "{}",
                    description.name
                );
            }
        }
    }

    #[test]
    fn each_number_is_allowed_up_to_its_limits_and_no_further() {
        for description in SETTINGS {
            let setting = description.setting;
            let (least, most) = match description.kind {
                Kind::Number { least, most, .. } => (least, most),
                Kind::Identifier { least, most } => (least.into(), most.into()),
                Kind::Word(words) => {
                    let count = words.len() as u32;
                    assert!(setting.check(&Value::Number(count - 1)).is_ok());
                    assert_eq!(
                        setting.check(&Value::Number(count)),
                        Err(Refusal::NotOffered {
                            setting: setting.number()
                        })
                    );
                    continue;
                }
                Kind::OneOf { numbers, .. } => {
                    for &number in numbers {
                        assert_eq!(setting.check(&Value::Number(number)), Ok(()));
                        for other in [number - 1, number + 1] {
                            assert_eq!(
                                setting.check(&Value::Number(other)).is_ok(),
                                numbers.contains(&other)
                            );
                        }
                    }
                    continue;
                }
                Kind::Addresses { .. } => continue,
            };
            let refusal = Err(Refusal::OutOfRange {
                setting: setting.number(),
                least,
                most,
            });
            for allowed in [least, most] {
                assert_eq!(setting.check(&Value::Number(allowed)), Ok(()));
            }
            for refused in [least.checked_sub(1), most.checked_add(1)]
                .into_iter()
                .flatten()
            {
                assert_eq!(setting.check(&Value::Number(refused)), refusal);
            }
        }
    }

    #[test]
    fn a_refused_change_changes_nothing_and_a_change_without_a_value_takes_back() {
        let mut settings = Settings::new();
        let pan = |value| Change {
            setting: Setting::Pan.number(),
            value,
        };
        settings.change(&pan(Some(Value::Number(7)))).unwrap();
        let refused = settings.change(&pan(Some(Value::Number(0xFFFF))));
        assert!(matches!(refused, Err(Refusal::OutOfRange { .. })));
        let wrong = settings.change(&pan(Some(Value::Addresses(Addresses::NONE))));
        assert_eq!(wrong, Err(Refusal::WrongKind { setting: 1 }));
        assert_eq!(settings.get(Setting::Pan), Some(Value::Number(7)));
        assert_eq!(settings.changes().count(), 1);
        settings.change(&pan(None)).unwrap();
        assert_eq!(settings, Settings::new());
    }

    #[test]
    fn a_setting_from_the_future_is_refused_by_its_number() {
        let refused = Settings::new().change(&Change {
            setting: 200,
            value: None,
        });
        assert_eq!(refused, Err(Refusal::UnknownSetting { setting: 200 }));
    }

    #[test]
    fn peers_must_be_addresses_that_nodes_can_have_each_named_once() {
        let check =
            |list: &[u16]| Setting::Peers.check(&Value::Addresses(Addresses::new(list).unwrap()));
        assert_eq!(check(&[]), Ok(()));
        assert_eq!(check(&[1, 2, 3, 4, 5, 6, 7, 0xFFFD]), Ok(()));
        for bad in [0, 0xFFFE, 0xFFFF] {
            assert_eq!(
                check(&[1, bad]),
                Err(Refusal::OutOfRange {
                    setting: 3,
                    least: 1,
                    most: 0xFFFD
                })
            );
        }
        assert_eq!(Addresses::new(&[1; 9]), None);
        for twice in [&[5, 5][..], &[1, 2, 3, 4, 5, 6, 7, 1]] {
            assert_eq!(check(twice), Err(Refusal::NotOffered { setting: 3 }));
        }
    }

    #[test]
    fn changes_lead_from_nothing_to_the_settings() {
        let mut settings = Settings::new();
        for (setting, value) in [(0, 5), (4, 20_000), (6, 16_500)] {
            let value = Some(Value::Number(value));
            settings.change(&Change { setting, value }).unwrap();
        }
        let changes: Vec<Change> = settings.changes().collect();
        let mut again = Settings::new();
        changes.iter().for_each(|c| again.change(c).unwrap());
        assert_eq!(again, settings);
    }
}
