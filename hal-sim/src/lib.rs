//! Simulated boards for firmware that talks to a DW1000: the chip at register level behind SPI, chip select, IRQ and
//! RST, its crystal, the air between boards, and virtual time.
//!
//! Ordinary blocking drivers run on it unmodified through embedded-hal 0.2 or 1.0; the tests run the `dw1000` crate's
//! own high-level API. Runs depend on the configuration and the seed alone: no wall clock, no threads.
//!
//! Two ways in:
//! - [`Simulation`]: boards whose code runs as coroutines, every HAL call a scheduling point.
//! - [`World`]: chips and air as plain values driven by explicit time, for those who bring their own processor.
//!
//! ```
//! use embedded_hal::spi::{Operation, SpiDevice};
//! use nova_hal_sim::{BoardConfig, SimConfig, SimTime, Simulation};
//!
//! let mut sim = Simulation::new(SimConfig::default());
//! let board = sim.add_board(BoardConfig::default(), |hal| {
//!     let mut id = [0; 4];
//!     let mut dw1000 = hal.spi_device();
//!     dw1000.transaction(&mut [Operation::Write(&[0x00]), Operation::Read(&mut id)]).unwrap();
//!     hal.uart().write(&id);
//! });
//! sim.run_until(SimTime::from_ms(10))?;
//! assert_eq!(sim.uart(board)[0].bytes, 0xDECA_0130u32.to_le_bytes());
//! # Ok::<(), nova_hal_sim::SimError>(())
//! ```
//!
//! # Modelled
//! - All register files with reset values, access kinds and SPI headers; self-clearing commands; SYS_STATUS with
//!   write-1-to-clear, mask, polarity; event counters; OTP; crystal trim.
//! - Start-up, RST, soft resets of the chip and of the receiver, PLL lock and what fast SPI does before it, loading of
//!   the LDE microcode.
//! - SLEEP and DEEPSLEEP: what survives them, waking by chip select or counter, the charge that is drawn.
//! - Immediate and delayed transmission on the 512-tick grid, late ones (HPDWARN, TXPUTE), FCS suppression and its
//!   cancelling, WAIT4RESP, smart transmit power.
//! - Reception from preamble to FCS with real bytes and CRC, timeouts, frame filtering, auto re-enable, double buffer,
//!   overrun; time stamps with noise, both antenna delays, the bias that follows the receive power (APS011), and the
//!   error after a missing receiver reset.
//! - RX power, first-path power, RXPACC, carrier integrator, time tracking, a made-up impulse response.
//! - The processor's flash: page erase, word writes, how often each is allowed, and power lost in the middle of them.
//! - Path loss, flight time, moving boards, obstructed links, loss, scripted faults, collisions with capture.
//! - Mishaps at random: damaged and repeated frames, bits lost on the SPI, interrupts served late, brown-outs, receivers
//!   that go deaf; a host that does not read.
//!
//! # Not modelled
//! - Snooze and low-power listening; automatic acknowledgement; external sync; GPIO, LEDs, temperature and
//!   voltage; sniff mode; test modes. Their registers are plain storage.
//! - Tuning registers (AGC, DRX, RF, TC, PLL, LDE): wrong values cost nothing, except the PAC size in DRX_TUNE2.
//! - Resets of single blocks other than the receiver's.
//! - Packet errors near the sensitivity limit: a frame is received or not. Multipath beyond a late or weak first path.
//!   Overlap of channels 2 and 4, or 5 and 7, counts as full overlap.
//! - Failures of the leading edge search (LDEERR).
//! - Receive events cleared by RXAUTR: here they stay until the host clears them or enables the receiver.
//! - Delayed transmissions that get lost without a flag (errata TX-1; APS022, section 5.4).
//! - Powers of PHR and data apart from the preamble's. Contents of user-defined SFDs: they are taken to match.

pub mod air;
pub mod airtime;
pub mod board;
pub mod chip;
pub mod clock;
mod coroutine;
mod error;
pub mod flash;
pub mod phy;
mod simulation;
pub mod time;
pub mod world;

pub use air::{ChannelConfig, Fault, FaultAction, LinkEffect, Motion, Position};
pub use board::{BoardConfig, BoardHal, MishapStats, Mishaps, SpiTiming, UartChunk, UartConfig};
pub use clock::ClockConfig;
pub use error::SimError;
pub use flash::{Flash, FlashError};
pub use simulation::{BoardId, BoardStats, SimConfig, SimStats, Simulation};
pub use time::{SimDuration, SimTime};
pub use world::World;
