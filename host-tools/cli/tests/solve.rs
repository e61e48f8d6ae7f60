//! `nova solve` on made and on recorded ranges.
#![allow(clippy::unwrap_used)]

mod common;

use common::{Nova, recorded};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;

/// Ranges from a climbing circle to a node, evenly distributed errors of up to
/// `noise_m`.
fn flight(node: [f64; 3], bias_m: f64, noise_m: f64) -> String {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let mut lines = String::from("t_s,peer,x_m,y_m,z_m,range_m\n");
    for k in 0..400 {
        let a = 0.05 * f64::from(k);
        let place = [6.0 * a.cos(), 6.0 * a.sin(), 2.0 + 0.02 * f64::from(k)];
        let square: f64 = node.iter().zip(&place).map(|(n, p)| (n - p).powi(2)).sum();
        let [x, y, z] = place;
        let range = square.sqrt() + bias_m + rng.random_range(-1.0..1.0) * noise_m;
        lines += &format!("{a},7,{x},{y},{z},{range}\n");
    }
    lines
}

fn vector(value: &Value) -> Vec<f64> {
    value
        .as_array()
        .unwrap()
        .iter()
        .map(|v| v.as_f64().unwrap())
        .collect()
}

fn distance_m(found: &Value, truth: &[f64]) -> f64 {
    let squares = vector(&found["position_m"]);
    squares
        .iter()
        .zip(truth)
        .map(|(a, b)| (a - b).powi(2))
        .sum::<f64>()
        .sqrt()
}

#[test]
fn standard_input_gives_what_a_file_gives() {
    let nova = Nova::new();
    let ranges = flight([3.0, -4.0, 0.0], 0.0, 0.1);
    nova.file("flight.csv", &ranges);
    let fed = nova.run_fed(ranges.as_bytes(), &["solve", "-", "--json"]);
    let read = nova.run(&["solve", "flight.csv", "--json"]);
    assert_eq!((fed.code, fed.out), (0, read.out));
}

#[test]
fn json_has_every_field_that_the_help_promises() {
    let nova = Nova::new();
    nova.file("flight.csv", flight([3.0, -4.0, 0.0], 0.0, 0.0));
    let said = nova.run(&["solve", "flight.csv", "--json"]);
    assert_eq!((said.code, said.err.as_str()), (0, ""));
    let results = said.json();
    assert_eq!(results.len(), 1);
    let found = &results[0];
    assert_eq!(found["peer"], 7);
    assert!(distance_m(found, &[3.0, -4.0, 0.0]) < 1e-6);
    assert_eq!(vector(&found["sigma_m"]).len(), 3);
    let covariance = found["covariance_m2"].as_array().unwrap();
    for (row, sigma) in vector(&found["sigma_m"]).into_iter().enumerate() {
        assert!((vector(&covariance[row])[row] - sigma * sigma).abs() < 1e-12);
    }
    assert_eq!(found["range_bias_m"], 0.0);
    assert!(found["residual_rms_m"].as_f64().unwrap() < 1e-6);
    assert_eq!(
        (&found["used"], &found["rejected"]),
        (&Value::from(400), &Value::from(0))
    );
    assert_eq!(found["alternative"], Value::Null);
    assert_eq!(found["observable"], true);
    assert!(found["condition"].as_f64().unwrap() >= 1.0);
}

#[test]
fn a_known_bias_is_taken_off_and_an_unknown_one_is_found() {
    let nova = Nova::new();
    nova.file("flight.csv", flight([3.0, -4.0, 0.0], 0.24, 0.05));
    for arguments in [["--range-bias", "0.24"], ["--estimate-bias", "0.5"]] {
        let simulated = ["solve", "flight.csv", "--json", "--systematic-sigma", "0"];
        let said = nova.run(&[&simulated[..], &arguments].concat());
        let found = &said.json()[0];
        assert!(distance_m(found, &[3.0, -4.0, 0.0]) < 0.05, "{}", said.out);
        let bias_m = found["range_bias_m"].as_f64().unwrap();
        assert!((bias_m - 0.24).abs() < 0.03, "{}", said.out);
    }
}

#[test]
fn bad_lines_are_skipped_and_counted_where_asked_for() {
    let nova = Nova::new();
    let lines = flight([3.0, -4.0, 0.0], 0.0, 0.0) + "99,7,0,0,0,-1\n99,7,0,0,nan,1\n";
    nova.file("flight.csv", lines);
    let said = nova.run(&["solve", "flight.csv", "--json", "--skip-bad"]);
    assert_eq!(said.code, 0);
    assert_eq!(said.err, "2 of 402 lines skipped\n");
    assert_eq!(said.json()[0]["used"], 400);
}

