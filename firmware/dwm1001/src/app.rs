//! The program: start everything once, then serve the radio for ever.

use embassy_executor::Spawner;
use embassy_futures::select::{Either3, select3};
use embassy_futures::yield_now;
use embassy_nrf::gpio::Input;
use embassy_nrf::pac;
use embassy_time::{Delay, Duration, Instant, Timer};
use nova_node::ranging::Address;
use nova_node::{Keeper, Node, NodeConfig, Then};
use nova_wire::{Record, ResetCause, Role};

use crate::identity::short_address;
use crate::leds::Leds;
use crate::progress::Progress;
use crate::radio::Radio;
use crate::uart::{self, RecordSink};
use crate::watchdog::Watchdog;
use crate::{fault, flash, pins};

/// What the answers that wait take to leave, at most: a full outbox at 1 Mbaud.
const LAST_WORDS_MS: u64 = 50;

/// The longest sleep: the watchdog wants to be fed.
const LONGEST_SLEEP_US: u64 = 250_000;

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
    // Without its cache the flash makes the processor wait two cycles for each fetch (nRF52832 product specification,
    // 11.1.6); embassy leaves it off.
    pac::NVMC.icachecnf().modify(|w| w.set_cacheen(true));
    let board = pins::take();
    let (reset_cause, mut crash) = fault::take_past();
    let flash = flash::open(board.flash);
    let Ok(mut keeper) = Keeper::new(configuration(role, reset_cause), flash, flash::SETTINGS)
    else {
        fault::restart("no place for settings");
    };
    let config = keeper.config();
    defmt::info!(
        "{} {}, started by {}, settings: {}",
        role,
        config.identity,
        reset_cause,
        config.settings
    );

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
    let mut from_host = [0; 64];
    let mut count = 0;
    loop {
        let mut emit = |record: &Record| {
            leds.note(record, now_us());
            records.send(record);
        };
        let bytes = from_host.get(..count).unwrap_or_default();
        let then = keeper.on_bytes(bytes, &mut node, now_us(), &mut emit);
        // Tries a radio that is down again, and tells the host.
        let wake_us = node.service(now_us(), &mut emit);
        // After the boot record.
        if let Some(crash) = crash.take() {
            emit(&Record::Crash(crash));
        }
        node.count_dropped_records(records.take_dropped());
        if progress.check(node.counters().radio_resets, now_us()) {
            watchdog.feed();
        }
        let wake_us = wake_us
            .min(leds.update(now_us()))
            .min(now_us() + LONGEST_SLEEP_US);
        if then == Then::Reboot {
            Timer::after_millis(LAST_WORDS_MS).await;
            fault::reboot();
        }
        count = sleep(&mut interrupt, wake_us, &mut from_host).await;
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

/// Sleeps until the DW1000 wants something, the host says something, or `wake_us` is reached. Returns how many
/// bytes the host has said.
async fn sleep(interrupt: &mut Input<'static>, wake_us: u64, from_host: &mut [u8]) -> usize {
    // The clock ticks at 32 768 Hz and is read rounded down: without the tick on top the loop would wake
    // just before the time it asked for, and spin until it comes.
    let wake = Instant::from_micros(wake_us) + Duration::from_ticks(1);
    // The UART tasks have their turn even if the interrupt line never goes low. Here and not behind the wait, where a
    // frame may wait for its answer.
    yield_now().await;
    let woken = select3(
        interrupt.wait_for_high(),
        Timer::at(wake),
        uart::from_host(from_host),
    )
    .await;
    match woken {
        Either3::Third(count) => count,
        Either3::First(()) | Either3::Second(()) => 0,
    }
}

/// Microseconds since the start, in steps of 30.5 µs.
fn now_us() -> u64 {
    Instant::now().as_micros()
}

/// The number that Nordic gave this chip (FICR.DEVICEID).
fn device_id() -> [u32; 2] {
    [pac::FICR.deviceid(0).read(), pac::FICR.deviceid(1).read()]
}
