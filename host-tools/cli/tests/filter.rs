//! `nova filter` on made and on recorded ranges.
#![allow(clippy::unwrap_used)]

mod common;

use common::{Nova, recorded};
use std::fmt::Write as _;

/// A peer that swings by 2 m in 9 s, seen 10 times a second; every 20th range is 30 m off.
fn flight(nova: &Nova) {
    let (mut ranges, mut truth) = (
        String::from("t_s,peer,range_m\n"),
        String::from("t_s,x_m,y_m,z_m\n"),
    );
    for k in 0..600 {
        let t_s = f64::from(k) * 0.1;
        let x_m = 5.0 + 2.0 * (t_s * 0.7).sin();
        let noise_m = f64::from((k * 7_919) % 101 - 50) * 0.001;
        let gross_m = if k % 20 == 13 { 30.0 } else { 0.0 };
        writeln!(truth, "{t_s},{x_m},0,0").unwrap();
        writeln!(ranges, "{t_s},7,{}", x_m + 0.2 + noise_m + gross_m).unwrap();
    }
    nova.file("ranges.csv", ranges).file("truth.csv", truth);
}

#[test]
fn each_range_gets_an_estimate_and_the_word_for_what_became_of_it() {
    let nova = Nova::new();
    nova.file(
        "ranges.csv",
        "t_s,peer,range_m\n0,1,5\n0,2,8\n0.1,1,5.02\n0.2,1,55\n0.2,2,8.01\n0.3,2,-9\n",
    );
    let said = nova.run(&["filter", "ranges.csv", "--per", "peer", "--json"]);
    assert_eq!((said.code, said.err.as_str()), (0, ""));
    let got: Vec<(String, String)> = said
        .json()
        .iter()
        .map(|l| {
            assert!(l["range_m"].as_f64().unwrap() < 10.0);
            let text = |key: &str| l[key].as_str().unwrap().to_owned();
            (text("pair"), text("treatment"))
        })
        .collect();
    let expected = [
        ("1", "started"),
        ("1", "accepted"),
        ("1", "rejected_outlier"),
        ("2", "started"),
        ("2", "accepted"),
        ("2", "rejected_invalid"),
    ];
    assert_eq!(got, expected.map(|(p, t)| (p.to_owned(), t.to_owned())));
    let table = nova.run(&["filter", "ranges.csv", "--per", "peer"]);
    assert_eq!(table.out.lines().count(), 7);
    assert!(
        table.out.contains("\n4,0.1,1,5.02,accepted,5.0"),
        "{}",
        table.out
    );
}

/// Methods of a comparison: rms, worst error and delay.
fn methods(nova: &Nova, arguments: &[&str]) -> [(f64, f64, Option<f64>); 4] {
    let said = nova.run(&[&["filter", "--json"], arguments].concat());
    assert_eq!((said.code, said.err.as_str()), (0, ""));
    let lines = said.json();
    ["raw", "median of 5", "mean of 5", "filter"].map(|method| {
        let line = lines.iter().find(|l| l["method"] == method).unwrap();
        let number = |key: &str| line[key].as_f64();
        (
            number("rms_m").unwrap(),
            number("worst_m").unwrap(),
            number("delay_s"),
        )
    })
}

#[test]
fn a_comparison_measures_error_and_delay() {
    let nova = Nova::new();
    flight(&nova);
    let arguments = [
        "ranges.csv",
        "--per",
        "peer",
        "--truth",
        "truth.csv",
        "--anchor",
        "7=0,0,0",
    ];
    let [raw, median, mean, filter] = methods(&nova, &arguments);
    assert!(raw.1 > 29.0 && mean.1 > 5.0, "{raw:?} {mean:?}");
    assert!(filter.0 < 0.05 && filter.1 < 0.2, "{filter:?}");
    assert_eq!(raw.2, Some(0.0));
    for two_samples in [median, mean] {
        assert!(
            (two_samples.2.unwrap() - 0.2).abs() < 0.05,
            "{two_samples:?}"
        );
    }
    assert!(filter.2.unwrap().abs() < 0.03, "{filter:?}");
    let table = nova.run(&[&["filter"], &arguments[..]].concat());
    assert!(table.out.contains("| filter | 0.0"), "{}", table.out);
    assert!(table.out.contains("rejected_outlier 30"), "{}", table.out);
}

