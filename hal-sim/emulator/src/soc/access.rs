//! Reads and writes of the processor, and what comes from outside the chip.

use super::block::{self, Effect};
use super::lines::Peripheral as _;
use super::{Cycles, Soc, gpio, memory, plain, uart};
use crate::error::{Access, Refusal};

impl Soc {
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
pub(super) fn place(address: u32) -> (u8, u16) {
    (((address >> 12) & 0xFF) as u8, (address & 0xFFF) as u16)
}
