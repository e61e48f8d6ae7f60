//! Records to the host: the radio loop queues them, a task sends them by DMA. The radio never waits
//! for the host.

use core::cell::RefCell;

use embassy_executor::{SpawnError, Spawner};
use embassy_nrf::uarte::{self, Baudrate, UarteTx};
use embassy_nrf::{bind_interrupts, peripherals};
use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::ThreadModeRawMutex;
use embassy_sync::signal::Signal;
use nova_wire::{Encoder, MAX_FRAME_LEN, Record};

use crate::outbox::Outbox;
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

/// Raised when [`OUTBOX`] got a frame.
static QUEUED: Signal<ThreadModeRawMutex, ()> = Signal::new();

/// Where the radio loop puts its records. There is one.
pub(crate) struct RecordSink {
    encoder: Encoder,
    frame: [u8; MAX_FRAME_LEN],
}

impl RecordSink {
    /// Starts the sending task.
    pub(crate) fn start(spawner: Spawner, pins: UartPins) -> Result<Self, SpawnError> {
        let mut config = uarte::Config::default();
        config.baudrate = Baudrate::Baud1m;
        let tx = UarteTx::new(pins.uart, Irqs, pins.tx, config);
        spawner.spawn(send_queued(tx)?);
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
