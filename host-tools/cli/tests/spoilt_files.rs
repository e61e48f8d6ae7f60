//! What `nova survey` and `nova fuse` do with files that are spoilt anywhere: they never panic, and say which
//! file it is, in CSV files which line.
#![allow(clippy::unwrap_used)]

mod common;

use common::{Nova, Said};
use proptest::prelude::*;
use std::fmt::Write as _;
use std::sync::OnceLock;

/// Files by name, in the order of the command's options.
type Files = Vec<(&'static str, String)>;

/// The first seconds of the example's flight.
fn fuse_files() -> &'static Files {
    static FILES: OnceLock<Files> = OnceLock::new();
    FILES.get_or_init(|| {
        let nova = Nova::new();
        assert_eq!(nova.run(&["fuse", "--example", "f"]).code, 0);
        [
            "imu.csv",
            "gnss.csv",
            "ranges.csv",
            "truth.csv",
            "anchors.toml",
        ]
        .map(|name| {
            let text = std::fs::read_to_string(nova.folder.path().join("f").join(name)).unwrap();
            let most = if name == "anchors.toml" {
                usize::MAX
            } else {
                60
            };
            let lines: Vec<&str> = text.lines().take(most).collect();
            (name, lines.join("\n") + "\n")
        })
        .into()
    })
}

fn survey_files() -> &'static Files {
    static FILES: OnceLock<Files> = OnceLock::new();
    FILES.get_or_init(|| {
        let mut track = String::from("t_s,x_m,y_m,z_m\n");
        let mut ranges = String::from("t_s,range_m,sigma_m,peer\n");
        for k in 0..60 {
            let t = 0.2 * f64::from(k);
            let place = [8.0 * t.cos(), 6.0 * t.sin(), 5.0 + (0.7 * t).sin()];
            let _ = writeln!(
                track,
                "{t:.2},{:.4},{:.4},{:.4}",
                place[0], place[1], place[2]
            );
            let range = place.iter().map(|v| (v - 1.0).powi(2)).sum::<f64>().sqrt();
            let _ = writeln!(ranges, "{:.2},{range:.4},0.1,7", t + 0.05);
        }
        vec![("track.csv", track), ("ranges.csv", ranges)]
    })
}

fn run(files: &[(&str, Vec<u8>)]) -> Said {
    let nova = Nova::new();
    for (name, content) in files {
        nova.file(name, content);
    }
    if files.iter().any(|(name, _)| *name == "imu.csv") {
        let files = [
            "--imu",
            "imu.csv",
            "--gnss",
            "gnss.csv",
            "--ranges",
            "ranges.csv",
        ];
        let rest = ["--anchors", "anchors.toml", "--truth", "truth.csv"];
        nova.run(&[&["fuse"], &files[..], &rest[..]].concat())
    } else {
        nova.run(&["survey", "ranges.csv", "--track", "track.csv"])
    }
}

/// The files with one of them as this says.
fn with(
    files: &Files,
    which: usize,
    spoil: impl Fn(&str) -> Vec<u8>,
) -> Vec<(&'static str, Vec<u8>)> {
    (files.iter().enumerate())
        .map(|(k, (name, text))| {
            let content = if k == which {
                spoil(text)
            } else {
                text.clone().into_bytes()
            };
            (*name, content)
        })
        .collect()
}

/// One of the commands' files.
fn any_file() -> impl Strategy<Value = (&'static Files, usize)> {
    (any::<bool>(), 0usize..20).prop_map(|(fuse, which)| {
        let files = if fuse { fuse_files() } else { survey_files() };
        (files, which % files.len())
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 96, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_field_that_is_no_number_is_told_by_file_and_line(
        (files, which) in any_file(), line in 0usize..1000, column in 0usize..8,
        junk in prop::sample::select(vec!["", "x", "nan", "-inf", "1e999", "1.2.3", "0x10", "--1", "1 2"]),
    ) {
        let (name, text) = &files[which];
        // The last of a CSV file's columns names the peer in one of them, which may be anything.
        let columns = text.lines().next().unwrap().split(',').position(|c| c == "peer");
        prop_assume!(name.ends_with(".csv"));
        let line = 1 + line % (text.lines().count() - 1);
        let count = text.lines().next().unwrap().split(',').count();
        let column = column % count;
        prop_assume!(Some(column) != columns);
        let spoilt = with(files, which, |text| {
            let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
            let mut fields: Vec<&str> = lines[line].split(',').collect();
            fields[column] = junk;
            lines[line] = fields.join(",");
            (lines.join("\n") + "\n").into_bytes()
        });
        let said = run(&spoilt);
        let place = format!("{name}: line {}", line + 1);
        prop_assert_eq!(said.code, 2, "{} {}: {} {}", place, junk, said.out, said.err);
        prop_assert!(said.err.contains(&place), "{place} {junk}: {}", said.err);
    }

    #[test]
    fn bytes_changed_cut_or_put_in_anywhere_never_panic_and_name_the_file(
        (files, which) in any_file(), at in any::<prop::sample::Index>(), cut in 0usize..40,
        put in prop::collection::vec(prop_oneof![any::<u8>(), Just(b','), Just(b'\n'), Just(b'"'), b'0'..=b'9'], 0..12),
    ) {
        let (name, _) = &files[which];
        let spoilt = with(files, which, |text| {
            let mut bytes = text.as_bytes().to_vec();
            let from = at.index(bytes.len());
            let to = (from + cut).min(bytes.len());
            bytes.splice(from..to, put.iter().copied());
            bytes
        });
        let said = run(&spoilt);
        prop_assert!(!said.err.contains("panicked"), "{}", said.err);
        prop_assert!(said.code == 0 || said.code == 2, "{} {}", said.code, said.err);
        // A peer renamed is refused where it is missed: as a file whose ranges are to nobody.
        prop_assert!(said.code == 0 || said.err.contains(name) || *name == "anchors.toml", "{name}: {}", said.err);
    }
}