#[test]
fn what_is_wrong_is_said_with_file_and_line() {
    let nova = Nova::new();
    flight(&nova);
    nova.file("bad.csv", "t_s,range_m\n0,1\n1,x\n")
        .file("back.csv", "t_s,x_m,y_m,z_m\n1,0,0,0\n0,0,0,0\n");
    for (arguments, mention) in [
        (&["bad.csv"][..], "bad.csv: line 3: range_m is 'x'"),
        (
            &["ranges.csv", "--per", "anchor"],
            "there is no column 'anchor'",
        ),
        (
            &["ranges.csv", "--sigma", "0"],
            "sigma_m = 0 is not between",
        ),
        (&["ranges.csv", "--channel", "6"], "6"),
        (
            &["ranges.csv", "--per", "peer", "--truth", "truth.csv"],
            "--anchor 7=X,Y,Z",
        ),
        (
            &["ranges.csv", "--truth", "back.csv", "--anchor", "=0,0,0"],
            "back.csv: line 3",
        ),
    ] {
        let said = nova.run(&[&["filter"], arguments].concat());
        assert_eq!((said.code, said.out.as_str()), (2, ""), "{arguments:?}");
        assert!(said.err.contains(mention), "{arguments:?}: {}", said.err);
    }
}

/// On every recorded flight the filter's error is below that of raw ranges, median and mean, and it is later than
/// the raw ranges by less than a tenth of what the others are.
#[test]
fn on_recorded_flights_the_filter_is_better_and_sooner_than_median_and_mean() {
    let nova = Nova::new();
    for (name, arguments) in recordings() {
        let [raw, median, mean, filter] = methods(
            &nova,
            &arguments.iter().map(String::as_str).collect::<Vec<_>>(),
        );
        println!("{name}: raw {raw:?}, median {median:?}, mean {mean:?}, filter {filter:?}");
        for other in [raw, median, mean] {
            assert!(filter.0 < other.0 * 0.95, "{name}: {filter:?} {other:?}");
        }
        if let (Some(filter), Some(median), Some(mean)) = (filter.2, median.2, mean.2) {
            assert!(
                filter.abs() < 0.1 * median.min(mean),
                "{name}: {filter} {median} {mean}"
            );
        }
    }
}

/// The recorded flights that are at hand, with the command's arguments for each.
fn recordings() -> Vec<(String, Vec<String>)> {
    let mut all = Vec::new();
    for seq in ["1", "2", "5"] {
        let file = |what: &str| recorded(&format!("B1_drone_ranges_rcv/seq{seq}_{what}.csv"));
        let (Some(ranges), Some(mocap), Some(anchors)) = (
            file("ranges"),
            file("mocap"),
            recorded("B1_drone_ranges_rcv/anchors.csv"),
        ) else {
            continue;
        };
        let mut arguments = vec![
            text(&ranges),
            "--per".into(),
            "anchor".into(),
            "--truth".into(),
            text(&mocap),
        ];
        for line in std::fs::read_to_string(anchors).unwrap().lines() {
            if let [s, anchor, x, y, z] = line.split(',').collect::<Vec<_>>()[..]
                && s == seq
            {
                arguments.extend(["--anchor".into(), format!("{anchor}={x},{y},{z}")]);
            }
        }
        all.push((format!("B1 {seq}"), arguments));
    }
    for case in ["LOSA", "NLOSA"] {
        let file =
            |what: &str| recorded(&format!("B2_dwm1001_outdoor/dyn_{case}_case1_{what}.csv"));
        if let (Some(ranges), Some(rtk)) = (file("ranges"), file("rtk_enu")) {
            let mut arguments = vec![text(&ranges), "--truth".into(), text(&rtk)];
            arguments.extend(B2.map(String::from));
            all.push((format!("B2 {case}"), arguments));
        }
    }
    all
}

/// The antenna is 1 m up, the ranges are 0.18 s late (the recording's notes).
const B2: [&str; 8] = [
    "--per",
    "anchor",
    "--columns",
    "anchor_x_m=ax_m,anchor_y_m=ay_m,anchor_z_m=az_m,first_path_power_dbm=fp_power_dbm",
    "--antenna",
    "0,0,1",
    "--truth-delay",
    "0.18",
];

fn text(path: &std::path::Path) -> String {
    path.to_str().unwrap().to_owned()
}

/// One range in 2.6 s and pair, a third of them behind obstacles: next to nothing can be smoothed. The filter
/// does no harm, where the others do.
#[test]
fn where_ranges_are_rare_the_filter_does_no_harm() {
    let Some(file) = recorded("A2_miluv/random3_flight_anchors0to2.csv") else {
        return;
    };
    let nova = Nova::new();
    let arguments = [
        text(&file),
        "--per".into(),
        "from_id,to_id".into(),
        "--columns".into(),
        "range_m=range_raw_m,truth_m=gt_range_m".into(),
    ];
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let [raw, median, mean, filter] = methods(&nova, &arguments);
    println!("MILUV: raw {raw:?}, median {median:?}, mean {mean:?}, filter {filter:?}");
    assert!(filter.0 < raw.0 * 1.02);
    assert!(filter.0 < median.0 / 2.0 && filter.0 < mean.0 / 2.0);
    assert_eq!(filter.2, None);
}
