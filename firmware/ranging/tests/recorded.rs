//! The formula on stamps recorded by real radios, against exact rational
//! arithmetic, and beside the two formulas that it replaces.
//!
//! The recording is not ours to publish: the test looks for it in the folder
//! `NOVA_DATA`, or `../shared/data` beside the repository, and says so when it
//! is not there.
#![allow(clippy::unwrap_used)]

use nova_ranging::time::TICKS_PER_SECOND;
use nova_ranging::tof::SPEED_OF_LIGHT_AIR_M_PER_S;
use nova_ranging::{DeviceTime, Intervals, Stamps, TwoWay};
use num_bigint::BigInt;
use num_rational::BigRational;
use std::io::Write as _;
use std::path::PathBuf;

struct Row {
    stamps: [u64; 6],
    surveyed_m: f64,
}

fn recording() -> Option<Vec<Row>> {
    let folder = std::env::var_os("NOVA_DATA").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"),
        PathBuf::from,
    );
    let path = folder.join("A1_dstwr_ticks_iiot20/tag1.csv");
    let Ok(mut reader) = csv::Reader::from_path(&path) else {
        // Past the capture of the test runner: a skip is to be seen.
        let _ = writeln!(
            std::io::stderr(),
            "skipped: no recording at {}",
            path.display()
        );
        return None;
    };
    let headers = reader.headers().unwrap().clone();
    let column = |name: &str| headers.iter().position(|h| h == name).unwrap();
    let stamps = ["t1", "t2", "t3", "t4", "t5", "t6"].map(|t| column(&format!("{t}_ticks")));
    let surveyed = column("gt_mm");
    let rows = reader
        .records()
        .map(|r| {
            let r = r.unwrap();
            Row {
                stamps: stamps.map(|c| r[c].parse().unwrap()),
                surveyed_m: r[surveyed].parse::<f64>().unwrap() / 1000.0,
            }
        })
        .collect();
    Some(rows)
}

fn intervals(row: &Row) -> Intervals {
    let [
        poll_tx,
        poll_rx,
        response_tx,
        response_rx,
        final_tx,
        final_rx,
    ] = row.stamps.map(DeviceTime::from_ticks);
    Intervals::from(&Stamps {
        poll_tx,
        poll_rx,
        response_tx,
        response_rx,
        final_tx,
        final_rx,
    })
}

fn exact_range_m(row: &Row) -> f64 {
    let span = |later: u64, earlier: u64| {
        let modulus = BigInt::from(1u64 << 40);
        let d = BigInt::from(later) - BigInt::from(earlier);
        ((d % &modulus) + &modulus) % &modulus
    };
    let [t1, t2, t3, t4, t5, t6] = row.stamps;
    let (ra, db, rb, da) = (span(t4, t1), span(t3, t2), span(t6, t3), span(t5, t4));
    let tof = BigRational::new(&ra * &rb - &da * &db, ra + rb + da + db);
    let metres = tof
        * BigRational::new(
            BigInt::from(SPEED_OF_LIGHT_AIR_M_PER_S as u64),
            BigInt::from(TICKS_PER_SECOND),
        );
    // Whole nanometres first: exact enough, and small enough for f64.
    let nm = (metres * BigInt::from(1_000_000_000u64)).to_integer();
    nm.to_string().parse::<f64>().unwrap() * 1e-9
}

#[test]
fn every_recorded_exchange_is_exact_to_a_tenth_of_a_millimetre() {
    let Some(rows) = recording() else { return };
    let mut wrapping = 0;
    let mut worst: f64 = 0.0;
    for row in &rows {
        let range = TwoWay::from_intervals(&intervals(row))
            .unwrap()
            .range_m(SPEED_OF_LIGHT_AIR_M_PER_S);
        worst = worst.max((range - exact_range_m(row)).abs());
        let [t1, t2, t3, t4, t5, t6] = row.stamps;
        wrapping += usize::from(t1 > t4 || t4 > t5 || t2 > t3 || t3 > t6);
    }
    println!(
        "{} exchanges, {wrapping} with a wrap: at most {worst:.1e} m off",
        rows.len()
    );
    assert!(rows.len() > 500 && wrapping > 0);
    assert!(worst < 1e-4);
}

#[test]
fn simpler_formulas_are_tens_of_metres_off_on_the_same_stamps() {
    let Some(rows) = recording() else { return };
    let metres_per_tick = SPEED_OF_LIGHT_AIR_M_PER_S / TICKS_PER_SECOND as f64;
    let rms = |range: &dyn Fn(&Intervals) -> f64| {
        let sum: f64 = rows
            .iter()
            .map(|r| (range(&intervals(r)) - r.surveyed_m).powi(2))
            .sum();
        (sum / rows.len() as f64).sqrt()
    };
    let seconds = |i: &Intervals| {
        [
            i.initiator_round,
            i.responder_reply,
            i.responder_round,
            i.initiator_reply,
        ]
        .map(|t| t.get() as f64)
    };
    let single_sided = rms(&|i| {
        let [ra, db, _, _] = seconds(i);
        (ra - db) / 2.0 * metres_per_tick
    });
    let symmetric = rms(&|i| {
        let [ra, db, rb, da] = seconds(i);
        (ra - db + rb - da) / 4.0 * metres_per_tick
    });
    let asymmetric = rms(&|i| {
        TwoWay::from_intervals(i)
            .unwrap()
            .range_m(SPEED_OF_LIGHT_AIR_M_PER_S)
    });
    println!(
        "rms error: single-sided {single_sided:.1} m, symmetric {symmetric:.1} m, asymmetric {asymmetric:.3} m"
    );
    assert!(single_sided > 50.0);
    assert!(symmetric > 20.0);
    assert!(asymmetric < 0.2);
}
