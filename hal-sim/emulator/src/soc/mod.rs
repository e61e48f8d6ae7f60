//! The nRF52832 around its processor core: peripherals, interrupt lines, PPI, flash and EasyDMA.
//!
//! ```text
//!   core ──read, write──► Soc ─► peripheral ─► event ─┬─► interrupt line
//!                          ▲                          └─► PPI ─► task of another peripheral
//!                          └── advance(now): timers that run out, transfers that end
//! ```
//! Time is counted in cycles of the 64 MHz clock; every peripheral names the cycle at which it will do something by
//! itself. Accesses to what is not modelled are refused by name, never answered with a silent zero.
//!
//! | file | subject |
//! |---|---|
//! | `block` | what all peripherals have in common |
//! | `lines` | what a peripheral can reach beyond its registers |
//! | `access` | the processor's reads and writes |
//! | `clock` | CLOCK and POWER: oscillators, reset reasons, retained registers |
//! | `gpio` | P0 and GPIOTE |
//! | `spi` | SPIM and the older SPI |
//! | `uart` | UARTE and the older UART |
//! | `received` | what the older SPI and UART hold until it is read |
//! | `rtc`, `timer`, `watchdog` | counters |
//! | `memory` | flash and UICR behind NVMC |
//! | `ppi`, `random`, `plain` | the rest: PPI, RNG, FICR, and registers that only hold what is written |

mod access;
pub(crate) mod block;
mod clock;
mod gpio;
mod lines;
mod memory;
mod plain;
mod ppi;
mod random;
mod received;
mod rtc;
mod spi;
mod timer;
mod uart;
mod watchdog;

use crate::error::{Access, Refusal, Trouble};

pub use clock::ResetReason;
pub(crate) use lines::Outward;
use lines::{Lines, Peripheral};
pub(crate) use memory::{Memory, UICR_START};

/// Cycles of the processor's clock since the board was switched on.
pub type Cycles = u64;

/// The processor's clock in Hz (product specification, chapter 19).
pub const CPU_HZ: u64 = 64_000_000;

/// Where RAM begins.
pub const RAM_START: u32 = 0x2000_0000;
/// Its length in bytes.
pub const RAM_BYTES: u32 = 64 * 1024;
/// Length of the flash in bytes; it begins at 0.
pub const FLASH_BYTES: u32 = 512 * 1024;

/// Longest chain of events and tasks through PPI in one cycle; a longer one is a ring.
const LONGEST_CHAIN: usize = 64;

/// What is burnt into a chip.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ChipIdentity {
    /// FICR.DEVICEID.
    pub device_id: [u32; 2],
    /// Seed of what its random number generator gives.
    pub random_seed: u64,
}

/// Peripherals and memories of one chip.
pub(crate) struct Soc {
    identity: ChipIdentity,
    pub(crate) ram: Vec<u8>,
    pub(crate) memory: Memory,
    clock: clock::ClockAndPower,
    pub(crate) gpio: gpio::Gpio,
    ppi: ppi::Ppi,
    pub(crate) watchdog: watchdog::Watchdog,
    pub(crate) uart: uart::Uart,
    spi: [spi::Spi; 3],
    timers: [timer::Timer; 5],
    rtcs: [rtc::Rtc; 3],
    random: random::Random,
    plain: Vec<plain::Plain>,
    raised: Vec<(u8, u16)>,
    pub(crate) outward: Vec<Outward>,
    due: [Cycles; IDS],
    /// Levels of the interrupt lines, a bit each.
    pub(crate) interrupts: u64,
    pub(crate) trouble: Option<Trouble>,
}

/// Peripherals have numbers below this.
const IDS: usize = 40;

/// Never.
const NEVER: Cycles = Cycles::MAX;

impl Soc {
    pub(crate) fn new(identity: ChipIdentity, memory: Memory) -> Self {
        let mut soc = Soc {
            identity,
            ram: vec![0; RAM_BYTES as usize],
            memory,
            clock: clock::ClockAndPower::new(),
            gpio: gpio::Gpio::new(),
            ppi: ppi::Ppi::new(),
            watchdog: watchdog::Watchdog::new(),
            uart: uart::Uart::new(),
            spi: spi::ALL.map(spi::Spi::new),
            timers: timer::ALL.map(timer::Timer::new),
            rtcs: rtc::ALL.map(rtc::Rtc::new),
            random: random::Random::new(identity.random_seed),
            plain: plain::all(),
            raised: Vec::new(),
            outward: Vec::new(),
            due: [NEVER; IDS],
            interrupts: 0,
            trouble: None,
        };
        soc.refresh_all();
        soc
    }

    /// All peripherals as after a reset; what a reset for this reason leaves alone stays (product specification,
    /// table 34, "Reset behavior"). A radio line that was driven is told to be released.
    pub(crate) fn reset(&mut self, reason: ResetReason) {
        let clock = core::mem::replace(&mut self.clock, clock::ClockAndPower::new());
        let gpio = core::mem::replace(&mut self.gpio, gpio::Gpio::new());
        let uart = core::mem::replace(&mut self.uart, uart::Uart::new());
        self.outward.clear();
        self.clock.inherit(&clock, reason);
        self.gpio.inherit(gpio, &mut self.outward);
        self.uart.inherit(uart);
        self.random.reset();
        if !matches!(reason, ResetReason::Software | ResetReason::Lockup) {
            self.watchdog = watchdog::Watchdog::new();
        }
        self.memory.reset();
        self.ppi = ppi::Ppi::new();
        self.spi = spi::ALL.map(spi::Spi::new);
        self.timers = timer::ALL.map(timer::Timer::new);
        self.rtcs = rtc::ALL.map(rtc::Rtc::new);
        self.plain = plain::all();
        self.raised.clear();
        self.trouble = None;
        self.refresh_all();
    }

