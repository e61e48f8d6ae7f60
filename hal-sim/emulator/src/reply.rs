//! Where the time of an answer goes: from the radio's interrupt to the command that sends, and on to the frame's first
//! symbol. Found from outside: the firmware does nothing for it.
//!
//! ```text
//!  interrupt ─latency─► first instruction ─SPI and processor─► TXSTRT written ─radio─► preamble leaves
//! ```

use crate::soc::Cycles;

/// Sums over all answers, in cycles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Replies {
    /// How many there were: frames that were sent in the same go in which an interrupt was served.
    pub count: u64,
    /// From the interrupt line's edge to the first instruction.
    pub latency: Cycles,
    /// Bits on the SPI.
    pub spi: Cycles,
    /// The rest until TXSTRT was written: the processor's work.
    pub processor: Cycles,
    /// From there until the preamble leaves: the radio waits for its time and starts.
    pub radio: Cycles,
}

/// Watches one board.
#[derive(Debug, Default)]
pub(crate) struct Watch {
    state: State,
    pub(crate) replies: Replies,
}

#[derive(Debug, Default, Clone, Copy)]
enum State {
    #[default]
    Idle,
    Raised {
        at: Cycles,
    },
    Serving {
        raised: Cycles,
        woke: Cycles,
        spi: Cycles,
    },
    Told {
        at: Cycles,
    },
}

/// SYS_CTRL's header byte for writing, without and with a sub-index, and its TXSTRT bit (DW1000 User Manual 2.2.1,
/// 7.2.15).
const WRITE_SYS_CTRL: u8 = 0x80 | 0x0D;
const WRITE_SYS_CTRL_AT: u8 = WRITE_SYS_CTRL | 0x40;
const TXSTRT: u8 = 1 << 1;

impl Watch {
    /// The interrupt line went high.
    pub(crate) fn raised(&mut self, now: Cycles) {
        self.state = State::Raised { at: now };
    }

    /// Whether the first instruction is awaited.
    pub(crate) fn waits(&self) -> bool {
        matches!(self.state, State::Raised { .. })
    }

    /// An instruction begins.
    pub(crate) fn executes(&mut self, now: Cycles) {
        if let State::Raised { at } = self.state {
            self.state = State::Serving {
                raised: at,
                woke: now,
                spi: 0,
            };
        }
    }

    /// The processor goes to sleep: whatever it served, no answer came of it.
    pub(crate) fn sleeps(&mut self) {
        if let State::Serving { .. } = self.state {
            self.state = State::Idle;
        }
    }

    /// Bytes are clocked to the radio, for so long from now on.
    pub(crate) fn transfers(&mut self, mosi: &[u8], now: Cycles, takes: Cycles) {
        let State::Serving { raised, woke, spi } = &mut self.state else {
            return;
        };
        *spi += takes;
        let told = match mosi {
            [WRITE_SYS_CTRL, control, ..] | [WRITE_SYS_CTRL_AT, 0, control, ..] => {
                control & TXSTRT != 0
            }
            _ => false,
        };
        if told {
            let end = now + takes;
            self.replies.count += 1;
            self.replies.latency += *woke - *raised;
            self.replies.spi += *spi;
            self.replies.processor += (end - *woke).saturating_sub(*spi);
            self.state = State::Told { at: end };
        }
    }

    /// A frame's preamble begins to leave.
    pub(crate) fn sends(&mut self, now: Cycles) {
        if let State::Told { at } = self.state {
            self.replies.radio += now.saturating_sub(at);
            self.state = State::Idle;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answers_parts_add_up_to_the_time_from_interrupt_to_preamble() {
        let mut watch = Watch::default();
        watch.raised(100);
        watch.executes(112);
        watch.transfers(&[0x0F, 0, 0, 0, 0], 200, 40);
        watch.transfers(&[WRITE_SYS_CTRL, TXSTRT | 4], 300, 16);
        watch.sends(1_000);
        let replies = watch.replies;
        assert_eq!((replies.count, replies.latency, replies.spi), (1, 12, 56));
        let sum = replies.latency + replies.spi + replies.processor + replies.radio;
        assert_eq!(sum, 1_000 - 100);
    }

    #[test]
    fn a_frame_that_no_interrupt_asked_for_is_no_answer() {
        let mut watch = Watch::default();
        watch.raised(100);
        watch.executes(112);
        watch.sleeps();
        watch.transfers(&[WRITE_SYS_CTRL, TXSTRT], 300, 16);
        watch.sends(400);
        assert_eq!(watch.replies, Replies::default());
    }
}
