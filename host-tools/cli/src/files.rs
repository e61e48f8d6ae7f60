//! Files that are either whole or as they were.

use anyhow::{Context, Result};
use std::io;
use std::path::Path;

/// Writes a file beside `path` and puts it in its place, so that a reader, or
/// an interruption, never meets half of it. What is no ordinary file, a pipe or
/// a terminal, is written to as it is; a link keeps pointing where it points.
pub(crate) fn write_whole(path: &Path, content: impl AsRef<[u8]>) -> Result<()> {
    write(path, content.as_ref()).with_context(|| format!("{}: cannot be written", path.display()))
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
