//! `nova fuse` on files of a simulated flight, sound and spoilt.
#![allow(clippy::unwrap_used)]

mod common;

use common::Nova;

const FILES: [&str; 9] = [
    "fuse",
    "--imu",
    "f/imu.csv",
    "--gnss",
    "f/gnss.csv",
    "--ranges",
    "f/ranges.csv",
    "--anchors",
    "f/anchors.toml",
];

fn example() -> Nova {
    let nova = Nova::new();
    let said = nova.run(&["fuse", "--example", "f"]);
    assert_eq!(said.code, 0, "{}", said.err);
    nova
}

fn run(nova: &Nova, more: &[&str]) -> common::Said {
    nova.run(&[&FILES[..], more].concat())
}

#[test]
fn both_modes_follow_the_flight_and_tight_is_better() {
    let nova = example();
    // Among the anchors: on the way there is nothing but GNSS.
    let truth = std::fs::read_to_string(nova.folder.path().join("f/truth.csv")).unwrap();
    let late = |line: &&str| {
        let t_s: f64 = line.split(',').next().unwrap().parse().unwrap_or(0.0);
        t_s > 20.0
    };
    let lines: Vec<&str> = (truth.lines().take(1))
        .chain(truth.lines().filter(late))
        .collect();
    nova.file("late.csv", lines.join("\n"));
    let rmse = |mode| {
        let said = run(
            &nova,
            &[
                "--mode",
                mode,
                "--truth",
                "late.csv",
                "--json",
                "--out",
                "track.csv",
            ],
        );
        assert_eq!(said.code, 0, "{}", said.err);
        let report = &said.json()[0];
        ["rmse_horizontal_m", "rmse_vertical_m"]
            .map(|name| report["errors"][name].as_f64().unwrap())
    };
    let (loose, tight) = (rmse("loose"), rmse("tight"));
    for k in 0..2 {
        assert!(
            tight[k] < 0.5 * loose[k] && tight[k] < 0.3,
            "{tight:?} {loose:?}"
        );
    }
    let track = std::fs::read_to_string(nova.folder.path().join("track.csv")).unwrap();
    assert!(track.starts_with("t_s,x_m") && track.lines().next().unwrap().ends_with("alt_m"));
    assert!(track.lines().count() > 500);
    let text = run(&nova, &[]);
    assert!(text.out.contains("NIS of ranges"), "{}", text.out);
}

#[test]
fn lines_out_of_order_are_sorted_and_said() {
    let nova = example();
    let path = nova.folder.path().join("f/ranges.csv");
    let content = std::fs::read_to_string(&path).unwrap();
    let (straight, before) = (run(&nova, &["--json"]), content.lines().count());
    let mut lines: Vec<&str> = content.lines().collect();
    lines[1..].reverse();
    assert_eq!(lines.len(), before);
    std::fs::write(&path, lines.join("\n")).unwrap();
    let reversed = run(&nova, &["--json"]);
    assert!(
        reversed.err.contains("lines out of order, sorted"),
        "{}",
        reversed.err
    );
    assert_eq!(straight.json()[0]["end_m"], reversed.json()[0]["end_m"]);
}

#[test]
fn bad_input_names_file_and_line() {
    let nova = example();
    let folder = nova.folder.path().join("f");
    for (file, from, to, message) in [
        ("imu.csv", ",9.", ",x.", "imu.csv: line 2: fz_m_s2"),
        (
            "imu.csv",
            "fx_m_s2",
            "ax",
            "imu.csv: line 1: there is no column 'fx_m_s2'",
        ),
        (
            "gnss.csv",
            "\n0.000,37.",
            "\n0.000,97.",
            "gnss.csv: line 2: lat_deg makes no place",
        ),
        (
            "ranges.csv",
            "peer",
            "from",
            "ranges.csv: line 1: there is no column 'peer'",
        ),
        (
            "anchors.toml",
            "position_m = [",
            "position_m = [1e99, ",
            "anchors.toml: ",
        ),
        (
            "anchors.toml",
            "node = 2",
            "node = 1",
            "anchor 1 is in it twice",
        ),
    ] {
        let path = folder.join(file);
        let sound = std::fs::read_to_string(&path).unwrap();
        let spoilt = sound.replacen(from, to, 1);
        assert_ne!(sound, spoilt, "{file}: {from}");
        std::fs::write(&path, spoilt).unwrap();
        let said = run(&nova, &[]);
        assert_eq!(said.code, 2, "{file} {to}: {}", said.err);
        assert!(said.err.contains(message), "{file} {to}: {}", said.err);
        std::fs::write(&path, sound).unwrap();
    }
    let said = nova.run(&["fuse", "--imu", "f/imu.csv"]);
    assert_eq!(said.code, 2);
}

#[test]
fn page_shows_the_track_its_doubt_and_what_became_of_ranges() {
    let nova = example();
    let plain = run(&nova, &["--plot", "plain.html"]);
    assert_eq!(plain.code, 0, "{}", plain.err);
    let said = run(&nova, &["--truth", "f/truth.csv", "--plot", "page.html"]);
    assert_eq!(said.code, 0, "{}", said.err);
    let read = |name| std::fs::read_to_string(nova.folder.path().join(name)).unwrap();
    let (plain, page) = (read("plain.html"), read("page.html"));
    assert_eq!(page.matches("<svg").count(), 4);
    for text in [
        "two sigmas",
        "set aside",
        "weighed down",
        "anchors",
        "error, vertical",
    ] {
        assert!(page.contains(text), "{text}");
    }
    assert!(!plain.contains("error, vertical") && plain.matches("<svg").count() == 4);
    let loose = run(&nova, &["--mode", "loose", "--plot", "loose.html"]);
    assert_eq!(loose.code, 0, "{}", loose.err);
    assert_eq!(read("loose.html").matches("<svg").count(), 3);
    let nowhere = run(&nova, &["--plot", "nowhere/page.html"]);
    assert_eq!(nowhere.code, 1);
    assert!(nowhere.err.contains("nowhere/page.html"), "{}", nowhere.err);
}
