//! The UART between board and host.

use std::collections::VecDeque;

use super::config::UartConfig;
use super::core::Port;
use crate::time::{SimDuration, SimTime};

/// Bytes that the host received from a board.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UartChunk {
    /// When the last of them was in.
    pub t: SimTime,
    /// What one write of the board put on the wire.
    pub bytes: Vec<u8>,
}

/// A start bit, eight data bits, a stop bit.
const BITS_PER_BYTE: u64 = 10;

/// Both directions of one board's UART.
#[derive(Debug)]
pub(crate) struct UartState {
    config: UartConfig,
    to_host: VecDeque<UartChunk>,
    to_host_busy_until: SimTime,
    to_board: VecDeque<(SimTime, u8)>,
    to_board_busy_until: SimTime,
    pub(crate) overflow_bytes: u64,
}

impl UartState {
    pub(super) fn new(config: UartConfig) -> Self {
        UartState {
            config,
            to_host: VecDeque::new(),
            to_host_busy_until: SimTime::ZERO,
            to_board: VecDeque::new(),
            to_board_busy_until: SimTime::ZERO,
            overflow_bytes: 0,
        }
    }

    fn byte_time(&self) -> SimDuration {
        SimDuration::of_bits(BITS_PER_BYTE, self.config.baud)
    }

    fn write(&mut self, now: SimTime, bytes: &[u8]) -> usize {
        let waiting = self.to_host_busy_until.since(now).as_fs();
        let waiting_bytes = waiting.div_ceil(self.byte_time().as_fs().max(1)) as usize;
        let room = self.config.buffer_bytes.saturating_sub(waiting_bytes);
        let taken = bytes.len().min(room);
        self.overflow_bytes += (bytes.len() - taken) as u64;
        if let Some(bytes) = bytes.get(..taken).filter(|b| !b.is_empty()) {
            let start = self.to_host_busy_until.max(now);
            let end = start + self.byte_time().times(taken as u64);
            self.to_host_busy_until = end;
            self.to_host.push_back(UartChunk {
                t: end,
                bytes: bytes.to_vec(),
            });
        }
        taken
    }

    fn read(&mut self, now: SimTime, out: &mut [u8]) -> usize {
        let mut n = 0;
        for slot in out {
            match self.to_board.front() {
                Some(&(at, byte)) if at <= now => *slot = byte,
                _ => break,
            }
            self.to_board.pop_front();
            n += 1;
        }
        n
    }

    /// Nothing goes to the host until `until`.
    pub(crate) fn stall(&mut self, until: SimTime) {
        self.to_host_busy_until = self.to_host_busy_until.max(until);
    }

    /// When the line from the host goes idle after bytes that nobody has read yet.
    pub(super) fn idle_after_bytes(&self) -> Option<SimTime> {
        (!self.to_board.is_empty()).then_some(self.to_board_busy_until)
    }

    /// What has reached the host by `now`.
    pub(crate) fn drain(&mut self, now: SimTime) -> Vec<UartChunk> {
        let arrived = self.to_host.iter().take_while(|c| c.t <= now).count();
        self.to_host.drain(..arrived).collect()
    }

    /// The host sends `bytes` as soon as the line is free.
    pub(crate) fn send(&mut self, now: SimTime, bytes: &[u8]) {
        let byte_time = self.byte_time();
        let mut at = self.to_board_busy_until.max(now);
        for &byte in bytes {
            at += byte_time;
            self.to_board.push_back((at, byte));
        }
        self.to_board_busy_until = at;
    }
}

/// Sends bytes to the host in the background.
#[derive(Clone)]
pub struct UartTx(pub(super) Port);

impl UartTx {
    /// Queues `bytes` and returns how many fitted; the rest is dropped and counted. Does not block.
    pub fn write(&mut self, bytes: &[u8]) -> usize {
        self.0.call();
        self.0
            .with_board(|board, now| board.uart.write(now, bytes))
            .unwrap_or(0)
    }

    /// When all that was queued is out, on the processor's clock, in microseconds; that of now, or before, if it is.
    pub fn idle_at_us(&self) -> u64 {
        self.0
            .with_board(|board, _| board.mcu.us_at(board.uart.to_host_busy_until) + 1)
            .unwrap_or(0)
    }
}

/// Receives bytes from the host.
#[derive(Clone)]
pub struct UartRx(pub(super) Port);

impl UartRx {
    /// Takes what has arrived, up to the length of `out`, and returns how much. Does not block.
    pub fn read(&mut self, out: &mut [u8]) -> usize {
        self.0.call();
        self.0
            .with_board(|board, now| board.uart.read(now, out))
            .unwrap_or(0)
    }
}
