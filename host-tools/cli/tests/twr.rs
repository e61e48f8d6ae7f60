//! `nova twr` on made and on recorded time stamps.
#![allow(clippy::unwrap_used)]

mod common;

use common::{Nova, recorded};
use num_bigint::BigInt;
use num_rational::BigRational;

const HEADER: &str = "t1_ticks,t2_ticks,t3_ticks,t4_ticks,t5_ticks,t6_ticks\n";

/// 1000 ticks of flight, replies of 100 000 and 200 000; the responder's clock
/// wraps between poll and response.
const GOOD: &str = "5000,1099511600000,72224,107000,307000,274224\n";

#[test]
fn each_line_gives_a_range_or_the_reason_why_not() {
    let nova = Nova::new();
    let lines = format!(
        "{HEADER}{GOOD}5000,1,2,3,4\u{20},\n1,1,1,1,1,1\n5000,1099511600000,72224,107000,307000,9274224\n99999999999999,0,0,0,0,0\n"
    );
    nova.file("stamps.csv", lines);
    let said = nova.run(&["twr", "stamps.csv", "--json"]);
    assert_eq!(said.code, 0, "{}", said.err);
    let results = said.json();
    let range = results[0]["range_m"].as_f64().unwrap();
    assert!((range - 1000.0 / 63_897_600_000.0 * 299_702_547.0).abs() < 1e-9);
    assert_eq!(results[0]["clock_offset_ppm"], 0.0);
    for (line, mention) in [
        (1, "t6_ticks is missing"),
        (2, "no time passes"),
        (3, "ppm"),
        (4, "more than 40 bits"),
    ] {
        let result = &results[line];
        assert!(result["range_m"].is_null());
        assert!(
            result["error"].as_str().unwrap().contains(mention),
            "{result}"
        );
    }
    assert_eq!(said.err, "4 of 5 lines gave no range\n");
}

#[test]
fn the_table_is_csv_that_names_file_lines() {
    let nova = Nova::new();
    nova.file("stamps.csv", format!("{HEADER}{GOOD}"));
    let said = nova.run(&["twr", "stamps.csv"]);
    assert_eq!(
        said.out,
        "line,range_m,clock_offset_ppm,error\n2,4.6904,0.0000,\n"
    );
}

#[test]
fn standard_input_gives_what_a_file_gives() {
    let nova = Nova::new();
    let stamps = format!("{HEADER}{GOOD}");
    nova.file("stamps.csv", &stamps);
    let fed = nova.run_fed(stamps.as_bytes(), &["twr", "-"]);
    assert_eq!(
        (fed.code, fed.out),
        (0, nova.run(&["twr", "stamps.csv"]).out)
    );
}

#[test]
fn the_speed_of_light_is_that_in_air_unless_told_otherwise() {
    let nova = Nova::new();
    nova.file("stamps.csv", format!("{HEADER}{GOOD}"));
    let range = |arguments: &[&str]| {
        let said = nova.run(&[&["twr", "stamps.csv", "--json"], arguments].concat());
        said.json()[0]["range_m"].as_f64().unwrap()
    };
    let air = range(&[]);
    assert_eq!(air, range(&["--speed-of-light", "299702547"]));
    let vacuum = range(&["--speed-of-light", "vacuum"]);
    assert!((vacuum / air - 299_792_458.0 / 299_702_547.0).abs() < 1e-12);
    let said = nova.run(&["twr", "stamps.csv", "--speed-of-light", "3"]);
    assert_eq!(said.code, 2);
}

#[test]
fn a_file_without_a_single_range_is_an_error() {
    let nova = Nova::new();
    nova.file("stamps.csv", format!("{HEADER}1,1,1,1,1,1\n"));
    let said = nova.run(&["twr", "stamps.csv"]);
    assert_eq!(said.code, 2);
    assert_eq!(said.out, "");
    assert!(said.err.contains("no line gives a range"), "{}", said.err);
}

fn exact_range_m(stamps: &[u64]) -> BigRational {
    let modulus = BigInt::from(1u64 << 40);
    let span = |later: usize, earlier: usize| {
        let d = BigInt::from(stamps[later]) - BigInt::from(stamps[earlier]);
        ((d % &modulus) + &modulus) % &modulus
    };
    let (ra, db, rb, da) = (span(3, 0), span(2, 1), span(5, 2), span(4, 3));
    let tof = BigRational::new(&ra * &rb - &da * &db, ra + rb + da + db);
    tof * BigRational::new(BigInt::from(299_702_547), BigInt::from(63_897_600_000u64))
}

#[test]
fn recorded_ranges_are_within_a_tenth_of_a_millimetre_of_exact_arithmetic() {
    let Some(path) = recorded("A1_dstwr_ticks_iiot20/tag1.csv") else {
        return;
    };
    let said = Nova::new().run(&["twr", path.to_str().unwrap(), "--json"]);
    assert_eq!((said.code, said.err.as_str()), (0, ""));
    let results = said.json();

    let text = std::fs::read_to_string(&path).unwrap();
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let columns: Vec<usize> = (1..=6)
        .map(|k| {
            let name = format!("t{k}_ticks");
            header.iter().position(|h| **h == name).unwrap()
        })
        .collect();
    let mut worst = BigRational::from_integer(BigInt::ZERO);
    let mut wraps = 0;
    for (line, result) in lines.zip(&results) {
        let fields: Vec<&str> = line.split(',').collect();
        let stamps: Vec<u64> = columns
            .iter()
            .map(|&c| fields[c].parse().unwrap())
            .collect();
        wraps += usize::from(stamps[4] < stamps[0] || stamps[5] < stamps[1]);
        let range = BigRational::from_float(result["range_m"].as_f64().unwrap()).unwrap();
        let error = range - exact_range_m(&stamps);
        worst = worst.max(if *error.numer() < BigInt::ZERO {
            -error
        } else {
            error
        });
    }
    assert!(
        results.len() > 500 && wraps > 0,
        "{} lines, {wraps} wraps",
        results.len()
    );
    let limit = BigRational::new(BigInt::from(1), BigInt::from(10_000));
    assert!(worst < limit, "worst error {worst} m");
    println!(
        "{} lines, {wraps} with a wrap, worst error below 0.1 mm",
        results.len()
    );
}
