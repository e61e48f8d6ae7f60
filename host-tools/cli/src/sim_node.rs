//! The firmware's node on a simulated board: what `firmware/dwm1001` is on a
//! real one.

use nova_hal_sim::flash::PAGE_BYTES;
use nova_hal_sim::{BoardConfig, BoardHal, BoardId, Simulation, UartConfig};
use nova_node::{ConfigError, Keeper, Node, NodeConfig, RadioBus, SpiBusWithSpeed, SpiSpeed, Then};
use nova_wire::{Encoder, MAX_FRAME_LEN, Record, ResetCause};

/// SPI clocks as on the board, in Hz.
const SLOW_HZ: u32 = 2_000_000;
const FAST_HZ: u32 = 8_000_000;

/// Bits per second of the board's serial port.
pub const BAUD: u32 = 1_000_000;

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
            ..board.uart
        },
        ..board
    };
    Ok(sim.add_board(board, move |hal| run(&hal, node)))
}

/// The way to the board's radio.
pub fn radio_bus(hal: &BoardHal) -> impl RadioBus {
    SpiBusWithSpeed::new(hal.spi_device(), |spi, speed| {
        spi.set_frequency(match speed {
            SpiSpeed::Slow => SLOW_HZ,
            SpiSpeed::Fast => FAST_HZ,
        });
    })
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
    let (mut uart, mut from_host) = (hal.uart(), hal.uart_rx());
    loop {
        let mut dropped = 0;
        let mut emit = |record: &Record| {
            // What has no power says nothing.
            if flash.is_without_power() {
                return;
            }
            let mut buffer = [0; MAX_FRAME_LEN];
            let sent = encoder
                .encode(record, &mut buffer)
                .is_ok_and(|frame| uart.write(frame) == frame.len());
            dropped += u32::from(!sent);
        };
        let now_us = || hal.now_us() - start_us;
        let mut then = Then::GoOn;
        let mut bytes = [0; 256];
        let count = from_host.read(&mut bytes);
        if let Some(bytes) = bytes.get(..count).filter(|bytes| !bytes.is_empty()) {
            then = keeper.on_bytes(bytes, &mut node, now_us(), &mut emit);
        }
        let wake_us = node.service(now_us(), &mut emit);
        node.count_dropped_records(dropped);
        if flash.is_without_power() {
            return Some(End::PowerLost);
        }
        if then == Then::Reboot {
            return Some(End::Rebooted);
        }
        hal.wait_event_until(start_us.saturating_add(wake_us));
    }
}
