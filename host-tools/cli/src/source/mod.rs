//! A board's bytes, wherever they come from, and the way back to the board.
//!
//! ```text
//!   Place::named("/dev/ttyACM0" | "tcp://host:port" | "file" | "-")
//!        │
//!   Source::open ──► read: Bytes, Silence, Lost, Back, End
//!        └────────► send: to a port or a server
//! ```
//!
//! Reading waits for [`PATIENCE`] at most, except at a file or standard input, so that a
//! loop around it can look at the clock and for Ctrl-C. Serial ports go through
//! `serialport` (which `tokio-serial` wraps) without libudev: a thread a source is all
//! the concurrency that some ports need, and no second runtime has to be learnt.

mod place;

pub(crate) use place::Place;

use crate::error::bad_input;
use anyhow::{Context, Result};
use nova_wire::{Command, Encoder, MAX_FRAME_LEN};
use serialport::SerialPort;
use std::fs::File;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::{Duration, Instant};

/// The longest that one call of [`Source::read`] waits for a live board.
pub(crate) const PATIENCE: Duration = Duration::from_millis(100);

/// The longest wait for a TCP server to answer.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(3);

/// From one attempt to reach a board that was lost to the next.
pub(crate) const RETRY: Duration = Duration::from_millis(500);

/// An open way to a board's bytes.
pub(crate) struct Source {
    place: Place,
    link: Link,
    /// From one attempt to reach a lost board to the next; no attempt without it.
    retry: Option<Duration>,
    /// Whether a board that is reached again is asked for its settings again.
    asks: bool,
}

enum Link {
    Serial(Box<dyn SerialPort>),
    Tcp(TcpStream),
    /// Ends, and cannot be written to.
    OneWay(Box<dyn Read + Send>),
    Down {
        retry_at: Instant,
    },
}

/// What one call of [`Source::read`] brought.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Input {
    /// So many bytes, at the start of the buffer.
    Bytes(usize),
    /// Nothing within [`PATIENCE`].
    Silence,
    /// The board cannot be reached any more, for this reason. Attempts go on.
    Lost(String),
    /// It is reached again. What it sent in between is missing.
    Back,
    /// There is no more to come.
    End,
}

impl Source {
    /// Opens the place.
    ///
    /// # Errors
    /// It cannot be opened: what, why, and what to do about it.
    pub(crate) fn open(place: Place) -> Result<Self> {
        let link = connect(&place).map_err(|why| bad_input!("{place}: {why}"))?;
        Ok(Self {
            place,
            link,
            retry: None,
            asks: false,
        })
    }

    /// From now on tries to reach a port or server that was lost again, every so often.
    pub(crate) fn retrying(mut self, every: Duration) -> Self {
        if matches!(self.place, Place::Serial { .. } | Place::Tcp(_)) {
            self.retry = Some(every);
        }
        self
    }

    /// A source of bytes that were read from the place already.
    pub(crate) fn of(place: Place, bytes: impl Read + Send + 'static) -> Self {
        Self {
            place,
            link: Link::OneWay(Box::new(bytes)),
            retry: None,
            asks: false,
        }
    }

    /// What this is the source of.
    pub(crate) fn place(&self) -> &Place {
        &self.place
    }

    /// Waits for what comes next.
    ///
    /// # Errors
    /// Reading failed, and no attempts to reach the board again were asked for.
    pub(crate) fn read(&mut self, buffer: &mut [u8]) -> Result<Input> {
        let result = match &mut self.link {
            Link::Serial(port) => port.read(buffer),
            Link::Tcp(stream) => stream.read(buffer),
            Link::OneWay(reader) => match reader.read(buffer) {
                Ok(0) => return Ok(Input::End),
                other => other,
            },
            Link::Down { retry_at } => {
                let retry_at = *retry_at;
                return Ok(self.try_again(retry_at));
            }
        };
        let why = match result {
            // A server that has closed the connection; a port whose board was unplugged.
            Ok(0) if self.retry.is_none() => return Ok(Input::End),
            Ok(0) => "the other end has closed it".to_owned(),
            Ok(count) => return Ok(Input::Bytes(count)),
            Err(error) if is_silence(&error) => return Ok(Input::Silence),
            Err(error) => error.to_string(),
        };
        match self.retry {
            Some(every) => {
                self.link = Link::Down {
                    retry_at: Instant::now() + every,
                };
                Ok(Input::Lost(why))
            }
            // As text: a pipe that the board's end broke is not one that our reader closed.
            None => Err(anyhow::anyhow!("{}: reading failed: {why}", self.place)),
        }
    }

