//! What must hold for bytes from anywhere: each function takes any input and
//! panics where a promise is broken. `fuzz/` drives them with cargo-fuzz,
//! `tests/any_bytes.rs` with a bounded number of inputs on stable Rust.
//!
//! Where input is guarded by a checksum, half of it is sealed with a good one:
//! otherwise no fuzzer would ever get past it.
#![allow(clippy::panic)]

use core::convert::Infallible;
use nova_hal_sim::Flash;
use nova_hal_sim::flash::PAGE_BYTES;
use nova_node::ranging::{Address, Frame};
use nova_node::store::settings_of_image;
use nova_node::{Keeper, Node, NodeConfig, RadioBus, SpiSpeed};
use nova_wire::{
    Command, CommandDecoder, CommandEvent, Decoder, Encoder, Event, FrameEvent, MAX_FRAME_LEN,
    Message, Outcome, Record, Trouble,
};

/// A stream from a board: records come out as they went in, and the decoder
/// accounts for everything.
///
/// # Panics
/// If not.
pub fn wire_decoder(bytes: &[u8]) {
    for stream in [bytes.to_vec(), sealed(bytes)] {
        let mut decoder = Decoder::new();
        let mut events: Vec<Event> = stream.iter().filter_map(|&b| decoder.push(b)).collect();
        events.extend(decoder.finish());
        events.iter().for_each(round_trip);
        let statistics = decoder.statistics();
        let count = |wanted: fn(&Event) -> bool| events.iter().filter(|e| wanted(e)).count() as u64;
        assert_eq!(
            statistics.records,
            count(|e| matches!(e, Event::Record { .. }))
        );
        assert_eq!(
            statistics.corrupt,
            count(|e| matches!(e, Event::Trouble(Trouble::Corrupt)))
        );
        assert_eq!(
            statistics.records + statistics.corrupt + statistics.unknown,
            events.len() as u64
        );
        assert_eq!(statistics.bytes, stream.len() as u64);
    }
}

/// A decoded message is encoded to bytes that give the same message. Compared
/// as bytes: NaN is a good value.
fn round_trip<M: Message + core::fmt::Debug>(event: &FrameEvent<M>) {
    let FrameEvent::Record { record, .. } = event else {
        return;
    };
    let mut buffer = [0; MAX_FRAME_LEN];
    let bytes = match Encoder::new().encode(record, &mut buffer) {
        Ok(bytes) => bytes.to_vec(),
        // Bytes that say the same at greater length than needed fit a frame
        // whenever their shortest form does.
        Err(error) => panic!("{record:?} was read and cannot be written: {error:?}"),
    };
    let mut decoder = nova_wire::FrameDecoder::<M>::new();
    let again: Vec<FrameEvent<M>> = bytes.iter().filter_map(|&b| decoder.push(b)).collect();
    let [FrameEvent::Record { record: again, .. }] = &again[..] else {
        panic!("{record:?} came back as {again:?}");
    };
    let mut second = [0; MAX_FRAME_LEN];
    assert_eq!(Encoder::new().encode(again, &mut second), Ok(&bytes[..]));
}

/// These bytes as the content of one good frame of our version.
fn sealed(content: &[u8]) -> Vec<u8> {
    let mut payload = vec![nova_wire::PROTOCOL_VERSION];
    payload.extend(content);
    let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(&payload);
    payload.extend(crc.to_le_bytes());
    let mut frame = vec![0];
    frame.extend(cobs::encode_vec(&payload));
    frame.push(0);
    frame
}

/// A frame from the air: what is taken for one of ours says the same when sent.
///
/// # Panics
/// If not.
pub fn air_frame(bytes: &[u8]) {
    for bytes in [bytes.to_vec(), sealed_frame(bytes)] {
        let Ok(frame) = Frame::parse(&bytes) else {
            continue;
        };
        let sent = frame.encode();
        assert_eq!(&sent[..], &bytes[..]);
        assert_eq!(Frame::parse(&sent).ok(), Some(frame));
    }
}

