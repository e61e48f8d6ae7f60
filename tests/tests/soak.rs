//! The short version of `cargo xtask soak`.
#![allow(clippy::unwrap_used)]

use nova_hal_sim::{Mishaps, SimDuration};
use nova_tests::soak::{Faults, Report, run};

fn soak(exchanges: u64, faults: &Faults) -> Report {
    let report = run(exchanges, 1, faults, |_| {}).unwrap();
    println!("{report}");
    report
}

const NONE: Faults = Faults {
    lost: 0.0,
    corrupt: 0.0,
    repeated: 0.0,
    mishaps: Mishaps {
        spi_bit_error: 0.0,
        late_interrupt: 0.0,
        late_by: SimDuration::ZERO,
        brown_outs_per_s: 0.0,
        stuck_receivers_per_s: 0.0,
    },
    uart_stall: SimDuration::ZERO,
};

#[test]
fn with_everything_going_wrong_nothing_hangs_and_no_wrong_range_passes() {
    let report = soak(60_000, &Faults::all());
    assert!(report.passes());
    // All of it has been there, and all of it has been counted.
    let m = report.mishaps;
    assert!(report.air.iter().all(|&count| count > 100));
    assert!(
        m.spi_bits > 10 && m.late_interrupts > 100 && m.brown_outs > 0 && m.stuck_receivers > 0
    );
    for counter in [
        "no_response",
        "no_report",
        "no_final",
        "not_heard",
        "damaged_frames",
        "silences",
        "send_too_late",
        "radio_resets",
        "records_dropped",
    ] {
        assert!(report.counters.get(counter) > 0, "{counter}");
    }
}

#[test]
fn without_faults_nothing_fails() {
    let report = soak(5_000, &NONE);
    assert!(report.passes() && report.flagged == 0);
    for counter in [
        "no_response",
        "no_final",
        "no_report",
        "radio_resets",
        "bad_stamps",
    ] {
        assert!(
            report.counters.get(counter) * 100 < report.ranges,
            "{counter}"
        );
    }
}

/// Bits on the SPI alone, a hundred times as often.
#[test]
fn no_bit_lost_on_the_spi_makes_a_wrong_range() {
    let faults = Faults {
        mishaps: Mishaps {
            spi_bit_error: 1e-5,
            ..NONE.mishaps
        },
        ..NONE
    };
    let report = soak(5_000, &faults);
    assert!(report.mishaps.spi_bits > 1_000);
    assert!(report.passes());
}
