//! `nova guide` on made and on recorded measurements.
#![allow(clippy::unwrap_used)]

mod common;

use common::{Nova, Said, recorded};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;

const TAG: [f64; 3] = [3.0, -4.0, 0.0];

/// A path at 1 m/s, seconds to metres.
type Path = fn(f64) -> [f64; 3];

fn descending_circle(t_s: f64) -> [f64; 3] {
    let angle = t_s / 6.0;
    [6.0 * angle.cos(), 6.0 * angle.sin(), 12.0 - 0.12 * t_s]
}

fn straight_line(t_s: f64) -> [f64; 3] {
    [t_s - 20.0, 5.0, 10.0]
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    let square: f64 = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum();
    square.sqrt()
}

/// A minute of ranges at 10 Hz with errors of up to 5 cm to two nodes, and dead reckoning at 20 Hz
/// that drifts away with 4 mm/s.
fn measurements(path: Path) -> (String, String) {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let mut ranges = String::from("t_s,peer,range_m\n");
    let mut ins = String::from("t_s,x_m,y_m,z_m\n");
    for tick in 0..1200 {
        let t_s = 0.05 * f64::from(tick);
        let place = path(t_s);
        let [x, y, z] = place;
        let noise_m = rng.random_range(-0.01..0.01);
        ins += &format!("{t_s:.3},{},{y},{}\n", x + 0.004 * t_s, z + noise_m);
        if tick % 2 == 0 {
            // Between two readings of dead reckoning.
            let t_s = t_s + 0.02;
            for (peer, tag) in [("7", TAG), ("kitchen", [-8.0, 1.0, 1.0])] {
                let range_m = distance(path(t_s), tag) + rng.random_range(-0.05..0.05);
                ranges += &format!("{t_s:.3},{peer},{range_m}\n");
            }
        }
    }
    (ranges, ins)
}

fn nova(path: Path) -> Nova {
    let (ranges, ins) = measurements(path);
    let nova = Nova::new();
    nova.file("ranges", ranges).file("ins", ins);
    nova
}

const FILES: [&str; 5] = ["guide", "--board", "ranges", "--ins", "ins"];

fn guide(nova: &Nova, more: &[&str]) -> Said {
    nova.run(&[&FILES[..], more].concat())
}

fn vector(value: &Value) -> [f64; 3] {
    let numbers: Vec<f64> = value
        .as_array()
        .unwrap()
        .iter()
        .map(|v| v.as_f64().unwrap())
        .collect();
    numbers.try_into().unwrap()
}

/// Error and length of the sigma of an estimate.
fn error_and_sigma(estimate: &Value, truth: [f64; 3]) -> (f64, f64) {
    let sigma = distance(vector(&estimate["sigma_m"]), [0.0; 3]);
    (distance(vector(&estimate["tag_m"]), truth), sigma)
}

/// The last word on each node.
fn ends(said: &Said) -> Vec<Value> {
    assert_eq!(said.code, 0, "{}", said.err);
    said.json()
        .iter()
        .filter_map(|line| line.get("end"))
        .cloned()
        .collect()
}

#[test]
fn every_node_is_found_within_its_sigma() {
    let said = guide(&nova(descending_circle), &[]);
    assert_eq!(said.err, "");
    let ends = ends(&said);
    assert_eq!(ends.len(), 2);
    for (end, (peer, truth)) in ends
        .iter()
        .zip([(Value::from(7), TAG), ("kitchen".into(), [-8.0, 1.0, 1.0])])
    {
        assert_eq!(end["peer"], peer);
        let (error_m, sigma_m) = error_and_sigma(&end["estimate"], truth);
        println!("{peer}: error {error_m:.3} m, sigma {sigma_m:.3} m");
        assert!(
            error_m < 0.5 && error_m < 3.0 * sigma_m,
            "{error_m} {sigma_m}"
        );
        let doubts = &end["estimate"]["doubts"];
        assert_eq!(doubts.as_array().unwrap().len(), 0, "{doubts}");
        assert_eq!(end["refused"], 0);
        let all = end["ranges"].as_u64().unwrap() + end["unpaired"].as_u64().unwrap();
        assert_eq!(all, 600);
    }
}

