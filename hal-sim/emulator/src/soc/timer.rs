//! Timers (product specification, chapter 24): 16 MHz divided by a power of two, or a count of tasks.

use super::block::{Block, Layout, rw};
use super::{CPU_HZ, Cycles, Lines, Peripheral};
use crate::error::Refusal;

const START: u16 = 0x000;
const STOP: u16 = 0x004;
const COUNT: u16 = 0x008;
const CLEAR: u16 = 0x00C;
const SHUTDOWN: u16 = 0x010;
const CAPTURE: u16 = 0x040;
const COMPARE: u16 = 0x140;
const MODE: u16 = 0x504;
const BITMODE: u16 = 0x508;
const PRESCALER: u16 = 0x510;
const CC: u16 = 0x540;

macro_rules! layout {
    ($name:literal, $compares:expr, [$($n:expr),*]) => {
        Layout {
            name: $name,
            tasks: &[START, STOP, COUNT, CLEAR, SHUTDOWN, $(CAPTURE + 4 * $n),*],
            events: &[$(COMPARE + 4 * $n),*],
            shorts: (1 << $compares) - 1 | ((1 << $compares) - 1) << 8,
            interrupts: true,
            registers: &[
                rw(MODE, 3),
                rw(BITMODE, 3),
                rw(PRESCALER, 0xF).reset(4),
                rw(CC, !0).times($compares),
            ],
        }
    };
}

const TIMER0: Layout = layout!("TIMER0", 4, [0, 1, 2, 3]);
const TIMER1: Layout = layout!("TIMER1", 4, [0, 1, 2, 3]);
const TIMER2: Layout = layout!("TIMER2", 4, [0, 1, 2, 3]);
const TIMER3: Layout = layout!("TIMER3", 6, [0, 1, 2, 3, 4, 5]);
const TIMER4: Layout = layout!("TIMER4", 6, [0, 1, 2, 3, 4, 5]);

/// Their numbers.
pub(super) const ALL: [u8; 5] = [8, 9, 10, 26, 27];

/// Cycles of 64 MHz in one of 16 MHz.
const CYCLES_PER_STEP: u64 = CPU_HZ / 16_000_000;

/// One timer.
pub(super) struct Timer {
    block: Block,
    compares: u16,
    /// Since when it runs; it showed `base` then.
    started: Option<Cycles>,
    base: u64,
    /// Steps since `started` whose events have been raised.
    done: u64,
}

impl Timer {
    pub(super) fn new(id: u8) -> Self {
        let (layout, compares) = match id {
            8 => (&TIMER0, 4),
            9 => (&TIMER1, 4),
            10 => (&TIMER2, 4),
            26 => (&TIMER3, 6),
            _ => (&TIMER4, 6),
        };
        Timer {
            block: Block::new(id, layout),
            compares,
            started: None,
            base: 0,
            done: 0,
        }
    }

    fn counts_tasks(&self) -> bool {
        self.block.get(MODE) != 0
    }

    /// The counter's values before it wraps.
    fn wrap(&self) -> u64 {
        match self.block.get(BITMODE) {
            0 => 1 << 16,
            1 => 1 << 8,
            2 => 1 << 24,
            _ => 1 << 32,
        }
    }

    fn cycles_per_step(&self) -> u64 {
        CYCLES_PER_STEP << self.block.get(PRESCALER).min(9)
    }

    fn elapsed(&self, now: Cycles) -> u64 {
        match self.started {
            Some(started) if !self.counts_tasks() => {
                now.saturating_sub(started) / self.cycles_per_step()
            }
            _ => 0,
        }
    }

    fn counter(&self, now: Cycles) -> u64 {
        (self.base + self.elapsed(now)) % self.wrap()
    }

    fn restart(&mut self, value: u64, now: Cycles) {
        (self.base, self.done) = (value, 0);
        self.started = self.started.map(|_| now);
    }

    fn values(&self) -> impl Iterator<Item = (u16, u64)> {
        (0..self.compares).map(|n| (n, u64::from(self.block.get(CC + 4 * n)) % self.wrap()))
    }

    fn until(&self, value: u64) -> u64 {
        let (present, wrap) = ((self.base + self.done) % self.wrap(), self.wrap());
        match (value + wrap - present) % wrap {
            0 => wrap,
            steps => steps,
        }
    }

    /// The counter has reached the value of compare `n`.
    fn hit(&mut self, n: u16, lines: &mut Lines<'_>) {
        lines.raise(&mut self.block, COMPARE + 4 * n);
        let short = |bit: u16| self.block.shorts >> bit & 1 == 1;
        let (clears, stops) = (short(n), short(n + 8));
        if clears {
            self.restart(0, lines.now);
        }
        if stops {
            self.stop(lines.now);
        }
    }

    fn stop(&mut self, now: Cycles) {
        (self.base, self.done, self.started) = (self.counter(now), 0, None);
    }
}

impl Peripheral for Timer {
    fn block(&self) -> &Block {
        &self.block
    }

    fn block_mut(&mut self) -> &mut Block {
        &mut self.block
    }

    fn task(&mut self, task: u16, lines: &mut Lines<'_>) -> Result<(), Refusal> {
        match task {
            START if self.started.is_none() => {
                self.started = Some(lines.now);
                self.done = 0;
            }
            STOP | SHUTDOWN => {
                self.stop(lines.now);
                if task == SHUTDOWN {
                    self.base = 0;
                }
            }
            COUNT if self.counts_tasks() && self.started.is_some() => {
                self.base = (self.base + 1) % self.wrap();
                let hits: Vec<u16> = self
                    .values()
                    .filter_map(|(n, value)| (value == self.base).then_some(n))
                    .collect();
                hits.into_iter().for_each(|n| self.hit(n, lines));
            }
            CLEAR => self.restart(0, lines.now),
            CAPTURE.. => {
                let value = self.counter(lines.now);
                self.block.set(CC + (task - CAPTURE), value as u32);
                self.done = self.elapsed(lines.now);
            }
            _ => {}
        }
        Ok(())
    }

    fn written(&mut self, offset: u16, _: u32, lines: &mut Lines<'_>) -> Result<(), Refusal> {
        match offset {
            CC.. => self.done = self.elapsed(lines.now),
            _ if self.started.is_some() => {
                return Err(Refusal::misuse("a running timer's set-up is written"));
            }
            _ => {}
        }
        Ok(())
    }

    fn due(&self) -> Option<Cycles> {
        let started = self.started.filter(|_| !self.counts_tasks())?;
        let steps = self.values().map(|(_, value)| self.until(value)).min()?;
        Some(started + (self.done + steps) * self.cycles_per_step())
    }

    fn advance(&mut self, lines: &mut Lines<'_>) -> Result<(), Refusal> {
        let Some(steps) = self.values().map(|(_, value)| self.until(value)).min() else {
            return Ok(());
        };
        let hits: Vec<u16> = self
            .values()
            .filter_map(|(n, value)| (self.until(value) == steps).then_some(n))
            .collect();
        self.done += steps;
        hits.into_iter().for_each(|n| self.hit(n, lines));
        Ok(())
    }
}
