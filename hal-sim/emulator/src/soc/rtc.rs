//! Real-time counters (product specification, chapter 25). 24 bits, 32 768 Hz divided by PRESCALER + 1.
//!
//! A compare event comes when the counter reaches the value, not when the value is set to what the counter shows.
//! The delays of tasks of up to a tick and a half (25.9) are not modelled: they act at once.

use super::block::{Block, Layout, ro, rw, wo};
use super::{CPU_HZ, Cycles, Lines, Peripheral};
use crate::error::Refusal;

const START: u16 = 0x000;
const STOP: u16 = 0x004;
const CLEAR: u16 = 0x008;
const TRIGGER_OVERFLOW: u16 = 0x00C;
const TICK: u16 = 0x100;
const OVERFLOW: u16 = 0x104;
const COMPARE: u16 = 0x140;
const EVTEN: u16 = 0x340;
const EVTENSET: u16 = 0x344;
const EVTENCLR: u16 = 0x348;
const COUNTER: u16 = 0x504;
const PRESCALER: u16 = 0x508;
const CC: u16 = 0x540;

macro_rules! layout {
    ($name:literal, $compares:expr) => {
        Layout {
            name: $name,
            tasks: &[START, STOP, CLEAR, TRIGGER_OVERFLOW],
            events: &[TICK, OVERFLOW, 0x140, 0x144, 0x148, 0x14C],
            shorts: 0,
            interrupts: true,
            registers: &[
                rw(EVTEN, !0),
                wo(EVTENSET, !0),
                wo(EVTENCLR, !0),
                ro(COUNTER, 0),
                rw(PRESCALER, 0xFFF),
                rw(CC, 0xFF_FFFF).times($compares),
            ],
        }
    };
}

const RTC0: Layout = layout!("RTC0", 3);
const RTC1: Layout = layout!("RTC1", 4);
const RTC2: Layout = layout!("RTC2", 4);

/// Their numbers.
pub(super) const ALL: [u8; 3] = [11, 17, 36];

/// 32 768 Hz from 64 MHz: 8 ticks in 15 625 cycles.
const TICKS: u64 = 8;
const PER_CYCLES: u64 = 15_625;
const _: () = assert!(32_768 * PER_CYCLES == CPU_HZ * TICKS);

const WRAP: u64 = 1 << 24;
/// What TRIGOVRFLW sets the counter to.
const NEAR_OVERFLOW: u64 = 0xFF_FFF0;

/// One counter.
pub(super) struct Rtc {
    block: Block,
    compares: u16,
    /// Since when it has been running, and what it showed then.
    started: Option<Cycles>,
    base: u64,
    /// Ticks since `started` whose events have been raised.
    done: u64,
}

impl Rtc {
    pub(super) fn new(id: u8) -> Self {
        let (layout, compares) = match id {
            11 => (&RTC0, 3),
            17 => (&RTC1, 4),
            _ => (&RTC2, 4),
        };
        Rtc {
            block: Block::new(id, layout),
            compares,
            started: None,
            base: 0,
            done: 0,
        }
    }

    fn divider(&self) -> u64 {
        u64::from(self.block.get(PRESCALER)) + 1
    }

    /// Ticks since it was started, never wrapping.
    fn elapsed(&self, now: Cycles) -> u64 {
        self.started.map_or(0, |started| {
            now.saturating_sub(started) * TICKS / (PER_CYCLES * self.divider())
        })
    }

    /// The first cycle at which so many ticks have elapsed.
    fn when(&self, ticks: u64) -> Option<Cycles> {
        Some(self.started? + (ticks * PER_CYCLES * self.divider()).div_ceil(TICKS))
    }

    /// Goes on from `value`.
    fn restart(&mut self, value: u64, now: Cycles) {
        (self.base, self.done) = (value, 0);
        self.started = self.started.map(|_| now);
    }

    fn counter(&self, now: Cycles) -> u64 {
        (self.base + self.elapsed(now)) % WRAP
    }

    /// Ticks from those done until the counter shows `value` next.
    fn until(&self, value: u64) -> u64 {
        let present = (self.base + self.done) % WRAP;
        match (value + WRAP - present) % WRAP {
            0 => WRAP,
            ticks => ticks,
        }
    }

    fn wants(&self, event: u16) -> bool {
        let bit = 1 << ((event - 0x100) / 4);
        self.block.is_enabled(event) || self.block.get(EVTEN) & bit != 0
    }

    /// Events that are wanted and the values at which they come. TICK comes always.
    fn awaited(&self) -> impl Iterator<Item = (u16, u64)> {
        let compares = (0..self.compares).map(|n| {
            let value = self.block.get(CC + 4 * n);
            (COMPARE + 4 * n, u64::from(value))
        });
        compares
            .chain([(OVERFLOW, 0)])
            .filter(|&(event, _)| self.wants(event))
    }

    fn next(&self) -> Option<u64> {
        let ticks = self.awaited().map(|(_, value)| self.until(value)).min();
        let each = self.wants(TICK).then_some(1);
        [ticks, each].into_iter().flatten().min()
    }
}

impl Peripheral for Rtc {
    fn block(&self) -> &Block {
        &self.block
    }

    fn block_mut(&mut self) -> &mut Block {
        &mut self.block
    }

    fn task(&mut self, task: u16, lines: &mut Lines<'_>) -> Result<(), Refusal> {
        let shown = self.counter(lines.now);
        match task {
            START if self.started.is_none() => {
                self.started = Some(lines.now);
                self.done = 0;
            }
            STOP => {
                (self.base, self.done, self.started) = (shown, 0, None);
            }
            CLEAR => self.restart(0, lines.now),
            TRIGGER_OVERFLOW => self.restart(NEAR_OVERFLOW, lines.now),
            _ => {}
        }
        Ok(())
    }

    fn read(&mut self, offset: u16, lines: &mut Lines<'_>) -> Option<u32> {
        match offset {
            COUNTER => Some(self.counter(lines.now) as u32),
            EVTENSET | EVTENCLR => Some(self.block.get(EVTEN)),
            _ => None,
        }
    }

    fn written(&mut self, offset: u16, value: u32, lines: &mut Lines<'_>) -> Result<(), Refusal> {
        let enabled = self.block.get(EVTEN);
        match offset {
            EVTENSET => self.block.set(EVTEN, enabled | value),
            EVTENCLR => self.block.set(EVTEN, enabled & !value),
            PRESCALER if self.started.is_some() => {
                return Err(Refusal::misuse(
                    "PRESCALER is written while the counter runs",
                ));
            }
            // Ticks that have gone by do not count for a value that is set now.
            _ => self.done = self.elapsed(lines.now),
        }
        Ok(())
    }

    fn due(&self) -> Option<Cycles> {
        self.when(self.done + self.next()?)
    }

    fn advance(&mut self, lines: &mut Lines<'_>) -> Result<(), Refusal> {
        let Some(ticks) = self.next() else {
            return Ok(());
        };
        let hits: Vec<u16> = self
            .awaited()
            .filter(|&(_, value)| self.until(value) == ticks)
            .map(|(event, _)| event)
            .collect();
        self.done += ticks;
        for event in hits {
            lines.raise(&mut self.block, event);
        }
        if self.wants(TICK) {
            lines.raise(&mut self.block, TICK);
        }
        Ok(())
    }
}
