//! `nova evaluate` and `nova merge`.
#![allow(clippy::unwrap_used)]

mod common;

use common::{Nova, Said};
use serde_json::Value;

const TABLE: &str = "\
title = \"Try\"
source = \"a test\"
[common]
method = \"nova\"
set = { pilot = \"follow\", distance_m = 6, altitude_m = 8 }
[[condition]]
name = \"calm\"
paper = \"0.42 / 94\"
reference_bound_m = 0.05
[[condition]]
name = \"windy\"
preset = \"R\"
set = { wind_xy = 0.3 }
";

fn nova() -> Nova {
    let nova = Nova::new();
    nova.file("table.toml", TABLE);
    nova
}

/// The rows without what depends on how fast the computer is.
fn rows(said: &Said) -> Vec<Value> {
    assert_eq!((said.code, said.err.as_str()), (0, ""));
    let mut rows = said.json();
    for row in &mut rows {
        for timing in ["solve_ms_median", "solve_ms_p99"] {
            assert!(row[timing].take().is_f64(), "{row}");
        }
    }
    rows
}

const RUN: [&str; 7] = [
    "evaluate",
    "table.toml",
    "--trials",
    "5",
    "--seed",
    "3",
    "--json",
];

#[test]
fn rows_do_not_depend_on_the_number_of_threads() {
    let nova = nova();
    let [one, three] = ["1", "3"].map(|n| rows(&nova.run_with(&[("RAYON_NUM_THREADS", n)], &RUN)));
    assert_eq!(one, three);
    assert_eq!(one[0]["condition"], "calm");
    assert_eq!(one[0]["paper"], "0.42 / 94");
    assert_eq!(one[0]["reference_bound_m"], 0.05);
    assert_eq!(one[1]["settings"]["wind_xy"], 0.3);
    assert_eq!(one[1]["trials"], 5);
    assert_ne!(one[0]["mean_m"], one[1]["mean_m"]);
}

fn shards(nova: &Nova) {
    for part in ["1", "2", "3"] {
        let (shard, out) = (format!("{part}/3"), format!("part-{part}"));
        let piece = ["--shard", &shard, "--out", &out];
        let said = nova.run(&[&RUN[..6], &piece].concat());
        assert_eq!((said.code, said.out.as_str()), (0, ""), "{}", said.err);
    }
}

#[test]
fn pieces_in_any_order_make_the_same_rows_as_the_whole() {
    let nova = nova();
    shards(&nova);
    let merged = rows(&nova.run(&["merge", "part-2", "part-3", "part-1", "--json"]));
    assert_eq!(merged, rows(&nova.run(&RUN)));
}

#[test]
fn pieces_that_do_not_make_a_whole_are_refused() {
    let nova = nova();
    shards(&nova);
    let whole = |name: &str| std::fs::read_to_string(nova.folder.path().join(name)).unwrap();
    let text = whole("part-1");
    nova.file("other-seed", text.replacen("\"seed\":3", "\"seed\":4", 1));
    nova.file("other-table", text.replacen("calm", "mild", 1));
    nova.file("cut-off", text.trim_end().rsplit_once('\n').unwrap().0);
    nova.file("cut-in-line", &text[..text.len() - 10]);
    nova.file("no-shard", "{}\n");
    let mut lines: Vec<&str> = text.lines().collect();
    lines.swap(1, 2);
    nova.file("disordered", lines.join("\n"));
    for (pieces, mentions) in [
        (["part-1", "part-2", "part-2"], ["part-2", "both part 2/3"]),
        (["part-2", "part-2", "part-3"], ["part-2", "both part 2/3"]),
        (
            ["other-seed", "part-2", "part-3"],
            ["different runs", "seeds"],
        ),
        (
            ["other-table", "part-2", "part-3"],
            ["different runs", "tables"],
        ),
        (
            ["cut-off", "part-2", "part-3"],
            ["cut-off: 1 flights", "cut off"],
        ),
        (
            ["cut-in-line", "part-2", "part-3"],
            ["cut-in-line: line", "EOF"],
        ),
        (
            ["disordered", "part-2", "part-3"],
            ["disordered: line 2", "not due"],
        ),
        (
            ["no-shard", "part-2", "part-3"],
            ["no-shard: line 1", "nova evaluate --shard"],
        ),
        (
            ["nowhere", "part-2", "part-3"],
            ["nowhere", "cannot be read"],
        ),
    ] {
        let said = nova.run(&[&["merge"], &pieces[..]].concat());
        assert_eq!((said.code, said.out.as_str()), (2, ""), "{pieces:?}");
        for mention in mentions {
            assert!(said.err.contains(mention), "no '{mention}' in {}", said.err);
        }
    }
    let said = nova.run(&["merge", "part-3", "part-1"]);
    assert_eq!(said.code, 2);
    assert!(said.err.contains("missing: part 2/3"), "{}", said.err);
}

#[test]
fn the_table_stands_beside_the_figures_of_others_and_goes_where_it_is_told() {
    let nova = nova();
    let said = nova.run(&[
        "evaluate",
        "table.toml",
        "--trials",
        "2",
        "--out",
        "said.txt",
        "--page",
        "page.html",
    ]);
    assert_eq!((said.code, said.out.as_str()), (0, ""), "{}", said.err);
    let read = |name: &str| std::fs::read_to_string(nova.folder.path().join(name)).unwrap();
    let text = read("said.txt");
    let calm = text.lines().find(|line| line.starts_with("calm")).unwrap();
    assert!(
        calm.contains("0.42 / 94") && calm.contains("bound 0.050"),
        "{calm}"
    );
    let page = read("page.html");
    assert_eq!(page.matches("<svg").count(), 1);
    assert!(page.contains("<td>windy</td>") && page.contains("a test"));
}

#[test]
fn what_is_wrong_with_a_table_is_told_with_its_place() {
    for (table, mentions) in [
        ("title = 't'\n[common\n", ["table.toml: line 2", "]"]),
        (
            "title = 't'\ncolour = 1\n",
            ["table.toml: line 2", "colour"],
        ),
        ("title = 't'\n", ["table.toml", "no [[condition]]"]),
        (
            "title = 't'\n[[condition]]\nname = 'a'\nmethod = 'magic'\n",
            ["table.toml: line 4", "magic"],
        ),
        (
            "title = 't'\n[common]\nmethod = 'map'\n[[condition]]\nname = 'a'\nset = { wnd_xy = 1 }\n",
            ["condition \"a\"", "is wind_xy meant?"],
        ),
    ] {
        let nova = Nova::new();
        nova.file("table.toml", table);
        let said = nova.run(&["evaluate", "table.toml", "--trials", "1"]);
        assert_eq!((said.code, said.out.as_str()), (2, ""), "{table}");
        assert_eq!(said.err.lines().count(), 1, "{}", said.err);
        for mention in mentions {
            assert!(said.err.contains(mention), "no '{mention}' in {}", said.err);
        }
    }
}

#[test]
fn a_piece_needs_a_file_and_a_number_that_can_be() {
    let nova = nova();
    for arguments in [
        &["--shard", "1/2"][..],
        &["--shard", "3/2", "--out", "x"],
        &["--shard", "1/2", "--out", "x", "--json"],
    ] {
        let said = nova.run(&[&["evaluate", "table.toml"], arguments].concat());
        assert_eq!(said.code, 2, "{arguments:?}");
    }
    assert_eq!(nova.files(), ["table.toml"]);
}

/// The table comes through a pipe, so that the test knows when it has been asked for.
#[cfg(unix)]
#[test]
fn interrupted_runs_leave_the_files_as_they_were() {
    use rustix::process::{Pid, Signal, kill_process};
    use std::os::unix::process::ExitStatusExt as _;
    use std::process::{Command, Stdio};

    for piece in [&[][..], &["--shard", "1/2"], &["--page", "page"]] {
        let nova = Nova::new();
        nova.file("rows", "of an earlier run");
        let table = nova.folder.path().join("table.toml");
        assert!(
            Command::new("mkfifo")
                .arg(&table)
                .status()
                .unwrap()
                .success()
        );
        let long = ["--trials", "1000000", "--out", "rows"];
        let mut child = Command::new(env!("CARGO_BIN_EXE_nova"))
            .args([&["evaluate", "table.toml"], &long[..], piece].concat())
            .current_dir(nova.folder.path())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        std::fs::write(&table, TABLE).unwrap();
        // Ctrl-C's own signal is ignored by whatever a script starts in the background.
        kill_process(Pid::from_child(&child), Signal::TERM).unwrap();
        let status = child.wait().unwrap();
        assert_eq!(status.signal(), Some(Signal::TERM.as_raw()), "{piece:?}");
        assert_eq!(nova.files(), ["rows", "table.toml"]);
        let rows = std::fs::read_to_string(nova.folder.path().join("rows"));
        assert_eq!(rows.unwrap(), "of an earlier run");
    }
}
