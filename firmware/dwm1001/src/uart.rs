//! The line to the host. Records: the radio loop queues them, a task sends them by DMA; the radio never waits
//! for the host. Commands: a task receives them by DMA, and the radio loop finds them in a pipe.

use core::cell::RefCell;

use embassy_executor::{SpawnError, Spawner};
use embassy_nrf::pac;
use embassy_nrf::pac::gpio::vals::Pull;
use embassy_nrf::uarte::{self, Baudrate, Uarte, UarteRxWithIdle, UarteTx};
use embassy_nrf::{bind_interrupts, peripherals};
use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::ThreadModeRawMutex;
use embassy_sync::pipe::Pipe;
use embassy_sync::signal::Signal;
use embassy_time::Timer;
use nova_node::Outbox;
use nova_wire::{Encoder, MAX_FRAME_LEN, Record};

use crate::pins::UartPins;

bind_interrupts!(struct Irqs {
    UARTE0 => uarte::InterruptHandler<peripherals::UARTE0>;
});

/// What waits for the line: about 40 ms of it at 1 Mbaud.
const OUTBOX_BYTES: usize = 4096;

/// The most that EasyDMA sends at once (nRF52832: an 8-bit counter).
const CHUNK_BYTES: usize = 255;

const _: () = assert!(
    MAX_FRAME_LEN <= CHUNK_BYTES,
    "a frame must go out in one transfer"
);

static OUTBOX: Mutex<ThreadModeRawMutex, RefCell<Outbox<OUTBOX_BYTES>>> =
    Mutex::new(RefCell::new(Outbox::new()));

/// What came from the host and has not been read: three commands of the longest kind.
const INBOX_BYTES: usize = 512;

static INBOX: Pipe<ThreadModeRawMutex, INBOX_BYTES> = Pipe::new();

/// Which pin of port 0 commands come in by.
const RX_PIN: usize = 11;

/// From an error on the receive line to the next attempt: one that is held low gives errors without end.
const AFTER_ERROR_MS: u64 = 10;

/// Raised when [`OUTBOX`] got a frame.
static QUEUED: Signal<ThreadModeRawMutex, ()> = Signal::new();

/// Where the radio loop puts its records. There is one.
pub(crate) struct RecordSink {
    encoder: Encoder,
    frame: [u8; MAX_FRAME_LEN],
}

impl RecordSink {
    /// Starts the tasks that send and receive.
    pub(crate) fn start(spawner: Spawner, pins: UartPins) -> Result<Self, SpawnError> {
        let mut config = uarte::Config::default();
        config.baudrate = Baudrate::Baud1m;
        let uart = Uarte::new(pins.uart, pins.rx, pins.tx, Irqs, config);
        // An open line must not look like bytes.
        pac::P0.pin_cnf(RX_PIN).modify(|w| w.set_pull(Pull::Pullup));
        let (tx, rx) = uart.split_with_idle(pins.idle_timer, pins.idle_start, pins.idle_stop);
        spawner.spawn(send_queued(tx)?);
        spawner.spawn(receive(rx)?);
        Ok(Self {
            encoder: Encoder::new(),
            frame: [0; MAX_FRAME_LEN],
        })
    }

    /// Frames `record` and queues it; never waits. Where the queue is full, the oldest records go.
    pub(crate) fn send(&mut self, record: &Record) {
        match self.encoder.encode(record, &mut self.frame) {
            Ok(frame) => {
                OUTBOX.lock(|outbox| outbox.borrow_mut().push(frame));
                QUEUED.signal(());
            }
            Err(error) => defmt::error!("record not sent: {}", error),
        }
    }

    /// How many records were dropped since this was asked last.
    pub(crate) fn take_dropped(&mut self) -> u32 {
        OUTBOX.lock(|outbox| outbox.borrow_mut().take_dropped())
    }
}

#[embassy_executor::task]
async fn send_queued(mut tx: UarteTx<'static>) -> ! {
    let mut buffer = [0; CHUNK_BYTES];
    loop {
        QUEUED.wait().await;
        loop {
            let length = OUTBOX.lock(|outbox| outbox.borrow_mut().pop(&mut buffer));
            let Some(bytes) = buffer.get(..length).filter(|bytes| !bytes.is_empty()) else {
                break;
            };
            if let Err(error) = tx.write(bytes).await {
                defmt::error!("UART: {}", error);
            }
        }
    }
}

/// Waits for bytes from the host; returns how many there were.
pub(crate) async fn from_host(buffer: &mut [u8]) -> usize {
    INBOX.read(buffer).await
}

#[embassy_executor::task]
async fn receive(mut rx: UarteRxWithIdle<'static>) -> ! {
    let mut buffer = [0; CHUNK_BYTES];
    loop {
        match rx.read_until_idle(&mut buffer).await {
            Ok(count) => {
                // What does not fit is lost: the command is damaged then, which is counted, and asked again.
                let _ = INBOX.try_write(buffer.get(..count).unwrap_or_default());
            }
            Err(error) => {
                defmt::debug!("UART, receiving: {}", error);
                Timer::after_millis(AFTER_ERROR_MS).await;
            }
        }
    }
}
