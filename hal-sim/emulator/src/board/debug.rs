//! What a debugger does to a board: it stands still between two instructions while its time does not pass.

use std::collections::BTreeSet;

use rsemu_executor::Registers;

use super::Board;
use crate::soc::{RAM_BYTES, RAM_START};

/// Why a board stands still.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Halt {
    /// It was told to.
    Asked,
    /// It has carried out the one step that it was to.
    Stepped,
    /// The next instruction has a breakpoint.
    Breakpoint,
}

#[derive(Debug, Clone, Copy, Default)]
enum Go {
    #[default]
    On,
    /// On, and over a breakpoint at the first instruction.
    Over,
    /// One step, and over a breakpoint.
    Step,
    /// That step has begun.
    Stepping,
    Halted(Halt),
}

/// A debugger's wishes; none costs a board a comparison an instruction.
#[derive(Debug, Default)]
pub(super) struct Debug {
    breakpoints: BTreeSet<u32>,
    go: Go,
}

impl Debug {
    /// Whether the board is not to carry out the instruction at `pc` now.
    pub(super) fn stops_at(&mut self, pc: u32) -> bool {
        self.go = match self.go {
            Go::On if self.breakpoints.contains(&pc) => Go::Halted(Halt::Breakpoint),
            Go::Over => Go::On,
            Go::Step => Go::Stepping,
            Go::Stepping => Go::Halted(Halt::Stepped),
            other => other,
        };
        matches!(self.go, Go::Halted(_))
    }

    fn is_idle(&self) -> bool {
        self.breakpoints.is_empty() && matches!(self.go, Go::On)
    }
}

impl Board {
    /// Whether it stands still for a debugger, and why.
    pub fn halted(&self) -> Option<Halt> {
        match self.debug.as_ref()?.go {
            Go::Halted(why) => Some(why),
            _ => None,
        }
    }

    fn change(&mut self, change: impl FnOnce(&mut Debug)) {
        let mut debug = self.debug.take().unwrap_or_default();
        change(&mut debug);
        self.debug = Some(debug).filter(|debug| !debug.is_idle());
    }

    /// Stands still before the next instruction.
    pub fn halt(&mut self) {
        self.change(|debug| debug.go = Go::Halted(Halt::Asked));
    }

    /// Goes on, over a breakpoint at the first instruction.
    pub fn resume(&mut self) {
        self.change(|debug| debug.go = Go::Over);
    }

    /// Goes on for one step: an instruction, or the entry into an exception.
    pub fn step_once(&mut self) {
        self.change(|debug| debug.go = Go::Step);
    }

    /// Goes on without any breakpoint.
    pub fn let_go(&mut self) {
        self.debug = None;
    }

    /// Stands still before the instruction at `address` from now on.
    pub fn set_breakpoint(&mut self, address: u32) {
        self.change(|debug| {
            debug.breakpoints.insert(address & !1);
        });
    }

    /// Not any more; false if there was no breakpoint.
    pub fn remove_breakpoint(&mut self, address: u32) -> bool {
        let mut was_there = false;
        self.change(|debug| was_there = debug.breakpoints.remove(&(address & !1)));
        was_there
    }

    /// Registers of its core.
    pub fn registers(&self) -> Registers {
        self.core.registers()
    }

    /// Main and process stack pointer.
    pub fn stack_pointers(&self) -> [u32; 2] {
        [self.core.msp(), self.core.psp()]
    }

    /// `S0` to `S31`, and `FPSCR`.
    pub fn floats(&self) -> ([u32; 32], u32) {
        (self.core.floats(), self.core.fpscr())
    }

    /// Writes registers.
    pub fn set_registers(&mut self, registers: Registers, floats: [u32; 32], fpscr: u32) {
        self.core.set_registers(registers);
        self.core.set_floats(floats, fpscr);
    }

    /// Reads RAM, flash, or the system control space; returns how many bytes there were. Registers of peripherals are
    /// left alone: reading some of them changes them.
    pub fn read_memory(&self, address: u32, bytes: &mut [u8]) -> usize {
        // Reading it for a debugger changes nothing, but rsemu wants it to be its own.
        let mut system = self.core.sys().clone();
        let mut count = 0;
        for (at, byte) in (address..).zip(bytes) {
            let word = self.chip.word(at & !3);
            let word = word.or_else(|| system.read_word(at & !3, true));
            let Some(word) = word else { break };
            *byte = (word >> (8 * (at & 3))) as u8;
            count += 1;
        }
        count
    }

    /// Writes to RAM; false, and nothing is written, where not all of it is RAM.
    pub fn write_ram(&mut self, address: u32, bytes: &[u8]) -> bool {
        let start = address.wrapping_sub(RAM_START) as usize;
        let end = start.saturating_add(bytes.len());
        if end > RAM_BYTES as usize {
            return false;
        }
        let place = self.chip.soc.ram.get_mut(start..end);
        place.is_some_and(|place| {
            place.copy_from_slice(bytes);
            true
        })
    }
}