    fn try_again(&mut self, retry_at: Instant) -> Input {
        let wait = retry_at.saturating_duration_since(Instant::now());
        if !wait.is_zero() {
            std::thread::sleep(wait.min(PATIENCE));
            return Input::Silence;
        }
        match connect(&self.place) {
            Ok(link) => {
                self.link = link;
                if self.asks {
                    self.ask_for_settings();
                }
                Input::Back
            }
            Err(_) => {
                self.link = Link::Down {
                    retry_at: Instant::now() + self.retry.unwrap_or(RETRY),
                };
                Input::Silence
            }
        }
    }

    /// Sends bytes to the board.
    ///
    /// # Errors
    /// There is no way to a board here, or it is lost.
    pub(crate) fn send(&mut self, bytes: &[u8]) -> Result<()> {
        let place = &self.place;
        let sent = match &mut self.link {
            Link::Serial(port) => port.write_all(bytes).and_then(|()| port.flush()),
            Link::Tcp(stream) => stream.write_all(bytes),
            Link::OneWay(_) => {
                return Err(bad_input!(
                    "{place}: nothing can be sent to a board this way; \
                     a serial port or tcp://HOST:PORT leads to one"
                ));
            }
            Link::Down { .. } => Err(ErrorKind::NotConnected.into()),
        };
        sent.map_err(|error| anyhow::anyhow!("{error}"))
            .with_context(|| format!("{place}: sending failed"))
    }

    /// Asks a live board who it is and for its settings, its antenna delays among them. The answers come
    /// in its stream; a board that cannot be asked is heard without them. Asks again whenever the board
    /// is reached again: it may be another one, or have been changed.
    pub(crate) fn ask_for_settings(&mut self) {
        self.asks = true;
        if !self.place.is_live() {
            return;
        }
        for command in [Command::Status, Command::Get] {
            if let Ok(bytes) = Encoder::new().encode(&command, &mut [0; MAX_FRAME_LEN]) {
                // Standard input leads to no board.
                let _ = self.send(bytes);
            }
        }
    }
}

/// Nothing came in time; or a signal came.
pub(crate) fn is_silence(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted
    )
}

fn connect(place: &Place) -> Result<Link, String> {
    match place {
        Place::Serial { name, baud } => open_serial(name, *baud).map(Link::Serial),
        Place::Tcp(address) => open_tcp(address).map(Link::Tcp),
        Place::File(path) => match File::open(path) {
            Ok(file) => Ok(Link::OneWay(Box::new(file))),
            Err(error) => Err(format!("cannot be read: {error}")),
        },
        Place::StandardInput => Ok(Link::OneWay(Box::new(io::stdin()))),
    }
}

/// A serial port whose reads wait for [`PATIENCE`] at most; or why there is none, and what to do about it.
pub(crate) fn open_serial(name: &str, baud: u32) -> Result<Box<dyn SerialPort>, String> {
    (serialport::new(name, baud).timeout(PATIENCE).open()).map_err(|error| serial_trouble(&error))
}

/// A connection to `host:port` whose reads wait for [`PATIENCE`] at most; or why there is none.
pub(crate) fn open_tcp(address: &str) -> Result<TcpStream, String> {
    dial(address).map_err(|error| tcp_trouble(&error))
}

fn dial(address: &str) -> io::Result<TcpStream> {
    let mut last = io::Error::new(ErrorKind::NotFound, "the name stands for no address");
    for address in address.to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, CONNECT_TIMEOUT) {
            Ok(stream) => {
                stream.set_read_timeout(Some(PATIENCE))?;
                // Commands are short, and waited for.
                stream.set_nodelay(true)?;
                return Ok(stream);
            }
            Err(error) => last = error,
        }
    }
    Err(last)
}

fn serial_trouble(error: &serialport::Error) -> String {
    use serialport::ErrorKind as Kind;
    let remedy = match error.kind() {
        Kind::Io(ErrorKind::NotFound) => there_are(),
        Kind::Io(ErrorKind::PermissionDenied) => {
            "; this user may not: `sudo usermod -aG dialout $USER`, then log in again".to_owned()
        }
        Kind::NoDevice => "; another program may have it open".to_owned(),
        _ => String::new(),
    };
    format!("cannot be opened: {error}{remedy}")
}

/// The ports that there are, for one who has named another.
fn there_are() -> String {
    /// A machine may list dozens that nothing is connected to.
    const MOST: usize = 8;
    let ports = serialport::available_ports().unwrap_or_default();
    let usb = |port: &&serialport::SerialPortInfo| {
        matches!(port.port_type, serialport::SerialPortType::UsbPort(_))
    };
    let names: Vec<&str> = (ports.iter().filter(usb).take(MOST))
        .map(|port| port.port_name.as_str())
        .collect();
    if names.is_empty() {
        "; no board is seen on USB: is it plugged in?".to_owned()
    } else {
        format!("; on USB there are: {}", names.join(", "))
    }
}

