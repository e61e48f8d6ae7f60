//! What can be set about a simulated chip.

use crate::air::Motion;
use crate::clock::ClockConfig;
use crate::time::SimDuration;

use super::otp::OtpConfig;
use super::supply::SupplyCurrents;

/// A chip, its crystal, its antenna and where it is.
#[derive(Debug)]
pub struct ChipConfig {
    /// Crystal.
    pub clock: ClockConfig,
    /// Position.
    pub motion: Motion,
    /// True delay from the internal transmit time stamp to the antenna, in ticks. What the firmware writes into
    /// TX_ANTD only changes the reported stamp, so a wrong calibration shows as a range offset.
    pub tx_antenna_delay_ticks: f64,
    /// True delay from the antenna to the internal receive time stamp, in ticks.
    pub rx_antenna_delay_ticks: f64,
    /// Standard deviation of each receive time stamp in picoseconds.
    pub rx_noise_ps: f64,
    /// Contents of the one-time programmable memory.
    pub otp: OtpConfig,
    /// Durations inside the chip.
    pub timing: ChipTiming,
    /// Less than ideal behaviour.
    pub quirks: Quirks,
    /// Supply currents by state.
    pub supply_currents: SupplyCurrents,
}

impl Default for ChipConfig {
    fn default() -> Self {
        ChipConfig {
            clock: ClockConfig::default(),
            motion: Motion::default(),
            tx_antenna_delay_ticks: 16_456.0,
            rx_antenna_delay_ticks: 16_456.0,
            rx_noise_ps: 0.0,
            otp: OtpConfig::default(),
            timing: ChipTiming::default(),
            quirks: Quirks::default(),
            supply_currents: SupplyCurrents::default(),
        }
    }
}

/// Durations inside the chip.
#[derive(Debug, Clone, PartialEq)]
pub struct ChipTiming {
    /// From power-on or release of RST until SPI answers (INIT state): the crystal starts. Assumed; drivers wait
    /// 2 ms or more after RST, and the manual has some 4 ms from power-on (2.4, figure 9).
    pub start_up: SimDuration,
    /// How long chip select has to stay low to wake the chip (User Manual 2.3.2: nominally 500 us).
    pub wake_cs_hold: SimDuration,
    /// From the wake-up event until SPI answers (INIT state): the crystal starts, the AON memory is copied back. Some 4 ms
    /// (User Manual 2.3.2; the vendor's driver waits 5).
    pub wake_up: SimDuration,
    /// From INIT until the clock PLL has locked (IDLE state; User Manual 2.4, figure 9: 7 us and 5 us).
    pub pll_lock: SimDuration,
    /// From LDELOAD until the microcode is loaded (User Manual 2.5.5.10: 150 us).
    pub lde_load: SimDuration,
    /// From TXSTRT until the first preamble symbol can leave. Assumed; the manual says a few microseconds (3.3).
    pub tx_start_up: SimDuration,
    /// From RXENAB until the receiver hears (User Manual 7.2.15, RXENAB: 16 us).
    pub rx_start_up: SimDuration,
    /// From the RMARKER until the leading edge has been found (LDEDONE). Assumed; shorter than the PHR, so that it
    /// comes before RXDFR, which the chip holds back until then (User Manual 7.2.17, RXDFR).
    pub lde_run: SimDuration,
    /// Preamble that the receiver needs before it notices a frame, in preamble acquisition chunks (PAC).
    pub detection_pacs: u32,
    /// Highest SPI clock while the chip runs from its crystal: before the PLL locks or with SYSCLKS = XTI.
    pub slow_spi_max_hz: u32,
}

impl Default for ChipTiming {
    fn default() -> Self {
        ChipTiming {
            start_up: SimDuration::from_us(1_000),
            wake_cs_hold: SimDuration::from_us(500),
            wake_up: SimDuration::from_us(4_000),
            pll_lock: SimDuration::from_us(12),
            lde_load: SimDuration::from_us(150),
            tx_start_up: SimDuration::from_us(10),
            rx_start_up: SimDuration::from_us(16),
            lde_run: SimDuration::from_us(20),
            detection_pacs: 2,
            slow_spi_max_hz: 3_000_000,
        }
    }
}

/// Less than ideal behaviour, each part switchable.
#[derive(Debug, Clone, PartialEq)]
pub struct Quirks {
    /// After a receive error or timeout, receive time stamps are wrong by up to this many ticks until the receiver
    /// has been reset through PMSC_CTRL0 (User Manual 4.1.6, "RX message timestamp"). The manual does not say by how
    /// much; the error here is uniform. It exempts RXPTO and RXSFDTO, which count here too: the vendor's driver resets
    /// after them as well. 0 switches it off.
    pub stale_receiver_error_ticks: u32,
    /// Receive time stamps of strong signals are early, those of weak ones late, so that ranges are off by up to 0.4 m
    /// (application note APS011; `range_bias.rs`). On unless a test is about something else: firmware that does not
    /// correct it should be seen to be off.
    pub range_bias: bool,
    /// How RX_FQUAL and the first path amplitudes follow the power received.
    pub level_report: LevelReport,
    /// Frequency change of one step of the crystal trim, in ppm; more trim is slower. 0 switches it off.
    pub xtal_trim_ppm_per_step: f64,
}

impl Default for Quirks {
    fn default() -> Self {
        Quirks {
            stale_receiver_error_ticks: 1_000,
            range_bias: true,
            level_report: LevelReport::Compressed,
            xtal_trim_ppm_per_step: 1.5,
        }
    }
}

/// How the diagnostics follow the power received.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LevelReport {
    /// The User Manual's formulas give back the simulated power.
    Linear,
    /// Above -88 dBm the formulas read low, as figure 22 of the User Manual shows (the usual straight-line fit:
    /// actual = reported + (reported + 88) k, with k = 2.33 at PRF 16 MHz and 1.17 at 64 MHz).
    Compressed,
}
