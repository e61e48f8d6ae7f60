//! What all peripherals of an nRF52 have in common: tasks, events, shortcuts and interrupt enables at fixed offsets
//! (product specification, chapter 15, "Peripheral interface").
//!
//! ```text
//! 0x000 tasks   0x100 events   0x200 SHORTS   0x300 INTEN, INTENSET, INTENCLR   0x400.. the peripheral's own
//! ```
//! Event `0x100 + 4 n` belongs to bit `n` of INTEN. What is not listed in a peripheral's [`Layout`] does not exist.

use crate::error::{Access, Refusal};

/// Events begin here.
pub(crate) const EVENTS: u16 = 0x100;
/// What is particular to a peripheral begins here; some have EVTEN in front of it.
pub(crate) const OWN_REGISTERS: u16 = 0x340;
const SHORTS: u16 = 0x200;
const INTEN: u16 = 0x300;
const INTENSET: u16 = 0x304;
const INTENCLR: u16 = 0x308;

/// A peripheral's registers.
#[derive(Debug)]
pub(crate) struct Layout {
    pub(crate) name: &'static str,
    /// Offsets of tasks.
    pub(crate) tasks: &'static [u16],
    /// Offsets of events.
    pub(crate) events: &'static [u16],
    /// Bits that SHORTS has.
    pub(crate) shorts: u32,
    /// Whether it can interrupt.
    pub(crate) interrupts: bool,
    pub(crate) registers: &'static [Register],
}

/// One of a peripheral's own registers, or several of one kind.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Register {
    first: u16,
    count: u16,
    stride: u16,
    reset: u32,
    /// Bits that can be written.
    mask: u32,
    readable: bool,
}

/// A register to read and write; other bits than those in `mask` stay 0.
pub(crate) const fn rw(offset: u16, mask: u32) -> Register {
    Register {
        first: offset,
        count: 1,
        stride: 4,
        reset: 0,
        mask,
        readable: true,
    }
}

/// A register to read.
pub(crate) const fn ro(offset: u16, reset: u32) -> Register {
    rw(offset, 0).reset(reset)
}

/// A register to write.
pub(crate) const fn wo(offset: u16, mask: u32) -> Register {
    let mut register = rw(offset, mask);
    register.readable = false;
    register
}

impl Register {
    /// With a value after a reset.
    pub(crate) const fn reset(mut self, value: u32) -> Self {
        self.reset = value;
        self
    }

    /// So many of them, one behind the other.
    pub(crate) const fn times(mut self, count: u16) -> Self {
        self.count = count;
        self
    }

    /// So many bytes from one to the next.
    pub(crate) const fn every(mut self, stride: u16) -> Self {
        self.stride = stride;
        self
    }

    fn index(&self, offset: u16) -> Option<usize> {
        let from_first = offset.checked_sub(self.first)?;
        let index = from_first / self.stride;
        (from_first.is_multiple_of(self.stride) && index < self.count).then_some(index.into())
    }
}

/// What a write did beyond changing the register.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Effect {
    /// Nothing.
    Done,
    /// A task was triggered.
    Task(u16),
    /// One of the peripheral's own registers has this value now.
    Written(u16, u32),
}

/// The registers of one peripheral.
#[derive(Debug)]
pub(crate) struct Block {
    /// Also its interrupt's number.
    pub(crate) id: u8,
    pub(crate) layout: &'static Layout,
    events: u32,
    inten: u32,
    pub(crate) shorts: u32,
    /// One vector a [`Register`].
    values: Vec<Vec<u32>>,
}

impl Block {
    pub(crate) fn new(id: u8, layout: &'static Layout) -> Self {
        let values = layout.registers.iter();
        Block {
            id,
            layout,
            events: 0,
            inten: 0,
            shorts: 0,
            values: values.map(|r| vec![r.reset; r.count.into()]).collect(),
        }
    }

    fn place(&self, offset: u16) -> Option<(&Register, usize, usize)> {
        let mut registers = self.layout.registers.iter().enumerate();
        registers.find_map(|(row, register)| Some((register, row, register.index(offset)?)))
    }

    /// The value of one of the peripheral's own registers; 0 where there is none.
    pub(crate) fn get(&self, offset: u16) -> u32 {
        let place = self.place(offset);
        place
            .and_then(|(_, row, index)| self.values.get(row)?.get(index).copied())
            .unwrap_or(0)
    }

    /// Changes a register from the inside.
    pub(crate) fn set(&mut self, offset: u16, value: u32) {
        if let Some((row, index)) = self.place(offset).map(|(_, row, index)| (row, index))
            && let Some(place) = self.values.get_mut(row).and_then(|row| row.get_mut(index))
        {
            *place = value;
        }
    }

    /// Reads as the processor does.
    pub(crate) fn read(&self, offset: u16) -> Result<u32, Refusal> {
        if self.layout.tasks.contains(&offset) {
            return Ok(0);
        }
        if self.layout.events.contains(&offset) {
            return Ok(self.event(offset).into());
        }
        match offset {
            SHORTS if self.layout.shorts != 0 => return Ok(self.shorts),
            INTEN | INTENSET | INTENCLR if self.layout.interrupts => return Ok(self.inten),
            _ => {}
        }
        match self.place(offset) {
            Some((register, ..)) if register.readable => Ok(self.get(offset)),
            _ => Err(Refusal::Unmodelled(Access::Read)),
        }
    }

