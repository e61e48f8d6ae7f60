//! What is wired to what on the DWM1001 module and the DWM1001-DEV board
//! (DWM1001 datasheet, table 2; DWM1001-DEV schematic). docs/hardware.md draws it.

use embassy_nrf::config::{Config, HfclkSource, LfclkSource};
use embassy_nrf::{Peri, peripherals};

/// The DW1000 on its SPI.
pub(crate) struct RadioPins {
    pub(crate) spi: Peri<'static, peripherals::SPI2>,
    pub(crate) sck: Peri<'static, peripherals::P0_16>,
    pub(crate) mosi: Peri<'static, peripherals::P0_20>,
    pub(crate) miso: Peri<'static, peripherals::P0_18>,
    pub(crate) chip_select: Peri<'static, peripherals::P0_17>,
    /// High while the DW1000 has something to say.
    pub(crate) interrupt: Peri<'static, peripherals::P0_19>,
    /// RSTn: pull low to reset, never drive high (DW1000 data sheet, table 1).
    pub(crate) reset: Peri<'static, peripherals::P0_24>,
}

/// The serial line to the host; on the DEV board the J-Link's virtual COM port.
pub(crate) struct UartPins {
    pub(crate) uart: Peri<'static, peripherals::UARTE0>,
    pub(crate) tx: Peri<'static, peripherals::P0_05>,
    pub(crate) rx: Peri<'static, peripherals::P0_11>,
    /// Tells when the line has gone idle, by these two channels.
    pub(crate) idle_timer: Peri<'static, peripherals::TIMER1>,
    pub(crate) idle_start: Peri<'static, peripherals::PPI_CH0>,
    pub(crate) idle_stop: Peri<'static, peripherals::PPI_CH1>,
}

/// The four lights of the DEV board, lit by a low pin.
pub(crate) struct LedPins {
    /// D9.
    pub(crate) green: Peri<'static, peripherals::P0_30>,
    /// D10.
    pub(crate) blue: Peri<'static, peripherals::P0_31>,
    /// D11.
    pub(crate) red_left: Peri<'static, peripherals::P0_22>,
    /// D12.
    pub(crate) red_right: Peri<'static, peripherals::P0_14>,
}

/// Everything the firmware uses of the board.
pub(crate) struct Board {
    pub(crate) radio: RadioPins,
    pub(crate) uart: UartPins,
    pub(crate) leds: LedPins,
    pub(crate) watchdog: Peri<'static, peripherals::WDT>,
    pub(crate) flash: Peri<'static, peripherals::NVMC>,
}

/// Starts the clocks and hands out the pins. To be called once.
pub(crate) fn take() -> Board {
    let mut config = Config::default();
    // UART at 1 Mbaud and the node's timing want the 32 MHz crystal (±40 ppm), not the RC oscillator (±8 %).
    config.hfclk_source = HfclkSource::ExternalXtal;
    // As exact as the crystal above, which runs anyway, and independent of a 32 kHz one.
    config.lfclk_source = LfclkSource::Synthesized;
    let p = embassy_nrf::init(config);
    Board {
        radio: RadioPins {
            spi: p.SPI2,
            sck: p.P0_16,
            mosi: p.P0_20,
            miso: p.P0_18,
            chip_select: p.P0_17,
            interrupt: p.P0_19,
            reset: p.P0_24,
        },
        uart: UartPins {
            uart: p.UARTE0,
            tx: p.P0_05,
            rx: p.P0_11,
            idle_timer: p.TIMER1,
            idle_start: p.PPI_CH0,
            idle_stop: p.PPI_CH1,
        },
        leds: LedPins {
            green: p.P0_30,
            blue: p.P0_31,
            red_left: p.P0_22,
            red_right: p.P0_14,
        },
        watchdog: p.WDT,
        flash: p.NVMC,
    }
}
