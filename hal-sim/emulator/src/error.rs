//! What ends an emulation.

use thiserror::Error;

/// Why the emulation cannot go on.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum EmulatorError {
    /// The file is no firmware for this chip.
    #[error("the image cannot be loaded: {0}")]
    Image(String),
    /// Firmware used something that is not modelled, or that the hardware leaves undefined.
    #[error("{board}, after {seconds:.6} s: {trouble}")]
    Stopped {
        /// The board's name.
        board: String,
        /// Emulated time since the board was switched on.
        seconds: Seconds,
        /// What it was.
        trouble: Trouble,
    },
    /// Two boards have one name.
    #[error("two boards are called {0}")]
    SameName(String),
    /// There is no such board.
    #[error("there is no board called {0}")]
    UnknownBoard(String),
}

/// Seconds, comparable because they come from whole cycles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seconds(pub f64);

impl Eq for Seconds {}

impl core::fmt::Display for Seconds {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        self.0.fmt(f)
    }
}

/// What firmware did that the emulator refuses.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{place}, {offset:#05x}, by the instruction at {pc:#010x}: {refusal}")]
pub struct Trouble {
    /// The peripheral or the memory.
    pub place: String,
    /// From its start, in bytes.
    pub offset: u32,
    /// The instruction that did it; 0 where no instruction was involved.
    pub pc: u32,
    /// What is wrong with it.
    pub refusal: Refusal,
}

/// Why an access was refused.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum Refusal {
    /// The emulator has no such register or peripheral: it would have to guess.
    #[error("{0} of something that is not modelled")]
    Unmodelled(Access),
    /// The product specification leaves open what happens then, or forbids it.
    #[error("{0}")]
    Misuse(String),
}

impl Refusal {
    pub(crate) fn misuse(what: impl Into<String>) -> Self {
        Refusal::Misuse(what.into())
    }
}

/// What was tried.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    /// A read.
    Read,
    /// A write of this value.
    Write(u32),
}

impl core::fmt::Display for Access {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Access::Read => f.write_str("read"),
            Access::Write(value) => write!(f, "write of {value:#010x}"),
        }
    }
}
