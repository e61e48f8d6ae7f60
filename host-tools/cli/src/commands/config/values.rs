//! Settings as people write them.

use crate::board::{allowed, explained};
use crate::error::bad_input;
use anyhow::Result;
use nova_wire::settings::{Addresses, Description, Kind, MAX_ADDRESSES, SETTINGS, Setting};
use nova_wire::{Change, Value};

/// The word that takes a setting back.
const DEFAULT: &str = "default";

/// The setting of this name.
///
/// # Errors
/// There is none; which ones there are, and which was likely meant.
pub(super) fn named(name: &str) -> Result<&'static Description> {
    Setting::from_name(name)
        .map(Setting::description)
        .ok_or_else(|| crate::settings::unknown(name, SETTINGS.iter().map(|d| d.name)))
}

/// `name=value`, where the value may be `default`.
///
/// # Errors
/// What is wrong with it, and what is allowed.
pub(super) fn change(text: &str) -> Result<Change> {
    let (name, value) = text
        .split_once('=')
        .ok_or_else(|| bad_input!("{text}: not of the form NAME=VALUE"))?;
    let description = named(name.trim())?;
    let value = value.trim();
    if value == DEFAULT {
        return Ok(Change {
            setting: description.setting.number(),
            value: None,
        });
    }
    // As in a file; words and lists may come without their quotes and brackets.
    let (list, word) = (format!("[{value}]"), format!("{value:?}"));
    let parsed = [value, &list, &word].into_iter().find_map(|text| {
        let mut table = toml::from_str::<toml::Table>(&format!("value = {text}")).ok()?;
        table.remove("value")
    });
    let parsed = parsed.ok_or_else(|| wrong(description, value))?;
    given(description, &parsed)
}

/// A setting as it stands in a file.
///
/// # Errors
/// What is wrong with it, and what is allowed.
pub(super) fn given(description: &Description, value: &toml::Value) -> Result<Change> {
    let parsed =
        parsed(description, value).ok_or_else(|| wrong(description, &value.to_string()))?;
    (description.setting.check(&parsed))
        .map_err(|refusal| bad_input!("{}", explained(&refusal)))?;
    Ok(Change {
        setting: description.setting.number(),
        value: Some(parsed),
    })
}

fn wrong(description: &Description, value: &str) -> anyhow::Error {
    bad_input!(
        "{}: {value} is not allowed; {}",
        description.name,
        allowed(description)
    )
}

fn parsed(description: &Description, value: &toml::Value) -> Option<Value> {
    let number = |value: &toml::Value| value.as_integer().and_then(|n| u32::try_from(n).ok());
    match description.kind {
        Kind::Number { .. } | Kind::Identifier { .. } | Kind::OneOf { .. } => {
            number(value).map(Value::Number)
        }
        Kind::Word(words) => {
            let place = words.iter().position(|word| value.as_str() == Some(word))?;
            u32::try_from(place).ok().map(Value::Number)
        }
        Kind::Addresses { .. } => {
            let one = std::slice::from_ref(value);
            let list = value.as_array().map_or(one, Vec::as_slice);
            let addresses = list
                .iter()
                .map(|value| number(value).and_then(|n| u16::try_from(n).ok()))
                .collect::<Option<Vec<u16>>>()?;
            (addresses.len() <= MAX_ADDRESSES).then_some(())?;
            Addresses::new(&addresses).map(Value::Addresses)
        }
    }
}

/// A value as it stands in a file.
pub(super) fn shown(description: &Description, value: &Value) -> String {
    match (description.kind, value) {
        (Kind::Identifier { .. }, Value::Number(number)) => format!("0x{number:04X}"),
        (Kind::Word(words), Value::Number(number)) => {
            let word = usize::try_from(*number).ok().and_then(|n| words.get(n));
            // A word that only newer programs know.
            word.map_or_else(|| number.to_string(), |word| format!("{word:?}"))
        }
        (_, Value::Number(number)) => number.to_string(),
        (_, Value::Addresses(addresses)) => {
            let list: Vec<String> = (addresses.as_slice().iter())
                .map(|address| format!("0x{address:04X}"))
                .collect();
            format!("[{}]", list.join(", "))
        }
    }
}

/// A value for programs.
pub(super) fn json(description: &Description, value: &Value) -> serde_json::Value {
    match (description.kind, value) {
        (Kind::Word(words), Value::Number(number)) => (usize::try_from(*number).ok())
            .and_then(|n| words.get(n))
            .map_or_else(|| (*number).into(), |&word| word.into()),
        (_, Value::Number(number)) => (*number).into(),
        (_, Value::Addresses(addresses)) => addresses.as_slice().into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn complaint(text: &str) -> String {
        change(text).unwrap_err().to_string()
    }

    #[test]
    fn values_are_taken_as_people_write_them() {
        let number = |n| Some(Value::Number(n));
        let addresses = |list: &[u16]| Some(Value::Addresses(Addresses::new(list).unwrap()));
        for (text, value) in [
            ("pan=0xDECA", number(0xDECA)),
            ("pan = 7", number(7)),
            ("part=initiator", number(1)),
            ("part=\"responder\"", number(0)),
            ("peers=0x0A1B", addresses(&[0x0A1B])),
            ("peers=0x0A1B,258", addresses(&[0x0A1B, 258])),
            ("peers=[1, 2]", addresses(&[1, 2])),
            ("peers=[]", addresses(&[])),
            ("period_us=20_000", number(20_000)),
            ("antenna_delay.tx_ticks=16500", number(16_500)),
            ("address=default", None),
        ] {
            assert_eq!(change(text).unwrap().value, value, "{text}");
        }
    }

    #[test]
    fn what_is_not_allowed_is_told_with_what_is() {
        for (text, part) in [
            ("pan", "NAME=VALUE"),
            ("pam=1", "is pan meant?"),
            ("pan=0x10000", "pan: must lie between 0x0000 and 0xFFFE"),
            ("pan=-1", "pan: -1 is not allowed; 0x0000 to 0xFFFE"),
            ("pan=abc", "pan: \"abc\" is not allowed"),
            ("pan=\"", "is not allowed"),
            (
                "period_us=1.5",
                "period_us: 1.5 is not allowed; 1000 to 60000000 us",
            ),
            ("part=boss", "responder or initiator"),
            ("phy.channel=6", "1 or 2 or 3 or 4 or 5 or 7"),
            ("peers=1,2,3,4,5,6,7,8,9", "up to 8 addresses"),
            ("peers=0", "must lie between 0x0001 and 0xFFFD"),
            ("peers=65536", "up to 8 addresses"),
        ] {
            assert!(
                complaint(text).contains(part),
                "{text}: {}",
                complaint(text)
            );
        }
    }

    #[test]
    fn what_is_shown_can_be_given() {
        for (name, value) in [
            ("pan", Value::Number(0xDECA)),
            ("part", Value::Number(1)),
            ("peers", Value::Addresses(Addresses::NONE)),
            (
                "peers",
                Value::Addresses(Addresses::new(&[1, 0xFFFD]).unwrap()),
            ),
            ("reply_us", Value::Number(700)),
            ("phy.bitrate_kbps", Value::Number(850)),
        ] {
            let shown = shown(named(name).unwrap(), &value);
            let again = change(&format!("{name}={shown}")).unwrap();
            assert_eq!(again.value, Some(value), "{shown}");
        }
    }
}
