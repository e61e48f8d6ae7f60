//! What firmware logs with defmt through SEGGER's RTT, read out of RAM as a debug probe does.
//!
//! RTT's control block lies at the symbol `_SEGGER_RTT`: 16 bytes that mark it, two counts, then the channels of 24
//! bytes each: name, buffer, size, write offset, read offset, flags.

use defmt_decoder::DecodeError;

use crate::image::Image;
use crate::soc::{CPU_HZ, Cycles, RAM_START};

/// A line of the log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LogLine {
    /// `INFO`, `ERROR` and so on; empty where the firmware gave none.
    pub level: String,
    /// What the firmware's own clock said, as it is displayed.
    pub time: String,
    /// The text.
    pub text: String,
}

/// Where the first channel's fields are.
const BUFFER: u32 = 28;
const SIZE: u32 = 32;
const WRITTEN: u32 = 36;
const READ: u32 = 40;

/// Between two looks, long enough to cost nothing and short enough for a buffer of 1 kB.
const EVERY: Cycles = CPU_HZ / 1000;

pub(crate) struct LogReader {
    image: Image,
    control: Option<u32>,
    looked: Cycles,
    waiting: Vec<u8>,
    lines: Vec<LogLine>,
}

fn word(ram: &[u8], address: u32) -> Option<u32> {
    let offset = address.checked_sub(RAM_START)?;
    let word = ram.get(offset as usize..)?.first_chunk()?;
    Some(u32::from_le_bytes(*word))
}

impl LogReader {
    pub(crate) fn new(image: &Image) -> Self {
        let control = image.log_table().and(image.symbol("_SEGGER_RTT"));
        LogReader {
            image: image.clone(),
            control,
            looked: 0,
            waiting: Vec::new(),
            lines: Vec::new(),
        }
    }

    pub(crate) fn take(&mut self) -> Vec<LogLine> {
        std::mem::take(&mut self.lines)
    }

    pub(crate) fn poll_now_and_then(&mut self, ram: &mut [u8], now: Cycles) {
        if now >= self.looked + EVERY {
            self.looked = now;
            self.poll(ram);
        }
    }

    /// Takes what is in the buffer.
    pub(crate) fn poll(&mut self, ram: &mut [u8]) {
        if let Some(control) = self.control
            && let Some(bytes) = drain(ram, control)
            && !bytes.is_empty()
        {
            self.waiting.extend(bytes);
            self.decode();
        }
    }

    fn decode(&mut self) {
        let image = self.image.clone();
        let Some(table) = image.log_table() else {
            return;
        };
        // Each frame ends with a zero byte (defmt's rzCOBS); what is behind the last waits for the rest.
        let Some(end) = self.waiting.iter().rposition(|&byte| byte == 0) else {
            return;
        };
        let rest = self.waiting.split_off(end + 1);
        let mut decoder = table.new_stream_decoder();
        decoder.received(&std::mem::replace(&mut self.waiting, rest));
        loop {
            match decoder.decode() {
                Ok(frame) => self.lines.push(LogLine {
                    level: frame
                        .level()
                        .map_or_else(String::new, |level| level.as_str().to_uppercase()),
                    time: frame
                        .display_timestamp()
                        .map_or_else(String::new, |time| time.to_string()),
                    text: frame.display_message().to_string(),
                }),
                Err(DecodeError::UnexpectedEof) => return,
                Err(DecodeError::Malformed) => self.lines.push(LogLine {
                    level: String::new(),
                    time: String::new(),
                    text: "(a log line that cannot be read)".to_owned(),
                }),
            }
        }
    }
}

/// The bytes of the first channel; `None` while there is no buffer.
fn drain(ram: &mut [u8], control: u32) -> Option<Vec<u8>> {
    let field = |offset| word(ram, control + offset);
    let (buffer, size) = (field(BUFFER)?, field(SIZE)?);
    let (written, mut read) = (field(WRITTEN)?, field(READ)?);
    if size == 0 || size > 0x1_0000 || written >= size || read >= size || written == read {
        return None;
    }
    let start = buffer.checked_sub(RAM_START)?;
    let mut bytes = Vec::new();
    while read != written {
        bytes.push(*ram.get((start + read) as usize)?);
        read = (read + 1) % size;
    }
    let place = (control.checked_sub(RAM_START)? + READ) as usize;
    *ram.get_mut(place..)?.first_chunk_mut()? = written.to_le_bytes();
    Some(bytes)
}
