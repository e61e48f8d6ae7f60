//! The DW1000's connections: its bus at two speeds, its interrupt and its reset line.

use core::convert::Infallible;

use embassy_embedded_hal::SetConfig;
use embassy_nrf::gpio::{Input, Level, Output, OutputDrive, Pull};
use embassy_nrf::interrupt::{self, InterruptExt};
use embassy_nrf::spim::{self, Frequency, Spim};
use embassy_nrf::{bind_interrupts, peripherals};
use embassy_time::Delay;
use embedded_hal_bus::spi::ExclusiveDevice;
use nova_node::{SpiBusWithSpeed, SpiSpeed};

use crate::pins::RadioPins;

bind_interrupts!(struct Irqs {
    SPI2 => spim::InterruptHandler<peripherals::SPI2>;
});

/// The DW1000 on SPIM2, chip select included.
type Device = ExclusiveDevice<Spim<'static>, Output<'static>, Delay>;

/// The same at two speeds. Transfers block: they last microseconds, less than a task switch and back.
///
/// nRF52832 anomaly 58 clocks an extra byte out when one byte is sent and received at once. The node
/// never does: each of its transactions has a header in front of some data.
pub(crate) type RadioSpi = SpiBusWithSpeed<Device, fn(&mut Device, SpiSpeed)>;

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

fn set_speed(device: &mut Device, speed: SpiSpeed) {
    // Cannot fail: its error type only satisfies the trait.
    let _ = device.bus_mut().set_config(&config(speed));
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
            config(SpiSpeed::Slow),
        );
        // Transfers block and watch the peripheral themselves; its interrupts, two a transfer, only cost time.
        interrupt::SPI2.disable();
        let chip_select = Output::new(pins.chip_select, Level::High, OutputDrive::Standard);
        let device: Result<_, Infallible> = ExclusiveDevice::new(spi, chip_select, Delay);
        let Ok(device) = device;
        Self {
            bus: SpiBusWithSpeed::new(device, set_speed),
            reset: Output::new(pins.reset, Level::High, OutputDrive::Standard0Disconnect1),
            // The DW1000 drives the line both ways; the pull keeps it quiet while the chip is in reset.
            interrupt: Input::new(pins.interrupt, Pull::Down),
        }
    }
}
