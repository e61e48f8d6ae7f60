//! `nova decode` and `nova demo`.
#![allow(clippy::unwrap_used)]

mod common;

use common::Nova;
use nova_wire::{
    Boot, Encoder, MAX_FRAME_LEN, Quality, Range, RangeFlags, Record, ResetCause, Role,
    SettingsSource, Treatment,
};

fn range(raw_m: f32) -> Record {
    Record::Range(Range {
        t_us: 1_000_000,
        peer: 0x1234,
        exchange: 9,
        raw_m,
        bias_m: -0.0625,
        treatment: Treatment::RejectedOutlier,
        filtered: None,
        clock_offset_ppm: 1.25,
        quality: Some(Quality {
            rx_power_dbm: -80.5,
            first_path_power_dbm: f32::NAN,
            ..Quality::default()
        }),
        flags: RangeFlags::INITIATOR,
    })
}

fn frames(records: &[Record]) -> Vec<Vec<u8>> {
    let mut encoder = Encoder::new();
    records
        .iter()
        .map(|r| encoder.encode(r, &mut [0; MAX_FRAME_LEN]).unwrap().to_vec())
        .collect()
}

#[test]
fn a_capture_becomes_one_json_line_a_record_and_the_counts() {
    let boot = Record::Boot(Boot {
        address: 10,
        pan: 0xDECA,
        role: Role::Anchor,
        firmware: [0, 1, 0],
        reset_cause: ResetCause::PowerOn,
        settings: SettingsSource::Defaults,
    });
    let mut frames = frames(&[boot, range(1.5), range(2.5), range(-0.25)]);
    frames.remove(2);
    frames.insert(2, b"garbage\0".to_vec());
    let nova = Nova::new();
    nova.file("capture.bin", frames.concat());
    let said = nova.run(&["decode", "capture.bin"]);
    assert_eq!((said.code, said.err.as_str()), (0, ""));
    let lines = said.json();
    assert_eq!(lines[0]["boot"]["role"], "anchor");
    assert_eq!(lines[1]["range"]["raw_m"], 1.5);
    assert_eq!(lines[1]["range"]["peer"], 0x1234);
    assert_eq!(lines[1]["range"]["treatment"], "rejected_outlier");
    assert!(lines[1]["range"]["filtered"].is_null());
    assert_eq!(lines[1]["range"]["quality"]["rx_power_dbm"], -80.5);
    assert!(lines[1]["range"]["quality"]["first_path_power_dbm"].is_null());
    assert_eq!(lines[2]["trouble"], "corrupt");
    assert_eq!(
        (&lines[3]["lost"], &lines[3]["range"]["raw_m"]),
        (&1.into(), &(-0.25).into())
    );
    let end = &lines[4]["end"];
    assert_eq!(
        [
            &end["records"],
            &end["lost"],
            &end["corrupt"],
            &end["unknown"]
        ],
        [3, 1, 1, 0]
    );
}

#[test]
fn the_demonstration_finds_the_tag_and_writes_a_page_that_needs_nothing_else() {
    let nova = Nova::new();
    let said = nova.demonstration();
    assert_eq!((said.code, said.err.as_str()), (0, ""));
    let result = &said.json()[0];
    assert_eq!(result["observable"], true);
    assert!(result["used"].as_u64().unwrap() > 1_000);
    // 99.9 % point of chi-square with three degrees of freedom.
    assert!(
        result["normalised_error_squared"].as_f64().unwrap() < 16.3,
        "{}",
        said.out
    );
    assert_eq!(result["wire"]["lost"], 0);
    assert_eq!(nova.files(), ["anchor.bin", "flight.csv", "nova-demo.html"]);

    let page = std::fs::read_to_string(nova.folder.path().join("nova-demo.html")).unwrap();
    assert_eq!(page.matches("<svg").count(), 3);
    for elsewhere in ["<script src", "<link", "src=\"http", "url("] {
        assert!(!page.contains(elsewhere), "the page needs {elsewhere}");
    }

    // The bytes it wrote hold the records it counted.
    let decoded = nova.run(&["decode", "anchor.bin"]).json();
    let end = &decoded.last().unwrap()["end"];
    assert_eq!(end["records"], result["wire"]["records"]);
    assert_eq!(decoded[0]["boot"]["role"], "anchor");

    // The measurements it wrote lead `nova solve` to the same place.
    let solved = &nova.run(&["solve", "flight.csv", "--json"]).json()[0];
    for axis in 0..3 {
        let difference = solved["position_m"][axis].as_f64().unwrap()
            - result["estimate_m"][axis].as_f64().unwrap();
        assert!(difference.abs() < 1e-3);
    }
}

#[test]
fn the_same_seed_gives_the_same_flight_and_another_seed_another() {
    let run = |seed| Nova::new().run(&["demo", "--json", "--seed", seed]).out;
    assert_eq!(run("11"), run("11"));
    assert_ne!(run("11"), run("12"));
}

#[test]
fn every_subcommand_has_help_with_an_example() {
    for command in [
        "demo",
        "solve",
        "guide",
        "fly",
        "evaluate",
        "merge",
        "twr",
        "decode",
        "listen",
        "simulate",
        "calibrate",
    ] {
        let said = Nova::new().run(&[command, "--help"]);
        assert_eq!(said.code, 0);
        assert!(
            said.out.contains(&format!("nova {command} ")),
            "{}",
            said.out
        );
        assert!(said.out.contains("Examples:"), "{}", said.out);
    }
}
