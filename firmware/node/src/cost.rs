//! What ranging costs on a DWM1001 (nRF52832 at 64 MHz, SPI at 8 MHz).
//!
//! Transactions and bytes are those of `radio/`; a test counts them there. The processor's part is counted in
//! instructions of the firmware itself, run on an emulated board, with an allowance of a quarter for instructions of
//! more than one cycle: docs/air-time.md has the figures.

use nova_ranging::phy::{Budget, Work};

/// Frames.
pub const DWM1001: Budget = Budget {
    spi_hz: 8_000_000,
    transaction_ns: 5_500,
    wake_ns: 51_000,
    take: Work {
        transactions: 5,
        bytes: 23,
        cpu_ns: 0,
    },
    answer: Work {
        transactions: 4,
        bytes: 14,
        // A final taken in, a report made: the most of all.
        cpu_ns: 133_000,
    },
    listen: Work {
        transactions: 4,
        bytes: 17,
        cpu_ns: 108_000,
    },
    // Not in the manual, which says "a few microseconds" (3.3).
    transmitter_ns: 10_000,
    // 7.2.15, RXENAB.
    receiver_ns: 16_000,
    guard_ns: 15_000,
};

/// Making a record of a range, framing it and queueing it for the serial port, in nanoseconds.
pub const RECORD_NS: u32 = 119_000;
