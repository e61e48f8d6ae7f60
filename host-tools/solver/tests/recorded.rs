//! Static anchors found from recorded flights of drones that measured their distance to them.
//!
//! The recordings are not part of this repository. They are looked for in `$NOVA_DATA`, then in
//! `../shared/data` beside the workspace; where they are absent the tests say that they skipped.
//! Truth is read in the assertions only.
//!
//! The table of docs/solver.md is printed by `cargo test -p nova-solver --test recorded --
//! --nocapture --test-threads 1`.

#![allow(clippy::unwrap_used)] // the helpers below are tests as well

mod recordings;

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::Vector3;
use nova_solver::multilateration::RangeBias;
use nova_solver::{
    Localisation, MultilaterationOptions, Observability, RangeMeasurement, multilaterate,
};
use recordings::data;

type Flight = BTreeMap<i64, Vec<RangeMeasurement>>;
type Survey = BTreeMap<i64, Vector3<f64>>;

/// Rows as maps from column to number; what is not a number becomes NaN.
fn rows(path: &Path) -> Vec<BTreeMap<String, f64>> {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let columns = reader.headers().unwrap().clone();
    reader
        .records()
        .map(|record| {
            let record = record.unwrap();
            let number = |text: &str| text.trim().parse().unwrap_or(f64::NAN);
            columns
                .iter()
                .zip(&record)
                .map(|(column, text)| (column.to_owned(), number(text)))
                .collect()
        })
        .collect()
}

/// Adds a row unless it holds something that is not a number, as recordings do.
fn push(flight: &mut Flight, anchor: i64, t_s: f64, position_m: Vector3<f64>, range_m: f64) {
    let measurement = RangeMeasurement {
        t_s,
        position_m,
        range_m,
        sigma_m: 0.1,
    };
    if measurement.validate().is_ok() {
        flight.entry(anchor).or_default().push(measurement);
    }
}

/// One flight of the RCV set: raw ranges of four anchors.
fn rcv_flight(sequence: u32) -> Option<Flight> {
    let path = data(&format!("B1_drone_ranges_rcv/seq{sequence}_ranges.csv"))?;
    let mut flight = Flight::new();
    for row in rows(&path) {
        let place = Vector3::new(row["x_m"], row["y_m"], row["z_m"]);
        push(
            &mut flight,
            row["anchor"] as i64,
            row["t_s"],
            place,
            row["range_m"],
        );
    }
    Some(flight)
}

fn rcv_truth(sequence: u32) -> Survey {
    rows(&data("B1_drone_ranges_rcv/anchors.csv").unwrap())
        .iter()
        .filter(|row| row["seq"] as u32 == sequence)
        .map(|row| {
            (
                row["anchor"] as i64,
                Vector3::new(row["x_m"], row["y_m"], row["z_m"]),
            )
        })
        .collect()
}

/// One flight of MILUV: calibrated ranges between the drone's own tags and the anchors (identifiers
/// below 10).
fn miluv_flight(file: &str) -> Option<Flight> {
    let path = data(&format!("A2_miluv/{file}"))?;
    let mut flight = Flight::new();
    for row in rows(&path) {
        let (from, to) = (row["from_id"] as i64, row["to_id"] as i64);
        let anchor = from.min(to);
        if anchor < 10 && row["own_tag"] >= 10.0 {
            let place = Vector3::new(row["tag_x_m"], row["tag_y_m"], row["tag_z_m"]);
            push(&mut flight, anchor, row["t_s"], place, row["range_cal_m"]);
        }
    }
    Some(flight)
}

fn miluv_truth() -> Survey {
    rows(&data("A2_miluv/anchors_constellation0.csv").unwrap())
        .iter()
        .map(|row| {
            (
                row["anchor_id"] as i64,
                Vector3::new(row["x_m"], row["y_m"], row["z_m"]),
            )
        })
        .collect()
}

/// Normalised error squared of a solution: 3 on average where the covariance is right.
fn nees(found: &Localisation, truth: Vector3<f64>) -> f64 {
    let error = found.position_m - truth;
    error.dot(&(found.covariance_m2.try_inverse().unwrap() * error))
}

/// Solves for every anchor and prints a row each.
fn solve_all(
    name: &str,
    flight: &Flight,
    truth: &Survey,
    bias: RangeBias,
) -> Vec<(Localisation, Vector3<f64>)> {
    let options = MultilaterationOptions {
        bias,
        ..MultilaterationOptions::default()
    };
    flight
        .iter()
        .map(|(anchor, measurements)| {
            let found = multilaterate(measurements, &options).unwrap();
            let truth = truth[anchor];
            println!(
                "| {name} | {anchor} | {} | {} | {:.0} | {:.3} | {:.3} | {:.3} | {:.1} | {} |",
                found.used,
                found.rejected,
                found.effective_measurements,
                found.residual_rms_m,
                (found.position_m - truth).norm(),
                found.covariance_m2.trace().sqrt(),
                nees(&found, truth),
                match found.observability {
                    Observability::Unique => "yes",
                    Observability::Mirror => "mirror",
                    Observability::Ring { .. } => "ring",
                    Observability::Sphere { .. } => "sphere",
                    Observability::Weak { .. } => "weak",
                },
            );
            (found, truth)
        })
        .collect()
}

