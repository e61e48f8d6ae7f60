//! The program: start everything once, then serve the radio for ever.

use embassy_executor::Spawner;
use embassy_futures::select::select;
use embassy_futures::yield_now;
use embassy_nrf::gpio::Input;
use embassy_nrf::pac;
use embassy_time::{Delay, Duration, Instant, Timer};
use nova_node::ranging::Address;
use nova_node::{Node, NodeConfig};
use nova_wire::{Record, ResetCause, Role};

use crate::identity::short_address;
use crate::leds::Leds;
use crate::progress::Progress;
use crate::radio::Radio;
use crate::uart::RecordSink;
use crate::watchdog::Watchdog;
use crate::{fault, pins};

/// This crate's version: major, minor, patch.
const FIRMWARE: [u8; 3] = [
    number(env!("CARGO_PKG_VERSION_MAJOR")),
    number(env!("CARGO_PKG_VERSION_MINOR")),
    number(env!("CARGO_PKG_VERSION_PATCH")),
];

/// A number in decimal digits; anything else stops the compiler.
#[allow(clippy::panic)]
const fn number(digits: &str) -> u8 {
    match u8::from_str_radix(digits, 10) {
        Ok(number) => number,
        Err(_) => panic!("a part of the version is not a number below 256"),
    }
}

/// Runs a node with the settings that `role` brings. Never returns.
pub async fn run(spawner: Spawner, role: Role) -> ! {
    let board = pins::take();
    let reset_cause = fault::take_reset_cause();
    let config = configuration(role, reset_cause);
    defmt::info!("{} {}, started by {}", role, config.identity, reset_cause);

    let mut watchdog = Watchdog::start(board.watchdog);
    let mut leds = Leds::new(board.leds);
    let Ok(mut records) = RecordSink::start(spawner, board.uart) else {
        fault::restart("the UART task did not start");
    };
    let radio = Radio::new(board.radio);
    let mut interrupt = radio.interrupt;

    let Ok(mut node) = Node::new(radio.bus, radio.reset, Delay, config) else {
        fault::restart("a setting cannot work");
    };
    if let Err(error) = node.start(now_us()) {
        defmt::error!("{}", error);
    }

    let mut progress = Progress::new(now_us());
    loop {
        // Tries a radio that is down again, and tells the host.
        let wake_us = node.service(now_us(), &mut |record: &Record| {
            leds.note(record, now_us());
            records.send(record);
        });
        node.count_dropped_records(records.take_dropped());
        if progress.check(node.counters().radio_resets, now_us()) {
            watchdog.feed();
        }
        let wake_us = wake_us.min(leds.update(now_us()));
        sleep(&mut interrupt, wake_us).await;
    }
}

/// What `role` brings, at this board's own address: an anchor finds the tags around it, so nobody has to
/// enter anything.
fn configuration(role: Role, reset_cause: ResetCause) -> NodeConfig {
    let address = Address(short_address(device_id()));
    let role_default = match role {
        Role::Tag => NodeConfig::tag(address),
        Role::Anchor => NodeConfig::anchor(address),
    };
    NodeConfig {
        firmware: FIRMWARE,
        reset_cause,
        ..role_default
    }
}

/// Sleeps until the DW1000 wants something, or `wake_us` is reached.
async fn sleep(interrupt: &mut Input<'static>, wake_us: u64) {
    // The clock ticks at 32 768 Hz and is read rounded down: without the tick on top the loop would wake
    // just before the time it asked for, and spin until it comes.
    let wake = Instant::from_micros(wake_us) + Duration::from_ticks(1);
    // The UART task has its turn even if the interrupt line never goes low. Here and not behind the wait, where a
    // frame may wait for its answer.
    yield_now().await;
    select(interrupt.wait_for_high(), Timer::at(wake)).await;
}

/// Microseconds since the start, in steps of 30.5 µs.
fn now_us() -> u64 {
    Instant::now().as_micros()
}

/// The number that Nordic gave this chip (FICR.DEVICEID).
fn device_id() -> [u32; 2] {
    [pac::FICR.deviceid(0).read(), pac::FICR.deviceid(1).read()]
}
