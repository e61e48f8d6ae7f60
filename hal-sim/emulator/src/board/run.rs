//! A board's time: instructions, sleep, what the chip tells the board around it, resets.

use rand::RngExt as _;
use rsemu::cpu::arm::v7m::sys::Exception;

use super::{Board, RadioRequest, fresh_core};
use crate::error::{EmulatorError, Seconds, Trouble};
use crate::soc::{CPU_HZ, Cycles, Outward, ResetReason};

/// What the core charges for entering an exception.
const EXCEPTION_ENTRY: u64 = 12;

impl Board {
    pub(super) fn wakes_at(&self) -> Cycles {
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
            if self.halted().is_some() {
                break;
            }
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
            if let Some(debug) = &mut self.debug
                && debug.stops_at(self.core.pc())
            {
                break;
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
    pub(super) fn look_around(&mut self) {
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
