//! WDT (product specification, chapter 38). It really resets.

use super::block::{Block, Layout, ro, rw, wo};
use super::{Cycles, Lines, Outward, Peripheral};
use crate::error::Refusal;

const START: u16 = 0x000;
const TIMEOUT: u16 = 0x100;
const RUNSTATUS: u16 = 0x400;
const REQSTATUS: u16 = 0x404;
const CRV: u16 = 0x504;
const RREN: u16 = 0x508;
const CONFIG: u16 = 0x50C;
const RR: u16 = 0x600;

const LAYOUT: Layout = Layout {
    name: "WDT",
    tasks: &[START],
    events: &[TIMEOUT],
    shorts: 0,
    interrupts: true,
    registers: &[
        ro(RUNSTATUS, 0),
        ro(REQSTATUS, 1),
        rw(CRV, !0).reset(!0),
        rw(RREN, 0xFF).reset(1),
        rw(CONFIG, 9).reset(1),
        wo(RR, !0).times(8),
    ],
};

/// What reloads it.
const RELOAD: u32 = 0x6E52_4635;

/// Cycles in a tick of 32 768 Hz, times 8.
const EIGHT_TICKS: u64 = 15_625;

/// WDT.
pub(crate) struct Watchdog {
    block: Block,
    /// Since when it counts, once started.
    fed: Option<Cycles>,
    timed_out: Option<Cycles>,
    /// The set-up it was started with.
    locked: [u32; 3],
}

const SET_UP: [u16; 3] = [CRV, RREN, CONFIG];

fn ticks(count: u64) -> Cycles {
    (count * EIGHT_TICKS).div_ceil(8)
}

impl Watchdog {
    pub(super) fn new() -> Self {
        Watchdog {
            block: Block::new(16, &LAYOUT),
            fed: None,
            timed_out: None,
            locked: [0; 3],
        }
    }
}

impl Peripheral for Watchdog {
    fn block(&self) -> &Block {
        &self.block
    }

    fn block_mut(&mut self) -> &mut Block {
        &mut self.block
    }

    fn task(&mut self, _: u16, lines: &mut Lines<'_>) -> Result<(), Refusal> {
        if self.fed.is_none() {
            self.fed = Some(lines.now);
            self.locked = SET_UP.map(|offset| self.block.get(offset));
            self.block.set(RUNSTATUS, 1);
            self.block.set(REQSTATUS, self.block.get(RREN));
        }
        Ok(())
    }

    fn written(&mut self, offset: u16, value: u32, lines: &mut Lines<'_>) -> Result<(), Refusal> {
        match offset {
            RR.. if value == RELOAD && self.fed.is_some() => {
                let bit = 1 << ((offset - RR) / 4);
                let waiting = self.block.get(REQSTATUS) & !bit;
                self.block.set(REQSTATUS, waiting);
                if waiting == 0 {
                    self.fed = Some(lines.now);
                    self.block.set(REQSTATUS, self.block.get(RREN));
                }
                Ok(())
            }
            RR.. => Ok(()),
            // While it runs its set-up is locked (38.2): what was written is undone.
            _ if self.fed.is_some() => {
                for (offset, value) in SET_UP.into_iter().zip(self.locked) {
                    self.block.set(offset, value);
                }
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn due(&self) -> Option<Cycles> {
        // Two ticks from TIMEOUT to the reset (38.1).
        let resets = self.timed_out.map(|at| at + ticks(2));
        resets.or(self
            .fed
            .map(|fed| fed + ticks(u64::from(self.block.get(CRV)) + 1)))
    }

    fn advance(&mut self, lines: &mut Lines<'_>) -> Result<(), Refusal> {
        if self.timed_out.is_none() {
            self.timed_out = Some(lines.now);
            lines.raise(&mut self.block, TIMEOUT);
        } else {
            self.fed = None;
            self.timed_out = None;
            lines.tell(Outward::WatchdogReset);
        }
        Ok(())
    }
}
