//! One board: the processor, what is around it, and what it has done so far.
//!
//! A board runs until a given cycle, or until it wants something from its radio; then it stands still until
//! [`Emulation`](crate::Emulation) has let the air get to that moment and answered.

use std::collections::{BTreeMap, VecDeque};

use nova_hal_sim::chip::ChipConfig;
use nova_hal_sim::{Flash, SimDuration, SimTime};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rsemu::cpu::arm::v7m::sys::Exception;
use rsemu_executor::Core;

use crate::bus::Chip;
use crate::error::{EmulatorError, Seconds, Trouble};
use crate::image::Image;
use crate::log::{LogLine, LogReader};
use crate::reply::{Replies, Watch};
use crate::soc::{
    CPU_HZ, ChipIdentity, Cycles, Memory, Outward, RAM_BYTES, RAM_START, ResetReason, Soc,
};
use crate::stack::{StackUse, measure};
use crate::wiring;

/// A board to be emulated.
#[derive(Debug)]
pub struct BoardConfig {
    /// Its name; no two may have the same.
    pub name: String,
    /// What is burnt into its processor.
    pub identity: ChipIdentity,
    /// Its DW1000, crystal and place.
    pub chip: ChipConfig,
    /// Frequency error of the processor's crystal, in ppm.
    pub mcu_ppm: f64,
    /// From power-on (time zero) until the processor's first instruction.
    pub boot_delay: SimDuration,
    /// Flash and UICR of a board that has been in use; new ones if absent. The image is written into it.
    pub memory: Option<ChipMemory>,
}

/// Flash and UICR of a board, to give to the same board when it is emulated again.
#[derive(Debug, Clone)]
pub struct ChipMemory {
    pub(crate) flash: Flash,
    pub(crate) uicr: Flash,
}

impl ChipMemory {
    /// Another chip with the same contents and wear.
    pub fn duplicate(&self) -> Self {
        ChipMemory {
            flash: self.flash.duplicate(),
            uicr: self.uicr.duplicate(),
        }
    }
}

impl BoardConfig {
    /// A board with this name and this number burnt in; all else as hal-sim's boards.
    pub fn new(name: impl Into<String>, device_id: [u32; 2]) -> Self {
        let [low, high] = device_id;
        BoardConfig {
            name: name.into(),
            identity: ChipIdentity {
                device_id,
                random_seed: u64::from(high) << 32 | u64::from(low),
            },
            chip: ChipConfig::default(),
            mcu_ppm: 0.0,
            boot_delay: SimDuration::from_ms(5),
            memory: None,
        }
    }
}

