//! How soon a frame can be answered.
//!
//! ```text
//!  frame received        |marker ── rest ──|
//!  board                                   |wake|── take ──|── answer ──|guard|
//!  frame sent                                                           |start-up|── preamble ──|marker
//!                        |<------------------------ reply time ------------------------------->|
//! ```
//!
//! Turn times are counted from marker to marker, as those are what is time-stamped. Nothing in here is a guess: air
//! times follow from the profile, transfers from their number and length and the bus's clock, and the processor's part
//! is measured (docs/air-time.md).

use super::PhyProfile;
use crate::time::Ticks;

/// What a board spends on one step, beyond the bytes of the frame that it handles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Work {
    /// Transactions on the bus.
    pub transactions: u32,
    /// Bytes on the bus, headers included, the frame's own not.
    pub bytes: u32,
    /// The processor's own time, in nanoseconds.
    pub cpu_ns: u32,
}

/// What answering costs on one kind of board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Budget {
    /// Clock of the bus to the radio, in Hz.
    pub spi_hz: u32,
    /// What a transaction costs beside its bits, in nanoseconds.
    pub transaction_ns: u32,
    /// From the radio's interrupt until the code that answers runs, in nanoseconds.
    pub wake_ns: u32,
    /// From there until the received frame and its time stamp are in memory.
    pub take: Work,
    /// From there until the radio has its orders.
    pub answer: Work,
    /// From the frame in memory until the receiver is told to go on.
    pub listen: Work,
    /// What the radio's transmitter needs from its orders to the first symbol, in nanoseconds.
    pub transmitter_ns: u32,
    /// What the radio's receiver needs until it hears, in nanoseconds.
    pub receiver_ns: u32,
    /// What is left for anything unforeseen, in nanoseconds.
    pub guard_ns: u32,
}

/// The time from one frame to the next, from marker to marker, and what it is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Turn {
    /// The rest of the received frame, behind its marker.
    pub rest: Ticks,
    /// Interrupt.
    pub wake: Ticks,
    /// The bus's part of taking the frame in and giving orders.
    pub bus: Ticks,
    /// The processor's part of the same.
    pub cpu: Ticks,
    /// The radio's own start, of its transmitter or its receiver.
    pub start_up: Ticks,
    /// Left for anything unforeseen.
    pub guard: Ticks,
    /// Preamble and start-of-frame delimiter of the second frame.
    pub preamble: Ticks,
}

impl Turn {
    /// From marker to marker.
    pub const fn total(&self) -> Ticks {
        Ticks::new(self.rest.get() + self.silence().get() + self.preamble.get())
    }

    /// From the last bit of the one frame to the first symbol of the other.
    pub const fn silence(&self) -> Ticks {
        Ticks::new(
            self.wake.get()
                + self.bus.get()
                + self.cpu.get()
                + self.start_up.get()
                + self.guard.get(),
        )
    }
}

impl Budget {
    /// The shortest time in which a frame of `received` bytes can be answered by one of `sent` bytes, frame check
    /// sequences not counted.
    pub const fn reply(&self, profile: &PhyProfile, received: usize, sent: usize) -> Turn {
        self.turn(profile, received, &self.answer, sent, self.transmitter_ns)
    }

    /// The shortest time in which a frame of `received` bytes can be followed by another that is to be received too.
    pub const fn slot(&self, profile: &PhyProfile, received: usize) -> Turn {
        self.turn(profile, received, &self.listen, 0, self.receiver_ns)
    }

    const fn turn(
        &self,
        profile: &PhyProfile,
        received: usize,
        then: &Work,
        sent: usize,
        start_up_ns: u32,
    ) -> Turn {
        Turn {
            rest: profile.marker_to_end(received),
            wake: Ticks::from_ns(self.wake_ns as u64),
            bus: Ticks::from_ns(
                self.bus_ns(&self.take, received as u64) + self.bus_ns(then, sent as u64),
            ),
            cpu: Ticks::from_ns(self.take.cpu_ns as u64 + then.cpu_ns as u64),
            start_up: Ticks::from_ns(start_up_ns as u64),
            guard: Ticks::from_ns(self.guard_ns as u64),
            preamble: profile.preamble_to_marker(),
        }
    }

    /// How long the bus is busy with a step that handles a frame of `frame` bytes, in nanoseconds.
    pub const fn bus_ns(&self, work: &Work, frame: u64) -> u64 {
        let bits = 8 * (work.bytes as u64 + frame);
        let hz = if self.spi_hz == 0 {
            1
        } else {
            self.spi_hz as u64
        };
        bits.saturating_mul(1_000_000_000).div_ceil(hz)
            + work.transactions as u64 * self.transaction_ns as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const BUDGET: Budget = Budget {
        spi_hz: 8_000_000,
        transaction_ns: 3_000,
        wake_ns: 5_000,
        take: Work {
            transactions: 3,
            bytes: 20,
            cpu_ns: 10_000,
        },
        answer: Work {
            transactions: 4,
            bytes: 15,
            cpu_ns: 20_000,
        },
        listen: Work {
            transactions: 2,
            bytes: 8,
            cpu_ns: 5_000,
        },
        transmitter_ns: 10_000,
        receiver_ns: 16_000,
        guard_ns: 15_000,
    };

    #[test]
    fn a_reply_is_the_sum_of_its_parts() {
        let reply = BUDGET.reply(&PhyProfile::DEFAULT, 12, 22);
        // 7 transactions, and 20 + 12 + 15 + 22 bytes at 1 us each.
        assert_eq!(reply.bus, Ticks::from_ns(21_000 + 69_000));
        assert_eq!(reply.cpu, Ticks::from_ns(30_000));
        assert!(reply.silence().get().abs_diff(Ticks::from_us(150).get()) < 10);
        let frames = PhyProfile::DEFAULT.marker_to_end(12).get()
            + PhyProfile::DEFAULT.preamble_to_marker().get();
        assert_eq!(reply.total().get(), reply.silence().get() + frames);
    }

    #[test]
    fn listening_on_takes_less_than_answering() {
        let slot = BUDGET.slot(&PhyProfile::DEFAULT, 14);
        // 5 transactions, 20 + 14 + 8 bytes.
        assert_eq!(slot.bus, Ticks::from_ns(15_000 + 42_000));
        assert!(slot.total() < BUDGET.reply(&PhyProfile::DEFAULT, 14, 24).total());
    }

    proptest! {
        #[test]
        fn a_slower_bus_never_answers_sooner(hz in 1_000_000u32..20_000_000, slower in 0u32..900_000) {
            let reply = |spi_hz| {
                Budget { spi_hz, ..BUDGET }.reply(&PhyProfile::DEFAULT, 12, 22).total()
            };
            prop_assert!(reply(hz - slower) >= reply(hz));
        }
    }
}
