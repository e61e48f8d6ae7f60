//! A server for GDB: one board is stepped through, and while it stands still, so does everything else in the air.
//!
//! ```text
//!  gdb ──remote protocol──► gdbstub ──► Session ──► Board: registers, memory, breakpoints
//!                                           └─────► Emulation::run_until, a slice at a time
//! ```
//! Time does not pass while a board is halted, so looking at one changes nothing: what it does afterwards is what it
//! would have done. Breakpoints are kept beside the board, not in its flash.

mod arch;

use std::net::TcpStream;

use gdbstub::common::Signal;
use gdbstub::conn::{Connection, ConnectionExt};
use gdbstub::stub::run_blocking::{BlockingEventLoop, Event, WaitForStopReasonError};
use gdbstub::stub::{DisconnectReason, GdbStub, SingleThreadStopReason};
use gdbstub::target::ext::base::BaseOps;
use gdbstub::target::ext::base::singlethread::{
    SingleThreadBase, SingleThreadResume, SingleThreadResumeOps, SingleThreadSingleStep,
    SingleThreadSingleStepOps,
};
use gdbstub::target::ext::breakpoints::{
    Breakpoints, BreakpointsOps, HwBreakpoint, HwBreakpointOps, SwBreakpoint, SwBreakpointOps,
};
use gdbstub::target::{Target, TargetError, TargetResult};
use nova_hal_sim::{SimDuration, SimTime};
use rsemu_executor::Registers;

use crate::board::{Board, Halt};
use crate::emulation::Emulation;
use crate::error::EmulatorError;
use arch::{AllRegisters, CortexM4f};

/// How long boards run between two looks at whether GDB wants something.
const SLICE: SimDuration = SimDuration::from_ms(1);

/// How a session ended.
#[derive(Debug, PartialEq, Eq)]
pub enum Ended {
    /// GDB let go of the board, or went away: it runs on without breakpoints.
    Detached,
    /// GDB wants the emulation to end.
    Killed,
    /// The time to be emulated is over.
    TimeIsUp,
}

/// Serves one session with GDB on `board`, which stands still at first. `after_slice` is called whenever some time has
/// passed, to take care of serial ports and logs.
///
/// # Errors
/// [`EmulatorError::UnknownBoard`]; [`EmulatorError::Stopped`] when a board did what is not modelled and GDB wanted to
/// go on nevertheless.
pub fn serve(
    emulation: &mut Emulation,
    board: &str,
    gdb: TcpStream,
    end: SimTime,
    after_slice: &mut dyn FnMut(&mut Emulation),
) -> Result<Ended, EmulatorError> {
    let unknown = || EmulatorError::UnknownBoard(board.to_owned());
    emulation.board_mut(board).ok_or_else(unknown)?.halt();
    let mut session = Session {
        emulation,
        board,
        end,
        after_slice,
        trouble: None,
    };
    let outcome = GdbStub::new(gdb).run_blocking::<Loop<'_>>(&mut session);
    let trouble = session.trouble.take();
    if let Some(board) = session.emulation.board_mut(board) {
        board.let_go();
    }
    match outcome {
        Ok(DisconnectReason::Kill) => Ok(Ended::Killed),
        Ok(DisconnectReason::TargetExited(_) | DisconnectReason::TargetTerminated(_)) => {
            Ok(Ended::TimeIsUp)
        }
        Ok(DisconnectReason::Disconnect) => trouble.map_or(Ok(Ended::Detached), Err),
        // A connection that breaks is GDB going away.
        Err(error) => match error.into_target_error().or(trouble) {
            Some(error) => Err(error),
            None => Ok(Ended::Detached),
        },
    }
}

struct Session<'a> {
    emulation: &'a mut Emulation,
    board: &'a str,
    end: SimTime,
    after_slice: &'a mut dyn FnMut(&mut Emulation),
    /// The emulation cannot go on, but GDB may still look around.
    trouble: Option<EmulatorError>,
}

impl Session<'_> {
    fn board(&mut self) -> Result<&mut Board, EmulatorError> {
        let board = self.emulation.board_mut(self.board);
        board.ok_or_else(|| EmulatorError::UnknownBoard(self.board.to_owned()))
    }

    /// Runs for a slice; why GDB is to be told, if it is.
    fn run_slice(&mut self) -> Result<Option<SingleThreadStopReason<u32>>, EmulatorError> {
        if let Some(trouble) = self.trouble.take() {
            return Err(trouble);
        }
        let until = (self.emulation.now() + SLICE).min(self.end);
        let outcome = self.emulation.run_until(until);
        (self.after_slice)(self.emulation);
        if let Err(trouble) = outcome {
            self.trouble = Some(trouble);
            self.board()?.halt();
            return Ok(Some(SingleThreadStopReason::Signal(Signal::SIGILL)));
        }
        let halted = self.board()?.halted();
        Ok(match halted {
            Some(Halt::Breakpoint) => Some(SingleThreadStopReason::HwBreak(())),
            Some(Halt::Stepped) => Some(SingleThreadStopReason::DoneStep),
            Some(Halt::Asked) => Some(SingleThreadStopReason::Signal(Signal::SIGINT)),
            None if self.emulation.now() >= self.end => Some(SingleThreadStopReason::Exited(0)),
            None => None,
        })
    }
}