#[test]
fn lines_say_what_an_autopilot_needs() {
    let said = guide(&nova(descending_circle), &["--peer", "7"]);
    let lines = said.json();
    let (end, news) = lines.split_last().unwrap();
    assert_eq!(end["end"]["peer"], 7);
    assert!(news.len() > 100);
    let mut last_s = f64::NEG_INFINITY;
    for line in news {
        let t_s = line["t_s"].as_f64().unwrap();
        assert!(t_s > last_s);
        last_s = t_s;
        assert_eq!(line["peer"], 7);
        let command = &line["command"];
        assert!(["hold", "fly", "land"].contains(&command["action"].as_str().unwrap()));
        vector(&command["waypoint_m"]);
        vector(&command["ins_error"]["velocity_m_s"]);
    }
    let estimate = &news.last().unwrap()["estimate"];
    for (row, column) in [(0, 1), (0, 2), (1, 2)] {
        let covariance = &estimate["covariance_m2"];
        let [upper, lower] = [(row, column), (column, row)]
            .map(|(row, column)| covariance[row][column].as_f64().unwrap());
        assert!((upper - lower).abs() < 1e-9);
    }
}

#[test]
fn a_straight_flight_is_not_believed() {
    for end in ends(&guide(&nova(straight_line), &[])) {
        let estimate = &end["estimate"];
        let doubts = estimate["doubts"].to_string();
        let doubted = doubts.contains("weak_geometry") || doubts.contains("ambiguous");
        assert!(doubted, "{estimate}");
    }
}

#[test]
fn the_summary_is_a_table_with_the_doubts() {
    let said = guide(&nova(straight_line), &["--summary"]);
    assert_eq!((said.code, said.err.as_str()), (0, ""));
    assert!(said.out.contains("sigma (m)") && said.out.contains("kitchen"));
    assert!(said.out.contains("! "), "{}", said.out);
}

#[test]
fn a_capture_of_the_demonstration_leads_to_its_tag() {
    let nova = Nova::new();
    let demo = nova.demonstration();
    let truth = vector(&demo.json()[0]["tag_m"]);
    let said = nova.run(&[
        "guide",
        "--board",
        "anchor.bin",
        "--ins",
        "flight.csv",
        "--speed",
        "2",
    ]);
    let end = &ends(&said)[0];
    let (error_m, sigma_m) = error_and_sigma(&end["estimate"], truth);
    println!("error {error_m:.3} m, sigma {sigma_m:.3} m");
    assert!(error_m < 0.1, "{end}");
}

#[test]
fn bad_lines_are_named_or_skipped_where_asked_for() {
    let (ranges, ins) = measurements(descending_circle);
    let changed = |text: &str, line: usize, new: &str| {
        let mut lines: Vec<&str> = text.lines().collect();
        lines[line - 1] = new;
        lines.join("\n")
    };
    for (bad_ranges, bad_ins, mention) in [
        (
            changed(&ranges, 5, "0.2,7,NaN"),
            ins.clone(),
            "ranges: line 5: range_m is NaN",
        ),
        (
            changed(&ranges, 9, "0.01,7,12"),
            ins.clone(),
            "ranges: line 9: t_s is not after",
        ),
        (
            changed(&ranges, 4, "0.2,,12"),
            ins.clone(),
            "ranges: line 4: peer is empty",
        ),
        (
            changed(&ranges, 4, "0.2,7,-3"),
            ins.clone(),
            "ranges: line 4: range_m is negative",
        ),
        (
            ranges.clone(),
            changed(&ins, 7, "0.01,0,0,9"),
            "ins: line 7: t_s is not after",
        ),
        (
            ranges.clone(),
            changed(&ins, 7, "0.25,0,inf,9"),
            "ins: line 7: y_m is inf",
        ),
        (
            ranges.clone(),
            changed(&ins, 7, "0.25,0,9"),
            "ins: line 7: 3 fields instead of 4",
        ),
    ] {
        let nova = Nova::new();
        nova.file("ranges", bad_ranges).file("ins", bad_ins);
        let said = guide(&nova, &[]);
        assert_eq!((said.code, said.out.as_str()), (2, ""), "{mention}");
        assert!(said.err.contains(mention), "{}", said.err);
        let said = guide(&nova, &["--skip-bad", "--summary", "--peer", "7"]);
        assert_eq!(said.code, 0, "{}", said.err);
        assert!(said.err.contains("lines skipped"), "{}", said.err);
    }
}

