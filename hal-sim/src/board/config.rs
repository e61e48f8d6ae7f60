//! What can be set about a simulated board.

use super::mishaps::Mishaps;
use crate::air::Motion;
use crate::chip::{ChipConfig, ChipTiming, OtpConfig, Quirks, SupplyCurrents};
use crate::clock::ClockConfig;
use crate::flash::Flash;
use crate::time::SimDuration;

/// A board: a DW1000, a processor with its own crystal, an SPI bus and a UART.
#[derive(Debug)]
pub struct BoardConfig {
    /// For messages and statistics.
    pub name: String,
    /// The DW1000's crystal.
    pub clock: ClockConfig,
    /// Where the board is.
    pub motion: Motion,
    /// True delay from the internal transmit time stamp to the antenna, in ticks.
    pub tx_antenna_delay_ticks: f64,
    /// True delay from the antenna to the internal receive time stamp, in ticks.
    pub rx_antenna_delay_ticks: f64,
    /// Standard deviation of each receive time stamp in picoseconds.
    pub rx_noise_ps: f64,
    /// The DW1000's one-time programmable memory.
    pub otp: OtpConfig,
    /// Durations inside the DW1000.
    pub chip_timing: ChipTiming,
    /// Less than ideal behaviour of the DW1000.
    pub quirks: Quirks,
    /// What the DW1000 draws, state by state.
    pub supply_currents: SupplyCurrents,
    /// Frequency error of the processor's crystal in ppm.
    pub mcu_ppm: f64,
    /// From power-on (time zero) until the board's code begins.
    pub boot_delay: SimDuration,
    /// From the IRQ pin going active until code waiting for it runs.
    pub irq_latency: SimDuration,
    /// SPI.
    pub spi: SpiTiming,
    /// What goes wrong at random.
    pub mishaps: Mishaps,
    /// UART to the host.
    pub uart: UartConfig,
    /// Flash that the firmware may write to. It outlives the board: give it to another simulation to switch the board
    /// off and on.
    pub flash: Flash,
    /// Stack of the board's code in bytes.
    pub stack_bytes: usize,
}

impl Default for BoardConfig {
    fn default() -> Self {
        let chip = ChipConfig::default();
        BoardConfig {
            name: String::from("board"),
            clock: chip.clock,
            motion: chip.motion,
            tx_antenna_delay_ticks: chip.tx_antenna_delay_ticks,
            rx_antenna_delay_ticks: chip.rx_antenna_delay_ticks,
            rx_noise_ps: chip.rx_noise_ps,
            otp: chip.otp,
            chip_timing: chip.timing,
            quirks: chip.quirks,
            supply_currents: chip.supply_currents,
            mcu_ppm: 0.0,
            boot_delay: SimDuration::from_ms(5),
            irq_latency: SimDuration::from_us(2),
            spi: SpiTiming::default(),
            mishaps: Mishaps::default(),
            uart: UartConfig::default(),
            flash: Flash::new(4),
            stack_bytes: 1 << 20,
        }
    }
}

/// What SPI transactions cost besides their bits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpiTiming {
    /// Clock at boot in Hz.
    pub initial_hz: u32,
    /// Chip select going low, set-up of the DMA: before the first bit.
    pub before: SimDuration,
    /// Noticing the end, chip select going high: after the last bit.
    pub after: SimDuration,
}

impl Default for SpiTiming {
    /// 2 MHz, and 3 us a transaction, about what an nRF52832 at 64 MHz needs with EasyDMA.
    fn default() -> Self {
        SpiTiming {
            initial_hz: 2_000_000,
            before: SimDuration::from_ns(1_500),
            after: SimDuration::from_ns(1_500),
        }
    }
}

/// The UART between board and host, 8N1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct UartConfig {
    /// Bits per second.
    pub baud: u32,
    /// Bytes that can wait for transmission, as in a DMA ring.
    pub buffer_bytes: usize,
}

impl Default for UartConfig {
    fn default() -> Self {
        UartConfig {
            baud: 115_200,
            buffer_bytes: 1024,
        }
    }
}
