//! The firmware's node on a simulated board: what `firmware/dwm1001` is on a
//! real one.

use nova_hal_sim::{BoardConfig, BoardHal, BoardId, Simulation, UartConfig};
use nova_node::{ConfigError, Node, NodeConfig, RadioBus, SpiBusWithSpeed, SpiSpeed};
use nova_wire::{Encoder, MAX_FRAME_LEN};

/// SPI clocks as on the board, in Hz.
const SLOW_HZ: u32 = 2_000_000;
const FAST_HZ: u32 = 8_000_000;

/// Bits per second of the board's serial port.
pub const BAUD: u32 = 1_000_000;

/// Adds a board that runs a node; its records leave on the simulated serial port.
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

fn run(hal: &BoardHal, config: NodeConfig) {
    // The settings have been checked.
    let Ok(mut node) = Node::new(radio_bus(hal), hal.rst(), hal.delay(), config) else {
        return;
    };
    let mut encoder = Encoder::new();
    let mut uart = hal.uart();
    loop {
        let mut dropped = 0;
        let wake_us = node.service(hal.now_us(), &mut |record| {
            let mut buffer = [0; MAX_FRAME_LEN];
            let sent = encoder
                .encode(record, &mut buffer)
                .is_ok_and(|frame| uart.write(frame) == frame.len());
            dropped += u32::from(!sent);
        });
        node.count_dropped_records(dropped);
        hal.wait_irq_until(wake_us);
    }
}
