//! `nova track`: figures, the page, and scenes that cannot be meant.
#![allow(clippy::unwrap_used)]

mod common;

use common::Nova;
use serde_json::Value;

const SCENE: &str = r#"
title = "A short walk <at noon>"
duration_s = 6.0
[target]
motion = "staged"
start_m = [2.5, 0, 1]
heading_deg = 0
speed_m_s = 0
stages = [{ for_s = 1.0 }, { for_s = 1.0, along = 1.0 }]
[vehicle]
start_m = [0.0, 0.0, 1.0]
[sensor]
outlier_probability = [0.0, 0.2]
[standoff]
"#;

fn nova(scene: &str) -> Nova {
    let nova = Nova::new();
    std::fs::write(nova.folder.path().join("scene.toml"), scene).unwrap();
    nova
}

fn track(nova: &Nova, more: &[&str]) -> Value {
    let said = nova.run(&[&["track", "--scenario", "scene.toml", "--json"], more].concat());
    assert_eq!((said.code, said.err.as_str()), (0, ""));
    said.json().remove(0)
}

#[test]
fn every_condition_has_its_row_and_a_seed_its_figures() {
    let nova = nova(SCENE);
    let strip = |mut told: Value| {
        for row in told["rows"].as_array_mut().unwrap() {
            assert!(row["step_ms"].take().is_array());
        }
        told
    };
    let told = strip(track(&nova, &["--trials", "2", "--seed", "5"]));
    let rows = told["rows"].as_array().unwrap();
    // Four controllers under two parts of outliers.
    assert_eq!(rows.len(), 8);
    for row in rows {
        assert_eq!(row["estimator"], "robust");
        assert_eq!(row["trials"], 2);
        assert_eq!(row["commands"], 240);
        assert!(row["rmse_m"].as_f64().unwrap() < 0.5);
    }
    assert_eq!(told, strip(track(&nova, &["--trials", "2", "--seed", "5"])));
    assert_ne!(told, strip(track(&nova, &["--trials", "2", "--seed", "6"])));
    let one = track(&nova, &["--estimator", "ekf", "--controller", "clf"]);
    assert_eq!(one["rows"].as_array().unwrap().len(), 2);
}

#[test]
fn the_page_has_table_and_pictures_and_needs_nothing_else() {
    let nova = nova(SCENE);
    let told = track(&nova, &["--out", "track.html"]);
    assert_eq!(told["page"], "track.html");
    let page = std::fs::read_to_string(nova.folder.path().join("track.html")).unwrap();
    assert!(page.contains("A short walk &lt;at noon&gt;"));
    assert_eq!(page.matches("<svg").count(), 5);
    for elsewhere in ["<script src", "<link", "src=\"http", "url(http"] {
        assert!(!page.contains(elsewhere), "the page needs {elsewhere}");
    }
    for controller in ["clf", "fixed", "aware", "sampled"] {
        assert!(page.contains(&format!("<td>{controller}</td>")));
    }
}

#[test]
fn walls_are_drawn_and_how_near_the_vehicle_came_is_said() {
    let scene = SCENE
        .replace("[sensor]", "[sensor]\nwalls_m = [[-1.0, 1.0, 4.0, 1.0]]")
        .replace("[standoff]", "[standoff]\nwall_clearance_m = 0.4");
    let nova = nova(&scene);
    let arguments = ["track", "--scenario", "scene.toml", "--out", "track.html"];
    let said = nova.run(&arguments);
    assert_eq!((said.code, said.err.as_str()), (0, ""));
    assert!(said.out.contains("nearest to a wall: "), "{}", said.out);
    let page = std::fs::read_to_string(nova.folder.path().join("track.html")).unwrap();
    assert!(page.contains("walls"));
    let told = track(&nova, &["--controller", "sampled"]);
    for row in told["rows"].as_array().unwrap() {
        assert!(row["least_wall_m"].as_f64().unwrap() > 0.39, "{row}");
    }
}

#[test]
fn the_text_has_a_line_a_condition() {
    let nova = nova(SCENE);
    let said = nova.run(&["track", "--scenario", "scene.toml", "--controller", "aware"]);
    assert_eq!(said.code, 0);
    assert_eq!(said.out.matches(" aware ").count(), 2, "{}", said.out);
    assert!(said.out.contains("bounds 1.5 to 4 m"));
}

#[test]
fn scenes_that_cannot_be_meant_are_refused_with_what_and_where() {
    let change = |from: &str, to: &str| SCENE.replace(from, to);
    for (scene, mentions) in [
        (
            change("duration_s = 6.0", "duration_s = -1"),
            vec!["duration_s", "-1"],
        ),
        (
            change("duration_s = 6.0", "duration_s = nan"),
            vec!["duration_s", "NaN"],
        ),
        (
            change("[standoff]", "[standoff]\nleast_m = 3.0"),
            vec!["standoff_m", "2.5"],
        ),
        (
            change("0.0, 0.2]", "0.0, 1.2]"),
            vec!["outlier_probability", "1.2"],
        ),
        (
            change("for_s = 1.0 }", "for_s = 0.0 }"),
            vec!["for_s", "above 0"],
        ),
        (change("[vehicle]", "[vehicel]"), vec!["line 10", "vehicel"]),
        (
            change("[0.0, 0.0, 1.0]", "[2.4, 0.0, 1.0]"),
            vec!["distance at the start", "0.1"],
        ),
        (
            change("[standoff]", "[standoff]\nwall_clearance_m = -1.0"),
            vec!["wall_clearance_m", "-1"],
        ),
        (
            change("[standoff]", "[tracker]\ntilt_sigma_deg = -2.0"),
            vec!["tilt_sigma_deg", "-2"],
        ),
        (change("title", "title ="), vec!["line 2"]),
    ] {
        let nova = nova(&scene);
        let said = nova.run(&["track", "--scenario", "scene.toml"]);
        assert_eq!((said.code, said.out.as_str()), (2, ""), "{mentions:?}");
        for mention in mentions {
            assert!(said.err.contains(mention), "no {mention} in {}", said.err);
        }
        assert!(said.err.contains("scene.toml"), "{}", said.err);
    }
    for (arguments, mention) in [
        (["--estimator", "magic"], "ekf, plain"),
        (["--controller", "magic"], "clf, fixed"),
        (["--trials", "0"], "--trials"),
        (["--scenario", "absent.toml"], "scenario"),
    ] {
        let said =
            nova(SCENE).run(&[&["track", "--scenario", "scene.toml"], &arguments[..]].concat());
        assert_eq!((said.code, said.out.as_str()), (2, ""), "{arguments:?}");
        assert!(said.err.contains(mention), "{}", said.err);
    }
    let open = SCENE.replace("[standoff]", "");
    let said = nova(&open).run(&["track", "--scenario", "scene.toml", "--controller", "clf"]);
    assert_eq!(said.code, 2);
    assert!(said.err.contains("no [standoff]"), "{}", said.err);
}
