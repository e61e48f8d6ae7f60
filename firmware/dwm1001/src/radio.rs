//! The DW1000's connections: its bus at two speeds, its interrupt and its reset line.

use core::convert::Infallible;

use embassy_embedded_hal::SetConfig;
use embassy_nrf::gpio::{Input, Level, Output, OutputDrive, Pull};
use embassy_nrf::interrupt::{self, InterruptExt};
use embassy_nrf::spim::{self, Frequency, Spim};
use embassy_nrf::{bind_interrupts, peripherals};
use embassy_time::Delay;
use embedded_hal::spi::{ErrorType, Operation, SpiDevice};
use embedded_hal_bus::spi::ExclusiveDevice;
use nova_node::{RadioBus, SpiSpeed};

use crate::pins::RadioPins;

bind_interrupts!(struct Irqs {
    SPI2 => spim::InterruptHandler<peripherals::SPI2>;
});

/// The DW1000 on SPIM2, chip select included. Transfers block: they last microseconds, less than
/// a task switch and back.
pub(crate) struct RadioSpi {
    device: ExclusiveDevice<Spim<'static>, Output<'static>, Delay>,
}

impl RadioSpi {
    fn config(speed: SpiSpeed) -> spim::Config {
        let mut config = spim::Config::default();
        config.frequency = match speed {
            // Below the 3 MHz that the DW1000 takes before its PLL is locked (user manual, 2.3.2).
            SpiSpeed::Slow => Frequency::M2,
            // The most the nRF52832 can; the DW1000 would take 20 MHz.
            SpiSpeed::Fast => Frequency::M8,
        };
        config
    }
}

impl ErrorType for RadioSpi {
    type Error = <ExclusiveDevice<Spim<'static>, Output<'static>, Delay> as ErrorType>::Error;
}

impl SpiDevice for RadioSpi {
    /// nRF52832 anomaly 58 clocks an extra byte out when one byte is sent and received at once.
    /// The node never does: each of its transactions has a header in front of some data.
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), Self::Error> {
        self.device.transaction(operations)
    }
}

impl RadioBus for RadioSpi {
    fn set_speed(&mut self, speed: SpiSpeed) {
        // Cannot fail: its error type only satisfies the trait.
        let _ = self.device.bus_mut().set_config(&Self::config(speed));
    }
}

/// All that the node needs of the radio, and the line that wakes it.
pub(crate) struct Radio {
    /// Slow until told otherwise.
    pub(crate) bus: RadioSpi,
    /// Open drain: high means released.
    pub(crate) reset: Output<'static>,
    /// High while the DW1000 has an event that nobody has read.
    pub(crate) interrupt: Input<'static>,
}

impl Radio {
    pub(crate) fn new(pins: RadioPins) -> Self {
        let spi = Spim::new(
            pins.spi,
            Irqs,
            pins.sck,
            pins.miso,
            pins.mosi,
            RadioSpi::config(SpiSpeed::Slow),
        );
        // Transfers block and watch the peripheral themselves; its interrupts, two a transfer, only cost time.
        interrupt::SPI2.disable();
        let chip_select = Output::new(pins.chip_select, Level::High, OutputDrive::Standard);
        let device: Result<_, Infallible> = ExclusiveDevice::new(spi, chip_select, Delay);
        let Ok(device) = device;
        Self {
            bus: RadioSpi { device },
            reset: Output::new(pins.reset, Level::High, OutputDrive::Standard0Disconnect1),
            // The DW1000 drives the line both ways; the pull keeps it quiet while the chip is in reset.
            interrupt: Input::new(pins.interrupt, Pull::Down),
        }
    }
}
