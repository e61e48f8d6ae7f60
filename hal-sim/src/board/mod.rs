//! A board as its firmware sees it: HAL handles whose every call is a scheduling point.
//!
//! Handles work in the code of the board they belong to; anywhere else they do nothing. CPU work costs no time unless
//! the code says so with [`BoardHal::charge_cpu_ns`]; SPI transactions, pin accesses and looks at the clock do.

mod config;
mod core;
mod delay;
mod flash;
mod mishaps;
mod pins;
mod spi;
mod uart;

pub use config::{BoardConfig, SpiTiming, UartConfig};
pub use delay::Delay;
pub use flash::BoardFlash;
pub use mishaps::{MishapStats, Mishaps};
pub use pins::{Irq, Reset};
pub use spi::{ChipSelect, Spi, SpiDev};
pub use uart::{UartChunk, UartRx, UartTx};

pub(crate) use self::core::{BoardState, Core, Port};

use crate::time::SimDuration;

/// Everything that a board's firmware gets. Clones stand for the same board.
#[derive(Clone)]
pub struct BoardHal {
    port: Port,
}

impl BoardHal {
    pub(crate) fn new(port: Port) -> Self {
        BoardHal { port }
    }

    /// The SPI bus to the DW1000, to be used with [`BoardHal::cs`].
    pub fn spi(&self) -> Spi {
        Spi(self.port.clone())
    }

    /// The DW1000's chip select.
    pub fn cs(&self) -> ChipSelect {
        ChipSelect(self.port.clone())
    }

    /// Bus and chip select as one.
    pub fn spi_device(&self) -> SpiDev {
        SpiDev(self.spi())
    }

    /// The DW1000's interrupt pin.
    pub fn irq(&self) -> Irq {
        Irq(self.port.clone())
    }

    /// The DW1000's reset pin.
    pub fn rst(&self) -> Reset {
        Reset(self.port.clone())
    }

    /// Blocking delays.
    pub fn delay(&self) -> Delay {
        Delay(self.port.clone())
    }

    /// Bytes to the host.
    pub fn uart(&self) -> UartTx {
        UartTx(self.port.clone())
    }

    /// Bytes from the host.
    pub fn uart_rx(&self) -> UartRx {
        UartRx(self.port.clone())
    }

    /// The flash that the firmware may write to, from address 0 on.
    pub fn flash(&self) -> BoardFlash {
        BoardFlash::new(self.port.clone())
    }

    /// Microseconds since boot by the processor's clock.
    pub fn now_us(&self) -> u64 {
        self.port.now_us()
    }

    /// Waits until the IRQ pin is high or the processor's clock shows `deadline_us`; whether the pin is high.
    pub fn wait_irq_until(&self, deadline_us: u64) -> bool {
        self.port.wait_irq_until_us(deadline_us)
    }

    /// Waits until the IRQ pin is high, the line from the host goes idle after bytes, or the processor's clock shows
    /// `deadline_us`; whether the pin is high.
    pub fn wait_event_until(&self, deadline_us: u64) -> bool {
        self.port.wait_event_until_us(deadline_us)
    }

    /// Sleeps until the processor's clock shows `us`.
    pub fn sleep_until(&self, us: u64) {
        self.port.sleep_until_us(us);
    }

    /// Says that the code has kept the processor busy for `ns`. The time passes with the next HAL call.
    pub fn charge_cpu_ns(&self, ns: u64) {
        self.port.charge(SimDuration::from_ns(ns));
    }
}
