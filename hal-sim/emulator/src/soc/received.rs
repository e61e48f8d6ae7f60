//! Bytes that came in and wait for the processor to read RXD, as the older SPI and UART have them: the byte that RXD
//! shows and those behind it. The event that RXD is ready comes when a byte moves there, not with every byte.

use std::collections::VecDeque;

use super::Lines;
use super::block::Block;

pub(super) struct Received {
    bytes: VecDeque<u8>,
    room: usize,
    ready: u16,
}

impl Received {
    /// Room for so many bytes; `ready` is the event.
    pub(super) fn new(room: usize, ready: u16) -> Self {
        Received {
            bytes: VecDeque::new(),
            room,
            ready,
        }
    }

    pub(super) fn clear(&mut self) {
        self.bytes.clear();
    }

    /// A byte has come in: whether RXD shows it now, or `None` if there was no room for it.
    pub(super) fn push(&mut self, byte: u8) -> Option<bool> {
        if self.bytes.len() >= self.room {
            return None;
        }
        self.bytes.push_back(byte);
        Some(self.bytes.len() == 1)
    }

    /// The processor reads RXD; 0 where nothing came in.
    pub(super) fn read(&mut self, block: &mut Block, lines: &mut Lines<'_>) -> u32 {
        let byte = self.take().unwrap_or(0);
        if !self.bytes.is_empty() {
            lines.raise(block, self.ready);
        }
        byte.into()
    }

    /// EasyDMA takes the first byte.
    pub(super) fn take(&mut self) -> Option<u8> {
        self.bytes.pop_front()
    }
}
