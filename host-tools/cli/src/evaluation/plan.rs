//! What a table flies, read from TOML.
//!
//! ```toml
//! title = "Wind"
//! source = "paper, Fig. 16"            # optional
//!
//! [common]                             # optional: what all conditions share
//! method = "nova"
//! preset = "P"
//! set = { pilot = "follow" }
//!
//! [[condition]]
//! name = "wind XY"
//! set = { wind_xy = 0.35 }             # over those of [common]
//! paper = "1.665 / 52-59"              # optional: figures to stand beside ours
//! reference = "0.95 / 59"
//! reference_bound_m = 0.060
//! ```
//!
//! A condition may also give `method`, `preset` and `flown_by`: the method that flies instead, while
//! the condition's own method is shown what that flight measured.

use crate::error::bad_input;
use crate::files::read_toml;
use crate::settings;
use anyhow::Result;
use nova_flight::{Condition, Method, Preset, Settings};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// A table to be flown.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Plan {
    pub(crate) title: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) source: Option<String>,
    pub(crate) entries: Vec<Entry>,
}

/// One condition, and the figures to stand beside its own.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Entry {
    pub(crate) name: String,
    pub(crate) method: Method,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) flown_by: Option<Method>,
    pub(crate) settings: Settings,
    pub(crate) beside: Beside,
}

/// Figures of others.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Beside {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) paper: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) reference: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) reference_bound_m: Option<f64>,
}

impl Plan {
    /// Reads a table.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let shown = path.display();
        let file: File = read_toml(path)?;
        file.plan().map_err(|error| bad_input!("{shown}: {error}"))
    }

    /// All conditions, for the simulator.
    pub(crate) fn conditions(&self) -> Vec<Condition> {
        self.entries.iter().map(Entry::condition).collect()
    }
}

impl Entry {
    /// For the simulator.
    pub(crate) fn condition(&self) -> Condition {
        Condition {
            method: self.method,
            flown_by: self.flown_by,
            settings: self.settings.clone(),
        }
    }
}

/// The file as it is.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    title: String,
    source: Option<String>,
    #[serde(default)]
    common: Common,
    #[serde(default)]
    condition: Vec<Row>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Common {
    method: Option<Method>,
    flown_by: Option<Method>,
    preset: Option<Preset>,
    #[serde(default)]
    set: toml::Table,
}

/// Without `flatten`, which would let unknown keys pass.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Row {
    name: String,
    method: Option<Method>,
    flown_by: Option<Method>,
    preset: Option<Preset>,
    #[serde(default)]
    set: toml::Table,
    paper: Option<String>,
    reference: Option<String>,
    reference_bound_m: Option<f64>,
}

impl File {
    fn plan(self) -> Result<Plan> {
        let common = &self.common;
        let entries = (self.condition.into_iter())
            .map(|row| {
                let name = row.name.clone();
                (row.entry(common)).map_err(|error| bad_input!("condition {name:?}: {error}"))
            })
            .collect::<Result<Vec<Entry>>>()?;
        if entries.is_empty() {
            return Err(bad_input!("there is no [[condition]]"));
        }
        for (index, entry) in entries.iter().enumerate() {
            if (entries.iter().take(index)).any(|earlier| earlier.name == entry.name) {
                return Err(bad_input!("there are two conditions {:?}", entry.name));
            }
        }
        Ok(Plan {
            title: self.title,
            source: self.source,
            entries,
        })
    }
}

impl Row {
    fn entry(self, common: &Common) -> Result<Entry> {
        let changes = settings::changes(&common.set).chain(settings::changes(&self.set));
        let preset = self.preset.or(common.preset).unwrap_or(Preset::P);
        Ok(Entry {
            settings: settings::settings(preset, changes)?,
            name: self.name,
            method: (self.method.or(common.method)).ok_or_else(|| bad_input!("no method"))?,
            flown_by: self.flown_by.or(common.flown_by),
            beside: Beside {
                paper: self.paper,
                reference: self.reference,
                reference_bound_m: self.reference_bound_m,
            },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(text: &str) -> Result<Plan> {
        toml::from_str::<File>(text)?.plan()
    }

    #[test]
    fn a_condition_overrides_what_is_common() {
        let plan = plan(
            "title = 't'\n\
             [common]\nmethod = 'map'\npreset = 'R'\nset = { wind_xy = 0.3, wind_z = 0.1 }\n\
             [[condition]]\nname = 'a'\n\
             [[condition]]\nname = 'b'\npreset = 'P'\nset = { wind_z = 0 }\npaper = '1 / 2'\n",
        )
        .unwrap();
        let [a, b] = &plan.entries[..] else { panic!() };
        assert_eq!((a.settings.wind_xy, a.settings.wind_z), (0.3, 0.1));
        assert_eq!(
            a.settings.uwb_bias_m,
            Settings::preset(Preset::R).uwb_bias_m
        );
        assert_eq!((b.settings.wind_xy, b.settings.wind_z), (0.3, 0.0));
        assert_eq!(
            b.settings.uwb_bias_m,
            Settings::preset(Preset::P).uwb_bias_m
        );
        assert_eq!(b.beside.paper.as_deref(), Some("1 / 2"));
    }

    #[test]
    fn every_table_of_the_repository_is_understood() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tables");
        let mut count = 0;
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if let Err(error) = Plan::read(&path) {
                panic!("{error}");
            }
            count += 1;
        }
        assert!(count >= 10, "{count}");
    }

    #[test]
    fn a_plan_survives_json() {
        let plan = plan(
            "title = 't'\n[common]\nmethod = 'map'\n\
             [[condition]]\nname = 'a'\nset = { rw = 0.1 }\nreference_bound_m = 0.1\n",
        )
        .unwrap();
        let json = serde_json::to_string(&plan).unwrap();
        assert_eq!(serde_json::from_str::<Plan>(&json).unwrap(), plan);
    }

    #[test]
    fn what_is_wrong_is_said() {
        for (text, mention) in [
            ("title = 't'", "no [[condition]]"),
            ("title = 't'\n[[condition]]\nname = 'a'", "\"a\": no method"),
            (
                "title = 't'\n[common]\nmethod = 'map'\n[[condition]]\nname = 'a'\nset = { x = 1 }",
                "\"a\": there is no setting \"x\"",
            ),
            (
                "title = 't'\n[common]\nmethod = 'map'\n[[condition]]\nname = 'a'\n[[condition]]\nname = 'a'",
                "two conditions \"a\"",
            ),
            (
                "title = 't'\n[common]\nmethod = 'map'\n[[condition]]\nname = 'a'\nwind = 1",
                "wind",
            ),
        ] {
            let error = plan(text).unwrap_err().to_string();
            assert!(error.contains(mention), "{error}");
        }
    }
}