    fn peripheral(&mut self, id: u8) -> Option<&mut dyn Peripheral> {
        Some(match id {
            0 => &mut self.clock,
            uart::ID => &mut self.uart,
            gpio::ID => &mut self.gpio,
            13 => &mut self.random,
            16 => &mut self.watchdog,
            memory::ID => &mut self.memory,
            31 => &mut self.ppi,
            3 | 4 | 35 => self.spi.iter_mut().find(|spi| spi.block().id == id)?,
            11 | 17 | 36 => self.rtcs.iter_mut().find(|rtc| rtc.block().id == id)?,
            8..=10 | 26 | 27 => self
                .timers
                .iter_mut()
                .find(|timer| timer.block().id == id)?,
            _ => self.plain.iter_mut().find(|plain| plain.block().id == id)?,
        })
    }

    /// The first cycle at which something happens by itself.
    pub(crate) fn next_due(&self) -> Cycles {
        self.due.iter().copied().min().unwrap_or(NEVER)
    }

    fn refresh(&mut self, id: u8) {
        let Some(peripheral) = self.peripheral(id) else {
            return;
        };
        let due = peripheral.due().unwrap_or(NEVER);
        let level = peripheral.block().interrupt();
        if let Some(place) = self.due.get_mut(usize::from(id)) {
            *place = due;
        }
        let bit = 1u64.checked_shl(id.into()).unwrap_or(0);
        self.interrupts = if level {
            self.interrupts | bit
        } else {
            self.interrupts & !bit
        };
    }

    fn refresh_all(&mut self) {
        (0..IDS as u8).for_each(|id| self.refresh(id));
    }

    /// Lets peripheral `id` act, and everything happen that follows from it.
    fn with<R>(
        &mut self,
        id: u8,
        now: Cycles,
        act: impl FnOnce(&mut Self, &mut Lines<'_>) -> Result<R, Refusal>,
    ) -> Result<R, Refusal> {
        let mut ram = core::mem::take(&mut self.ram);
        let mut raised = core::mem::take(&mut self.raised);
        let mut outward = core::mem::take(&mut self.outward);
        let mut lines = Lines {
            now,
            ram: &mut ram,
            raised: &mut raised,
            outward: &mut outward,
        };
        let mut result = act(self, &mut lines);
        self.refresh(id);
        let mut next = 0;
        while let Some(&(id, event)) = lines.raised.get(next) {
            next += 1;
            if let Err(refusal) = self.follow(id, event, next, &mut lines) {
                result = Err(refusal);
                break;
            }
        }
        raised.clear();
        self.ram = ram;
        self.raised = raised;
        self.outward = outward;
        result
    }

    /// Carries an event through PPI to the tasks it triggers.
    fn follow(
        &mut self,
        id: u8,
        event: u16,
        length: usize,
        lines: &mut Lines<'_>,
    ) -> Result<(), Refusal> {
        if length > LONGEST_CHAIN {
            return Err(Refusal::misuse("events and tasks in PPI form a ring"));
        }
        for (id, task) in self.ppi.tasks_of(id, event) {
            match self.peripheral(id) {
                Some(peripheral) if peripheral.block().layout.tasks.contains(&task) => {
                    peripheral.task(task, lines)?;
                }
                _ => {
                    return Err(Refusal::misuse(format!(
                        "PPI triggers task {task:#05x} of peripheral {id}, which is not modelled"
                    )));
                }
            }
            self.refresh(id);
        }
        Ok(())
    }

    /// The same for a peripheral that is known by its number alone.
    fn act<R>(
        &mut self,
        id: u8,
        now: Cycles,
        act: impl FnOnce(&mut dyn Peripheral, &mut Lines<'_>) -> Result<R, Refusal>,
    ) -> Result<R, Refusal> {
        self.with(id, now, |soc, lines| match soc.peripheral(id) {
            Some(peripheral) => act(peripheral, lines),
            None => Err(Refusal::Unmodelled(Access::Read)),
        })
    }

    /// Does everything that is due up to `now`, in order.
    pub(crate) fn advance(&mut self, now: Cycles) {
        loop {
            let mut dues = self.due.iter().copied().enumerate();
            let Some((id, at)) = dues.by_ref().min_by_key(|&(_, due)| due) else {
                return;
            };
            if at > now {
                return;
            }
            let id = id as u8;
            let result = self.act(id, at, |peripheral, lines| peripheral.advance(lines));
            if let Err(refusal) = result {
                self.refuse(id, 0, refusal);
                return;
            }
        }
    }

    fn refuse(&mut self, id: u8, offset: u32, refusal: Refusal) {
        let place = self.peripheral(id).map(|p| p.block().layout.name);
        let place = place.unwrap_or_else(|| plain::name(id)).to_owned();
        self.refuse_at(place, offset, refusal);
    }

    /// The first trouble counts.
    pub(crate) fn refuse_at(&mut self, place: String, offset: u32, refusal: Refusal) {
        self.trouble.get_or_insert(Trouble {
            place,
            offset,
            pc: 0,
            refusal,
        });
    }
}

#[cfg(test)]
mod tests;
