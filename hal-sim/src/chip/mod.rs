//! One DW1000: registers, SPI, radio.
//!
//! A [`Chip`] is a plain value driven by explicit time. It never calls anybody: what it wants done later or on the air
//! it puts into an outbox, which the [`World`](crate::world::World) empties after every call.
//!
//! | file | subject |
//! |---|---|
//! | `spi`, `access` | transactions and the side effects of reading and writing registers |
//! | `power` | reset, clock, PLL, microcode, OTP |
//! | `sleep` | SLEEP and DEEPSLEEP, what is kept in them, waking |
//! | `supply` | the charge that is drawn |
//! | `status` | SYS_STATUS, the interrupt line, event counters |
//! | `transmitter`, `receiver` | the two halves of the radio |
//! | `outcome`, `filter`, `buffers` | how receptions end, the address filter, the double receive buffer |
//! | `leading_edge`, `range_bias`, `diagnostics`, `accumulator` | time stamps and what else the chip reports about a reception |

mod access;
mod accumulator;
mod bits;
mod buffers;
mod config;
mod diagnostics;
mod filter;
mod leading_edge;
mod otp;
mod outcome;
mod power;
mod range_bias;
mod receiver;
mod registers;
mod settings;
mod sleep;
mod spi;
mod status;
mod supply;
mod transmitter;
mod tx_power;

pub use config::{ChipConfig, ChipTiming, LevelReport, Quirks};
pub use diagnostics::carrier_integrator;
pub use otp::OtpConfig;
pub use supply::{Consumption, SupplyCurrents};
pub use tx_power::MASK_POWER_DBM;

use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;

use crate::air::{ChannelConfig, FramesInFlight, Motion, OutgoingFrame, Signal};
use crate::clock::{ClockConfig, DeviceClock};
use crate::time::SimTime;

use buffers::ReceiveBuffers;
use power::Power;
use receiver::Receiver;
use registers::RegisterFile;
use sleep::Aon;
use spi::Transaction;
use status::Status;
use supply::Supply;
use transmitter::Transmitter;

/// Something a chip wants from the world.
#[derive(Debug)]
pub(crate) enum Request {
    /// Be called back.
    At(SimTime, ChipEvent),
    /// A frame leaves the antenna from its start on.
    StartFrame(OutgoingFrame),
    /// The bytes of the frame being sent are final.
    SealFrame(Vec<u8>),
    /// The frame being sent stops now.
    AbortFrame,
}

/// A call back. The number is the epoch of the activity that asked for it; a stale one is ignored.
#[derive(Debug)]
pub(crate) enum ChipEvent {
    Power(u32, power::PowerEvent),
    Transmitter(u32, transmitter::TxEvent),
    Receiver(u32, receiver::RxEvent),
    /// A frame reaches the antenna.
    SignalStart(Box<Signal>),
}

/// What happened inside a chip, by count. Never reset.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ChipStats {
    /// SPI transactions.
    pub spi_transactions: u64,
    /// Bytes clocked, headers included.
    pub spi_bytes: u64,
    /// Bytes read or written beyond the end of a register file, or in a file that does not exist.
    pub beyond_register: u64,
    /// Writes to read-only register files.
    pub read_only_writes: u64,
    /// Transactions while the chip could not answer (reset, start-up, killed).
    pub unanswered: u64,
    /// Times the chip went to sleep.
    pub sleeps: u64,
    /// Times the chip was killed by a fast SPI clock before its PLL had locked.
    pub killed_by_fast_spi: u64,
    /// TXSTRT or RXENAB while the radio was busy, in reset or set up with undefined values.
    pub ignored_commands: u64,
    /// Frames whose preamble began to leave.
    pub frames_begun: u64,
    /// Frames sent to their end.
    pub frames_sent: u64,
    /// Delayed transmissions or receptions asked for too late (HPDWARN or TXPUTE).
    pub late_commands: u64,
    /// Frames received with a good FCS.
    pub frames_good: u64,
    /// Frames received with a bad FCS.
    pub frames_bad_fcs: u64,
    /// Frames rejected by the address filter.
    pub frames_filtered: u64,
    /// Receptions that ended in RXPHE, RXRFSL or RXSFDTO.
    pub receive_errors: u64,
    /// Receptions that ended in RXRFTO or RXPTO.
    pub receive_timeouts: u64,
    /// Good receptions whose time stamp was wrong because the receiver was not reset after an error.
    pub stale_timestamps: u64,
}

