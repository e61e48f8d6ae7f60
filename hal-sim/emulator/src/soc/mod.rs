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
//! | `clock` | CLOCK and POWER: oscillators, reset reasons, retained registers |
//! | `gpio` | P0 and GPIOTE |
//! | `spi` | SPIM and the older SPI |
//! | `uart` | UARTE and the older UART |
//! | `rtc`, `timer`, `watchdog` | counters |
//! | `memory` | flash and UICR behind NVMC |
//! | `ppi`, `random`, `plain` | the rest: PPI, RNG, FICR, and registers that only hold what is written |

pub(crate) mod block;
mod clock;
mod gpio;
mod memory;
mod plain;
mod ppi;
mod random;
mod rtc;
mod spi;
mod timer;
mod uart;
mod watchdog;

use crate::error::{Access, Refusal, Trouble};
use block::{Block, Effect};

pub use clock::ResetReason;
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

/// What the chip wants from the board around it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Outward {
    /// The radio's chip select went low (true) or high.
    Select(bool),
    /// The radio's reset line was pulled low (true) or released.
    RadioReset(bool),
    /// Bytes begin to be clocked to and from the radio by this peripheral.
    Transfer {
        /// Its number.
        id: u8,
        mosi: Vec<u8>,
        bits_per_s: u32,
    },
    /// The last bit of a byte left on the serial line.
    Byte(u8),
    /// The processor stands still for so many cycles.
    Stall(Cycles),
    /// The watchdog ran out.
    WatchdogReset,
    /// The supply broke down in the middle of a write to flash.
    PowerLost,
    /// The supply is switched off until a pin wakes the chip.
    SystemOff,
}

/// What a peripheral can reach beyond its own registers.
pub(crate) struct Lines<'a> {
    pub(crate) now: Cycles,
    ram: &'a mut [u8],
    raised: &'a mut Vec<(u8, u16)>,
    outward: &'a mut Vec<Outward>,
}

impl Lines<'_> {
    /// An event happens.
    pub(crate) fn raise(&mut self, block: &mut Block, event: u16) {
        block.mark(event);
        self.raised.push((block.id, event));
    }

    /// Tells the board.
    pub(crate) fn tell(&mut self, what: Outward) {
        self.outward.push(what);
    }

    /// EasyDMA reads; RAM is all that it reaches (product specification, 15.1, "EasyDMA").
    pub(crate) fn dma_read(&self, from: u32, count: u32) -> Result<Vec<u8>, Refusal> {
        if count == 0 {
            return Ok(Vec::new());
        }
        let place = dma_place(from, count)?;
        Ok(self.ram.get(place).unwrap_or_default().to_vec())
    }

    /// EasyDMA writes.
    pub(crate) fn dma_write(&mut self, to: u32, bytes: &[u8]) -> Result<(), Refusal> {
        if bytes.is_empty() {
            return Ok(());
        }
        let place = dma_place(to, bytes.len() as u32)?;
        if let Some(place) = self.ram.get_mut(place) {
            place.copy_from_slice(bytes);
        }
        Ok(())
    }
}

/// Where in RAM that is.
fn dma_place(address: u32, count: u32) -> Result<core::ops::Range<usize>, Refusal> {
    let outside = || {
        Refusal::misuse(format!(
            "EasyDMA of {count} bytes at {address:#010x}, which is not in RAM"
        ))
    };
    let offset = address.checked_sub(RAM_START).ok_or_else(outside)?;
    let end = offset.checked_add(count).ok_or_else(outside)?;
    if end > RAM_BYTES {
        return Err(outside());
    }
    Ok(offset as usize..end as usize)
}

/// One peripheral.
pub(crate) trait Peripheral {
    fn block(&self) -> &Block;
    fn block_mut(&mut self) -> &mut Block;

    /// A task was triggered, by the processor or through PPI.
    fn task(&mut self, task: u16, lines: &mut Lines<'_>) -> Result<(), Refusal>;

    /// A register that is computed when read; `None` for those that [`Block`] holds.
    fn read(&mut self, _offset: u16, _lines: &mut Lines<'_>) -> Option<u32> {
        None
    }

    /// The processor has written one of the peripheral's own registers.
    fn written(
        &mut self,
        _offset: u16,
        _value: u32,
        _lines: &mut Lines<'_>,
    ) -> Result<(), Refusal> {
        Ok(())
    }

    /// When it will do something by itself.
    fn due(&self) -> Option<Cycles> {
        None
    }

    /// Does what is due now.
    fn advance(&mut self, _lines: &mut Lines<'_>) -> Result<(), Refusal> {
        Ok(())
    }
}

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
        let place = place.map_or_else(|| format!("peripheral {id}"), str::to_owned);
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

