//! Whatever is wrong with the input: one sentence that says what and where,
//! exit code 2, nothing on standard output, no file written.
#![allow(clippy::unwrap_used)]

mod common;

use common::Nova;
use nova_wire::{Encoder, MAX_FRAME_LEN, Record, Status};

const HEADER: &str = "t_s,peer,x_m,y_m,z_m,range_m\n";

/// Runs `nova` on a file called `input`, and checks that it complains as it
/// should, mentioning all of `mentions`.
fn complains(input: &[u8], arguments: &[&str], mentions: &[&str]) {
    let nova = Nova::new();
    nova.file("input", input);
    let said = nova.run(arguments);
    assert_eq!(said.code, 2, "{}", said.err);
    assert_eq!(said.out, "");
    assert_eq!(said.err.lines().count(), 1, "{}", said.err);
    for mention in mentions {
        assert!(
            said.err.contains(mention),
            "no '{mention}' in: {}",
            said.err
        );
    }
    assert_eq!(nova.files(), ["input"]);
}

fn solve_complains(lines: &str, mentions: &[&str]) {
    complains(lines.as_bytes(), &["solve", "input"], mentions);
}

#[test]
fn a_missing_column_is_named_with_those_that_are_there() {
    solve_complains(
        "t_s,anchor,x_m,y_m,z_m,range_m\n0,1,0,0,0,1\n",
        &["input", "line 1", "'peer'", "anchor", "--columns peer="],
    );
    complains(
        b"t1_ticks,t2_ticks\n1,2\n",
        &["twr", "input"],
        &["input", "line 1", "'t3_ticks'"],
    );
}

#[test]
fn a_field_that_is_not_a_finite_number_is_named_with_its_line() {
    for (value, mention) in [
        ("NaN", "not a finite number"),
        ("inf", "not a finite number"),
        ("far", "not a number"),
        ("", "is empty"),
    ] {
        let lines = format!("{HEADER}0,1,0,0,0,1\n0.1,1,0,0,0,{value}\n");
        solve_complains(&lines, &["input: line 3: range_m", mention]);
    }
}

#[test]
fn a_negative_range_is_refused() {
    let lines = format!("{HEADER}0,1,0,0,0,-0.5\n");
    solve_complains(&lines, &["input: line 2: range_m is negative (-0.5)"]);
}

#[test]
fn a_sigma_that_is_not_positive_is_refused() {
    solve_complains(
        "t_s,peer,x_m,y_m,z_m,range_m,sigma_m\n0,1,0,0,0,1,0\n",
        &["line 2: sigma_m is not positive (0)"],
    );
}

#[test]
fn an_empty_file_and_one_with_only_a_header_are_refused() {
    solve_complains("", &["input", "empty"]);
    solve_complains(HEADER, &["input", "no lines after the header"]);
    complains(b"", &["twr", "input"], &["input", "empty"]);
    complains(b"", &["decode", "input"], &["input", "empty"]);
}

#[test]
fn a_line_of_another_length_is_named() {
    let lines = format!("{HEADER}0,1,0,0,0,1\n0,1,0\n");
    solve_complains(&lines, &["input: line 3: 3 fields instead of 6"]);
}

#[test]
fn lines_are_counted_as_an_editor_counts_them() {
    let dos = format!("{HEADER}0,1,0,0,0,1\n0,1,0,0,0,far\n").replace('\n', "\r\n");
    solve_complains(&dos, &["input: line 3: range_m is 'far'"]);
    let noted = format!("{HEADER}\n# a note\n0,1,0,0,0,1\n\n0,1,0,0,0,far\n");
    solve_complains(&noted, &["input: line 6: range_m is 'far'"]);
}

#[test]
fn columns_that_cannot_be_meant_are_refused() {
    solve_complains(
        "t_s,peer,x_m,y_m,z_m,range_m,range_m\n0,1,0,0,0,1,2\n",
        &["input: line 1: there are two columns 'range_m'"],
    );
    solve_complains(
        "t_s;peer;x_m;y_m;z_m;range_m\n0;1;0;0;0;1\n",
        &["input: line 1", "separated by \";\"; only commas"],
    );
    complains(
        HEADER.as_bytes(),
        &["solve", "input", "--columns", "sigma=std"],
        &["--columns sigma=", "sigma_m"],
    );
}

#[test]
fn bytes_that_are_no_text_are_refused() {
    let mut lines = HEADER.as_bytes().to_vec();
    lines.extend(b"0,\xFF\xFE,0,0,0,1\n");
    complains(&lines, &["solve", "input"], &["input: line 2", "UTF-8"]);
}

#[test]
fn too_few_points_are_refused_with_the_nodes_name() {
    let lines = format!("{HEADER}0,kitchen,0,0,0,1\n1,kitchen,1,0,0,1\n");
    solve_complains(&lines, &["input: node kitchen has 2 ranges", "4 or more"]);
}