/// A simulated DW1000.
#[derive(Debug)]
pub struct Chip {
    clock_config: ClockConfig,
    motion: Motion,
    tx_antenna_delay_ticks: f64,
    rx_antenna_delay_ticks: f64,
    rx_noise_ticks: f64,
    otp: OtpConfig,
    timing: ChipTiming,
    quirks: Quirks,
    supply_currents: SupplyCurrents,
    air: ChannelConfig,

    registers: RegisterFile,
    clock: DeviceClock,
    power: Power,
    aon: Aon,
    supply: Supply,
    status: Status,
    transmitter: Transmitter,
    receiver: Receiver,
    buffers: ReceiveBuffers,
    transaction: Option<Transaction>,
    outbox: Vec<Request>,
    rng: ChaCha8Rng,
    stats: ChipStats,
}

impl Chip {
    /// A chip whose supply comes up at time zero. `stream` tells its random numbers from those of other chips.
    pub(crate) fn new(config: ChipConfig, air: ChannelConfig, seed: u64, stream: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(stream);
        let ticks_per_ps = crate::time::TICKS_PER_S as f64 * 1e-12;
        let mut chip = Chip {
            clock: DeviceClock::new(&config.clock, SimTime::ZERO),
            clock_config: config.clock,
            motion: config.motion,
            tx_antenna_delay_ticks: config.tx_antenna_delay_ticks,
            rx_antenna_delay_ticks: config.rx_antenna_delay_ticks,
            rx_noise_ticks: config.rx_noise_ps * ticks_per_ps,
            otp: config.otp,
            timing: config.timing,
            quirks: config.quirks,
            supply_currents: config.supply_currents,
            air,
            registers: RegisterFile::new(),
            power: Power::default(),
            aon: Aon::default(),
            supply: Supply::default(),
            status: Status::default(),
            transmitter: Transmitter::default(),
            receiver: Receiver::default(),
            buffers: ReceiveBuffers::default(),
            transaction: None,
            outbox: Vec::new(),
            rng,
            stats: ChipStats::default(),
        };
        chip.start_up(SimTime::ZERO);
        chip
    }

    /// Counts of what happened so far.
    pub fn stats(&self) -> ChipStats {
        self.stats
    }

    /// The chip's time base; what the firmware can only estimate.
    pub fn clock(&self) -> &DeviceClock {
        &self.clock
    }

    /// Where the chip is.
    pub fn motion(&self) -> &Motion {
        &self.motion
    }

    pub(crate) fn take_requests(&mut self) -> Vec<Request> {
        std::mem::take(&mut self.outbox)
    }

    pub(crate) fn on_event(&mut self, now: SimTime, event: ChipEvent, frames: &FramesInFlight) {
        match event {
            ChipEvent::Power(epoch, event) => self.on_power_event(now, epoch, event),
            ChipEvent::Transmitter(epoch, event) => self.on_tx_event(now, epoch, event),
            ChipEvent::Receiver(epoch, event) => self.on_rx_event(now, epoch, event, frames),
            ChipEvent::SignalStart(signal) => self.on_signal_start(now, *signal),
        }
    }

    fn ask(&mut self, at: SimTime, event: ChipEvent) {
        self.outbox.push(Request::At(at, event));
    }

    /// Ticks of nominal length as true time, for delays that do not depend on the crystal.
    fn fixed_delay(ticks: f64) -> crate::time::SimDuration {
        crate::time::SimDuration::from_s_f64(ticks / crate::time::TICKS_PER_S as f64)
    }
}
