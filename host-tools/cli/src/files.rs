//! Files that are written either whole or not at all, and TOML files, whose faults are said with their line.

use crate::error::bad_input;
use anyhow::{Context, Result};
use serde::de::DeserializeOwned;
use std::io;
use std::path::Path;

/// Writes a file beside `path` and puts it in its place, so that a reader, or
/// an interruption, never meets half of it. What is no ordinary file, a pipe or
/// a terminal, is written to as it is; a link keeps pointing where it points.
pub(crate) fn write_whole(path: &Path, content: impl AsRef<[u8]>) -> Result<()> {
    write(path, content.as_ref()).with_context(|| format!("{}: cannot be written", path.display()))
}

/// Reads a TOML file.
///
/// # Errors
/// `BadInput` with the file's name, the line and what is wrong there.
pub(crate) fn read_toml<T: DeserializeOwned>(path: &Path) -> Result<T> {
    let shown = path.display();
    let text = std::fs::read_to_string(path)
        .map_err(|error| bad_input!("{shown}: cannot be read: {error}"))?;
    toml::from_str(&text).map_err(|error| {
        let start = error.span().map_or(0, |span| span.start);
        let line = 1 + text.bytes().take(start).filter(|&b| b == b'\n').count();
        bad_input!(
            "{shown}: line {line}: {}",
            error.message().replace('\n', ", ")
        )
    })
}

fn write(path: &Path, content: &[u8]) -> io::Result<()> {
    let target = match path.canonicalize() {
        Ok(target) => target,
        Err(error) if error.kind() == io::ErrorKind::NotFound => path.to_owned(),
        Err(error) => return Err(error),
    };
    match std::fs::metadata(&target) {
        Ok(existing) if !existing.is_file() => return std::fs::write(&target, content),
        Ok(existing) if existing.permissions().readonly() => {
            return Err(io::Error::new(
                io::ErrorKind::PermissionDenied,
                "the file is read-only",
            ));
        }
        _ => {}
    }
    let mut part = target.as_os_str().to_owned();
    part.push(".part");
    std::fs::write(&part, content)
        .and_then(|()| std::fs::rename(&part, &target))
        .inspect_err(|_| {
            // Best effort: the first error is the one to tell.
            let _ = std::fs::remove_file(&part);
        })
}
