//! Receive time stamps that depend on how strong the signal is (application note APS011).
//!
//! The leading edge of a strong signal is found early, that of a weak one late. The note tables what comes of it in
//! two-way ranging, where both sides receive at the same level: the range is off by b. Each receive stamp enters such a
//! range by half, twice a range, so that each is off by b / c:
//!
//! ```text
//! T = (Ra - Db) / 2,   Ra = t4 - t1 is late by b/c at the initiator, Db = t3 - t2 short by b/c at the responder
//! ```
//!
//! The level is that of the whole signal at the antenna, not of its first path, as in the note's measurements. How much
//! one chip differs from the next the note does not say; here none does.

use crate::phy::{Channel, Prf};
use crate::time::TICKS_PER_S;

/// Speed of light in vacuum, m/s.
const C_M_PER_S: f64 = 299_792_458.0;

/// Level in dBm; bias of ranges in mm at 500 MHz bandwidth with PRF 16 and 64 MHz, and at 900 MHz with both.
const TABLE: [(f64, [f64; 4]); 18] = [
    (-61.0, [-198.0, -110.0, -274.0, -294.0]),
    (-63.0, [-187.0, -105.0, -244.0, -266.0]),
    (-65.0, [-179.0, -100.0, -210.0, -234.0]),
    (-67.0, [-163.0, -93.0, -176.0, -198.0]),
    (-69.0, [-143.0, -82.0, -138.0, -150.0]),
    (-71.0, [-127.0, -69.0, -94.0, -100.0]),
    (-73.0, [-109.0, -51.0, -50.0, -58.0]),
    (-75.0, [-84.0, -27.0, 0.0, 0.0]),
    (-77.0, [-59.0, 0.0, 42.0, 48.0]),
    (-79.0, [-31.0, 21.0, 96.0, 90.0]),
    (-81.0, [0.0, 35.0, 158.0, 126.0]),
    (-83.0, [36.0, 42.0, 210.0, 152.0]),
    (-85.0, [65.0, 49.0, 254.0, 174.0]),
    (-87.0, [84.0, 62.0, 294.0, 196.0]),
    (-89.0, [97.0, 71.0, 320.0, 232.0]),
    (-91.0, [106.0, 76.0, 338.0, 244.0]),
    (-93.0, [110.0, 81.0, 356.0, 264.0]),
    (-95.0, [112.0, 86.0, 394.0, 284.0]),
];

/// How late a receive time stamp is at this level, in ticks: linear between the table's entries, constant beyond them.
pub(super) fn stamp_bias_ticks(channel: Channel, prf: Prf, level_dbm: f64) -> f64 {
    let column = match (channel, prf) {
        (Channel::Ch4 | Channel::Ch7, Prf::Mhz16) => 2,
        (Channel::Ch4 | Channel::Ch7, Prf::Mhz64) => 3,
        (_, Prf::Mhz16) => 0,
        (_, Prf::Mhz64) => 1,
    };
    let [(strongest, _), .., (weakest, _)] = TABLE;
    let level = level_dbm.clamp(weakest, strongest);
    let mm = TABLE
        .windows(2)
        .find_map(|pair| match pair {
            [(above, a), (below, b)] if level >= *below => {
                let part = (above - level) / (above - below);
                Some(a[column] + (b[column] - a[column]) * part)
            }
            _ => None,
        })
        .unwrap_or(0.0);
    mm * 1e-3 / C_M_PER_S * TICKS_PER_S as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_follow_the_table_between_its_entries_and_end_with_it() {
        let mm = |channel, prf, dbm| {
            stamp_bias_ticks(channel, prf, dbm) / TICKS_PER_S as f64 * C_M_PER_S * 1e3
        };
        for (channel, prf, dbm, expected) in [
            (Channel::Ch5, Prf::Mhz64, -63.0, -105.0),
            (Channel::Ch5, Prf::Mhz64, -76.0, -13.5),
            (Channel::Ch2, Prf::Mhz16, -94.0, 111.0),
            (Channel::Ch7, Prf::Mhz64, -61.0, -294.0),
            (Channel::Ch4, Prf::Mhz16, -40.0, -274.0),
            (Channel::Ch7, Prf::Mhz16, -110.0, 394.0),
        ] {
            let got = mm(channel, prf, dbm);
            assert!(
                (got - expected).abs() < 1e-6,
                "{channel:?} {prf:?} {dbm}: {got}"
            );
        }
    }
}
