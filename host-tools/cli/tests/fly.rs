//! `nova fly`: the page, the figures, and settings that cannot be meant.
#![allow(clippy::unwrap_used)]

mod common;

use common::Nova;
use serde_json::Value;

/// A short flight.
const NEAR: [&str; 4] = ["--set", "distance_m=6", "--set", "altitude_m=8"];

fn fly(nova: &Nova, more: &[&str]) -> Value {
    let said = nova.run(&[&["fly", "--json"], &NEAR[..], more].concat());
    assert_eq!((said.code, said.err.as_str()), (0, ""));
    said.json().remove(0)
}

fn page(nova: &Nova, name: &str) -> String {
    std::fs::read_to_string(nova.folder.path().join(name)).unwrap()
}

/// What the page plays.
fn film(page: &str) -> Value {
    let (_, from) = page.split_once("id=\"film\">").unwrap();
    let (film, _) = from.split_once("</script>").unwrap();
    serde_json::from_str(film).unwrap()
}

#[test]
fn the_page_plays_the_flight_and_needs_nothing_else() {
    let nova = Nova::new();
    let told = fly(&nova, &["--out", "flight.html"]);
    assert_eq!(nova.files(), ["flight.html"]);
    let page = page(&nova, "flight.html");
    for elsewhere in [
        "<script src",
        "<link",
        "src=\"http",
        "url(http",
        "fetch(",
        "import ",
    ] {
        assert!(!page.contains(elsewhere), "the page needs {elsewhere}");
    }
    let film = film(&page);
    let frames = film["frames"].as_array().unwrap();
    let last = frames.last().unwrap();
    let time_s = told["time_s"].as_f64().unwrap();
    assert!((last["t"].as_f64().unwrap() - time_s).abs() < 1e-2);
    // Touchdown, and 10 ranges a second until then.
    assert!(last["height_m"].as_f64().unwrap().abs() < 0.05, "{last}");
    assert!(frames.len() as f64 > 9.0 * time_s, "{}", frames.len());
    let beliefs = film["beliefs"].as_array().unwrap();
    assert!(beliefs.iter().all(|b| b["above"]["ellipse"].is_array()));
    assert!(beliefs.len() > 10);
}

#[test]
fn without_javascript_the_page_shows_the_whole_flight() {
    let nova = Nova::new();
    fly(&nova, &["--out", "flight.html"]);
    let page = page(&nova, "flight.html");
    let frames = film(&page)["frames"].as_array().unwrap().len();
    for chart in ["above", "side"] {
        let (_, area) = page.split_once(&format!("data-chart=\"{chart}\"")).unwrap();
        let (_, path) = area
            .split_once("<polyline class=\"path\" points=\"")
            .unwrap();
        let (points, _) = path.split_once('"').unwrap();
        assert_eq!(points.split(' ').count(), frames);
        assert!(area.contains("<ellipse class=\"ellipse\""));
    }
    // What needs the script appears only with it.
    assert!(page.contains("<div id=\"player\" hidden>"));
    assert!(page.contains(".now { display: none; }"));
}

#[test]
fn the_same_seed_gives_the_same_page_and_another_seed_another() {
    let nova = Nova::new();
    let told = ["a", "b", "c"].map(|name| {
        let seed = if name == "c" { "12" } else { "11" };
        let mut told = fly(&nova, &["--seed", seed, "--out", name]);
        told["page"].take();
        (told, page(&nova, name))
    });
    assert_eq!(told[0], told[1]);
    assert_ne!(told[0].1, told[2].1);
}

#[test]
fn many_flights_give_the_figures_that_the_help_promises() {
    let nova = Nova::new();
    let row = fly(&nova, &["--trials", "3", "--seed", "5"]);
    assert!(nova.files().is_empty());
    let mut keys: Vec<&str> = row
        .as_object()
        .unwrap()
        .keys()
        .map(String::as_str)
        .collect();
    keys.sort_unstable();
    let mut promised = [
        "mean_m",
        "median_m",
        "p95_m",
        "max_m",
        "below_1m",
        "below_0_5m",
        "below_0_25m",
        "time_s",
        "overhead",
        "flips",
        "bound_m",
        "nees",
        "nees_band",
        "solve_ms_median",
        "solve_ms_p99",
        "trials",
        "landed",
        "method",
        "seed",
        "settings",
    ];
    promised.sort_unstable();
    assert_eq!(keys, promised);
    assert_eq!((&row["trials"], &row["seed"]), (&3.into(), &5.into()));
    assert_eq!(row["settings"]["distance_m"], 6.0);

    // They are of the flights that can be looked at one by one.
    let errors_m: f64 = ["0", "1", "2"]
        .map(|trial| {
            fly(&nova, &["--seed", "5", "--trial", trial])["error_m"]
                .as_f64()
                .unwrap()
        })
        .iter()
        .sum();
    assert!((row["mean_m"].as_f64().unwrap() - errors_m / 3.0).abs() < 1e-12);
}

#[test]
fn settings_that_cannot_be_meant_are_refused_with_what_there_is() {
    for (arguments, mentions) in [
        (["--set", "wind_yx=1"], ["wind_yx", "is wind_xy meant?"]),
        (
            ["--set", "colour=red"],
            ["colour", "altitude_m, antenna_null"],
        ),
        (["--set", "altitude_m=high"], ["altitude_m", "high"]),
        (["--set", "altitude_m=-3"], ["altitude_m", "-3"]),
        (["--set", "altitude_m"], ["altitude_m", "key=value"]),
        (["--pilot", "nobody"], ["pilot", "self-nav"]),
        (["--method", "magic"], ["magic", "map"]),
        (["--preset", "Q"], ["Q", "P, R"]),
        (["--trials", "0"], ["--trials", "1"]),
    ] {
        let nova = Nova::new();
        let said = nova.run(&[&["fly"], &arguments[..]].concat());
        assert_eq!((said.code, said.out.as_str()), (2, ""), "{arguments:?}");
        for mention in mentions {
            assert!(said.err.contains(mention), "no {mention} in {}", said.err);
        }
        assert!(nova.files().is_empty());
    }
}

#[test]
fn the_long_help_lists_all_settings_with_their_values() {
    let said = Nova::new().run(&["fly", "--help"]);
    for setting in [
        "wind_hold_s",
        "uwb_noise_floor_dbm",
        "nlos_probability",
        "rw ",
        "plan ",
    ] {
        assert!(said.out.contains(setting), "{setting}");
    }
}
