//! A host at an emulated board's serial port.

use std::io::{Read as _, Write as _};
use std::net::{TcpListener, TcpStream};

use anyhow::{Context as _, Result};
use nova_tests::EmulatedNetwork;

use crate::choose_board;

/// A host that talks to one board over TCP, as through a serial port.
pub(crate) struct Host {
    listener: TcpListener,
    stream: Option<TcpStream>,
    board: String,
    sent: usize,
}

impl Host {
    pub(crate) fn at(
        place: &str,
        board: Option<&str>,
        network: &mut EmulatedNetwork,
    ) -> Result<Self> {
        let address = place
            .strip_prefix("tcp://")
            .with_context(|| format!("{place}: only tcp://HOST:PORT"))?;
        let at = || place.to_owned();
        let listener = TcpListener::bind(address).with_context(at)?;
        let board = choose_board(board, network)?;
        eprintln!(
            "{board} at tcp://{}: waiting for a host",
            listener.local_addr()?
        );
        let (stream, _) = listener.accept().with_context(at)?;
        listener.set_nonblocking(true)?;
        stream.set_nonblocking(true)?;
        Ok(Self {
            listener,
            stream: Some(stream),
            board,
            sent: 0,
        })
    }

    /// Gives the host what the board has said, and the board what the host says. A host may go and another come.
    pub(crate) fn serve(&mut self, network: &mut EmulatedNetwork) -> Result<()> {
        if let Ok((stream, _)) = self.listener.accept() {
            stream.set_nonblocking(true)?;
            self.stream = Some(stream);
        }
        let log = network.log(&self.board).context("no log")?;
        let news = log.bytes.get(self.sent..).unwrap_or_default().to_vec();
        self.sent = log.bytes.len();
        let Some(stream) = &mut self.stream else {
            return Ok(());
        };
        let mut buffer = [0; 256];
        let heard = match stream.read(&mut buffer) {
            Ok(0) => None,
            Ok(count) => Some(count),
            Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => Some(0),
            Err(_) => None,
        };
        let Some(count) = heard.filter(|_| stream.write_all(&news).is_ok()) else {
            self.stream = None;
            return Ok(());
        };
        if let Some(board) = network.emulation().board_mut(&self.board) {
            board.say(buffer.get(..count).unwrap_or_default());
        }
        Ok(())
    }
}
