//! Files that are either whole or as they were.

use anyhow::{Context, Result};
use std::path::Path;

/// Writes a file beside `path` and puts it in its place, so that a reader, or
/// an interruption, never meets half of it.
pub(crate) fn write_whole(path: &Path, content: impl AsRef<[u8]>) -> Result<()> {
    let mut half_written = path.as_os_str().to_owned();
    half_written.push(".part");
    std::fs::write(&half_written, content)
        .and_then(|()| std::fs::rename(&half_written, path))
        .with_context(|| format!("{}: cannot be written", path.display()))
}
