//! The port P0 and GPIOTE (product specification, chapters 20 and 21).
//!
//! A pin's level is what the firmware drives where it is an output, else what the board drives, else its pull. Levels
//! are compared before and after everything that may change them; GPIOTE and the radio's control lines see the edges.

use super::block::{Block, Layout, rw};
use super::{Lines, Outward, Peripheral};
use crate::error::{Access, Refusal};
use crate::wiring;

/// GPIOTE's number.
pub(super) const ID: u8 = 6;

const PINS: u8 = 32;
const CHANNELS: u16 = 8;

const SET: u16 = 0x030;
const CLR: u16 = 0x060;
const IN: u16 = 0x100;
const PORT: u16 = 0x17C;
const CONFIG: u16 = 0x510;

const LAYOUT: Layout = Layout {
    name: "GPIOTE",
    tasks: &[
        0x000, 0x004, 0x008, 0x00C, 0x010, 0x014, 0x018, 0x01C, 0x030, 0x034, 0x038, 0x03C, 0x040,
        0x044, 0x048, 0x04C, 0x060, 0x064, 0x068, 0x06C, 0x070, 0x074, 0x078, 0x07C,
    ],
    events: &[0x100, 0x104, 0x108, 0x10C, 0x110, 0x114, 0x118, 0x11C, PORT],
    shorts: 0,
    interrupts: true,
    registers: &[rw(CONFIG, 0x13_1F03).times(CHANNELS)],
};

/// PIN_CNF after a reset: the input buffer is disconnected.
const PIN_CNF_RESET: u32 = 2;

const EVENT_MODE: u32 = 1;
const TASK_MODE: u32 = 3;

/// P0 and GPIOTE.
pub(crate) struct Gpio {
    block: Block,
    out: u32,
    configuration: [u32; PINS as usize],
    latch: u32,
    detect_mode: u32,
    /// What the board drives.
    driven: u32,
    drives: u32,
    /// What GPIOTE drives in task mode, by channel.
    task_levels: [bool; CHANNELS as usize],
    /// As last seen.
    levels: u32,
    detect: bool,
}

impl Gpio {
    pub(super) fn new() -> Self {
        let mut gpio = Gpio {
            block: Block::new(ID, &LAYOUT),
            out: 0,
            configuration: [PIN_CNF_RESET; PINS as usize],
            latch: 0,
            detect_mode: 0,
            driven: wiring::IDLE_HIGH,
            drives: wiring::DRIVEN,
            task_levels: [false; CHANNELS as usize],
            levels: 0,
            detect: false,
        };
        gpio.levels = gpio.present_levels();
        gpio
    }

    /// After a reset nobody drives the radio's lines; the board goes on driving its own.
    pub(super) fn inherit(&mut self, old: Self, outward: &mut Vec<Outward>) {
        self.driven = old.driven;
        self.drives = old.drives;
        self.levels = old.levels;
        let now = self.present_levels();
        self.tell_radio(now, |what| outward.push(what));
        self.levels = now;
    }

    fn cnf(&self, pin: u8) -> u32 {
        self.configuration
            .get(usize::from(pin))
            .copied()
            .unwrap_or(PIN_CNF_RESET)
    }

    fn channel(&self, channel: u16) -> (u32, u8, u32) {
        let config = self.block.get(CONFIG + 4 * channel);
        (config & 3, (config >> 8 & 0x1F) as u8, config >> 16 & 3)
    }

    /// Pins that channels of GPIOTE have taken over, and which of those are high; the lowest channel counts.
    fn taken_over(&self) -> (u32, u32) {
        let (mut pins, mut high) = (0, 0);
        for (channel, &level) in (0..CHANNELS).zip(&self.task_levels) {
            let (mode, pin, _) = self.channel(channel);
            let bit = 1 << pin;
            if mode == TASK_MODE && pins & bit == 0 {
                pins |= bit;
                high |= u32::from(level) << pin;
            }
        }
        (pins, high)
    }

    fn is_high(&self, pin: u8, (taken_over, high): (u32, u32)) -> bool {
        let (bit, cnf) = (1 << pin, self.cnf(pin));
        if taken_over & bit != 0 {
            return high & bit != 0;
        }
        let output = cnf & 1 == 1;
        // DRIVE's D1 options let a high output float, its D0 options a low one.
        let floats = match cnf >> 8 & 7 {
            6 | 7 => self.out & bit != 0,
            4 | 5 => self.out & bit == 0,
            _ => false,
        };
        if output && !floats {
            self.out & bit != 0
        } else if self.drives & bit != 0 {
            self.driven & bit != 0
        } else {
            cnf >> 2 & 3 == 3
        }
    }

    fn present_levels(&self) -> u32 {
        let taken_over = self.taken_over();
        (0..PINS).fold(0, |levels, pin| {
            levels | u32::from(self.is_high(pin, taken_over)) << pin
        })
    }

    fn sensed(&self, levels: u32) -> u32 {
        (0..PINS).fold(0, |sensed, pin| {
            let high = levels >> pin & 1 == 1;
            let hit = match self.cnf(pin) >> 16 & 3 {
                2 => high,
                3 => !high,
                _ => false,
            };
            sensed | u32::from(hit) << pin
        })
    }

