//! `nova status`: how a board is doing.

use super::config::Port;
use anyhow::{Result, bail};
use nova_wire::{Boot, Command, Counters, Record, SettingsSource, Status as StatusRecord};
use serde::Deserialize;
use serde::de::{MapAccess, Visitor};
use std::fmt;
use std::io::Write;

/// Asks a board how it is doing: what it is, where its settings come from, and a count of everything that
/// failed since its start, by cause.
///
/// docs/wire-format.md says what each counter counts.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  nova status /dev/ttyACM0
  nova status tcp://localhost:7000 --json")]
pub(crate) struct Status {
    #[command(flatten)]
    port: Port,
    /// As one JSON object: {"about": {..}, "status": {..}}
    #[arg(long)]
    json: bool,
}

impl Status {
    pub(crate) fn run(self) -> Result<()> {
        let mut board = self.port.open()?;
        let said = board.ask(&Command::Status)?;
        let about = said.iter().rev().find_map(|record| match record {
            Record::About(about) => Some(about),
            _ => None,
        });
        let status = said.iter().rev().find_map(|record| match record {
            Record::Status(status) => Some(status),
            _ => None,
        });
        let (Some(about), Some(status)) = (about, status) else {
            bail!("{}: the answer is not whole; ask again", board.place());
        };
        let text = if self.json {
            serde_json::json!({ "about": about, "status": status }).to_string() + "\n"
        } else {
            text(about, status)?
        };
        Ok(std::io::stdout().lock().write_all(text.as_bytes())?)
    }
}

fn text(about: &Boot, status: &StatusRecord) -> Result<String> {
    use fmt::Write as _;
    let [major, minor, patch] = about.firmware;
    let mut text = format!(
        "node 0x{:04X}, {}, network 0x{:04X}, firmware {major}.{minor}.{patch}\n\
         runs for {:.1} s, started by: {}\n\
         settings: {}\n\n",
        about.address,
        word(&about.role)?,
        about.pan,
        status.t_us as f64 * 1e-6,
        word(&about.reset_cause)?,
        origin(about.settings),
    );
    let counters = ordered(&status.counters)?;
    let width = (counters.iter()).map(|(name, _)| name.len()).max();
    for (name, count) in &counters {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{name:<0$}  {count}", width.unwrap_or(0));
    }
    Ok(text)
}

fn origin(source: SettingsSource) -> &'static str {
    match source {
        SettingsSource::Defaults => "all defaults",
        SettingsSource::Stored => "from flash",
        SettingsSource::Damaged => {
            "DEFAULTS, because those in flash are damaged or cannot work; set them anew"
        }
        SettingsSource::OtherVersion => {
            "DEFAULTS, because those in flash are of another version of the firmware; set them anew"
        }
        SettingsSource::FlashFailed => "DEFAULTS, because the flash does not work",
    }
}

/// A choice in the word that records have for it.
fn word(choice: &impl serde::Serialize) -> Result<String> {
    let value = serde_json::to_value(choice)?;
    Ok(value.as_str().unwrap_or_default().replace('_', " "))
}

/// The counters by name, in the order of the record.
fn ordered(counters: &Counters) -> Result<Vec<(String, u32)>> {
    /// A JSON object as it stands.
    struct Ordered(Vec<(String, u32)>);

    impl<'de> Deserialize<'de> for Ordered {
        fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
            struct Entries;
            impl<'de> Visitor<'de> for Entries {
                type Value = Ordered;
                fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                    f.write_str("counters")
                }
                fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Ordered, A::Error> {
                    let mut entries = Vec::new();
                    while let Some(entry) = map.next_entry()? {
                        entries.push(entry);
                    }
                    Ok(Ordered(entries))
                }
            }
            deserializer.deserialize_map(Entries)
        }
    }

    let json = serde_json::to_string(counters)?;
    Ok(serde_json::from_str::<Ordered>(&json)?.0)
}