#[test]
fn ranges_that_dead_reckoning_does_not_reach_are_counted() {
    let (ranges, ins) = measurements(descending_circle);
    // Silent from 20 s to 30 s.
    let silent: Vec<&str> = (ins.lines().enumerate())
        .filter(|(line, _)| !(402..602).contains(line))
        .map(|(_, line)| line)
        .collect();
    let nova = Nova::new();
    nova.file("ranges", ranges).file("ins", silent.join("\n"));
    for end in ends(&guide(&nova, &[])) {
        let unpaired = end["unpaired"].as_u64().unwrap();
        assert!((100..=103).contains(&unpaired), "{end}");
        assert_eq!(end["ranges"].as_u64().unwrap() + unpaired, 600);
    }
}

#[test]
fn sources_that_do_not_go_together_are_refused() {
    let (ranges, ins) = measurements(descending_circle);
    let later: String = (ins.lines().enumerate())
        .map(|(line, text)| match (line, text.split_once(',')) {
            (1.., Some((_, place))) => format!("{},{place}\n", 1000 + line),
            _ => format!("{text}\n"),
        })
        .collect();
    for (arguments, mentions) in [
        (
            &["--board", "ranges", "--ins", "udp:127.0.0.1:0"][..],
            ["ranges", "--ins FILE"],
        ),
        (
            &["--board", "no-such-port", "--ins", "ins"],
            ["no-such-port", "udp:"],
        ),
        (
            &["--board", "no-such-port", "--ins", "udp:127.0.0.1:0"],
            ["no-such-port", "cannot be read"],
        ),
        (
            &["--board", "/dev/ttyNOVA9", "--ins", "udp:127.0.0.1:0"],
            ["/dev/ttyNOVA9", "cannot be opened"],
        ),
        (
            &["--board", "ranges", "--ins", "nowhere"],
            ["nowhere", "cannot be read"],
        ),
        (
            &["--board", "ranges", "--ins", "udp:here"],
            ["udp:here", "udp:ADDRESS:PORT"],
        ),
        (
            &["--board", "ranges", "--ins", "ranges"],
            ["'x_m'", "--ins-columns x_m="],
        ),
        (
            &["--board", "ins", "--ins", "ins"],
            ["'peer'", "--range-columns peer="],
        ),
        (
            &["--board", "ranges", "--ins", "later"],
            ["ranges", "does not reach"],
        ),
        (
            &["--board", "ranges", "--ins", "ins", "--peer", "8"],
            ["no range", "asked for"],
        ),
        (
            &["--board", "ranges", "--ins", "ins", "--first-guess", "1,2"],
            ["--first-guess", "X,Y,Z"],
        ),
        (
            &["--board", "ranges", "--ins", "ins", "--speed", "0"],
            ["--speed", "more than 0"],
        ),
    ] {
        let nova = Nova::new();
        nova.file("ranges", &ranges)
            .file("ins", &ins)
            .file("later", &later);
        let said = nova.run(&[&["guide", "--summary"], arguments].concat());
        assert_eq!(said.code, 2, "{arguments:?}: {}", said.out);
        for mention in mentions {
            assert!(said.err.contains(mention), "no '{mention}' in {}", said.err);
        }
    }
}

