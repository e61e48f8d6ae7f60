//! Where a simulated board's serial port comes out.

use crate::error::bad_input;
use anyhow::{Context, Result};
use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};

/// One way out of a simulated board; most are ways in as well.
pub(super) enum Outlet {
    /// Whoever connects.
    Tcp {
        listener: TcpListener,
        clients: Vec<TcpStream>,
    },
    /// A pseudo-terminal, which behaves like a serial port.
    #[cfg(unix)]
    Terminal {
        board: serialport::TTYPort,
        /// Held open, so that programs may come and go at the other end.
        name: String,
        _host: serialport::TTYPort,
    },
    File {
        path: PathBuf,
        file: File,
    },
}

impl Outlet {
    /// Listens on an address `HOST:PORT`.
    pub(super) fn tcp(host: &str, port: u16) -> Result<Self> {
        let address = format!("{host}:{port}");
        let listener = TcpListener::bind(&address)
            .and_then(|listener| {
                listener.set_nonblocking(true)?;
                Ok(listener)
            })
            .map_err(|error| bad_input!("tcp://{address}: cannot be served on: {error}"))?;
        Ok(Self::Tcp {
            listener,
            clients: Vec::new(),
        })
    }

    /// A new pseudo-terminal.
    #[cfg(unix)]
    pub(super) fn terminal() -> Result<Self> {
        use serialport::SerialPort;
        use std::time::Duration;
        let (mut board, host) =
            serialport::TTYPort::pair().context("no pseudo-terminal can be had")?;
        // A full line drops what comes, as the board's own does; it never waits.
        board.set_timeout(Duration::ZERO)?;
        let name = host.name().context("the pseudo-terminal has no name")?;
        Ok(Self::Terminal {
            board,
            name,
            _host: host,
        })
    }

    #[cfg(not(unix))]
    pub(super) fn terminal() -> Result<Self> {
        Err(bad_input!(
            "--pty: there are no pseudo-terminals on this system"
        ))
    }

    /// A new file in `folder`.
    pub(super) fn file(folder: &Path, name: &str) -> Result<Self> {
        let path = folder.join(name);
        let file = std::fs::create_dir_all(folder)
            .and_then(|()| File::create(&path))
            .map_err(|error| bad_input!("{}: cannot be written: {error}", path.display()))?;
        Ok(Self::File { path, file })
    }

    /// What to give `nova listen`.
    pub(super) fn name(&self) -> String {
        match self {
            Self::Tcp { listener, .. } => match listener.local_addr() {
                Ok(address) => format!("tcp://{address}"),
                Err(error) => error.to_string(),
            },
            #[cfg(unix)]
            Self::Terminal { name, .. } => name.clone(),
            Self::File { path, .. } => path.display().to_string(),
        }
    }

    /// Passes on what the board has sent.
    pub(super) fn put(&mut self, bytes: &[u8]) -> Result<()> {
        match self {
            Self::Tcp { listener, clients } => {
                while let Ok((client, _)) = listener.accept() {
                    if client.set_nonblocking(true).is_ok() {
                        clients.push(client);
                    }
                }
                // One that has gone, or does not keep up, is let go.
                clients.retain_mut(|client| client.write_all(bytes).is_ok());
                Ok(())
            }
            #[cfg(unix)]
            Self::Terminal { board, .. } => {
                // Nobody reads, or not fast enough: lost, as on a wire.
                let _ = board.write(bytes);
                Ok(())
            }
            Self::File { path, file } => file
                .write_all(bytes)
                .with_context(|| format!("{}: cannot be written", path.display())),
        }
    }

    /// What the host has sent to the board.
    pub(super) fn take(&mut self) -> Vec<u8> {
        let mut taken = Vec::new();
        let mut chunk = [0; 256];
        match self {
            Self::Tcp { clients, .. } => {
                clients.retain_mut(|client| match client.read(&mut chunk) {
                    Ok(0) => false,
                    Ok(count) => {
                        taken.extend_from_slice(chunk.get(..count).unwrap_or_default());
                        true
                    }
                    Err(error) => {
                        matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted)
                    }
                })
            }
            #[cfg(unix)]
            Self::Terminal { board, .. } => {
                if let Ok(count) = board.read(&mut chunk) {
                    taken.extend_from_slice(chunk.get(..count).unwrap_or_default());
                }
            }
            Self::File { .. } => {}
        }
        taken
    }
}
