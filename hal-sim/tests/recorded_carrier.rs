//! The carrier integrator's sign and scale against recorded exchanges.
//!
//! Needs the data set A1_dstwr_ticks_iiot20 under `$NOVA_DATA` or `../shared/data` beside the repository.

#![allow(clippy::unwrap_used)] // in helpers of tests

use std::path::{Path, PathBuf};

use nova_hal_sim::chip::carrier_integrator;
use nova_hal_sim::clock::COUNTER_WRAP;
use nova_hal_sim::phy::{Channel, DataRate};

fn recording() -> Option<PathBuf> {
    let data = std::env::var_os("NOVA_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"),
        PathBuf::from,
    );
    let file = data.join("A1_dstwr_ticks_iiot20/tag1.csv");
    file.exists().then_some(file)
}

struct Row {
    /// Anchor against tag, from the six time stamps.
    anchor_ppm: f64,
    tag_integrator: Option<i32>,
    anchor_integrator: Option<i32>,
}

fn rows(file: &Path) -> Vec<Row> {
    let mut reader = csv::Reader::from_path(file).unwrap();
    let headers = reader.headers().unwrap().clone();
    let column = |name: &str| headers.iter().position(|h| h == name).unwrap();
    let stamps = [1, 2, 3, 4, 5, 6].map(|i| column(&format!("t{i}_ticks")));
    let tag = column("drx_car_int_u17_tag");
    let anchor = column("drx_car_int_u17_anchor");
    let records = reader.records().map(|record| {
        let record = record.unwrap();
        let t = stamps.map(|i| record[i].parse::<u64>().unwrap());
        let span =
            |from: usize, to: usize| ((t[to] + COUNTER_WRAP - t[from]) % COUNTER_WRAP) as f64;
        // Both sides see the same time pass between the first and the last frame.
        let at_tag = span(0, 4);
        let at_anchor = span(1, 5);
        let integrator = |i: usize| {
            let raw = record[i].parse::<i32>().ok()?;
            Some(if raw >= 1 << 16 { raw - (1 << 17) } else { raw })
        };
        Row {
            anchor_ppm: (at_anchor / at_tag - 1.0) * 1e6,
            tag_integrator: integrator(tag),
            anchor_integrator: integrator(anchor),
        }
    });
    records.collect()
}

#[test]
fn recorded_integrators_have_the_sign_and_scale_of_the_model() {
    let Some(file) = recording() else {
        println!("skipped: no recording A1_dstwr_ticks_iiot20");
        return;
    };
    let model =
        |sender_ppm| carrier_integrator(sender_ppm, Channel::Ch3.centre_hz(), DataRate::Kbps110);
    let ppm_per_unit = 1.0 / f64::from(model(-100.0)) * 100.0;
    let mut compared = 0;
    for row in rows(&file) {
        for (recorded, sender_ppm) in [
            (row.tag_integrator, row.anchor_ppm),
            (row.anchor_integrator, -row.anchor_ppm),
        ] {
            let Some(recorded) = recorded else { continue };
            let difference_ppm = f64::from(recorded - model(sender_ppm)) * ppm_per_unit;
            // Offsets reach 4.6 ppm; a wrong sign would show as 9.
            assert!(difference_ppm.abs() < 0.1, "{recorded} at {sender_ppm} ppm");
            compared += 1;
        }
    }
    println!("{compared} readings compared");
    assert!(compared > 500);
}
