//! What a user calls the place that a board's bytes come from.

use crate::error::bad_input;
use anyhow::Result;
use std::fmt;
use std::path::{Path, PathBuf};

/// Where a board's bytes come from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Place {
    /// A serial port: its name, and bits per second.
    Serial { name: String, baud: u32 },
    /// A TCP server that passes on a board's bytes: `host:port`.
    Tcp(String),
    /// A file, or a pipe that has a name.
    File(PathBuf),
    /// `-`.
    StandardInput,
}

const TCP: &str = "tcp://";

impl Place {
    /// The place that `text` names: `-`, `tcp://HOST:PORT`, a serial port or a file.
    ///
    /// # Errors
    /// It names none of them; the message says why.
    pub(crate) fn named(text: &str, baud: u32) -> Result<Self> {
        if text == "-" {
            return Ok(Self::StandardInput);
        }
        if let Some(address) = text.strip_prefix(TCP) {
            return tcp(address);
        }
        if let Some((scheme, _)) = text.split_once("://") {
            return Err(bad_input!(
                "{text}: {scheme}:// is not known; {TCP}HOST:PORT, a serial port, a file or - is"
            ));
        }
        let serial = || Self::Serial {
            name: text.to_owned(),
            baud,
        };
        match std::fs::metadata(text) {
            Ok(there) if there.is_dir() => Err(bad_input!("{text}: is a folder")),
            Ok(there) if is_port(&there) => Ok(serial()),
            Ok(_) => Ok(Self::File(text.into())),
            // A port that is not there now is told from a file by its name.
            Err(_) if is_port_name(text) => Ok(serial()),
            Err(error) => Err(bad_input!("{text}: cannot be read: {error}")),
        }
    }

    /// Whether bytes come from here when a board sends them, rather than from a recording.
    pub(crate) fn is_live(&self) -> bool {
        !matches!(self, Self::File(_))
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Serial { name, .. } => f.write_str(name),
            Self::Tcp(address) => write!(f, "{TCP}{address}"),
            Self::File(path) => write!(f, "{}", path.display()),
            Self::StandardInput => f.write_str("standard input"),
        }
    }
}

fn tcp(address: &str) -> Result<Place> {
    let address = address.trim_end_matches('/');
    match address.rsplit_once(':') {
        Some((host, port)) if !host.is_empty() && port.parse::<u16>().is_ok() => {
            Ok(Place::Tcp(address.to_owned()))
        }
        _ => Err(bad_input!(
            "{TCP}{address}: not of the form {TCP}HOST:PORT with a port up to 65535"
        )),
    }
}

#[cfg(unix)]
fn is_port(there: &std::fs::Metadata) -> bool {
    use std::os::unix::fs::FileTypeExt;
    there.file_type().is_char_device()
}

#[cfg(not(unix))]
fn is_port(_: &std::fs::Metadata) -> bool {
    false
}

fn is_port_name(text: &str) -> bool {
    let windows = text
        .trim_start_matches(r"\\.\")
        .strip_prefix("COM")
        .is_some_and(|number| number.parse::<u16>().is_ok());
    windows || Path::new(text).starts_with("/dev")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(text: &str) -> Result<Place> {
        Place::named(text, 1_000_000)
    }

    #[test]
    fn names_tell_ports_servers_files_and_standard_input_apart() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("anchor.bin");
        std::fs::write(&file, b"x").unwrap();
        let serial = |name: &str| Place::Serial {
            name: name.to_owned(),
            baud: 1_000_000,
        };
        for (text, place) in [
            ("-", Place::StandardInput),
            ("tcp://127.0.0.1:7000", Place::Tcp("127.0.0.1:7000".into())),
            ("tcp://[::1]:7000/", Place::Tcp("[::1]:7000".into())),
            ("/dev/ttyNOVA9", serial("/dev/ttyNOVA9")),
            ("COM3", serial("COM3")),
            (file.to_str().unwrap(), Place::File(file.clone())),
        ] {
            assert_eq!(named(text).unwrap(), place, "{text}");
        }
    }

    #[test]
    fn what_names_nothing_is_told_with_the_reason() {
        let folder = tempfile::tempdir().unwrap();
        for (text, mention) in [
            (folder.path().to_str().unwrap(), "is a folder"),
            ("nowhere.bin", "cannot be read"),
            ("udp://127.0.0.1:1", "udp:// is not known"),
            ("tcp://127.0.0.1", "HOST:PORT"),
            ("tcp://:7000", "HOST:PORT"),
            ("tcp://host:70000", "HOST:PORT"),
            ("COMET", "cannot be read"),
        ] {
            let error = named(text).unwrap_err().to_string();
            assert!(
                error.starts_with(text) && error.contains(mention),
                "{error}"
            );
        }
    }
}
