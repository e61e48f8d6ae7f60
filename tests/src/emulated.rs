//! A network of emulated boards: the firmware as it goes onto boards, and what its serial ports say.

use crate::network::BoardLog;
use nova_emulator::{
    Board, BoardConfig, BoardStats, Emulation, EmulatorError, Image, LogLine, gdb,
};
use nova_hal_sim::{ChannelConfig, SimTime};
use nova_wire::{Command, Decoder, EncodeError, Encoder, MAX_FRAME_LEN};
use std::net::TcpStream;
use std::path::Path;

/// Where `cargo xtask` says the firmware is.
pub const FIRMWARE_VARIABLE: &str = "NOVA_FIRMWARE";

/// The two binaries.
#[derive(Clone)]
pub struct Firmware {
    /// Answers.
    pub tag: Image,
    /// Polls.
    pub anchor: Image,
}

impl Firmware {
    /// From the folder that [`FIRMWARE_VARIABLE`] names; `None` where it is not set.
    ///
    /// # Errors
    /// As [`Firmware::read`].
    pub fn from_environment() -> Option<Result<Self, String>> {
        let folder = std::env::var_os(FIRMWARE_VARIABLE)?;
        Some(Self::read(Path::new(&folder)))
    }

    /// From the files `tag` and `anchor` in `folder`.
    ///
    /// # Errors
    /// Says which file cannot be read, or why it is no firmware.
    pub fn read(folder: &Path) -> Result<Self, String> {
        let image = |name: &str| {
            let path = folder.join(name);
            let at = |error: String| {
                let path = path.display();
                format!("{path}: {error}; `cargo xtask firmware` builds it")
            };
            let bytes = std::fs::read(&path).map_err(|error| at(error.to_string()))?;
            Image::parse(&bytes).map_err(|error| at(error.to_string()))
        };
        Ok(Self {
            tag: image("tag")?,
            anchor: image("anchor")?,
        })
    }
}

/// Emulated boards in one air.
pub struct EmulatedNetwork {
    emulation: Emulation,
    /// As the emulation has them.
    ports: Vec<Port>,
}

struct Port {
    decoder: Decoder,
    host: Encoder,
    log: BoardLog,
    lines: Vec<LogLine>,
}

impl EmulatedNetwork {
    /// Boards that are switched on now.
    ///
    /// # Errors
    /// Two boards of one name, or an image that does not fit.
    pub fn new(
        seed: u64,
        channel: ChannelConfig,
        boards: Vec<(BoardConfig, Image)>,
    ) -> Result<Self, EmulatorError> {
        let emulation = Emulation::new(seed, channel, boards)?;
        let port = |_: &Board| Port {
            decoder: Decoder::new(),
            host: Encoder::new(),
            log: BoardLog::default(),
            lines: Vec::new(),
        };
        let ports = emulation.boards().iter().map(port).collect();
        Ok(Self { emulation, ports })
    }

    /// The emulation underneath.
    pub fn emulation(&mut self) -> &mut Emulation {
        &mut self.emulation
    }

    fn index(&self, board: &str) -> Option<usize> {
        let mut boards = self.emulation.boards().iter();
        boards.position(|candidate| candidate.name() == board)
    }

    /// What the board of this name has said.
    pub fn log(&self, board: &str) -> Option<&BoardLog> {
        self.ports.get(self.index(board)?).map(|port| &port.log)
    }

    /// What the firmware of the board of this name has logged for developers.
    pub fn lines(&self, board: &str) -> Option<&[LogLine]> {
        self.ports.get(self.index(board)?).map(|port| &*port.lines)
    }

    /// What the board of this name has done.
    pub fn stats(&self, board: &str) -> Option<BoardStats> {
        self.emulation.board(board).map(Board::stats)
    }

    /// Gives the board of this name a command; returns its sequence number, `None` if there is no such board.
    ///
    /// # Errors
    /// A command that does not fit a frame.
    pub fn command(&mut self, board: &str, command: &Command) -> Result<Option<u16>, EncodeError> {
        let Some(index) = self.index(board) else {
            return Ok(None);
        };
        let (Some(port), Some(board)) = (
            self.ports.get_mut(index),
            self.emulation.boards_mut().get_mut(index),
        ) else {
            return Ok(None);
        };
        let sequence = port.host.next_sequence();
        let mut buffer = [0; MAX_FRAME_LEN];
        board.say(port.host.encode(command, &mut buffer)?);
        Ok(Some(sequence))
    }

    /// Runs until `t_s` seconds after the start.
    ///
    /// # Errors
    /// [`EmulatorError::Stopped`] when a board did something that is not modelled.
    pub fn run_until_s(&mut self, t_s: f64) -> Result<(), EmulatorError> {
        let outcome = self.emulation.run_until(SimTime::from_s_f64(t_s));
        collect(&mut self.emulation, &mut self.ports);
        outcome
    }

    /// Lets GDB step through the board of this name, at most until `t_s` seconds after the start.
    ///
    /// # Errors
    /// As [`gdb::serve`].
    pub fn debug(
        &mut self,
        board: &str,
        gdb: TcpStream,
        t_s: f64,
    ) -> Result<gdb::Ended, EmulatorError> {
        let Self { emulation, ports } = self;
        let end = SimTime::from_s_f64(t_s);
        gdb::serve(emulation, board, gdb, end, &mut |emulation| {
            collect(emulation, ports);
        })
    }
}

/// What boards have said and logged since this was done last.
fn collect(emulation: &mut Emulation, ports: &mut [Port]) {
    for (board, port) in emulation.boards_mut().iter_mut().zip(ports) {
        let bytes: Vec<u8> = board.take_serial().iter().map(|&(_, byte)| byte).collect();
        port.log.take(&bytes, &mut port.decoder);
        port.lines.extend(board.take_log());
    }
}
