//! The firmware's node on a simulated board: what `firmware/dwm1001` is on a
//! real one, the processor's time included: [`nova_node::cost`] says how much of it
//! is spent where, and it is charged there.

use embedded_hal::spi::{ErrorType, Operation, SpiDevice};
use nova_hal_sim::board::{SpiDev, UartTx};
use nova_hal_sim::flash::PAGE_BYTES;
use nova_hal_sim::{
    BoardConfig, BoardHal, BoardId, SimDuration, Simulation, SpiTiming, UartConfig,
};
use nova_node::cost::{DWM1001, RECORD_NS};
use nova_node::{
    ConfigError, Keeper, Node, NodeConfig, Outbox, RadioBus, SpiBusWithSpeed, SpiSpeed, Then,
};
use nova_wire::{Encoder, MAX_FRAME_LEN, Record, ResetCause};

/// SPI clocks as on the board, in Hz.
const SLOW_HZ: u32 = 2_000_000;
const FAST_HZ: u32 = 8_000_000;

/// Bits per second of the board's serial port.
pub const BAUD: u32 = 1_000_000;

/// What waits for the line, and the most that goes out at once: as on the board.
const OUTBOX_BYTES: usize = 4096;
const CHUNK_BYTES: usize = 255;

/// How long a board that is told to start anew waits for its last words to leave, in microseconds.
const LAST_WORDS_US: u64 = 50_000;

/// Where the node keeps its settings in the simulated flash.
pub const SETTINGS_FLASH: std::ops::Range<u32> = 0..4 * PAGE_BYTES as u32;

/// Adds a board that runs a node; its records leave on the simulated serial port, where commands are taken as well.
/// `node` is what the board is without any settings in its flash.
///
/// # Errors
/// A setting of the node that cannot work.
pub fn add(
    sim: &mut Simulation,
    board: BoardConfig,
    node: NodeConfig,
) -> Result<BoardId, ConfigError> {
    node.check()?;
    let board = BoardConfig {
        uart: UartConfig {
            baud: BAUD,
            buffer_bytes: CHUNK_BYTES,
        },
        // What the caller adds to the usual cost of a transaction comes on top.
        spi: SpiTiming {
            before: board.spi.before + SimDuration::from_ns(extra_transaction_ns()),
            ..board.spi
        },
        ..board
    };
    Ok(sim.add_board(board, move |hal| run(&hal, node)))
}

/// What a transaction costs on the board beyond what a simulated board takes for it.
fn extra_transaction_ns() -> u64 {
    let usual = SpiTiming::default();
    let usual_fs = usual.before.as_fs() + usual.after.as_fs();
    u64::from(DWM1001.transaction_ns).saturating_sub(usual_fs / 1_000_000)
}

/// The way to the board's radio.
pub fn radio_bus(hal: &BoardHal) -> impl RadioBus + use<> {
    let device = Charged {
        device: hal.spi_device(),
        hal: hal.clone(),
    };
    SpiBusWithSpeed::new(device, |spi: &mut Charged<SpiDev>, speed| {
        spi.device.set_frequency(match speed {
            SpiSpeed::Slow => SLOW_HZ,
            SpiSpeed::Fast => FAST_HZ,
        });
    })
}

/// A bus that charges what the processor does before it uses it.
struct Charged<S> {
    device: S,
    hal: BoardHal,
}

impl<S: ErrorType> ErrorType for Charged<S> {
    type Error = S::Error;
}

impl<S: SpiDevice> SpiDevice for Charged<S> {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), S::Error> {
        let bytes = match operations.first() {
            Some(Operation::Write(bytes)) => *bytes,
            Some(Operation::TransferInPlace(bytes)) => &**bytes,
            _ => &[],
        };
        self.hal.charge_cpu_ns(cpu_ns_before(bytes));
        self.device.transaction(operations)
    }
}

