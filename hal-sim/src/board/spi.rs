//! The SPI bus to the DW1000, its chip select, and both as one device.

use std::convert::Infallible;

use embedded_hal::spi::{ErrorType, Operation, SpiBus, SpiDevice};
use embedded_hal_02::blocking::spi::{Transfer, Write};

use super::core::Port;
use crate::time::SimDuration;

/// The bus: full-duplex transfers while chip select is low. embedded-hal 0.2 `Transfer` and `Write`, 1.0 [`SpiBus`].
#[derive(Clone)]
pub struct Spi(pub(super) Port);

impl Spi {
    /// Sets the clock in Hz for this and all other SPI handles of the board.
    pub fn set_frequency(&mut self, hz: u32) {
        self.0.set_spi_hz(hz);
    }

    fn exchange(&mut self, mosi: &[u8], miso: &mut [u8]) {
        self.0.transfer(mosi, miso);
    }

    fn exchange_in_place(&mut self, words: &mut [u8]) {
        let mosi = words.to_vec();
        self.exchange(&mosi, words);
    }

    fn send(&mut self, mosi: &[u8]) {
        self.exchange(mosi, &mut vec![0; mosi.len()]);
    }

    fn receive(&mut self, words: &mut [u8]) {
        self.exchange(&vec![0; words.len()], words);
    }

    /// embedded-hal 1.0: the longer side decides how many bytes are clocked.
    fn exchange_uneven(&mut self, read: &mut [u8], write: &[u8]) {
        let len = read.len().max(write.len());
        let mut mosi = write.to_vec();
        mosi.resize(len, 0);
        let mut miso = vec![0; len];
        self.exchange(&mosi, &mut miso);
        read.iter_mut().zip(miso).for_each(|(r, m)| *r = m);
    }
}

impl Transfer<u8> for Spi {
    type Error = Infallible;

    fn transfer<'w>(&mut self, words: &'w mut [u8]) -> Result<&'w [u8], Infallible> {
        self.exchange_in_place(words);
        Ok(words)
    }
}

impl Write<u8> for Spi {
    type Error = Infallible;

    fn write(&mut self, words: &[u8]) -> Result<(), Infallible> {
        self.send(words);
        Ok(())
    }
}

impl ErrorType for Spi {
    type Error = Infallible;
}

impl SpiBus for Spi {
    fn read(&mut self, words: &mut [u8]) -> Result<(), Infallible> {
        self.receive(words);
        Ok(())
    }

    fn write(&mut self, words: &[u8]) -> Result<(), Infallible> {
        self.send(words);
        Ok(())
    }

    fn transfer(&mut self, read: &mut [u8], write: &[u8]) -> Result<(), Infallible> {
        self.exchange_uneven(read, write);
        Ok(())
    }

    fn transfer_in_place(&mut self, words: &mut [u8]) -> Result<(), Infallible> {
        self.exchange_in_place(words);
        Ok(())
    }

    fn flush(&mut self) -> Result<(), Infallible> {
        self.0.pass(SimDuration::ZERO);
        Ok(())
    }
}

/// Chip select: low begins a transaction, high ends it. `OutputPin` of embedded-hal 0.2 and 1.0.
#[derive(Clone)]
pub struct ChipSelect(pub(super) Port);

impl embedded_hal_02::digital::v2::OutputPin for ChipSelect {
    type Error = Infallible;

    fn set_low(&mut self) -> Result<(), Infallible> {
        self.0.select();
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.0.deselect();
        Ok(())
    }
}

impl embedded_hal::digital::ErrorType for ChipSelect {
    type Error = Infallible;
}

impl embedded_hal::digital::OutputPin for ChipSelect {
    fn set_low(&mut self) -> Result<(), Infallible> {
        self.0.select();
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.0.deselect();
        Ok(())
    }
}

/// Bus and chip select together, embedded-hal 1.0 [`SpiDevice`].
#[derive(Clone)]
pub struct SpiDev(pub(super) Spi);

impl SpiDev {
    /// Sets the clock in Hz for this and all other SPI handles of the board.
    pub fn set_frequency(&mut self, hz: u32) {
        self.0.set_frequency(hz);
    }
}

impl ErrorType for SpiDev {
    type Error = Infallible;
}

impl SpiDevice for SpiDev {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), Infallible> {
        self.0.0.select();
        for operation in operations {
            match operation {
                Operation::Read(words) => self.0.receive(words),
                Operation::Write(words) => self.0.send(words),
                Operation::Transfer(read, write) => self.0.exchange_uneven(read, write),
                Operation::TransferInPlace(words) => self.0.exchange_in_place(words),
                Operation::DelayNs(ns) => self.0.0.charge(SimDuration::from_ns(u64::from(*ns))),
            }
        }
        self.0.0.deselect();
        Ok(())
    }
}
