//! CLOCK and POWER, which share their place (product specification, chapters 18 and 19).

use super::block::{Block, Layout, ro, rw, wo};
use super::{CPU_HZ, Cycles, Lines, Outward, Peripheral};
use crate::error::Refusal;

const HFCLKSTART: u16 = 0x000;
const HFCLKSTOP: u16 = 0x004;
const LFCLKSTART: u16 = 0x008;
const LFCLKSTOP: u16 = 0x00C;
const CAL: u16 = 0x010;
const CONSTLAT: u16 = 0x078;
const LOWPWR: u16 = 0x07C;
const HFCLKSTARTED: u16 = 0x100;
const LFCLKSTARTED: u16 = 0x104;
const DONE: u16 = 0x10C;
const RESETREAS: u16 = 0x400;
const HFCLKRUN: u16 = 0x408;
const HFCLKSTAT: u16 = 0x40C;
const LFCLKRUN: u16 = 0x414;
const LFCLKSTAT: u16 = 0x418;
const LFCLKSRCCOPY: u16 = 0x41C;
const SYSTEMOFF: u16 = 0x500;
const GPREGRET: u16 = 0x51C;
const GPREGRET2: u16 = 0x520;
const LFCLKSRC: u16 = 0x518;

const LAYOUT: Layout = Layout {
    name: "CLOCK/POWER",
    tasks: &[
        HFCLKSTART, HFCLKSTOP, LFCLKSTART, LFCLKSTOP, CAL, CONSTLAT, LOWPWR,
    ],
    // 0x108 POFWARN, 0x110 CTTO, 0x114 SLEEPENTER and 0x118 SLEEPEXIT never happen here.
    events: &[HFCLKSTARTED, LFCLKSTARTED, 0x108, DONE, 0x110, 0x114, 0x118],
    shorts: 0,
    interrupts: true,
    registers: &[
        // Holds no more than was written last; the reasons are kept apart.
        rw(RESETREAS, !0),
        ro(HFCLKRUN, 0),
        ro(HFCLKSTAT, 0),
        ro(LFCLKRUN, 0),
        ro(LFCLKSTAT, 0),
        ro(LFCLKSRCCOPY, 0),
        // RAMSTATUS.
        ro(0x428, 0xF),
        wo(SYSTEMOFF, 1),
        // POFCON.
        rw(0x510, 0x1F),
        rw(LFCLKSRC, 0x3_0003),
        rw(GPREGRET, 0xFF),
        rw(GPREGRET2, 0xFF),
        // RAMON, RAMONB.
        rw(0x524, 0x3_0003).reset(3),
        // CTIV.
        rw(0x538, 0x7F),
        rw(0x554, 0x3_0003).reset(3),
        // TRACECONFIG.
        rw(0x55C, 0x3_0003),
        // DCDCEN.
        rw(0x578, 1),
        // RAM[n].POWER, POWERSET, POWERCLR: powered whatever is written.
        rw(0x900, !0).times(8).every(16).reset(0xFFFF),
        wo(0x904, !0).times(8).every(16),
        wo(0x908, !0).times(8).every(16),
    ],
};

/// The 32 MHz crystal starts (product specification, 19.4.1: 0.36 ms).
const HFXO_START: Cycles = 360 * CPU_HZ / 1_000_000;
/// The 32.768 kHz RC oscillator starts (19.4.3: 0.6 ms), and so the one synthesised.
const LFRC_START: Cycles = 600 * CPU_HZ / 1_000_000;
/// The 32.768 kHz crystal starts (19.4.4: 0.25 s).
const LFXO_START: Cycles = CPU_HZ / 4;
/// A calibration of the RC oscillator (19.4.3: 16 ms).
const CALIBRATION: Cycles = 16 * CPU_HZ / 1000;

const LFXO: u32 = 1;

/// Why a chip starts; the values are those of RESETREAS.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ResetReason {
    /// The supply was switched on: no bit at all.
    PowerOn,
    /// The reset pin.
    Pin,
    /// The watchdog.
    Watchdog,
    /// SYSRESETREQ.
    Software,
    /// The core had locked up.
    Lockup,
}

