//! Files with a board's settings: TOML.

use super::values::{given, named, shown};
use crate::error::bad_input;
use anyhow::{Context, Result};
use nova_wire::settings::{Fallback, Setting};
use nova_wire::{Change, SettingValue};
use std::fmt::Write as _;
use std::path::Path;

/// What belongs to one board: on another these make two nodes with one address, and wrong ranges.
const OF_ONE_BOARD: [Setting; 3] = [
    Setting::Address,
    Setting::TxAntennaDelay,
    Setting::RxAntennaDelay,
];

/// A file with these settings; those that are defaults are commented out, so that on another board they
/// stay what that board brings. So are those of this board alone, unless `all` are wanted.
pub(super) fn written(settings: &[SettingValue], all: bool) -> String {
    let mut text = String::from(
        "# Settings of a board, for `nova config import`. What is commented out is the default, or this board's alone.\n",
    );
    for told in settings {
        // What only newer boards know has no name here.
        let Some(setting) = Setting::from_number(told.setting) else {
            continue;
        };
        let description = setting.description();
        let held_back = told.set && !all && OF_ONE_BOARD.contains(&setting);
        let reason = if held_back {
            "# Set on this board, and right for no other; `nova config export --all` exports it.\n"
        } else {
            ""
        };
        let mark = if told.set && !held_back { "" } else { "# " };
        let value = shown(description, &told.value);
        let default = match description.default {
            Fallback::Board(how) => format!(" (default: {how})"),
            Fallback::Value(_) => String::new(),
        };
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "\n# {}{default}\n{reason}{mark}{} = {value}",
            description.meaning, description.name
        );
    }
    text
}

/// The settings in a file.
///
/// # Errors
/// It cannot be read, or something in it is no setting or not allowed.
pub(super) fn read(path: &Path) -> Result<Vec<Change>> {
    let name = path.display();
    let text = std::fs::read_to_string(path)
        .map_err(|error| bad_input!("{name}: cannot be read: {error}"))?;
    changes(&text).with_context(|| name.to_string())
}

fn changes(text: &str) -> Result<Vec<Change>> {
    let table: toml::Table =
        toml::from_str(text).map_err(|error| bad_input!("{}", error.to_string().trim_end()))?;
    let mut changes = Vec::new();
    collect("", &table, &mut changes)?;
    if changes.is_empty() {
        return Err(bad_input!("there is no setting in it"));
    }
    Ok(changes)
}

/// Settings in groups have names with dots.
fn collect(group: &str, table: &toml::Table, changes: &mut Vec<Change>) -> Result<()> {
    for (key, value) in table {
        let name = format!("{group}{key}");
        match value {
            toml::Value::Table(table) => collect(&format!("{name}."), table, changes)?,
            value => changes.push(given(named(&name)?, value)?),
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use nova_wire::settings::Addresses;
    use nova_wire::{Settings, Value};

    fn settings(changes: &[Change]) -> Settings {
        let mut settings = Settings::new();
        changes.iter().for_each(|c| settings.change(c).unwrap());
        settings
    }

    #[test]
    fn what_was_set_comes_back_and_defaults_stay_out() {
        let peers = Addresses::new(&[3, 4]).unwrap();
        let told = [
            (Setting::Address, Value::Number(0x0A1B), false),
            (Setting::Pan, Value::Number(0x1234), true),
            (Setting::Part, Value::Number(1), true),
            (Setting::Peers, Value::Addresses(peers), true),
            (Setting::TxAntennaDelay, Value::Number(16_400), true),
            (Setting::RxAntennaDelay, Value::Number(16_456), false),
        ];
        let told = told.map(|(setting, value, set)| SettingValue {
            setting: setting.number(),
            value,
            set,
        });
        let set = |but: Option<Setting>| -> Vec<Change> {
            (told.iter().filter(|t| t.set))
                .filter(|t| but.is_none_or(|but| t.setting != but.number()))
                .map(|t| Change {
                    setting: t.setting,
                    value: Some(t.value),
                })
                .collect()
        };
        let all = written(&told, true);
        assert_eq!(settings(&changes(&all).unwrap()), settings(&set(None)));
        assert!(all.contains("# address = 0x0A1B"), "{all}");

        // Without what is this board's alone, and it says why.
        let text = written(&told, false);
        let others = set(Some(Setting::TxAntennaDelay));
        assert_eq!(settings(&changes(&text).unwrap()), settings(&others));
        let reason = "right for no other; `nova config export --all` exports it.\n";
        let held_back = format!("{reason}# antenna_delay.tx_ticks = 16400\n");
        assert_eq!(text.matches(reason).count(), 1, "{text}");
        assert!(text.contains(&held_back), "{text}");
    }

    #[test]
    fn groups_may_stand_as_tables() {
        let tables = "address = 7\n[antenna_delay]\ntx_ticks = 1\nrx_ticks = 2\n";
        let dots = "address = 7\nantenna_delay.tx_ticks = 1\nantenna_delay.rx_ticks = 2\n";
        let both = [tables, dots].map(|text| settings(&changes(text).unwrap()));
        assert_eq!(both[0], both[1]);
        assert_eq!(both[0].get(Setting::RxAntennaDelay), Some(Value::Number(2)));
    }

    #[test]
    fn what_is_wrong_in_a_file_is_told() {
        for (text, part) in [
            ("", "no setting"),
            ("# address = 7", "no setting"),
            ("pan = 1\npan = 2", "duplicate"),
            ("adress = 7", "is address meant?"),
            ("[antenna_delay]\ntx = 1", "antenna_delay.tx"),
            ("pan = [", "line 1"),
            ("period_us = 10", "between 1000 and"),
        ] {
            let told = format!("{:#}", changes(text).unwrap_err());
            assert!(told.contains(part), "{text}: {told}");
        }
    }
}
