//! One board: the processor, what is around it, and what it has done so far.
//!
//! A board runs until a given cycle, or until it wants something from its radio; then it stands still until
//! [`Emulation`](crate::Emulation) has let the air get to that moment and answered.

mod config;
mod debug;
mod run;

use std::collections::VecDeque;

use nova_hal_sim::{Flash, SimDuration, SimTime};
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rsemu_executor::Core;

use crate::bus::Chip;
use crate::error::EmulatorError;
use crate::image::Image;
use crate::log::{LogLine, LogReader};
use crate::reply::Watch;
use crate::soc::{ChipIdentity, Cycles, Memory, RAM_BYTES, RAM_START, Soc};
use crate::stack::{StackUse, measure};
use crate::wiring;

pub use config::{BoardConfig, BoardStats, ChipMemory};
pub use debug::Halt;

/// What a board wants from its radio.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum RadioRequest {
    Select(bool),
    Reset(bool),
    Transfer {
        id: u8,
        mosi: Vec<u8>,
        bits_per_s: u32,
    },
}

/// An emulated board.
pub struct Board {
    name: String,
    image: Image,
    core: Core,
    chip: Chip,
    noise: ChaCha8Rng,
    /// What RAM held when the supply came.
    initial_ram: Vec<u8>,
    now: Cycles,
    next_due: Cycles,
    interrupts: u64,
    asleep: bool,
    stalled_until: Cycles,
    off: bool,
    requests: VecDeque<(Cycles, RadioRequest)>,
    serial: Vec<(Cycles, u8)>,
    log: LogReader,
    stats: BoardStats,
    watch: Watch,
    /// Only while somebody debugs it.
    debug: Option<debug::Debug>,
    /// Femtoseconds of true time at cycle 0, and in 10^18 cycles.
    boot: SimTime,
    fs_per_1e12_cycles: u128,
}

/// Femtoseconds in a cycle.
const FS_PER_CYCLE: u128 = 15_625_000;
const SCALE: u128 = 1_000_000_000_000;