#[test]
fn a_level_path_gives_the_mirror_image_in_words_and_in_json() {
    let nova = Nova::new();
    let mut lines = String::from("t_s,peer,x_m,y_m,z_m,range_m\n");
    for k in 0..100 {
        let a = 0.06 * f64::from(k);
        let (x, y) = (6.0 * a.cos(), 6.0 * a.sin());
        let range = ((x - 2.0).powi(2) + (y - 1.0).powi(2) + 25.0_f64).sqrt();
        lines += &format!("{a},5,{x},{y},5,{range}\n");
    }
    nova.file("level.csv", lines);
    let said = nova.run(&["solve", "level.csv", "--json"]);
    let found = &said.json()[0];
    assert_eq!(found["observable"], false);
    let heights = [&found["position_m"], &found["alternative"]["position_m"]].map(|p| vector(p)[2]);
    assert!((heights[0] + heights[1] - 10.0).abs() < 1e-3, "{heights:?}");
    let said = nova.run(&["solve", "level.csv"]);
    assert!(said.out.contains("may as well be at"), "{}", said.out);

    // Where the height is known there is nothing to confuse.
    let said = nova.run(&["solve", "level.csv", "--json", "--height", "0"]);
    assert_eq!(said.json()[0]["observable"], true);
}

/// The four anchors of a flight and where they were surveyed, from CSV.
fn surveyed(file: &str, keep: impl Fn(&[&str]) -> bool, first: usize) -> Vec<(u64, Vec<f64>)> {
    std::fs::read_to_string(recorded(file).unwrap())
        .unwrap()
        .lines()
        .skip(1)
        .map(|line| line.split(',').collect::<Vec<_>>())
        .filter(|fields| keep(fields))
        .map(|fields| {
            let position = fields[first + 1..first + 4]
                .iter()
                .map(|f| f.parse().unwrap());
            (fields[first].parse().unwrap(), position.collect())
        })
        .collect()
}

/// What `nova solve` says of a recording, one object a node; `None` if the
/// recording is not there.
fn solved(file: &str, options: &[&str]) -> Option<Vec<Value>> {
    let path = recorded(file)?;
    let command = ["solve", path.to_str().unwrap(), "--json", "--skip-bad"];
    Some(Nova::new().run(&[&command[..], options].concat()).json())
}

/// How flights of B1 are to be read; see docs/recorded-data.md.
const B1: [&str; 4] = ["--columns", "peer=anchor", "--range-bias", "0.24"];

/// Prints each anchor's error and sigma, and holds the error below a limit.
fn assert_within(limit_m: f64, results: &[Value], anchors: &[(u64, Vec<f64>)]) {
    for (found, (anchor, truth)) in results.iter().zip(anchors) {
        assert_eq!(found["peer"], *anchor);
        assert_eq!(found["observable"], true);
        let error_m = distance_m(found, truth);
        let sigma_m = vector(&found["sigma_m"]);
        println!("anchor {anchor}: error {error_m:.3} m, sigma {sigma_m:.3?} m");
        assert!(error_m < limit_m, "anchor {anchor}: {error_m} m");
    }
}

#[test]
fn recorded_flights_give_each_anchor_within_a_quarter_of_a_metre() {
    for seq in ["1", "2"] {
        let file = format!("B1_drone_ranges_rcv/seq{seq}_ranges.csv");
        let Some(results) = solved(&file, &B1) else {
            return;
        };
        let anchors = surveyed("B1_drone_ranges_rcv/anchors.csv", |f| f[0] == seq, 1);
        assert_eq!((results.len(), anchors.len()), (4, 4));
        println!("flight {seq}");
        assert_within(0.25, &results, &anchors);
    }
}

#[test]
fn a_recorded_straight_flight_is_not_believed() {
    let Some(results) = solved("B1_drone_ranges_rcv/seq5_ranges.csv", &B1) else {
        return;
    };
    assert_eq!(results.len(), 4);
    for found in results {
        let doubted = found["observable"] == false || !found["alternative"].is_null();
        assert!(doubted, "{found}");
    }
}

#[test]
fn a_recorded_flight_with_calibrated_ranges_gives_each_anchor_within_16_cm() {
    let columns = "peer=to_id,x_m=tag_x_m,y_m=tag_y_m,z_m=tag_z_m,range_m=range_cal_m";
    let file = "A2_miluv/random3_flight_anchors0to2.csv";
    let Some(results) = solved(file, &["--columns", columns]) else {
        return;
    };
    let anchors = surveyed("A2_miluv/anchors_constellation0.csv", |_| true, 0);
    assert_eq!(results.len(), 3);
    assert_within(0.16, &results, &anchors);
}