    fn tell_radio(&self, now: u32, mut tell: impl FnMut(Outward)) {
        let changed = now ^ self.levels;
        let low = |pin: u8| now >> pin & 1 == 0;
        if changed >> wiring::RADIO_RESET & 1 == 1 {
            tell(Outward::RadioReset(low(wiring::RADIO_RESET)));
        }
        if changed >> wiring::RADIO_SELECT & 1 == 1 {
            tell(Outward::Select(low(wiring::RADIO_SELECT)));
        }
    }

    /// Compares levels with those before.
    fn update(&mut self, lines: &mut Lines<'_>) {
        let now = self.present_levels();
        self.tell_radio(now, |what| lines.tell(what));
        let changed = now ^ self.levels;
        self.levels = now;
        for channel in 0..CHANNELS {
            let (mode, pin, polarity) = self.channel(channel);
            let edge = changed >> pin & 1 == 1;
            let rising = now >> pin & 1 == 1;
            let wanted = match polarity {
                1 => rising,
                2 => !rising,
                3 => true,
                _ => false,
            };
            if mode == EVENT_MODE && edge && wanted {
                lines.raise(&mut self.block, IN + 4 * channel);
            }
        }
        let sensed = self.sensed(now);
        self.latch |= sensed;
        let detect = if self.detect_mode == 1 {
            self.latch != 0
        } else {
            sensed != 0
        };
        if detect && !self.detect {
            lines.raise(&mut self.block, PORT);
        }
        self.detect = detect;
    }

    /// The board drives a pin.
    pub(super) fn drive(&mut self, pin: u8, high: bool, lines: &mut Lines<'_>) {
        let bit = 1u32.checked_shl(pin.into()).unwrap_or(0);
        self.drives |= bit;
        self.driven = if high {
            self.driven | bit
        } else {
            self.driven & !bit
        };
        self.update(lines);
    }

    /// Whether the firmware holds a pin low as an output: a light that is lit.
    pub(crate) fn is_pulled_low(&self, pin: u8) -> bool {
        self.cnf(pin) & 1 == 1 && !self.is_high(pin, self.taken_over())
    }

    fn directions(&self) -> u32 {
        let outputs = self.configuration.iter().enumerate();
        outputs.fold(0, |all, (pin, cnf)| all | (cnf & 1) << pin)
    }

    fn set_directions(&mut self, outputs: u32) {
        for (pin, cnf) in self.configuration.iter_mut().enumerate() {
            *cnf = *cnf & !1 | outputs >> pin & 1;
        }
    }

    pub(super) fn read_port(&self, offset: u16) -> Result<u32, Refusal> {
        Ok(match offset {
            0x504 | 0x508 | 0x50C => self.out,
            0x510 => {
                let connected = self.configuration.iter().enumerate();
                let connected = connected.fold(0, |all, (pin, cnf)| all | (!cnf >> 1 & 1) << pin);
                self.levels & connected
            }
            0x514 | 0x518 | 0x51C => self.directions(),
            0x520 => self.latch,
            0x524 => self.detect_mode,
            0x700..=0x77C => self.cnf(((offset - 0x700) / 4) as u8),
            _ => return Err(Refusal::Unmodelled(Access::Read)),
        })
    }

    pub(super) fn write_port(
        &mut self,
        offset: u16,
        value: u32,
        lines: &mut Lines<'_>,
    ) -> Result<(), Refusal> {
        match offset {
            0x504 => self.out = value,
            0x508 => self.out |= value,
            0x50C => self.out &= !value,
            0x514 => self.set_directions(value),
            0x518 => self.set_directions(self.directions() | value),
            0x51C => self.set_directions(self.directions() & !value),
            0x520 => self.latch &= !value,
            0x524 => self.detect_mode = value & 1,
            0x700..=0x77C => {
                if let Some(cnf) = self
                    .configuration
                    .get_mut(usize::from((offset - 0x700) / 4))
                {
                    *cnf = value & 0x3_070F;
                }
            }
            _ => return Err(Refusal::Unmodelled(Access::Write(value))),
        }
        self.update(lines);
        Ok(())
    }
}

impl Peripheral for Gpio {
    fn block(&self) -> &Block {
        &self.block
    }

    fn block_mut(&mut self) -> &mut Block {
        &mut self.block
    }

    fn task(&mut self, task: u16, lines: &mut Lines<'_>) -> Result<(), Refusal> {
        let channel = match task {
            0..SET => task / 4,
            SET..CLR => (task - SET) / 4,
            _ => (task - CLR) / 4,
        };
        let (mode, _, polarity) = self.channel(channel);
        if mode == TASK_MODE
            && let Some(level) = self.task_levels.get_mut(usize::from(channel))
        {
            *level = match (task, polarity) {
                (SET..CLR, _) | (0..SET, 1) => true,
                (CLR.., _) | (0..SET, 2) => false,
                (0..SET, 3) => !*level,
                _ => *level,
            };
        }
        self.update(lines);
        Ok(())
    }

    fn written(&mut self, offset: u16, value: u32, lines: &mut Lines<'_>) -> Result<(), Refusal> {
        let channel = usize::from(offset.saturating_sub(CONFIG) / 4);
        if value & 3 == TASK_MODE
            && let Some(level) = self.task_levels.get_mut(channel)
        {
            // OUTINIT.
            *level = value >> 20 & 1 == 1;
        }
        self.update(lines);
        Ok(())
    }
}
