//! `nova deliver`.
#![allow(clippy::unwrap_used, clippy::panic)]

mod common;

use common::Nova;

/// A short way, so that a test is one too.
const SHORT: &str = "height_m = 12.0\nradius_m = 2.0\ndistance_m = 20.0\n";

#[test]
fn a_package_is_delivered_onto_the_platform_and_the_vehicle_returns() {
    let nova = Nova::new();
    nova.file("short.toml", SHORT);
    let said = nova.run(&[
        "deliver",
        "--scenario",
        "short.toml",
        "--json",
        "--out",
        "page.html",
    ]);
    assert_eq!(said.code, 0, "{}", said.err);
    let line = &said.json()[0];
    let result = &line["result"];
    println!("{result}");
    assert_eq!(result["on_platform"], true);
    assert_eq!(result["delivered"], true);
    assert_eq!(result["finished"], true);
    assert_eq!(line["row"]["trials"], 1);
    let page = std::fs::read_to_string(nova.folder.path().join("page.html")).unwrap();
    assert_eq!(page.matches("<svg").count(), 4);
}

#[test]
fn the_same_seed_gives_the_same_delivery() {
    let nova = Nova::new();
    nova.file("short.toml", SHORT);
    let fly = |seed: &str| {
        nova.run(&[
            "deliver",
            "--scenario",
            "short.toml",
            "--json",
            "--seed",
            seed,
        ])
        .out
    };
    assert_eq!(fly("7"), fly("7"));
    assert_ne!(fly("7"), fly("8"));
}

#[test]
fn without_anything_local_a_landing_is_broken_off_and_the_package_comes_back() {
    let nova = Nova::new();
    let blind = "large_marker = false\nsmall_marker = false\nuwb = false\n";
    nova.file("blind.toml", format!("{SHORT}{blind}"));
    let said = nova.run(&["deliver", "--scenario", "blind.toml"]);
    assert_eq!(said.code, 0, "{}", said.err);
    assert!(
        said.out.contains("did not land at the goal"),
        "{}",
        said.out
    );
    assert!(
        said.out.contains("too many landings were not sure"),
        "{}",
        said.out
    );
}

#[test]
fn a_scenario_that_cannot_be_flown_is_refused_with_the_reason() {
    let nova = Nova::new();
    for (scenario, mention) in [
        ("radius_m = 60.0", "do not fit"),
        ("height_m = nan", "the height"),
        ("package_kg = -1.0", "package_kg is -1"),
        ("wind = 3.0", "unknown field"),
        ("filter = \"best\"", "error-state"),
    ] {
        nova.file("bad.toml", scenario);
        let said = nova.run(&["deliver", "--scenario", "bad.toml"]);
        assert_eq!(said.code, 2, "{scenario}: {}", said.err);
        assert!(said.err.contains(mention), "{scenario}: {}", said.err);
    }
    assert_eq!(nova.run(&["deliver", "--scenario", "none.toml"]).code, 2);
    assert_eq!(nova.run(&["deliver", "--trials", "0"]).code, 2);
}

#[test]
fn one_tag_in_place_of_four_anchors_is_enough_to_land_on_the_platform() {
    let nova = Nova::new();
    let tag_alone = "uwb_by = \"single-tag\"\nlarge_marker = false\nsmall_marker = false\nreturn_trip = false\n";
    nova.file("tag.toml", format!("{SHORT}{tag_alone}"));
    let said = nova.run(&[
        "deliver",
        "--scenario",
        "tag.toml",
        "--trials",
        "6",
        "--json",
    ]);
    assert_eq!(said.code, 0, "{}", said.err);
    let row = &said.json()[0]["row"];
    println!("{row}");
    assert_eq!(row["on_platform"], 6);
    assert!(row["off_centre_m"].as_f64().unwrap() < 0.3);
}

#[test]
fn a_vehicle_that_only_listens_to_the_anchors_lands_on_the_platform() {
    let nova = Nova::new();
    let listening = "uwb_by = \"differences\"\nlarge_marker = false\nsmall_marker = false\nreturn_trip = false\n";
    nova.file("listen.toml", format!("{SHORT}{listening}"));
    let said = nova.run(&[
        "deliver",
        "--scenario",
        "listen.toml",
        "--trials",
        "8",
        "--json",
    ]);
    assert_eq!(said.code, 0, "{}", said.err);
    let row = &said.json()[0]["row"];
    println!("{row}");
    assert_eq!(row["on_platform"], 8);
    assert!(row["off_centre_m"].as_f64().unwrap() < 0.25);
    assert!(row["estimate_error_m"].as_f64().unwrap() < 0.15);
}
