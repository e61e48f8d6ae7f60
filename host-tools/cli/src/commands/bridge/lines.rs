//! Lines for whoever reads our output: a reader that is slow, or has stopped, must not hold up the autopilot.

use anyhow::Result;
use serde::Serialize;
use std::io::{self, Write};
use std::sync::mpsc::{SyncSender, TrySendError, sync_channel};
use std::thread::JoinHandle;

/// So many lines wait for their reader, a minute's worth or so; what comes when they are there already is dropped.
const WAITING: usize = 4096;

/// Writes lines in their order.
pub(super) struct Lines {
    to_writer: SyncSender<String>,
    writer: JoinHandle<io::Result<()>>,
    dropped: u64,
    have_nobody: bool,
    trouble: Option<serde_json::Error>,
}

impl Lines {
    pub(super) fn to_stdout() -> Self {
        Self::to(io::stdout())
    }

    fn to(mut out: impl Write + Send + 'static) -> Self {
        let (to_writer, lines) = sync_channel::<String>(WAITING);
        let writer = std::thread::spawn(move || {
            for line in lines {
                writeln!(out, "{line}")?;
                out.flush()?;
            }
            Ok(())
        });
        Self {
            to_writer,
            writer,
            dropped: 0,
            have_nobody: false,
            trouble: None,
        }
    }

    /// Hands on a line.
    pub(super) fn line(&mut self, line: &impl Serialize) {
        match serde_json::to_string(line) {
            Ok(line) => match self.to_writer.try_send(line) {
                Ok(()) => {}
                Err(TrySendError::Full(_)) => self.dropped += 1,
                Err(TrySendError::Disconnected(_)) => self.have_nobody = true,
            },
            Err(error) => self.trouble = Some(error),
        }
    }

    /// Whether nobody reads any more.
    pub(super) fn have_nobody(&self) -> bool {
        self.have_nobody
    }

    /// How many were dropped, once all others are written.
    ///
    /// # Errors
    /// Why they could not be written.
    pub(super) fn finish(self) -> Result<u64> {
        drop(self.to_writer);
        if let Ok(written) = self.writer.join() {
            written?;
        }
        self.trouble
            .map_or(Ok(self.dropped), |error| Err(error.into()))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use std::sync::{Arc, Mutex};

    /// A pipe whose reader takes nothing while this is locked.
    #[derive(Clone, Default)]
    struct Pipe(Arc<Mutex<Vec<u8>>>);

    impl Write for Pipe {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0.lock().unwrap().write(bytes)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn a_reader_that_stops_loses_lines_and_holds_nobody_up() {
        let pipe = Pipe::default();
        let mut lines = Lines::to(pipe.clone());
        let stopped = pipe.0.lock().unwrap();
        let told = 2 * WAITING;
        (0..told).for_each(|number| lines.line(&number));
        drop(stopped);
        let dropped = lines.finish().unwrap() as usize;
        // One may be on its way.
        assert!(
            (told - WAITING - 1..=told - WAITING).contains(&dropped),
            "{dropped}"
        );
        let text = String::from_utf8(pipe.0.lock().unwrap().clone()).unwrap();
        let numbers: Vec<usize> = text.lines().map(|line| line.parse().unwrap()).collect();
        assert!(numbers.iter().copied().eq(0..told - dropped));
    }

    #[test]
    fn a_reader_that_has_gone_is_noticed() {
        struct Closed;
        impl Write for Closed {
            fn write(&mut self, _: &[u8]) -> io::Result<usize> {
                Err(io::ErrorKind::BrokenPipe.into())
            }

            fn flush(&mut self) -> io::Result<()> {
                Ok(())
            }
        }
        let mut lines = Lines::to(Closed);
        while !lines.have_nobody() {
            lines.line(&1);
            std::thread::yield_now();
        }
        assert!(lines.finish().is_err());
    }
}