impl Board {
    /// A board that has just been switched on.
    ///
    /// # Errors
    /// An image with parts where the chip has no memory.
    pub(crate) fn new(
        name: String,
        identity: ChipIdentity,
        mcu_ppm: f64,
        boot_delay: SimDuration,
        memory: Option<ChipMemory>,
        image: Image,
    ) -> Result<Self, EmulatorError> {
        let mut memory =
            memory.map_or_else(Memory::new, |memory| Memory::of(memory.flash, memory.uicr));
        for (address, bytes) in image.segments() {
            if !memory.preload(*address, bytes) {
                return Err(EmulatorError::Image(format!(
                    "{} bytes at {address:#010x}, where the chip has no flash",
                    bytes.len()
                )));
            }
        }
        let mut board = Board {
            name,
            core: fresh_core(),
            chip: Chip::new(Soc::new(identity, memory)),
            noise: ChaCha8Rng::seed_from_u64(identity.random_seed ^ u64::from(RAM_START)),
            initial_ram: Vec::new(),
            now: 0,
            next_due: 0,
            interrupts: 0,
            asleep: false,
            stalled_until: 0,
            off: false,
            requests: VecDeque::new(),
            serial: Vec::new(),
            log: LogReader::new(&image),
            stats: BoardStats::default(),
            watch: Watch::default(),
            debug: None,
            boot: SimTime::ZERO + boot_delay,
            fs_per_1e12_cycles: (FS_PER_CYCLE as f64 * SCALE as f64 / (1.0 + mcu_ppm * 1e-6))
                .round() as u128,
            image,
        };
        board.switch_on();
        Ok(board)
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Cycles since it was switched on.
    pub fn now(&self) -> Cycles {
        self.now
    }

    /// What it has done so far.
    pub fn stats(&self) -> BoardStats {
        BoardStats {
            cycles: self.now,
            replies: self.watch.replies,
            ..self.stats.clone()
        }
    }

    /// What left its serial port since this was asked last: the cycle at which each byte was complete, and the byte.
    pub fn take_serial(&mut self) -> Vec<(Cycles, u8)> {
        std::mem::take(&mut self.serial)
    }

    /// The host says `bytes`, from now on, at the rate the firmware has set.
    pub fn say(&mut self, bytes: &[u8]) {
        let now = self.now;
        self.chip.soc.hear(bytes, now);
        self.look_around();
    }

    /// Whether all that the host has said has arrived at the serial port.
    pub fn has_heard_all(&self) -> bool {
        self.chip.soc.uart.has_heard_all()
    }

    /// The lights D9 to D12 that are lit.
    pub fn lights(&self) -> [bool; 4] {
        let soc = &self.chip.soc;
        wiring::LIGHTS.map(|pin| soc.gpio.is_pulled_low(pin))
    }

    /// Log lines (defmt through RTT) since this was asked last.
    pub fn take_log(&mut self) -> Vec<LogLine> {
        self.log.poll(&mut self.chip.soc.ram);
        self.log.take()
    }

    /// Its flash, to plan power cuts and to look at wear.
    pub fn flash(&self) -> Flash {
        self.chip.soc.memory.flash().clone()
    }

    /// Its flash and UICR: they outlive the emulation.
    pub fn memory(&self) -> ChipMemory {
        self.chip.soc.memory.parts()
    }

    /// Whether its supply broke down in the middle of a write to flash, as was planned.
    pub fn is_off(&self) -> bool {
        self.off
    }

    /// How far its main stack has grown; `None` if the image does not tell where it is.
    pub fn stack_use(&self) -> Option<StackUse> {
        measure(self.image.stack()?, &self.chip.soc.ram, &self.initial_ram)
    }

    /// A word of RAM; `None` elsewhere.
    pub fn ram_word(&self, address: u32) -> Option<u32> {
        let is_ram = (RAM_START..RAM_START + RAM_BYTES).contains(&address);
        self.chip.word(address).filter(|_| is_ram)
    }

    /// The address of the next instruction.
    pub fn program_counter(&self) -> u32 {
        self.core.pc()
    }

    /// Its image.
    pub fn image(&self) -> &Image {
        &self.image
    }

    /// When `cycle` is, in true time.
    pub fn time_of(&self, cycle: Cycles) -> SimTime {
        let fs = u128::from(cycle) * self.fs_per_1e12_cycles / SCALE;
        self.boot + SimDuration::from_fs(u64::try_from(fs).unwrap_or(u64::MAX))
    }

    /// The first cycle that begins at `t` or later.
    pub(crate) fn cycle_at(&self, t: SimTime) -> Cycles {
        let fs = u128::from(t.since(self.boot).as_fs());
        let cycles = (fs * SCALE).div_ceil(self.fs_per_1e12_cycles);
        u64::try_from(cycles).unwrap_or(Cycles::MAX)
    }

    /// The moment before which it will want nothing from its radio, unless the radio interrupts.
    pub(crate) fn earliest_request(&self) -> SimTime {
        if let Some((at, _)) = self.requests.front() {
            return self.time_of(*at);
        }
        if self.off {
            return SimTime::MAX;
        }
        let wakes = if self.asleep { self.wakes_at() } else { 0 };
        self.time_of(wakes.max(self.stalled_until).max(self.now))
    }

    /// The first request that was not answered.
    pub(crate) fn request(&self) -> Option<SimTime> {
        self.requests.front().map(|&(at, _)| self.time_of(at))
    }

    pub(crate) fn take_request(&mut self) -> Option<RadioRequest> {
        self.requests.pop_front().map(|(_, request)| request)
    }

    /// What the radio clocked out.
    pub(crate) fn answer(&mut self, id: u8, miso: Vec<u8>) {
        self.chip.soc.answer_transfer(id, miso);
    }

    /// The level of the radio's interrupt line.
    pub(crate) fn set_radio_interrupt(&mut self, high: bool) {
        let now = self.now;
        if high {
            self.watch.raised(now);
        }
        self.chip.soc.drive_pin(wiring::RADIO_INTERRUPT, high, now);
        self.look_around();
    }

    /// The radio begins to send.
    pub(crate) fn sends(&mut self, at: SimTime) {
        let cycle = self.cycle_at(at);
        self.watch.sends(cycle);
    }
}

/// The NVIC of the nRF52832 has three bits of priority (product specification, chapter 7).
fn fresh_core() -> Core {
    Core::new(3)
}
