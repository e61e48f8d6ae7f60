//! Settings of a flight as given on the command line or in a table.

use crate::error::bad_input;
use anyhow::Result;
use nova_flight::{Preset, Settings};
use std::fmt::Write as _;
use std::str::FromStr;

/// `key=value`: one setting that differs from the preset.
#[derive(Clone, Debug)]
pub(crate) struct Change {
    key: String,
    value: toml::Value,
}

impl Change {
    /// Sets `key` to a word.
    pub(crate) fn word(key: &str, word: &str) -> Self {
        Self {
            key: key.to_owned(),
            value: toml::Value::String(word.to_owned()),
        }
    }
}

impl FromStr for Change {
    type Err = String;

    /// The value is TOML; a bare word is a string.
    fn from_str(text: &str) -> Result<Self, String> {
        let (key, value) = text.split_once('=').ok_or("not of the form key=value")?;
        let (key, value) = (key.trim(), value.trim());
        if key.is_empty() || value.is_empty() {
            return Err("not of the form key=value".to_owned());
        }
        let parsed = toml::from_str::<toml::Table>(&format!("value = {value}"));
        let value = (parsed.ok())
            .and_then(|mut table| table.remove("value"))
            .unwrap_or_else(|| toml::Value::String(value.to_owned()));
        Ok(Self {
            key: key.to_owned(),
            value,
        })
    }
}

/// The changes that a table of settings makes.
pub(crate) fn changes(table: &toml::Table) -> impl Iterator<Item = Change> {
    table.iter().map(|(key, value)| Change {
        key: key.clone(),
        value: value.clone(),
    })
}

/// A preset with changes, the later ones over the earlier.
pub(crate) fn settings(
    preset: Preset,
    changes: impl IntoIterator<Item = Change>,
) -> Result<Settings> {
    let mut settings = Settings::preset(preset);
    for change in changes {
        settings = changed(&settings, change)?;
    }
    (settings.validate()).map_err(|error| bad_input!("setting {error}"))?;
    Ok(settings)
}

fn changed(settings: &Settings, Change { key, value }: Change) -> Result<Settings> {
    let mut table = table_of(settings)?;
    let Some(place) = table.get_mut(&key) else {
        return Err(unknown(&key, table.keys().map(String::as_str)));
    };
    let shown = value.to_string();
    *place = value;
    (table.try_into())
        .map_err(|error: toml::de::Error| bad_input!("setting {key}: {shown}: {}", error.message()))
}

/// There is no such setting; which ones there are, and which was likely meant.
pub(crate) fn unknown<'a>(key: &str, known: impl Iterator<Item = &'a str>) -> anyhow::Error {
    let list: Vec<&str> = known.collect();
    let nearest = (list.iter())
        .map(|name| (strsim::damerau_levenshtein(key, name), name))
        .min()
        .filter(|(distance, _)| 3 * distance <= key.chars().count().max(3))
        .map_or_else(String::new, |(_, name)| format!(" (is {name} meant?)"));
    bad_input!(
        "there is no setting {key:?}{nearest}; there are {}",
        list.join(", ")
    )
}

/// The settings by name.
pub(crate) fn table_of(settings: &Settings) -> Result<toml::Table> {
    Ok(toml::Table::try_from(settings)?)
}