struct Loop<'a>(core::marker::PhantomData<&'a ()>);

impl<'a> BlockingEventLoop for Loop<'a> {
    type Target = Session<'a>;
    type Connection = TcpStream;
    type StopReason = SingleThreadStopReason<u32>;

    fn wait_for_stop_reason(
        session: &mut Session<'a>,
        gdb: &mut TcpStream,
    ) -> Result<
        Event<Self::StopReason>,
        WaitForStopReasonError<EmulatorError, <TcpStream as Connection>::Error>,
    > {
        loop {
            let reason = session.run_slice();
            if let Some(reason) = reason.map_err(WaitForStopReasonError::Target)? {
                return Ok(Event::TargetStopped(reason));
            }
            let waits = ConnectionExt::peek(gdb).map_err(WaitForStopReasonError::Connection)?;
            if waits.is_some() {
                let byte = ConnectionExt::read(gdb).map_err(WaitForStopReasonError::Connection)?;
                return Ok(Event::IncomingData(byte));
            }
        }
    }

    fn on_interrupt(session: &mut Session<'a>) -> Result<Option<Self::StopReason>, EmulatorError> {
        session.board()?.halt();
        Ok(Some(SingleThreadStopReason::Signal(Signal::SIGINT)))
    }
}

impl Target for Session<'_> {
    type Arch = CortexM4f;
    type Error = EmulatorError;

    fn base_ops(&mut self) -> BaseOps<'_, CortexM4f, EmulatorError> {
        BaseOps::SingleThread(self)
    }

    fn support_breakpoints(&mut self) -> Option<BreakpointsOps<'_, Self>> {
        Some(self)
    }
}

impl SingleThreadBase for Session<'_> {
    fn read_registers(&mut self, all: &mut AllRegisters) -> TargetResult<(), Self> {
        let board = self.board().map_err(TargetError::Fatal)?;
        let Registers { r, xpsr } = board.registers();
        let others = [xpsr].into_iter().chain(board.stack_pointers());
        let core = r.into_iter().chain(others);
        all.core
            .iter_mut()
            .zip(core)
            .for_each(|(to, from)| *to = from);
        (all.floats, all.fpscr) = board.floats();
        Ok(())
    }

    fn write_registers(&mut self, all: &AllRegisters) -> TargetResult<(), Self> {
        let board = self.board().map_err(TargetError::Fatal)?;
        // MSP and PSP follow from SP: which of them is meant depends on the mode.
        let (Some(&r), Some(&xpsr)) = (all.core.first_chunk(), all.core.get(16)) else {
            return Err(TargetError::NonFatal);
        };
        board.set_registers(Registers { r, xpsr }, all.floats, all.fpscr);
        Ok(())
    }

    fn read_addrs(&mut self, start: u32, bytes: &mut [u8]) -> TargetResult<usize, Self> {
        let board = self.board().map_err(TargetError::Fatal)?;
        match board.read_memory(start, bytes) {
            0 if !bytes.is_empty() => Err(TargetError::NonFatal),
            count => Ok(count),
        }
    }

    fn write_addrs(&mut self, start: u32, bytes: &[u8]) -> TargetResult<(), Self> {
        let board = self.board().map_err(TargetError::Fatal)?;
        match board.write_ram(start, bytes) {
            true => Ok(()),
            false => Err(TargetError::NonFatal),
        }
    }

    fn support_resume(&mut self) -> Option<SingleThreadResumeOps<'_, Self>> {
        Some(self)
    }
}

impl SingleThreadResume for Session<'_> {
    fn resume(&mut self, _: Option<Signal>) -> Result<(), EmulatorError> {
        self.board()?.resume();
        Ok(())
    }

    fn support_single_step(&mut self) -> Option<SingleThreadSingleStepOps<'_, Self>> {
        Some(self)
    }
}

impl SingleThreadSingleStep for Session<'_> {
    fn step(&mut self, _: Option<Signal>) -> Result<(), EmulatorError> {
        self.board()?.step_once();
        Ok(())
    }
}

impl Breakpoints for Session<'_> {
    fn support_sw_breakpoint(&mut self) -> Option<SwBreakpointOps<'_, Self>> {
        Some(self)
    }

    fn support_hw_breakpoint(&mut self) -> Option<HwBreakpointOps<'_, Self>> {
        Some(self)
    }
}

impl SwBreakpoint for Session<'_> {
    fn add_sw_breakpoint(&mut self, address: u32, _: usize) -> TargetResult<bool, Self> {
        let board = self.board().map_err(TargetError::Fatal)?;
        board.set_breakpoint(address);
        Ok(true)
    }

    fn remove_sw_breakpoint(&mut self, address: u32, _: usize) -> TargetResult<bool, Self> {
        let board = self.board().map_err(TargetError::Fatal)?;
        Ok(board.remove_breakpoint(address))
    }
}

impl HwBreakpoint for Session<'_> {
    fn add_hw_breakpoint(&mut self, address: u32, kind: usize) -> TargetResult<bool, Self> {
        self.add_sw_breakpoint(address, kind)
    }

    fn remove_hw_breakpoint(&mut self, address: u32, kind: usize) -> TargetResult<bool, Self> {
        self.remove_sw_breakpoint(address, kind)
    }
}