/// What the processor works on before it writes or reads these bytes.
fn cpu_ns_before(bytes: &[u8]) -> u64 {
    /// SYS_TIME read: the end of a time-out is computed, or the age of a range.
    const READ_SYS_TIME: u8 = 0x06;
    /// TX_BUFFER written: a frame was understood, and its answer made.
    const WRITE_TX_BUFFER: u8 = 0x89;
    let ns = match bytes.first() {
        Some(&WRITE_TX_BUFFER) => DWM1001.answer.cpu_ns,
        Some(&READ_SYS_TIME) => DWM1001.listen.cpu_ns,
        _ => 0,
    };
    ns.into()
}

fn run(hal: &BoardHal, mut board: NodeConfig) {
    loop {
        board.reset_cause = match live(hal, board.clone()) {
            Some(End::Rebooted) => ResetCause::Software,
            Some(End::PowerLost) => {
                hal.flash().restore_power();
                ResetCause::PowerOn
            }
            None => return,
        };
    }
}

/// Why a board starts anew.
enum End {
    Rebooted,
    PowerLost,
}

/// From one start to the next. `None`: the settings cannot work.
fn live(hal: &BoardHal, board: NodeConfig) -> Option<End> {
    let start_us = hal.now_us();
    let flash = hal.flash();
    let mut keeper = Keeper::new(board, flash.clone(), SETTINGS_FLASH).ok()?;
    let (bus, reset) = (radio_bus(hal), hal.rst());
    let mut node = Node::new(bus, reset, hal.delay(), keeper.config()).ok()?;
    let mut encoder = Encoder::new();
    let mut line = Line {
        hal,
        uart: hal.uart(),
        outbox: Outbox::new(),
    };
    let mut from_host = hal.uart_rx();
    loop {
        let mut emit = |record: &Record| {
            // What has no power says nothing.
            if flash.is_without_power() {
                return;
            }
            let mut buffer = [0; MAX_FRAME_LEN];
            hal.charge_cpu_ns(RECORD_NS.into());
            if let Ok(frame) = encoder.encode(record, &mut buffer) {
                line.outbox.push(frame);
            }
        };
        let now_us = || hal.now_us() - start_us;
        let mut then = Then::GoOn;
        let mut bytes = [0; 256];
        let count = from_host.read(&mut bytes);
        if let Some(bytes) = bytes.get(..count).filter(|bytes| !bytes.is_empty()) {
            then = keeper.on_bytes(bytes, &mut node, now_us(), &mut emit);
        }
        let wake_us = node.service(now_us(), &mut emit);
        node.count_dropped_records(line.outbox.take_dropped());
        if flash.is_without_power() {
            return Some(End::PowerLost);
        }
        if then == Then::Reboot {
            line.say_last_words();
            return Some(End::Rebooted);
        }
        line.wait_until(start_us.saturating_add(wake_us));
        // Interrupt, executor, and back into the node.
        hal.charge_cpu_ns(DWM1001.wake_ns.into());
    }
}

/// The line to the host. What waits for it goes out in the background.
struct Line<'a> {
    hal: &'a BoardHal,
    uart: UartTx,
    outbox: Outbox<OUTBOX_BYTES>,
}

impl Line<'_> {
    /// Starts the next transfer if the last is over. When that which runs will be, if anything waits for it.
    fn go_on(&mut self) -> Option<u64> {
        if self.outbox.is_empty() {
            return None;
        }
        if self.uart.idle_at_us() <= self.hal.now_us() {
            let mut chunk = [0; CHUNK_BYTES];
            let count = self.outbox.pop(&mut chunk);
            self.uart.write(chunk.get(..count).unwrap_or_default());
        }
        (!self.outbox.is_empty()).then(|| self.uart.idle_at_us())
    }

    /// Waits for the radio, the host, or until the processor's clock shows `wake_us`.
    fn wait_until(&mut self, wake_us: u64) {
        while let Some(idle_us) = self.go_on().filter(|&idle_us| idle_us < wake_us) {
            if self.hal.wait_event_until(idle_us) || self.hal.now_us() < idle_us {
                return;
            }
        }
        self.hal.wait_event_until(wake_us);
    }

    fn say_last_words(&mut self) {
        let until_us = self.hal.now_us() + LAST_WORDS_US;
        while let Some(idle_us) = self.go_on().filter(|&idle_us| idle_us < until_us) {
            self.hal.sleep_until(idle_us);
        }
    }
}