fn tcp_trouble(error: &io::Error) -> String {
    let remedy = match error.kind() {
        ErrorKind::ConnectionRefused => "; is the server running, on this port?",
        ErrorKind::TimedOut => "; is the address right, and no firewall in between?",
        _ => "",
    };
    format!("cannot be connected to: {error}{remedy}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::TcpListener;

    /// Reads until something other than silence comes.
    fn next(source: &mut Source, buffer: &mut [u8]) -> Input {
        loop {
            match source.read(buffer).unwrap() {
                Input::Silence => {}
                other => return other,
            }
        }
    }

    fn text(source: &mut Source) -> Vec<u8> {
        let mut buffer = [0; 64];
        match next(source, &mut buffer) {
            Input::Bytes(count) => buffer[..count].to_vec(),
            other => panic!("{other:?}"),
        }
    }

    fn server() -> (TcpListener, Place) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let place = Place::Tcp(listener.local_addr().unwrap().to_string());
        (listener, place)
    }

    #[test]
    fn a_server_is_heard_and_spoken_to() {
        let (listener, place) = server();
        let mut source = Source::open(place).unwrap();
        let (mut board, _) = listener.accept().unwrap();
        board.write_all(b"range").unwrap();
        assert_eq!(text(&mut source), b"range");
        source.send(b"status?").unwrap();
        let mut heard = [0; 7];
        board.read_exact(&mut heard).unwrap();
        assert_eq!(&heard, b"status?");
        drop(board);
        assert_eq!(next(&mut source, &mut [0; 8]), Input::End);
    }

    #[test]
    fn a_server_that_was_lost_is_reached_again() {
        let (listener, place) = server();
        let mut source = Source::open(place).unwrap().retrying(Duration::ZERO);
        let (board, _) = listener.accept().unwrap();
        drop(board);
        assert!(matches!(next(&mut source, &mut [0; 8]), Input::Lost(_)));
        assert_eq!(next(&mut source, &mut [0; 8]), Input::Back);
        let (mut board, _) = listener.accept().unwrap();
        board.write_all(b"again").unwrap();
        assert_eq!(text(&mut source), b"again");
    }

    #[cfg(unix)]
    #[test]
    fn a_serial_port_is_heard_and_spoken_to_and_its_loss_is_told() {
        let (mut board, host) = serialport::TTYPort::pair().unwrap();
        let name = host.name().unwrap();
        drop(host);
        let baud = crate::sim_node::BAUD;
        let mut source = Source::open(Place::named(&name, baud).unwrap()).unwrap();
        // Zeros, line ends, Ctrl-C and XOFF pass as they are.
        let all: Vec<u8> = (0..=255).collect();
        board.write_all(&all).unwrap();
        let mut heard = Vec::new();
        while heard.len() < all.len() {
            heard.extend(text(&mut source));
        }
        assert_eq!(heard, all);
        source.send(&all).unwrap();
        let mut heard = vec![0; all.len()];
        board.read_exact(&mut heard).unwrap();
        assert_eq!(heard, all);

        let mut source = source.retrying(RETRY);
        drop(board);
        assert!(matches!(next(&mut source, &mut [0; 8]), Input::Lost(_)));
        assert!(source.send(b"x").is_err());
    }

    #[test]
    fn a_file_ends_and_cannot_be_spoken_to() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("capture.bin");
        std::fs::write(&path, b"bytes").unwrap();
        let mut source = Source::open(Place::File(path)).unwrap().retrying(RETRY);
        assert!(
            source
                .send(b"x")
                .unwrap_err()
                .to_string()
                .contains("nothing can be sent")
        );
        assert_eq!(text(&mut source), b"bytes");
        assert_eq!(next(&mut source, &mut [0; 8]), Input::End);
    }

    #[test]
    fn what_cannot_be_opened_is_told_with_what_to_do() {
        let (listener, place) = server();
        drop(listener);
        let error = Source::open(place).err().unwrap().to_string();
        assert!(error.contains("is the server running"), "{error}");
        let port = Place::named("/dev/ttyNOVA9", 1_000_000).unwrap();
        let error = Source::open(port).err().unwrap().to_string();
        assert!(
            error.starts_with("/dev/ttyNOVA9: cannot be opened") && error.contains("USB"),
            "{error}"
        );
    }
}
