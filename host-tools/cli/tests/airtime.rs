//! `nova airtime`: its sums add up, and simulated boards keep to them.
#![allow(clippy::unwrap_used)]

mod common;

use common::Nova;
use serde_json::Value;

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

fn airtime(arguments: &[&str]) -> Value {
    let arguments: Vec<&str> = [&["airtime", "--json"], arguments].concat();
    let said = Nova::new().run(&arguments);
    assert_eq!(said.code, 0, "{}", said.err);
    serde_json::from_str(&said.out).unwrap()
}

#[test]
fn every_microsecond_of_a_round_is_accounted_for() {
    for responders in 1..=8usize {
        let report = airtime(&["--responders", &responders.to_string()]);
        let steps = report["steps"].as_array().unwrap();
        // Poll, responses, final, reports, and the way to the next poll.
        assert_eq!(steps.len(), 3 + 2 * responders);
        let sum: f64 = steps.iter().map(|step| number(&step["total_us"])).sum();
        assert!((sum - number(&report["round"]["total_us"])).abs() < 1e-6);
        let parts = [
            "wake_us", "bus_us", "cpu_us", "radio_us", "guard_us", "air_us",
        ];
        let by_part: f64 = parts
            .iter()
            .map(|part| number(&report["round"][part]))
            .sum();
        assert!((sum - by_part).abs() < 1e-6);
        // Nobody has less time than needed.
        assert!(steps.iter().all(|step| number(&step["guard_us"]) >= 0.0));
    }
}

#[test]
fn simulated_boards_reach_what_the_budget_says() {
    for responders in ["1", "4"] {
        let report = airtime(&["--measure", "--responders", responders]);
        let (said, seen) = (&report["ranges_per_s"], &report["measured_ranges_per_s"]);
        let ratio = number(seen) / number(said);
        assert!(
            (0.9..1.15).contains(&ratio),
            "{responders}: {seen} of {said}"
        );
    }
}

#[test]
fn the_table_says_how_near_the_limit_it_comes() {
    let said = Nova::new().run(&["airtime"]);
    assert_eq!(said.code, 0, "{}", said.err);
    assert!(
        said.out.starts_with(
            "channel 5, 6800 kbit/s, PRF 64 MHz, preamble 128; SPI 8 MHz; 1 responder\n"
        )
    );
    assert!(said.out.contains("reached: "), "{}", said.out);
}

#[test]
fn a_mode_that_the_radio_does_not_have_is_refused_with_the_reason() {
    for (arguments, reason) in [
        (["--channel", "6"], "the radio has no channel 6"),
        (
            ["--bitrate", "110"],
            "a preamble of 128 symbols is too short for 110 kbit/s: from 1024",
        ),
        (
            ["--preamble", "100"],
            "the radio has no preamble of 100 symbols",
        ),
    ] {
        let said = Nova::new().run(&["airtime", arguments[0], arguments[1]]);
        assert_eq!(said.code, 2);
        assert!(said.err.contains(reason), "{}", said.err);
    }
}