impl ResetReason {
    fn bits(self) -> u32 {
        match self {
            ResetReason::PowerOn => 0,
            ResetReason::Pin => 1 << 0,
            ResetReason::Watchdog => 1 << 1,
            ResetReason::Software => 1 << 2,
            ResetReason::Lockup => 1 << 3,
        }
    }
}

/// CLOCK and POWER.
pub(super) struct ClockAndPower {
    block: Block,
    /// RESETREAS.
    reasons: u32,
    hf_ready: Option<Cycles>,
    lf_ready: Option<Cycles>,
    calibrated: Option<Cycles>,
}

impl ClockAndPower {
    pub(super) fn new() -> Self {
        ClockAndPower {
            block: Block::new(0, &LAYOUT),
            reasons: 0,
            hf_ready: None,
            lf_ready: None,
            calibrated: None,
        }
    }

    /// What a reset leaves: the reasons, which add up, and the retention registers. All goes with the supply.
    pub(super) fn inherit(&mut self, old: &Self, reason: ResetReason) {
        if reason == ResetReason::PowerOn {
            return;
        }
        for offset in [GPREGRET, GPREGRET2] {
            self.block.set(offset, old.block.get(offset));
        }
        self.reasons = old.reasons | reason.bits();
    }
}

impl Peripheral for ClockAndPower {
    fn block(&self) -> &Block {
        &self.block
    }

    fn block_mut(&mut self) -> &mut Block {
        &mut self.block
    }

    fn task(&mut self, task: u16, lines: &mut Lines<'_>) -> Result<(), Refusal> {
        match task {
            HFCLKSTART => {
                self.block.set(HFCLKRUN, 1);
                self.hf_ready = Some(lines.now + HFXO_START);
            }
            HFCLKSTOP => {
                self.block.set(HFCLKRUN, 0);
                self.block.set(HFCLKSTAT, 0);
                self.hf_ready = None;
            }
            LFCLKSTART => {
                let source = self.block.get(LFCLKSRC);
                self.block.set(LFCLKRUN, 1);
                self.block.set(LFCLKSRCCOPY, source);
                let start = if source & 3 == LFXO {
                    LFXO_START
                } else {
                    LFRC_START
                };
                self.lf_ready = Some(lines.now + start);
            }
            LFCLKSTOP => {
                self.block.set(LFCLKRUN, 0);
                self.block.set(LFCLKSTAT, 0);
                self.lf_ready = None;
            }
            CAL => self.calibrated = Some(lines.now + CALIBRATION),
            _ => {}
        }
        Ok(())
    }

    fn read(&mut self, offset: u16, _: &mut Lines<'_>) -> Option<u32> {
        (offset == RESETREAS).then_some(self.reasons)
    }

    fn written(&mut self, offset: u16, value: u32, lines: &mut Lines<'_>) -> Result<(), Refusal> {
        match offset {
            SYSTEMOFF if value == 1 => lines.tell(Outward::SystemOff),
            // A 1 clears the reason.
            RESETREAS => self.reasons &= !value,
            _ => {}
        }
        Ok(())
    }

    fn due(&self) -> Option<Cycles> {
        [self.hf_ready, self.lf_ready, self.calibrated]
            .into_iter()
            .flatten()
            .min()
    }

    fn advance(&mut self, lines: &mut Lines<'_>) -> Result<(), Refusal> {
        let is_due = |at: Option<Cycles>| at.is_some_and(|at| at <= lines.now);
        if is_due(self.hf_ready) {
            self.hf_ready = None;
            // Running, from the crystal.
            self.block.set(HFCLKSTAT, 1 << 16 | 1);
            lines.raise(&mut self.block, HFCLKSTARTED);
        } else if is_due(self.lf_ready) {
            self.lf_ready = None;
            let source = self.block.get(LFCLKSRCCOPY) & 3;
            self.block.set(LFCLKSTAT, 1 << 16 | source);
            lines.raise(&mut self.block, LFCLKSTARTED);
        } else if is_due(self.calibrated) {
            self.calibrated = None;
            lines.raise(&mut self.block, DONE);
        }
        Ok(())
    }
}