/// What the settings mean, for the help; in the order of [`Settings`], where more is said.
const MEANINGS: [(&str, &str); 35] = [
    ("pilot", "follow or self-nav; as --pilot"),
    ("distance_m", "horizontal distance at the start"),
    ("altitude_m", "height at the start"),
    ("speed_m_s", "cruise speed"),
    ("acceleration_m_s2", "how fast the velocity can be changed"),
    ("time_limit_s", "longest flight"),
    (
        "first_guess",
        "normal, high or very-high: how far off it is",
    ),
    ("wind_xy", "wind, east and north each, one sigma, m/s"),
    ("wind_z", "wind, vertical, one sigma, m/s"),
    ("wind_hold_s", "how long it stays the same"),
    ("wind_seen", "whether the accelerometer feels it"),
    ("imu_noise_density", "white noise, g/sqrt(Hz)"),
    ("imu_bias_instability", "g"),
    ("rw", "accelerometer random walk, m/s^2/sqrt(s)"),
    ("imu_scale", "factor on these three"),
    ("imu_rate_hz", "readings a second"),
    ("initial_velocity_sigma", "velocity error at the start, m/s"),
    ("initial_bias_sigma", "constant acceleration error, m/s^2"),
    ("attitude_sigma_rad", "constant attitude error"),
    ("baro_sigma_m", "barometer, white"),
    ("baro_drift", "barometer, random walk, m/sqrt(s)"),
    ("baro_rate_hz", "readings a second"),
    ("uwb_rate_hz", "ranges a second"),
    ("uwb_floor_m", "range noise whatever the signal"),
    (
        "uwb_reference_m",
        "range noise that grows with distance, at 30 m",
    ),
    ("uwb_bias_m", "constant range error"),
    ("tx_power_dbm", "transmit power"),
    ("uwb_noise_floor_dbm", "noise floor"),
    ("uwb_required_snr_db", "where one range in ten is lost"),
    (
        "antenna_null",
        "whether antennas are blind straight up and down",
    ),
    ("nlos_probability", "part of the ranges that come late"),
    ("nlos_mean_m", "how late, mean"),
    ("lambda", "weight in the planner of the paper's method"),
    ("lambda_weighs", "travel or dop: what it weighs"),
    ("plan", "careful or fast: how the MAP navigator approaches"),
];

/// All settings with their values in both presets, for the help.
pub(crate) fn help() -> String {
    let table = |preset| table_of(&Settings::preset(preset)).unwrap_or_default();
    let (p, r) = (table(Preset::P), table(Preset::R));
    let shown = |table: &toml::Table, key: &str| match table.get(key) {
        Some(toml::Value::String(word)) => word.clone(),
        Some(value) => value.to_string(),
        None => String::new(),
    };
    let mut text = format!("Settings:{:22}{:<10}{:<8}\n", "", "preset P", "R");
    for (key, meaning) in MEANINGS {
        let (p, r) = (shown(&p, key), shown(&r, key));
        let r = if p == r { "" } else { &r };
        // Writing to a string cannot fail.
        let _ = writeln!(text, "  {key:<28} {p:<9} {r:<7} {meaning}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn set(changes: &[&str]) -> Result<Settings> {
        settings(Preset::P, changes.iter().map(|text| text.parse().unwrap()))
    }

    #[test]
    fn numbers_words_and_truths_are_taken_as_such() {
        let settings = set(&[
            "altitude_m=40",
            "first_guess=very-high",
            "wind_seen = true",
            "rw=5e-4",
        ])
        .unwrap();
        assert_eq!(settings.altitude_m, 40.0);
        assert_eq!(
            settings.first_guess,
            nova_flight::FirstGuessQuality::VeryHigh
        );
        assert!(settings.wind_seen);
        assert_eq!(settings.rw, 5e-4);
    }

    #[test]
    fn every_setting_is_explained() {
        let table = table_of(&Settings::preset(Preset::P)).unwrap();
        let mut explained = MEANINGS.map(|(key, _)| key);
        explained.sort_unstable();
        let keys: Vec<&String> = table.keys().collect();
        assert_eq!(explained.to_vec(), keys);
    }

    #[test]
    fn the_last_of_several_changes_counts() {
        assert_eq!(set(&["wind_z=1", "wind_z=0.5"]).unwrap().wind_z, 0.5);
    }

    #[test]
    fn what_cannot_be_meant_is_named() {
        for (change, mentions) in [
            ("wind_yx=1", ["wind_yx", "(is wind_xy meant?)"]),
            ("colour=red", ["colour", "wind_xy, wind_z"]),
            ("wind_xy=strong", ["wind_xy", "\"strong\""]),
            ("first_guess=poor", ["first_guess", "very-high"]),
            ("wind_xy=-1", ["wind_xy", "-1"]),
            ("wind_xy=nan", ["wind_xy", "NaN"]),
        ] {
            let error = set(&[change]).unwrap_err().to_string();
            for mention in mentions {
                assert!(error.contains(mention), "{error}");
            }
        }
        for text in ["wind_xy", "=1", "wind_xy="] {
            assert!(text.parse::<Change>().is_err());
        }
    }
}