/// The authors' surveyed offset of this set.
const RCV_BIAS: RangeBias = RangeBias::Known(0.24);
const CALIBRATED: RangeBias = RangeBias::Known(0.0);
/// Exceeded by one in a hundred of chi-squares with three degrees of freedom.
const CHI2_99: f64 = 11.34;

#[test]
fn flights_about_four_anchors_place_each_within_25_cm() {
    for sequence in [1, 2] {
        let Some(flight) = rcv_flight(sequence) else {
            return;
        };
        let solved = solve_all(
            &format!("RCV {sequence}"),
            &flight,
            &rcv_truth(sequence),
            RCV_BIAS,
        );
        assert_eq!(solved.len(), 4);
        for (found, truth) in solved {
            assert!((found.position_m - truth).norm() < 0.25);
            assert!(nees(&found, truth) < CHI2_99);
            assert!(found.observable() && found.alternative.is_none());
        }
    }
}

#[test]
fn straight_flight_is_not_observable_and_its_sigma_covers_the_error() {
    let Some(flight) = rcv_flight(5) else { return };
    for bias in [
        RCV_BIAS,
        RangeBias::Estimate {
            prior_m: 0.24,
            prior_sigma_m: 0.1,
        },
    ] {
        let solved = solve_all("RCV 5", &flight, &rcv_truth(5), bias);
        assert_eq!(solved.len(), 4);
        for (found, truth) in solved {
            assert!(!found.observable());
            let sigma_m = found.covariance_m2.trace().sqrt();
            assert!(sigma_m > 1.0 && (found.position_m - truth).norm() < 2.0 * sigma_m);
            assert!(nees(&found, truth) < CHI2_99);
        }
    }
}

#[test]
fn flight_among_obstacles_places_each_anchor_within_16_cm() {
    let Some(flight) = miluv_flight("random3_flight_anchors0to2.csv") else {
        return;
    };
    let solved = solve_all("MILUV random3", &flight, &miluv_truth(), CALIBRATED);
    assert_eq!(solved.len(), 3);
    for (found, truth) in solved {
        assert!((found.position_m - truth).norm() < 0.16);
        assert!(nees(&found, truth) < CHI2_99);
        assert!(found.observable());
    }
}

#[test]
fn a_dozen_ranges_with_obstacles_give_a_large_sigma() {
    let Some(flight) = miluv_flight("3drones_ifo001_dstwr.csv") else {
        return;
    };
    let solved = solve_all("MILUV 3drones", &flight, &miluv_truth(), CALIBRATED);
    assert_eq!(solved.len(), 6);
    for (found, truth) in solved {
        let sigma_m = found.covariance_m2.trace().sqrt();
        assert!(sigma_m > 0.6 && (found.position_m - truth).norm() < 2.0 * sigma_m);
        assert!(nees(&found, truth) < CHI2_99);
    }
}

#[test]
fn bias_that_nobody_told_widens_the_sigma_to_cover_it() {
    let unknown = RangeBias::Estimate {
        prior_m: 0.0,
        prior_sigma_m: 1.0,
    };
    for sequence in [1, 2] {
        let Some(flight) = rcv_flight(sequence) else {
            return;
        };
        let name = format!("RCV {sequence}, bias estimated");
        for (found, truth) in solve_all(&name, &flight, &rcv_truth(sequence), unknown) {
            assert!(nees(&found, truth) < CHI2_99);
            assert!((found.range_bias_m - 0.24).abs() < 2.0 * found.range_bias_sigma_m);
        }
    }
}

/// A hundred ranges in a row instead of a whole flight: more geometries, most of them weak.
#[test]
fn pieces_of_flights_are_honest_as_well() {
    let (mut pieces, mut outside_95, mut outside_99, mut confident) = (0, 0, 0, 0);
    for sequence in [1, 2, 5] {
        let Some(flight) = rcv_flight(sequence) else {
            return;
        };
        let truth = rcv_truth(sequence);
        let options = MultilaterationOptions {
            bias: RCV_BIAS,
            ..MultilaterationOptions::default()
        };
        for (anchor, measurements) in &flight {
            for piece in measurements.chunks_exact(100) {
                let found = multilaterate(piece, &options).unwrap();
                let nees = nees(&found, truth[anchor]);
                pieces += 1;
                outside_95 += i32::from(nees > 7.81);
                outside_99 += i32::from(nees > CHI2_99);
                confident += i32::from(found.observable());
            }
        }
    }
    println!(
        "{pieces} pieces, {confident} observable, {outside_95} outside 95 %, {outside_99} outside 99 %"
    );
    assert!(pieces > 100);
    assert!(outside_95 * 20 <= pieces && outside_99 * 50 <= pieces);
}