    /// Writes as the processor does.
    pub(crate) fn write(&mut self, offset: u16, value: u32) -> Result<Effect, Refusal> {
        if self.layout.tasks.contains(&offset) {
            return Ok(if value & 1 == 1 {
                Effect::Task(offset)
            } else {
                Effect::Done
            });
        }
        if self.layout.events.contains(&offset) {
            // Writing 1 would generate the event; nobody does, and what it triggers is not specified for all.
            if value != 0 {
                return Err(Refusal::misuse(format!(
                    "write of {value:#x} to an event: only 0 clears it"
                )));
            }
            self.events &= !bit(offset);
            return Ok(Effect::Done);
        }
        match offset {
            SHORTS if self.layout.shorts != 0 => {
                if value & !self.layout.shorts != 0 {
                    return Err(Refusal::Unmodelled(Access::Write(value)));
                }
                self.shorts = value;
                return Ok(Effect::Done);
            }
            INTEN if self.layout.interrupts => {
                self.inten = value;
                return Ok(Effect::Done);
            }
            INTENSET if self.layout.interrupts => {
                self.inten |= value;
                return Ok(Effect::Done);
            }
            INTENCLR if self.layout.interrupts => {
                self.inten &= !value;
                return Ok(Effect::Done);
            }
            _ => {}
        }
        match self.place(offset).map(|(register, ..)| register.mask) {
            Some(mask) if mask != 0 => {
                let value = value & mask;
                self.set(offset, value);
                Ok(Effect::Written(offset, value))
            }
            _ => Err(Refusal::Unmodelled(Access::Write(value))),
        }
    }

    /// Whether an event has happened and not been cleared.
    pub(crate) fn event(&self, offset: u16) -> bool {
        self.events & bit(offset) != 0
    }

    /// Marks an event as happened. `Lines::raise` also tells PPI.
    pub(crate) fn mark(&mut self, offset: u16) {
        self.events |= bit(offset);
    }

    /// Whether the interrupt of this event is enabled.
    pub(crate) fn is_enabled(&self, offset: u16) -> bool {
        self.inten & bit(offset) != 0
    }

    /// The level of the interrupt line.
    pub(crate) fn interrupt(&self) -> bool {
        self.events & self.inten != 0
    }
}

/// The bit of INTEN that belongs to an event.
fn bit(event: u16) -> u32 {
    1u32.checked_shl(u32::from(event.wrapping_sub(EVENTS) / 4))
        .unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SAMPLE: Layout = Layout {
        name: "SAMPLE",
        tasks: &[0x000, 0x004],
        events: &[0x100, 0x17C],
        shorts: 0b11,
        interrupts: true,
        registers: &[
            rw(0x500, 0xFF).reset(7),
            ro(0x504, 9),
            wo(0x508, !0),
            rw(0x510, !0).times(3).every(8),
        ],
    };

    #[test]
    fn what_the_layout_does_not_list_is_refused_and_never_read_as_zero() {
        let mut block = Block::new(1, &SAMPLE);
        let known = [
            0x000, 0x004, 0x100, 0x17C, 0x200, 0x300, 0x304, 0x308, 0x500, 0x504, 0x510, 0x518,
            0x520,
        ];
        for offset in (0..0x1000).step_by(4) {
            assert_eq!(
                block.read(offset).is_ok(),
                known.contains(&offset),
                "{offset:#x}"
            );
        }
        assert!(block.write(0x504, 1).is_err(), "read-only");
        assert!(block.read(0x508).is_err(), "write-only");
        assert!(
            block.write(0x200, 0b100).is_err(),
            "a shortcut that is not modelled"
        );
    }

    #[test]
    fn an_event_interrupts_while_it_stands_and_is_enabled() {
        let mut block = Block::new(1, &SAMPLE);
        block.mark(0x17C);
        assert!(!block.interrupt());
        block.write(INTENSET, 1 << 31).unwrap();
        assert!(block.interrupt());
        assert_eq!(block.read(0x17C), Ok(1));
        block.write(0x17C, 0).unwrap();
        assert!(!block.interrupt());
        block.mark(0x17C);
        block.write(INTENCLR, 1 << 31).unwrap();
        assert!(!block.interrupt());
    }

    #[test]
    fn registers_keep_only_the_bits_they_have_and_a_task_needs_a_one() {
        let mut block = Block::new(1, &SAMPLE);
        assert_eq!(block.read(0x500), Ok(7));
        assert_eq!(block.write(0x500, 0x1FF), Ok(Effect::Written(0x500, 0xFF)));
        assert_eq!(block.write(0x518, 5), Ok(Effect::Written(0x518, 5)));
        assert_eq!([block.get(0x510), block.get(0x518)], [0, 5]);
        assert_eq!(block.write(0x004, 0), Ok(Effect::Done));
        assert_eq!(block.write(0x004, 1), Ok(Effect::Task(0x004)));
    }
}