    /// What an event or an interrupt enable reads as: nothing changes by reading it, and firmware does so over and over
    /// while it waits. `None` for all other registers.
    pub(crate) fn peek(&mut self, address: u32) -> Option<u32> {
        let (id, offset) = place(address);
        let is_plain = (block::EVENTS..block::OWN_REGISTERS).contains(&offset);
        let block = self.peripheral(id).filter(|_| is_plain)?.block();
        block.read(offset).ok()
    }

    /// The processor reads a register of the peripheral bus; `address` is a multiple of 4.
    pub(crate) fn read(&mut self, address: u32, now: Cycles) -> Option<u32> {
        if let Some(value) = plain::erratum(address) {
            return Some(value);
        }
        let (id, offset) = place(address);
        let result = self.act(id, now, |peripheral, lines| {
            match peripheral.read(offset, lines) {
                Some(value) => Ok(value),
                None => peripheral.block().read(offset),
            }
        });
        self.answer(id, offset, result)
    }

    /// The processor writes one.
    pub(crate) fn write(&mut self, address: u32, value: u32, now: Cycles) -> Option<()> {
        if plain::erratum(address).is_some() {
            return Some(());
        }
        let (id, offset) = place(address);
        let result = self.act(id, now, |peripheral, lines| {
            match peripheral.block_mut().write(offset, value)? {
                Effect::Done => Ok(()),
                Effect::Task(task) => peripheral.task(task, lines),
                Effect::Written(offset, value) => peripheral.written(offset, value, lines),
            }
        });
        let result = result.map_err(|refusal| match refusal {
            Refusal::Unmodelled(_) => Refusal::Unmodelled(Access::Write(value)),
            other => other,
        });
        self.answer(id, offset, result)
    }

    fn answer<R>(&mut self, id: u8, offset: u16, result: Result<R, Refusal>) -> Option<R> {
        match result {
            Ok(value) => Some(value),
            Err(refusal) => {
                self.refuse(id, offset.into(), refusal);
                None
            }
        }
    }

    /// The processor reads from the port; its registers are apart from GPIOTE's.
    pub(crate) fn read_port(&mut self, offset: u16) -> Option<u32> {
        let result = self.gpio.read_port(offset);
        self.answer_port(offset, result)
    }

    /// The processor writes to the port.
    pub(crate) fn write_port(&mut self, offset: u16, value: u32, now: Cycles) -> Option<()> {
        let result = self.with(gpio::ID, now, |soc, lines| {
            soc.gpio.write_port(offset, value, lines)
        });
        self.answer_port(offset, result)
    }

    fn answer_port<R>(&mut self, offset: u16, result: Result<R, Refusal>) -> Option<R> {
        match result {
            Ok(value) => Some(value),
            Err(refusal) => {
                self.refuse_at("P0".to_owned(), offset.into(), refusal);
                None
            }
        }
    }

    /// Something outside drives a pin.
    pub(crate) fn drive_pin(&mut self, pin: u8, high: bool, now: Cycles) {
        let result = self.with(gpio::ID, now, |soc, lines| {
            soc.gpio.drive(pin, high, lines);
            Ok(())
        });
        if let Err(refusal) = result {
            self.refuse(gpio::ID, 0, refusal);
        }
    }

    /// What the radio clocked out during the transfer under way.
    pub(crate) fn answer_transfer(&mut self, id: u8, miso: Vec<u8>) {
        if let Some(spi) = self.spi.iter_mut().find(|spi| spi.block().id == id) {
            spi.answer(miso);
        }
    }

    /// The host says `bytes` from `now` on.
    pub(crate) fn hear(&mut self, bytes: &[u8], now: Cycles) {
        self.uart.hear(bytes, now);
        self.refresh(uart::ID);
    }

    /// The processor writes to flash or UICR.
    pub(crate) fn write_memory(&mut self, address: u32, bytes: &[u8], now: Cycles) -> Option<()> {
        let result = self.with(memory::ID, now, |soc, lines| {
            soc.memory.write(address, bytes, lines)
        });
        if let Err(refusal) = result {
            self.refuse_at("flash or UICR".to_owned(), address, refusal);
            return None;
        }
        Some(())
    }

    /// By which the vendor's start-up code tells revisions of the chip.
    pub(crate) fn read_rom_table(&mut self, offset: u32) -> Option<u32> {
        let value = plain::rom_table(offset);
        if value.is_none() {
            self.refuse_at(
                "ROM table".to_owned(),
                offset,
                Refusal::Unmodelled(Access::Read),
            );
        }
        value
    }

    /// FICR, which cannot be written.
    pub(crate) fn read_ficr(&mut self, offset: u32) -> Option<u32> {
        let value = plain::ficr(&self.identity, offset);
        if value.is_none() {
            self.refuse_at("FICR".to_owned(), offset, Refusal::Unmodelled(Access::Read));
        }
        value
    }
}

/// A peripheral's number and the offset of a register (product specification, 15.1: 4 kB each).
fn place(address: u32) -> (u8, u16) {
    (((address >> 12) & 0xFF) as u8, (address & 0xFFF) as u16)
}