/// These bytes as a frame of our kind and protocol, with a good check.
fn sealed_frame(content: &[u8]) -> Vec<u8> {
    let mut frame = content.to_vec();
    for (place, value) in [(0, 0x41), (1, 0x88), (9, 0xD6)] {
        if let Some(byte) = frame.get_mut(place) {
            *byte = value;
        }
    }
    let check = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740).checksum(&frame);
    frame.extend(check.to_le_bytes());
    frame
}

/// A radio that nobody answers on.
struct NoRadio;

impl embedded_hal::spi::ErrorType for NoRadio {
    type Error = embedded_hal::spi::ErrorKind;
}

impl embedded_hal::spi::SpiDevice for NoRadio {
    fn transaction(
        &mut self,
        _: &mut [embedded_hal::spi::Operation<'_, u8>],
    ) -> Result<(), Self::Error> {
        Err(embedded_hal::spi::ErrorKind::Other)
    }
}

impl RadioBus for NoRadio {
    fn set_speed(&mut self, _: SpiSpeed) {}
}

impl embedded_hal::digital::ErrorType for NoRadio {
    type Error = Infallible;
}

impl embedded_hal::digital::OutputPin for NoRadio {
    fn set_low(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
    fn set_high(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

impl embedded_hal::delay::DelayNs for NoRadio {
    fn delay_ns(&mut self, _: u32) {}
}

const SETTINGS: core::ops::Range<u32> = 0..2 * PAGE_BYTES as u32;

/// Bytes from a host, at a node: each whole command is answered once, what
/// is refused changes nothing, and what the node then works by is what it
/// would work by after a restart.
///
/// # Panics
/// If not.
pub fn command_handler(bytes: &[u8]) {
    for stream in [bytes.to_vec(), sealed(bytes)] {
        let flash = Flash::new(2);
        let board = NodeConfig::anchor(Address(7));
        let Ok(mut keeper) = Keeper::new(board.clone(), flash.clone(), SETTINGS) else {
            panic!("two pages are enough");
        };
        let Ok(mut node) = Node::new(NoRadio, NoRadio, NoRadio, keeper.config()) else {
            panic!("the defaults work");
        };
        for (now_us, &byte) in (0..).zip(&stream) {
            let before = keeper.config();
            let mut answers = Vec::new();
            let mut emit = |record: &Record| {
                if let Record::Answer(answer) = record {
                    answers.push(*answer);
                }
            };
            let _ = keeper.on_bytes(&[byte], &mut node, now_us, &mut emit);
            assert!(answers.len() <= 1);
            if matches!(answers.first(), Some(a) if a.outcome != Outcome::Done) {
                assert_eq!(keeper.config(), before);
            }
            assert_eq!(keeper.config().check(), Ok(()));
        }
        let mut decoder = CommandDecoder::new();
        let commands: Vec<CommandEvent> = stream.iter().filter_map(|&b| decoder.push(b)).collect();
        commands.iter().for_each(round_trip);
        let adopted = commands.iter().any(|event| {
            matches!(
                event,
                CommandEvent::Record {
                    record: Command::Set(_) | Command::Reset,
                    ..
                }
            )
        });
        if adopted {
            let Ok(again) = Keeper::new(board, flash, SETTINGS) else {
                panic!("two pages are enough");
            };
            let (mut now, mut then) = (keeper.config(), again.config());
            // Said differently before and after a restart when all was refused.
            now.settings = nova_wire::SettingsSource::Stored;
            then.settings = nova_wire::SettingsSource::Stored;
            assert_eq!(now, then);
        }
    }
}

/// An image from flash: what is taken for settings makes a configuration, or
/// is noticed not to.
///
/// # Panics
/// If not.
pub fn settings_image(bytes: &[u8]) {
    let Some(settings) = settings_of_image(bytes) else {
        return;
    };
    for change in settings.changes() {
        let mut one = nova_wire::Settings::new();
        assert_eq!(one.change(&change), Ok(()), "each is within its range");
    }
}
