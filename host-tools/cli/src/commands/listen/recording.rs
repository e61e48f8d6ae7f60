//! The raw stream, kept byte for byte.

use crate::error::bad_input;
use anyhow::{Context, Result};
use std::fs::File;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

/// A recording that grows.
pub(super) struct Recording {
    path: PathBuf,
    file: File,
    bytes: u64,
}

impl Recording {
    /// Begins a recording. One that exists is kept: what a board said does not come again.
    pub(super) fn begin(path: &Path) -> Result<Self> {
        let shown = path.display();
        let file = File::options()
            .write(true)
            .create_new(true)
            .open(path)
            .map_err(|error| match error.kind() {
                ErrorKind::AlreadyExists => {
                    bad_input!("{shown}: exists already; --record writes new files only")
                }
                _ => bad_input!("{shown}: cannot be written: {error}"),
            })?;
        Ok(Self {
            path: path.to_owned(),
            file,
            bytes: 0,
        })
    }

    /// Adds what came. Unbuffered: what the screen has shown is in the file, whatever happens next.
    pub(super) fn add(&mut self, bytes: &[u8]) -> Result<()> {
        self.file
            .write_all(bytes)
            .map_err(|error| anyhow::anyhow!("{error}"))
            .with_context(|| format!("{}: cannot be written", self.path.display()))?;
        self.bytes += bytes.len() as u64;
        Ok(())
    }

    /// Where, and how much so far.
    pub(super) fn so_far(&self) -> (String, u64) {
        (self.path.display().to_string(), self.bytes)
    }
}
