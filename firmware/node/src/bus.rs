//! What a board must provide to reach the radio.

use core::convert::Infallible;
use embedded_hal::spi::{ErrorType, Operation, SpiDevice};

/// The SPI connection to a DW1000: mode 0, most significant bit first, chip
/// select low during each transaction.
pub trait RadioBus: SpiDevice<u8> {
    /// Changes the clock for the transactions that follow.
    fn set_speed(&mut self, speed: SpiSpeed);
}

/// How fast the radio can be talked to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum SpiSpeed {
    /// At most 3 MHz: until the radio's clock PLL has locked. Anything faster
    /// then upsets the radio until its next reset (user manual, section 2.3.2).
    Slow,
    /// As fast as the board can, at most 20 MHz.
    Fast,
}

/// A [`RadioBus`] made of any SPI device and a way to change its clock.
#[derive(Debug)]
pub struct SpiBusWithSpeed<S, F> {
    device: S,
    set_speed: F,
}

impl<S: SpiDevice<u8>, F: FnMut(&mut S, SpiSpeed)> SpiBusWithSpeed<S, F> {
    /// A bus of `device`, whose clock `set_speed` changes.
    pub fn new(device: S, set_speed: F) -> Self {
        Self { device, set_speed }
    }
}

impl<S: ErrorType, F> ErrorType for SpiBusWithSpeed<S, F> {
    type Error = S::Error;
}

impl<S: SpiDevice<u8>, F> SpiDevice<u8> for SpiBusWithSpeed<S, F> {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), S::Error> {
        self.device.transaction(operations)
    }
}

impl<S: SpiDevice<u8>, F: FnMut(&mut S, SpiSpeed)> RadioBus for SpiBusWithSpeed<S, F> {
    fn set_speed(&mut self, speed: SpiSpeed) {
        (self.set_speed)(&mut self.device, speed);
    }
}

/// A [`RadioBus`] seen through the traits of embedded-hal 0.2, which
/// `dw1000::ll` is written for.
///
/// That driver makes exactly one transfer or write between driving chip select
/// low and high, so each of them can be one `SpiDevice` transaction and its
/// chip select be a [`NoPin`].
pub(crate) struct Legacy<'a, B>(pub(crate) &'a mut B);

impl<B: SpiDevice<u8>> embedded_hal_02::blocking::spi::Transfer<u8> for Legacy<'_, B> {
    type Error = B::Error;

    fn transfer<'w>(&mut self, words: &'w mut [u8]) -> Result<&'w [u8], B::Error> {
        self.0
            .transaction(&mut [Operation::TransferInPlace(words)])?;
        Ok(words)
    }
}

impl<B: SpiDevice<u8>> embedded_hal_02::blocking::spi::Write<u8> for Legacy<'_, B> {
    type Error = B::Error;

    fn write(&mut self, words: &[u8]) -> Result<(), B::Error> {
        self.0.transaction(&mut [Operation::Write(words)])
    }
}

/// A chip select that the bus drives by itself.
pub(crate) struct NoPin;

impl embedded_hal_02::digital::v2::OutputPin for NoPin {
    type Error = Infallible;

    fn set_low(&mut self) -> Result<(), Infallible> {
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}