/// Where the anchors of a recording were surveyed: the file's last four fields.
fn surveyed(file: &str, starts_with: &str) -> Option<Vec<(u64, [f64; 3])>> {
    let text = std::fs::read_to_string(recorded(file)?).unwrap();
    let anchors = text
        .lines()
        .skip(1)
        .filter(|line| line.starts_with(starts_with))
        .map(|line| {
            let fields: Vec<&str> = line.rsplitn(5, ',').collect();
            let number = |k: usize| fields[k].parse::<f64>().unwrap();
            (
                fields[3].parse().unwrap(),
                [number(2), number(1), number(0)],
            )
        });
    Some(anchors.collect())
}

/// Guides to each anchor of a recording from a first guess 1.7 m off; prints error and sigma and hands
/// them to `check`, with the doubts.
fn on_recording(
    file: &str,
    options: &[&str],
    anchors: &[(u64, [f64; 3])],
    check: impl Fn(f64, f64, &str),
) {
    let path = recorded(file).unwrap();
    let path = path.to_str().unwrap();
    for (anchor, truth) in anchors {
        let guess = [truth[0] + 1.0, truth[1] - 1.0, truth[2] - 1.0].map(|c| c.to_string());
        let (guess, peer) = (guess.join(","), anchor.to_string());
        let files = ["guide", "--board", path, "--ins", path, "--skip-bad"];
        let wanted = [
            "--peer",
            &peer,
            "--first-guess",
            &guess,
            "--guess-sigma",
            "2",
        ];
        let said = Nova::new().run(&[&files[..], &wanted, options].concat());
        let estimate = &ends(&said)[0]["estimate"];
        let (error_m, sigma_m) = error_and_sigma(estimate, *truth);
        let doubts = estimate["doubts"].to_string();
        println!("{file}: anchor {anchor}: error {error_m:.2} m, sigma {sigma_m:.2} m, {doubts}");
        check(error_m, sigma_m, &doubts);
    }
}

/// How B1 is to be read; see docs/recorded-data.md.
const B1: [&str; 4] = ["--range-columns", "peer=anchor", "--range-bias", "0.24"];
const B1_ANCHORS: &str = "B1_drone_ranges_rcv/anchors.csv";

#[test]
fn errors_on_recorded_flights_are_within_their_sigmas_or_doubted() {
    let Some(anchors) = surveyed(B1_ANCHORS, "2,") else {
        return;
    };
    assert_eq!(anchors.len(), 4);
    let file = "B1_drone_ranges_rcv/seq2_ranges.csv";
    on_recording(file, &B1, &anchors, |error_m, sigma_m, _| {
        assert!(error_m < 3.0 * sigma_m && sigma_m < 1.0);
    });
    let anchors = surveyed("A2_miluv/anchors_constellation0.csv", "").unwrap();
    let file = "A2_miluv/random3_flight_anchors0to2.csv";
    let columns = [
        "--range-columns",
        "peer=to_id,range_m=range_cal_m",
        "--ins-columns",
        "x_m=tag_x_m,y_m=tag_y_m,z_m=tag_z_m",
    ];
    // A range every 1.3 s for three minutes: dead reckoning may have drifted by metres.
    on_recording(file, &columns, &anchors[..3], |error_m, sigma_m, doubts| {
        assert!(error_m < 3.0 * sigma_m || doubts != "[]");
    });
}

#[test]
fn a_recorded_straight_flight_is_doubted_or_leaves_a_large_sigma() {
    let Some(anchors) = surveyed(B1_ANCHORS, "5,") else {
        return;
    };
    let file = "B1_drone_ranges_rcv/seq5_ranges.csv";
    on_recording(file, &B1, &anchors, |error_m, sigma_m, doubts| {
        let doubted = doubts.contains("weak_geometry") || doubts.contains("ambiguous");
        // As much as the widest of the winding flight among the same anchors (0.41 m), and enough for the error.
        assert!(doubted || (sigma_m > 0.4 && error_m < 2.0 * sigma_m));
    });
}
