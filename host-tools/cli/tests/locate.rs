//! `nova locate` on what simulated listeners say, on differences in files, and on what is spoilt.
#![allow(clippy::unwrap_used)]

mod common;

use common::{Nova, recorded};
use serde_json::Value;

const ANCHORS: [[f64; 3]; 4] = [
    [0.0, 0.0, 2.0],
    [8.0, 0.0, 2.5],
    [8.0, 6.0, 0.5],
    [0.0, 6.0, 2.2],
];

fn toml(anchors: &[[f64; 3]], first: u32) -> String {
    (first..)
        .zip(anchors)
        .map(|(node, place)| format!("[[anchor]]\nnode = {node}\nposition_m = {place:?}\n"))
        .collect()
}

/// A recording of a listener that rests (0x0006.bin) and of one on a circle of 1 m about (4, 3, 1) (0x0005.bin).
fn heard() -> Nova {
    let nova = Nova::new();
    let mut arguments = vec!["simulate".to_owned()];
    let roles = ["anchor", "tag", "tag", "tag"];
    for (role, [x, y, z]) in roles.iter().zip(ANCHORS) {
        arguments.extend(["--board".to_owned(), format!("{role}@{x},{y},{z}")]);
    }
    for more in [
        "--board",
        "listener@4,3,1,1",
        "--board",
        "listener@2,4,1",
        "--capture",
        ".",
        "--duration",
        "4",
    ] {
        arguments.push(more.to_owned());
    }
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let said = nova.run(&arguments);
    assert_eq!(said.code, 0, "{}", said.err);
    let circle = |k: u32| {
        let t = 0.01 * f64::from(k);
        format!("{t},{},{},1\n", 4.0 + t.cos(), 3.0 + t.sin())
    };
    let truth: String = (0..401).map(circle).collect();
    nova.file("truth.csv", format!("t_s,x_m,y_m,z_m\n{truth}"));
    nova.file("anchors.toml", toml(&ANCHORS, 1));
    nova
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

fn end(said: &common::Said) -> Value {
    assert_eq!(said.code, 0, "{}", said.err);
    said.json().pop().unwrap()["end"].clone()
}

#[test]
fn a_listener_on_a_circle_is_followed_and_one_at_rest_is_placed() {
    let nova = heard();
    let files = [
        "--truth",
        "truth.csv",
        "--out",
        "track.csv",
        "--plot",
        "track.html",
        "--every",
        "1",
    ];
    let command = [
        "locate",
        "0x0005.bin",
        "--anchors",
        "anchors.toml",
        "--json",
    ];
    let said = nova.run(&[&command[..], &files].concat());
    let lines = said.json();
    let end = end(&said);
    assert!(
        (3..=5).contains(
            &lines
                .iter()
                .filter(|line| line["place"].is_object())
                .count()
        )
    );
    let errors = &end["errors"];
    assert!(number(&errors["rmse_horizontal_m"]) < 0.15, "{errors}");
    assert!(number(&errors["mean_nees"]) < 5.0, "{errors}");
    let counts = &end["counts"];
    let differences = number(&counts["differences"]);
    // All three of a round, a hundred rounds a second; few are lost.
    assert!(differences > 1100.0, "{counts}");
    assert!(number(&counts["used"]) > 0.98 * differences, "{counts}");
    let track = std::fs::read_to_string(nova.folder.path().join("track.csv")).unwrap();
    assert!(track.lines().count() > 300);
    let page = std::fs::read_to_string(nova.folder.path().join("track.html")).unwrap();
    assert_eq!(page.matches("<svg").count(), 3);

    let said = nova.run(&[
        "locate",
        "0x0006.bin",
        "--anchors",
        "anchors.toml",
        "--still",
        "--json",
    ]);
    let end = self::end(&said);
    let place = end["still"]["position_m"].as_array().unwrap();
    for (found, wanted) in place.iter().zip([2.0, 4.0, 1.0]) {
        assert!((number(found) - wanted).abs() < 0.2, "{place:?}");
    }
    let said = nova.run(&[
        "locate",
        "0x0006.bin",
        "--anchors",
        "anchors.toml",
        "--still",
    ]);
    for word in ["place ", "sigma", "offsets", "differences"] {
        assert!(said.out.contains(word), "{}", said.out);
    }
}

#[test]
fn a_stream_gives_what_the_recording_gives() {
    let nova = heard();
    let bytes = std::fs::read(nova.folder.path().join("0x0005.bin")).unwrap();
    let options = ["--anchors", "anchors.toml", "--json"];
    let file = nova.run(&[&["locate", "0x0005.bin"][..], &options].concat());
    let stream = nova.run_fed(&bytes, &[&["locate", "-"][..], &options].concat());
    assert_eq!(file.code, 0, "{}", file.err);
    assert_eq!((file.code, file.out), (stream.code, stream.out));
}

#[test]
fn damage_is_counted_and_the_track_goes_on() {
    let nova = heard();
    let mut bytes = std::fs::read(nova.folder.path().join("0x0005.bin")).unwrap();
    for k in (0..bytes.len()).step_by(3001) {
        bytes[k] ^= 0x41;
    }
    nova.file("spoilt.bin", &bytes);
    let said = nova.run(&[
        "locate",
        "spoilt.bin",
        "--anchors",
        "anchors.toml",
        "--json",
        "--truth",
        "truth.csv",
    ]);
    let end = end(&said);
    assert!(end["not_used"].as_object().unwrap().len() > 1, "{end}");
    assert!(end["notes"][0].as_str().unwrap().contains("lost"), "{end}");
    assert!(number(&end["errors"]["rmse_horizontal_m"]) < 0.2, "{end}");
}

#[test]
fn differences_in_a_file_give_a_place_and_wild_ones_are_counted() {
    let nova = Nova::new();
    let tag: [f64; 3] = [3.0, 2.0, 1.2];
    let away = |k: usize| {
        ANCHORS[k]
            .iter()
            .zip(tag)
            .map(|(a, t)| (a - t).powi(2))
            .sum::<f64>()
            .sqrt()
    };
    let mut lines = String::from("t_s,from,to,d\n");
    for k in 0..400usize {
        let (a, b) = (k % 4, (k + 1 + k / 4 % 3) % 4);
        let wild = if k % 10 == 7 { 20.0 } else { 0.0 };
        let noise = 0.05 * ((k * 7919 % 100) as f64 / 50.0 - 1.0);
        lines += &format!(
            "{},A{a},A{b},{}\n",
            0.02 * k as f64,
            away(b) - away(a) + noise + wild
        );
    }
    nova.file("differences.csv", lines);
    let named: String = (ANCHORS.iter().enumerate())
        .map(|(k, place)| format!("[[anchor]]\nnode = \"A{k}\"\nposition_m = {place:?}\n"))
        .collect();
    nova.file("anchors.toml", named);
    let command = [
        "locate",
        "differences.csv",
        "--anchors",
        "anchors.toml",
        "--columns",
        "anchor_a=from,anchor_b=to,difference_m=d",
        "--json",
        "--heights",
        "0,2",
    ];
    let moving = end(&nova.run(&command));
    let still = end(&nova.run(&[&command[..], &["--still"]].concat()));
    for place in [&moving["end_m"], &still["still"]["position_m"]] {
        let off: f64 = (place.as_array().unwrap().iter().zip(tag))
            .map(|(found, wanted)| (number(found) - wanted).powi(2))
            .sum();
        assert!(off.sqrt() < 0.25, "{place}");
    }
    for counts in [&moving["counts"], &still["counts"]] {
        assert!(number(&counts["set_aside"]) >= 38.0, "{counts}");
        assert!(number(&counts["set_aside"]) < 60.0, "{counts}");
    }
}

#[test]
fn what_cannot_be_located_is_said_in_a_sentence() {
    let nova = heard();
    nova.file("three.toml", toml(&ANCHORS[..3], 1));
    nova.file("strangers.toml", toml(&ANCHORS, 11));
    nova.file("twice.toml", toml(&[ANCHORS[0]; 4], 1));
    nova.file("empty.csv", "t_s,anchor_a,anchor_b,difference_m\n");
    nova.file("bad.csv", "t_s,anchor_a,anchor_b,difference_m\n1,1,2,x\n");
    nova.file(
        "few.csv",
        "t_s,anchor_a,anchor_b,difference_m\n1,1,2,0.5\n1,1,3,0.5\n",
    );
    nova.file("garbage.bin", [1, 2, 3, 0, 4, 5, 0]);
    for (arguments, wanted) in [
        (
            &["0x0005.bin", "--anchors", "three.toml"][..],
            "3 anchors; differences of distances need four or more",
        ),
        (
            &["0x0005.bin", "--anchors", "strangers.toml"],
            "unknown_anchor",
        ),
        (
            &["0x0005.bin", "--anchors", "twice.toml"],
            "two anchors stand at one place",
        ),
        (
            &["0x0001.bin", "--anchors", "anchors.toml"],
            "overheard nothing",
        ),
        (
            &["empty.csv", "--anchors", "anchors.toml"],
            "no lines after the header",
        ),
        (
            &["bad.csv", "--anchors", "anchors.toml"],
            "line 2: difference_m is 'x', not a number",
        ),
        (
            &["few.csv", "--anchors", "anchors.toml"],
            "no place can be told; 2 differences were had",
        ),
        (
            &["few.csv", "--anchors", "anchors.toml", "--still"],
            "2 measurements cannot determine 3 unknowns",
        ),
        (
            &["garbage.bin", "--anchors", "anchors.toml"],
            "is this what a board sent?",
        ),
        (
            &["nothing.bin", "--anchors", "anchors.toml"],
            "cannot be read",
        ),
        (
            &["few.csv", "--anchors", "anchors.toml", "--heights", "3,1"],
            "the lower first",
        ),
        (
            &["few.csv", "--anchors", "anchors.toml", "--sigma", "nan"],
            "--sigma must lie between",
        ),
    ] {
        let said = nova.run(&[&["locate"], arguments].concat());
        assert_eq!(said.code, 2, "{arguments:?}: {}", said.err);
        assert!(said.err.contains(wanted), "{arguments:?}: {}", said.err);
        assert!(said.out.is_empty(), "{arguments:?}: {}", said.out);
    }
}

/// The recording of docs/survey-and-fusion.md, by the command that stands there.
#[test]
fn a_recorded_tag_at_rest_is_placed_with_its_outliers_counted() {
    let (Some(file), Some(anchors)) = (
        recorded("D_crazyflie_tdoa_static/tdoa.csv"),
        recorded("D_crazyflie_tdoa_static/anchors.csv"),
    ) else {
        return;
    };
    let nova = Nova::new();
    let places: Vec<[f64; 3]> = (std::fs::read_to_string(anchors).unwrap().lines().skip(1))
        .map(|line| {
            let numbers: Vec<f64> = line
                .split(',')
                .map(|field| field.parse().unwrap())
                .collect();
            [numbers[1], numbers[2], numbers[3]]
        })
        .collect();
    nova.file("anchors.toml", toml(&places, 0));
    let said = nova.run(&[
        "locate",
        file.to_str().unwrap(),
        "--anchors",
        "anchors.toml",
        "--columns",
        "difference_m=dist_b_minus_dist_a_m",
        "--sigma",
        "0.15",
        "--still",
        "--json",
    ]);
    let end = end(&said);
    let off: f64 = (end["still"]["position_m"].as_array().unwrap().iter())
        .map(|v| number(v).powi(2))
        .sum();
    println!("{end}");
    assert!(off.sqrt() < 0.45, "{end}");
    assert!(
        (40.0..200.0).contains(&number(&end["counts"]["set_aside"])),
        "{end}"
    );
}
