//! An ARMv7E-M core (Cortex-M4F): rsemu's interpreter, over a memory bus that its owner lends it for each step.
//!
//! `exec` and `dsp` are rsemu 0.0.7's, with the changes that README.md lists; decoding, the system control space and
//! floating point are rsemu's own, from the registry.

mod decoded;
mod dsp;
mod exec;

use rsemu::cpu::arm::v7m::sys::{Exception, Sys};
use rsemu::cpu::arm::v7m::xpsr;

use decoded::DecodedCode;
use exec::{Exec, State};

/// What a core reads and writes. Addresses are multiples of the length; values are little-endian.
pub trait Bus {
    /// Reads 1, 2 or 4 bytes; `None` is a bus fault.
    fn read(&mut self, address: u32, bytes: u32) -> Option<u32>;

    /// Writes 1, 2 or 4 bytes; `None` is a bus fault.
    fn write(&mut self, address: u32, bytes: u32, value: u32) -> Option<()>;

    /// Half an instruction; `None` is a bus fault.
    fn fetch(&mut self, address: u32) -> Option<u16>;

    /// Whether what lies there stays until [`Core::forget_code`] is called, so that it need not be fetched again.
    fn is_constant(&self, address: u32) -> bool;
}

/// Registers of a core.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Registers {
    /// `R0` to `R15`; `R13` is the stack pointer in use.
    pub r: [u32; 16],
    /// `xPSR`.
    pub xpsr: u32,
}

/// One core.
#[derive(Debug, Clone)]
pub struct Core {
    state: State,
    decoded: DecodedCode,
    /// Levels of the external interrupts, a bit each.
    levels: u64,
}

impl Core {
    /// A core as after power-on, with so many bits of interrupt priority. Its first step is the reset sequence.
    pub fn new(priority_bits: u8) -> Self {
        Core {
            state: State::new(priority_bits),
            decoded: DecodedCode::new(),
            levels: 0,
        }
    }

    /// Carries out one reset sequence, one entry into an exception, or one instruction; returns the cycles it took.
    /// A sleeping core takes one cycle.
    #[inline]
    pub fn step<B: Bus>(&mut self, bus: &mut B) -> u64 {
        Exec::new(&mut self.state, bus, &mut self.decoded, self.levels).step()
    }

    /// Lines of external interrupts that are high, a bit each.
    pub fn set_levels(&mut self, levels: u64) {
        self.levels = levels;
    }

    /// Code has changed: what was decoded does not count any more.
    pub fn forget_code(&mut self) {
        self.decoded.forget();
    }

    /// `R0` to `R15` and `xPSR`.
    pub fn registers(&self) -> Registers {
        Registers {
            r: self.state.r,
            xpsr: self.state.xpsr,
        }
    }

    /// Writes them, as a debugger does.
    pub fn set_registers(&mut self, registers: Registers) {
        self.state.r = registers.r;
        self.state.xpsr = registers.xpsr;
        self.state.sync_stack();
    }

    /// `S0` to `S31`.
    pub fn floats(&self) -> [u32; 32] {
        self.state.fp.s
    }

    /// `FPSCR`.
    pub fn fpscr(&self) -> u32 {
        self.state.fp.fpscr
    }

    /// Writes `S0` to `S31` and `FPSCR`.
    pub fn set_floats(&mut self, floats: [u32; 32], fpscr: u32) {
        self.state.fp.s = floats;
        self.state.fp.fpscr = fpscr;
    }

    /// One of `R0` to `R15`.
    pub fn reg(&self, index: usize) -> u32 {
        self.state.r.get(index).copied().unwrap_or(0)
    }

    /// The address of the next instruction.
    #[inline]
    pub fn pc(&self) -> u32 {
        self.state.r[15]
    }

    /// The main stack pointer.
    pub fn msp(&self) -> u32 {
        self.state.msp()
    }

    /// The process stack pointer.
    pub fn psp(&self) -> u32 {
        self.state.psp()
    }

    /// The exception that is being handled.
    #[inline]
    pub fn current_exception(&self) -> Exception {
        Exception((self.state.xpsr & xpsr::EXCEPTION) as u16)
    }

    /// Whether it sleeps (`WFI`, `WFE`).
    #[inline]
    pub fn is_asleep(&self) -> bool {
        self.state.asleep
    }

    /// Whether a fault struck where no handler can be entered any more.
    #[inline]
    pub fn is_locked_up(&self) -> bool {
        self.state.locked_up
    }

    /// Whether the program has asked for a reset (`SYSRESETREQ`).
    #[inline]
    pub fn reset_requested(&self) -> bool {
        self.state.sys.reset_requested
    }

    /// Whether an enabled exception waits, as wakes a sleeping core.
    pub fn anything_pending(&self) -> bool {
        self.state.sys.highest_pending().is_some()
    }

    /// NVIC, SysTick, MPU and the rest of the system control space.
    pub fn sys(&self) -> &Sys {
        &self.state.sys
    }

    /// The same, to change it.
    pub fn sys_mut(&mut self) -> &mut Sys {
        &mut self.state.sys
    }
}