#[test]
fn a_node_with_too_few_ranges_is_skipped_where_asked_for() {
    let mut lines = format!("{HEADER}0,lonely,0,0,0,1\n0,7,1\n");
    for k in 0..40 {
        let a = 0.3 * f64::from(k);
        let (x, y, z) = (5.0 * a.cos(), 5.0 * a.sin(), 1.0 + 0.1 * f64::from(k));
        let range = (x * x + y * y + z * z).sqrt();
        lines += &format!("{k},home,{x},{y},{z},{range}\n");
    }
    let nova = Nova::new();
    nova.file("input", lines);
    let said = nova.run(&["solve", "input", "--json", "--skip-bad"]);
    assert_eq!(said.code, 0, "{}", said.err);
    assert_eq!(said.json().len(), 1);
    assert!(said.err.contains("1 of 42 lines skipped"), "{}", said.err);
    assert!(
        said.err.contains("node lonely has 1 range,"),
        "{}",
        said.err
    );
}

#[test]
fn a_file_that_is_not_there_is_named() {
    for command in ["solve", "twr", "decode"] {
        let said = Nova::new().run(&[command, "nowhere.csv"]);
        assert_eq!(said.code, 2);
        assert!(
            said.err.starts_with("error: nowhere.csv: cannot be read"),
            "{}",
            said.err
        );
    }
}

#[test]
fn options_that_make_no_sense_are_refused() {
    let lines = format!("{HEADER}0,1,0,0,0,1\n");
    for arguments in [
        ["solve", "input", "--sigma", "0"],
        ["solve", "input", "--sigma", "-1"],
        ["solve", "input", "--range-bias", "NaN"],
        ["solve", "input", "--height", "inf"],
        ["solve", "input", "--estimate-bias", "0"],
        ["solve", "input", "--systematic-sigma", "-0.1"],
    ] {
        let nova = Nova::new();
        nova.file("input", &lines);
        let said = nova.run(&arguments);
        assert_eq!((said.code, said.out.as_str()), (2, ""), "{arguments:?}");
        assert!(said.err.contains(arguments[2]), "{}", said.err);
    }
    let said = Nova::new().run(&["demo", "--speed", "0"]);
    assert_eq!(said.code, 2);
    assert!(said.err.contains("--speed"), "{}", said.err);
}

#[test]
fn a_capture_that_was_cut_off_is_refused_unless_asked_for() {
    let mut encoder = Encoder::new();
    let record = Record::Status(Status::default());
    let mut bytes = Vec::new();
    for _ in 0..3 {
        bytes.extend_from_slice(encoder.encode(&record, &mut [0; MAX_FRAME_LEN]).unwrap());
    }
    bytes.truncate(bytes.len() - 4);
    complains(
        &bytes,
        &["decode", "input"],
        &["input: byte", "ends inside a frame", "--truncated"],
    );

    let nova = Nova::new();
    nova.file("input", &bytes);
    let said = nova.run(&["decode", "input", "--truncated"]);
    assert_eq!(said.code, 0, "{}", said.err);
    let end = said.json().pop().unwrap();
    assert_eq!(end["end"]["records"], 2);
    assert_eq!(end["end"]["corrupt"], 1);
}

#[test]
fn a_file_that_is_no_capture_is_refused() {
    complains(
        b"just some text\n\0",
        &["decode", "input"],
        &["input: no frame in 16 bytes"],
    );
}

#[test]
fn a_page_that_cannot_be_written_is_named_and_nothing_is_left() {
    let nova = Nova::new();
    let said = nova.run(&["demo", "--out", "no/such/folder/page.html"]);
    assert_eq!(said.code, 1);
    assert!(
        said.err
            .contains("no/such/folder/page.html: cannot be written"),
        "{}",
        said.err
    );
    assert!(nova.files().is_empty());

    // Neither is a folder replaced, nor anything left beside it.
    nova.file("keep", "");
    let said = nova.run(&["demo", "--out", "."]);
    assert_eq!(said.code, 1);
    assert_eq!(nova.files(), ["keep"]);
}

#[test]
fn standard_input_is_named_when_it_is_at_fault() {
    for (arguments, input, mention) in [
        (["solve", "-"], "", "standard input: the file is empty"),
        (
            ["solve", "-"],
            "t_s\n1\n",
            "standard input: line 1: there is no column 'peer'",
        ),
        (["twr", "-"], "t1_ticks\n1\n", "standard input: line 1"),
    ] {
        let said = Nova::new().run_fed(input.as_bytes(), &arguments);
        assert_eq!((said.code, said.out.as_str()), (2, ""));
        assert!(said.err.contains(mention), "{}", said.err);
    }
}
