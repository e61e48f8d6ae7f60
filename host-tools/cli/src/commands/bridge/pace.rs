//! A recorded board at the pace at which it spoke.

use nova_wire::{Decoder, Event, Record};
use std::io::{self, Read};
use std::time::{Duration, Instant};

/// Hands a capture on frame by frame, each when it is due.
pub(super) struct Paced {
    bytes: Vec<u8>,
    next: usize,
    decoder: Decoder,
    start: Option<(Instant, u64)>,
}

impl Paced {
    /// The capture as it was read.
    pub(super) fn new(bytes: Vec<u8>) -> Self {
        Self {
            bytes,
            next: 0,
            decoder: Decoder::new(),
            start: None,
        }
    }

    /// When to hand on what was just read, if it says.
    fn due(&mut self, t_us: u64) -> Duration {
        /// A pause of the board, or a clock that jumped, need not be waited out.
        const LONGEST: Duration = Duration::from_secs(2);
        let now = Instant::now();
        let &mut (start, first_us) = self.start.get_or_insert((now, t_us));
        let Some(since_us) = t_us.checked_sub(first_us) else {
            // It has started again.
            self.start = Some((now, t_us));
            return Duration::ZERO;
        };
        let wait = (start + Duration::from_micros(since_us)).saturating_duration_since(now);
        if wait > LONGEST {
            self.start = Some((now, t_us));
            return Duration::ZERO;
        }
        wait
    }
}

impl Read for Paced {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let rest = self.bytes.get(self.next..).unwrap_or_default();
        // Frames end with a zero byte.
        let frame = rest
            .iter()
            .position(|&byte| byte == 0)
            .map_or(rest.len(), |end| end + 1);
        let count = frame.min(buffer.len());
        let piece = rest.get(..count).unwrap_or_default().to_vec();
        for event in piece
            .iter()
            .filter_map(|&byte| self.decoder.push(byte))
            .collect::<Vec<_>>()
        {
            if let Event::Record {
                record: Record::Range(range),
                ..
            } = event
            {
                std::thread::sleep(self.due(range.t_us));
            }
        }
        for (to, from) in buffer.iter_mut().zip(&piece) {
            *to = *from;
        }
        self.next += count;
        Ok(count)
    }
}
