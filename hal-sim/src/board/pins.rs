//! The DW1000's interrupt and reset pins.

use std::convert::Infallible;

use super::core::Port;

/// The IRQ pin. `InputPin` of embedded-hal 0.2 and 1.0; every look at it takes a little time.
#[derive(Clone)]
pub struct Irq(pub(super) Port);

impl Irq {
    fn high(&self) -> bool {
        self.0.call();
        self.0.irq()
    }
}

impl embedded_hal_02::digital::v2::InputPin for Irq {
    type Error = Infallible;

    fn is_high(&self) -> Result<bool, Infallible> {
        Ok(self.high())
    }

    fn is_low(&self) -> Result<bool, Infallible> {
        Ok(!self.high())
    }
}

impl embedded_hal::digital::ErrorType for Irq {
    type Error = Infallible;
}

impl embedded_hal::digital::InputPin for Irq {
    fn is_high(&mut self) -> Result<bool, Infallible> {
        Ok(self.high())
    }

    fn is_low(&mut self) -> Result<bool, Infallible> {
        Ok(!self.high())
    }
}

/// The RST pin, open drain: low holds the chip in reset, high lets it go. `OutputPin` of embedded-hal 0.2 and 1.0.
#[derive(Clone)]
pub struct Reset(pub(super) Port);

impl embedded_hal_02::digital::v2::OutputPin for Reset {
    type Error = Infallible;

    fn set_low(&mut self) -> Result<(), Infallible> {
        self.0.set_reset(true);
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.0.set_reset(false);
        Ok(())
    }
}

impl embedded_hal::digital::ErrorType for Reset {
    type Error = Infallible;
}

impl embedded_hal::digital::OutputPin for Reset {
    fn set_low(&mut self) -> Result<(), Infallible> {
        self.0.set_reset(true);
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.0.set_reset(false);
        Ok(())
    }
}
