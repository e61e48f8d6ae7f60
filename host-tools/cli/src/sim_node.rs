//! The firmware's node on a simulated board: what `firmware/dwm1001` is on a
//! real one.

use nova_hal_sim::BoardHal;
use nova_node::{Node, NodeConfig, SpiBusWithSpeed, SpiSpeed};
use nova_wire::{Encoder, MAX_FRAME_LEN};

/// SPI clocks as on the board, in Hz.
const SLOW_HZ: u32 = 2_000_000;
const FAST_HZ: u32 = 8_000_000;

/// Bits per second of the board's serial port.
pub const BAUD: u32 = 1_000_000;

/// Runs a node on `hal` for ever; records leave on the simulated UART.
pub fn run(hal: &BoardHal, config: NodeConfig) {
    let bus = SpiBusWithSpeed::new(hal.spi_device(), |spi, speed| {
        spi.set_frequency(match speed {
            SpiSpeed::Slow => SLOW_HZ,
            SpiSpeed::Fast => FAST_HZ,
        });
    });
    let mut node = Node::new(bus, hal.rst(), hal.delay(), config);
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
