//! Frames that wait for the UART.

use heapless::Deque;

/// A bounded queue of frames, `N` bytes in all, one of them a frame's length.
///
/// When a new frame does not fit, the oldest ones go: a host that falls behind wants the newest
/// ranges. What went is counted, and shows on the wire as a gap in the sequence numbers.
pub struct Outbox<const N: usize> {
    /// Frames, oldest first, each behind its length.
    bytes: Deque<u8, N>,
    dropped: u32,
}

impl<const N: usize> Outbox<N> {
    /// An empty queue.
    pub const fn new() -> Self {
        Self {
            bytes: Deque::new(),
            dropped: 0,
        }
    }

    /// Appends `frame`, and drops old ones to make room. A frame that the queue cannot hold at all (more
    /// than 255 bytes, or than `N` - 1) is itself dropped and counted.
    pub fn push(&mut self, frame: &[u8]) {
        let length = match u8::try_from(frame.len()) {
            Ok(length) if frame.len() < N => length,
            _ => {
                self.count_dropped();
                return;
            }
        };
        while N - self.bytes.len() < frame.len() + 1 {
            self.drop_oldest();
        }
        // There is room for all of it now.
        for &byte in [length].iter().chain(frame) {
            let _ = self.bytes.push_back(byte);
        }
    }

    /// Moves as many of the oldest frames as fit into `buffer` and returns how many bytes that were;
    /// never a part of a frame. 0 when nothing waits.
    ///
    /// `buffer` must hold the largest frame that is ever pushed: one that does not fit is dropped and counted.
    pub fn pop(&mut self, buffer: &mut [u8]) -> usize {
        let mut filled = 0;
        while let Some(&length) = self.bytes.front() {
            let Some(target) = buffer.get_mut(filled..filled + usize::from(length)) else {
                if filled > 0 {
                    break;
                }
                self.drop_oldest();
                continue;
            };
            self.bytes.pop_front();
            for (slot, byte) in target
                .iter_mut()
                .zip(core::iter::from_fn(|| self.bytes.pop_front()))
            {
                *slot = byte;
            }
            filled += usize::from(length);
        }
        filled
    }

    /// Whether nothing waits.
    pub fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }

    /// How many frames were dropped since this was asked last.
    pub fn take_dropped(&mut self) -> u32 {
        core::mem::take(&mut self.dropped)
    }

    fn drop_oldest(&mut self) {
        let length = self.bytes.pop_front().unwrap_or(0);
        for _ in 0..length {
            self.bytes.pop_front();
        }
        self.count_dropped();
    }

    fn count_dropped(&mut self) {
        self.dropped = self.dropped.saturating_add(1);
    }
}

impl<const N: usize> Default for Outbox<N> {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use std::vec;
    use std::vec::Vec;

    fn frame(tag: u8, length: usize) -> Vec<u8> {
        vec![tag; length]
    }

    fn pop<const N: usize>(outbox: &mut Outbox<N>, room: usize) -> Vec<u8> {
        let mut buffer = vec![0; room];
        let length = outbox.pop(&mut buffer);
        buffer.truncate(length);
        buffer
    }

    #[test]
    fn frames_leave_in_the_order_they_came_several_at_a_time() {
        let mut outbox: Outbox<64> = Outbox::new();
        for tag in 1..=4 {
            outbox.push(&frame(tag, 10));
        }
        assert_eq!(pop(&mut outbox, 25), [frame(1, 10), frame(2, 10)].concat());
        assert_eq!(pop(&mut outbox, 25), [frame(3, 10), frame(4, 10)].concat());
        assert!(pop(&mut outbox, 25).is_empty());
        assert_eq!(outbox.take_dropped(), 0);
    }

    #[test]
    fn a_full_queue_drops_the_oldest_whole_frames_and_counts_them() {
        let mut outbox: Outbox<36> = Outbox::new();
        for tag in 1..=3 {
            outbox.push(&frame(tag, 10));
        }
        // 36 - 3 * 11 = 3 bytes are free: a frame of 15 with its length needs frames 1 and 2 gone.
        outbox.push(&frame(4, 15));
        assert_eq!(outbox.take_dropped(), 2);
        assert_eq!(pop(&mut outbox, 64), [frame(3, 10), frame(4, 15)].concat());
    }

    #[test]
    fn a_frame_that_fills_the_queue_exactly_is_kept() {
        let mut outbox: Outbox<17> = Outbox::new();
        outbox.push(&frame(1, 16));
        outbox.push(&frame(2, 16));
        assert_eq!(pop(&mut outbox, 16), frame(2, 16));
        assert_eq!(outbox.take_dropped(), 1);
    }

    #[test]
    fn what_can_never_be_sent_whole_is_dropped_and_counted() {
        let mut outbox: Outbox<1000> = Outbox::new();
        outbox.push(&frame(1, 256));
        assert_eq!(outbox.take_dropped(), 1);
        outbox.push(&frame(2, 255));
        outbox.push(&frame(3, 8));
        assert_eq!(
            pop(&mut outbox, 20),
            frame(3, 8),
            "255 bytes fit the queue but not this buffer"
        );
        assert_eq!(outbox.take_dropped(), 1);

        let mut small: Outbox<16> = Outbox::new();
        small.push(&frame(1, 16));
        assert_eq!(small.take_dropped(), 1);
        assert!(pop(&mut small, 20).is_empty());
    }

    #[test]
    fn any_mix_of_pushes_and_pops_yields_whole_frames_in_order_and_loses_none_uncounted() {
        let mut outbox: Outbox<100> = Outbox::new();
        let mut lengths = vec![0];
        let mut received = Vec::new();
        let mut random = 1_u32;
        for tag in 1..=200_u8 {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let length = 1 + (random >> 24) as usize % 39;
            lengths.push(length);
            outbox.push(&frame(tag, length));
            if random & 0x0030_0000 == 0 {
                received.extend(pop(&mut outbox, 40));
            }
        }
        loop {
            let bytes = pop(&mut outbox, 40);
            if bytes.is_empty() {
                break;
            }
            received.extend(bytes);
        }
        let mut tags = Vec::new();
        for run in received.chunk_by(|a, b| a == b) {
            assert_eq!(run.len(), lengths[usize::from(run[0])], "a cut frame");
            tags.push(run[0]);
        }
        assert!(tags.is_sorted_by(|a, b| a < b), "{tags:?}");
        let dropped = outbox.take_dropped() as usize;
        assert_eq!(tags.len() + dropped, 200);
        assert!(dropped > 0 && tags.len() > 20, "both paths must have run");
    }
}