/// What a board has done.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct BoardStats {
    /// Instructions, and entries into exceptions.
    pub instructions: u64,
    /// Cycles in which the processor did not sleep; those in which it stood still for the flash included.
    pub busy_cycles: Cycles,
    /// Cycles altogether.
    pub cycles: Cycles,
    /// Interrupts that were served, by number.
    pub interrupts: BTreeMap<u16, u64>,
    /// Resets, by reason, the first start included.
    pub resets: Vec<(Cycles, ResetReason)>,
    /// SPI transfers to the radio.
    pub transfers: u64,
    /// Bytes of those.
    pub spi_bytes: u64,
    /// Cycles that the SPI was busy with them.
    pub spi_cycles: Cycles,
    /// Where the time of answers went.
    pub replies: Replies,
}

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

    fn wakes_at(&self) -> Cycles {
        let sys = self.core.sys();
        let runs = sys.syst_csr & 0b11 == 0b11 && sys.syst_rvr != 0;
        let left = match sys.syst_cvr {
            0 => sys.syst_rvr + 1,
            left => left,
        };
        let tick = if runs {
            self.now + u64::from(left)
        } else {
            Cycles::MAX
        };
        self.next_due.min(tick)
    }

    /// Runs until `limit`, or until the radio is wanted, or the supply breaks down.
    ///
    /// # Errors
    /// [`EmulatorError::Stopped`].
    pub(crate) fn run_until(&mut self, limit: Cycles) -> Result<(), EmulatorError> {
        while self.now < limit && self.requests.is_empty() && !self.off {
            if self.next_due <= self.now {
                self.chip.soc.advance(self.now);
                self.look_around();
                self.check_trouble()?;
                continue;
            }
            if self.now < self.stalled_until {
                let to = limit.min(self.stalled_until).min(self.next_due);
                self.stats.busy_cycles += to - self.now;
                self.now = to;
                continue;
            }
            if self.asleep {
                let to = limit.min(self.wakes_at());
                if to > self.now {
                    self.pass_asleep(to - self.now);
                    continue;
                }
            }
            self.step()?;
        }
        self.log.poll_now_and_then(&mut self.chip.soc.ram, self.now);
        Ok(())
    }

    fn pass_asleep(&mut self, cycles: Cycles) {
        self.now += cycles;
        let sys = self.core.sys_mut();
        if sys.tick_systick(cycles) && sys.syst_csr & 0b10 != 0 {
            sys.set_pending(Exception::SYSTICK, true);
        }
        self.asleep = self.core.is_asleep() && !self.core.anything_pending();
    }

    fn step(&mut self) -> Result<(), EmulatorError> {
        self.chip.begin(self.now);
        let cycles = self.core.step(&mut self.chip);
        self.now += cycles;
        self.stats.instructions += 1;
        self.stats.busy_cycles += cycles;
        if self.chip.take_touched() {
            self.look_around();
            self.check_trouble()?;
        }
        if self.watch.waits() {
            self.watch.executes(self.now);
        }
        if cycles >= EXCEPTION_ENTRY {
            self.count_interrupt();
        }
        self.asleep = self.core.is_asleep();
        if self.asleep {
            self.watch.sleeps();
        }
        if self.core.reset_requested() {
            self.reset(ResetReason::Software);
        } else if self.core.is_locked_up() {
            self.reset(ResetReason::Lockup);
        }
        Ok(())
    }

    /// If an exception has just been entered, counts it.
    fn count_interrupt(&mut self) {
        let exception = self.core.current_exception();
        let just_entered = exception != Exception::THREAD && self.core.reg(14) >= 0xFFFF_FFE0;
        if just_entered && exception.0 >= 16 {
            let vector = self.core.sys().vtor + 4 * u32::from(exception.0);
            if self.chip.word(vector).map(|handler| handler & !1) == Some(self.core.pc()) {
                *self.stats.interrupts.entry(exception.0 - 16).or_default() += 1;
            }
        }
    }

    /// Takes notice of what the chip wants after something has happened.
    fn look_around(&mut self) {
        let soc = &mut self.chip.soc;
        let outward = std::mem::take(&mut soc.outward);
        let levels = soc.interrupts;
        self.next_due = soc.next_due();
        if soc.memory.take_changed() {
            self.core.forget_code();
        }
        if levels != self.interrupts {
            self.interrupts = levels;
            self.core.set_levels(levels);
            // The next step finds out whether this wakes the processor.
            self.asleep = false;
        }
        let mut reset = None;
        for what in outward {
            match what {
                Outward::Select(low) => self.ask(RadioRequest::Select(low)),
                Outward::RadioReset(low) => self.ask(RadioRequest::Reset(low)),
                Outward::Transfer {
                    id,
                    mosi,
                    bits_per_s,
                } => {
                    self.stats.transfers += 1;
                    self.stats.spi_bytes += mosi.len() as u64;
                    let takes = 8 * mosi.len() as u64 * CPU_HZ / u64::from(bits_per_s.max(1));
                    self.stats.spi_cycles += takes;
                    self.watch.transfers(&mosi, self.now, takes);
                    self.ask(RadioRequest::Transfer {
                        id,
                        mosi,
                        bits_per_s,
                    });
                }
                Outward::Byte(byte) => self.serial.push((self.now, byte)),
                Outward::Stall(cycles) => self.stalled_until = self.now + cycles,
                Outward::WatchdogReset => reset = Some(ResetReason::Watchdog),
                Outward::PowerLost | Outward::SystemOff => self.off = true,
            }
        }
        if let Some(reason) = reset {
            self.reset(reason);
        }
    }

    fn ask(&mut self, request: RadioRequest) {
        self.requests.push_back((self.now, request));
    }

    fn check_trouble(&mut self) -> Result<(), EmulatorError> {
        let Some(mut trouble) = self.chip.soc.trouble.take() else {
            return Ok(());
        };
        trouble.pc = self.faulting_instruction();
        Err(self.stopped(trouble))
    }

    fn stopped(&self, trouble: Trouble) -> EmulatorError {
        EmulatorError::Stopped {
            board: self.name.clone(),
            seconds: Seconds(self.now as f64 / CPU_HZ as f64),
            trouble,
        }
    }

    /// A refused access is a bus fault; its return address lies on the stack (ARMv7-M, B1.5.6).
    fn faulting_instruction(&self) -> u32 {
        const RETURN_ADDRESS: u32 = 24;
        const FROM_PROCESS_STACK: u32 = 1 << 2;
        if self.core.current_exception() == Exception::THREAD {
            return 0;
        }
        let process = self.core.reg(14) & FROM_PROCESS_STACK != 0;
        let frame = if process {
            self.core.psp()
        } else {
            self.core.msp()
        };
        self.chip
            .word(frame.wrapping_add(RETURN_ADDRESS))
            .unwrap_or(0)
    }

    /// Starts anew; RAM keeps its contents.
    fn reset(&mut self, reason: ResetReason) {
        self.stats.resets.push((self.now, reason));
        self.log.poll(&mut self.chip.soc.ram);
        self.chip.soc.reset(reason);
        // A fresh core: a reset of this one would leave the NVIC's enables and priorities as they were.
        self.core = fresh_core();
        self.interrupts = 0;
        self.asleep = false;
        self.stalled_until = self.now;
        self.look_around();
    }

    /// The supply comes: RAM holds noise, flash what was written.
    pub(crate) fn switch_on(&mut self) {
        self.noise.fill(&mut self.chip.soc.ram[..]);
        self.initial_ram.clone_from(&self.chip.soc.ram);
        self.off = false;
        self.chip.soc.memory.restore_power();
        self.reset(ResetReason::PowerOn);
    }
}

/// What the core charges for entering an exception.
const EXCEPTION_ENTRY: u64 = 12;

/// The NVIC of the nRF52832 has three bits of priority (product specification, chapter 7).
fn fresh_core() -> Core {
    Core::new(3)
}
