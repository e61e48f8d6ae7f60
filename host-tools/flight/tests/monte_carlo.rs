//! Claims about many flights.
#![allow(clippy::unwrap_used)]

use nova_flight::{
    Condition, FlightResult, Method, Plan, Preset, Row, Settings, Trial, fly, fly_recorded, run,
    trial_seed,
};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Short flights: what is tested here does not need long ones.
fn conditions() -> Vec<Condition> {
    let short = |preset| Settings {
        distance_m: 5.0,
        altitude_m: 6.0,
        ..Settings::preset(preset)
    };
    [Preset::P, Preset::R]
        .map(|preset| Condition {
            method: Method::Map,
            flown_by: None,
            settings: short(preset),
        })
        .to_vec()
}

/// Without what depends on the machine's mood.
fn timeless(rows: &[Vec<FlightResult>]) -> Vec<Vec<FlightResult>> {
    let strip = |result: &FlightResult| FlightResult {
        update_ms: Vec::new(),
        ..result.clone()
    };
    rows.iter()
        .map(|row| row.iter().map(strip).collect())
        .collect()
}

fn with_threads(threads: usize) -> Vec<Vec<FlightResult>> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .unwrap();
    pool.install(|| timeless(&run(&conditions(), &[0, 1, 2], 42, |_| ())))
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    assert_eq!(with_threads(1), with_threads(3));
}

#[test]
fn shards_put_together_are_the_whole() {
    let whole = timeless(&run(&conditions(), &[0, 1, 2], 1, |_| ()));
    let mut parts = timeless(&run(&conditions(), &[0], 1, |_| ()));
    for (part, rest) in parts.iter_mut().zip(run(&conditions(), &[1, 2], 1, |_| ())) {
        part.extend(timeless(&[rest]).remove(0));
    }
    assert_eq!(whole, parts);
}

#[test]
fn progress_is_told_once_a_flight() {
    let told = [AtomicUsize::new(0), AtomicUsize::new(0)];
    run(&conditions(), &[5, 6], 1, |condition| {
        told[condition].fetch_add(1, Ordering::Relaxed);
    });
    assert_eq!(told.map(AtomicUsize::into_inner), [2, 2]);
}

#[test]
fn a_row_is_written_and_read_back_with_all_its_columns() {
    let rows = run(&conditions(), &[0, 1], 3, |_| ());
    let row = Row::of(&rows[0]);
    let text = toml::to_string(&row).unwrap();
    assert_eq!(toml::from_str::<Row>(&text).unwrap(), row);
    for column in [
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
    ] {
        assert!(text.contains(column), "{column} in {text}");
    }
}

#[test]
fn a_method_shown_its_own_flight_believes_what_it_believed_in_flight() {
    for condition in conditions() {
        let method = condition.method;
        let shown = Condition {
            flown_by: Some(method),
            ..condition.clone()
        };
        let seen = run(&[shown], &[4], 1, |_| ()).concat().remove(0);
        let (flown, recording) = fly_recorded(&Trial {
            method,
            settings: condition.settings,
            seed: trial_seed(1, 4),
        });
        assert_eq!((flown.nees, flown.flipped), (seen.nees, seen.flipped));
        assert_eq!((flown.time_s, flown.bound_m), (seen.time_s, seen.bound_m));
        let (_, last) = recording.estimates.last().unwrap();
        let believed = recording.relative_error_m(last, flown.time_s);
        assert_eq!(seen.error_m, believed.norm());
    }
}

#[test]
fn baselines_that_start_from_the_truth_beat_the_one_that_starts_from_the_guess() {
    let on_a_shared_flight = |method| Condition {
        method,
        flown_by: Some(Method::Sa),
        settings: Settings::default(),
    };
    let methods = [Method::Sa, Method::Rp, Method::RpError].map(on_a_shared_flight);
    let trials: Vec<u64> = (0..20).collect();
    let rows: Vec<Row> = run(&methods, &trials, 1, |_| ())
        .iter()
        .map(|results| Row::of(results))
        .collect();
    assert!(rows[0].mean_m < rows[2].mean_m && rows[1].mean_m < rows[2].mean_m);
    assert_eq!(rows[0].time_s, rows[2].time_s, "one flight for all");
}

/// Flights that earlier forms of the navigator lost by tens of metres: an explanation with strong gusts held a
/// wrong place, and nothing else was tried; or the sum of Gaussians knew better than the minimum flown by.
#[test]
fn flights_that_once_followed_a_phantom_come_down_beside_the_tag() {
    let wandering = Settings {
        rw: 0.01,
        ..Settings::preset(Preset::P)
    };
    let hasty = Settings {
        plan: Plan::Fast,
        ..wandering.clone()
    };
    let held = Settings {
        wind_xy: 0.35,
        wind_z: 0.15,
        wind_hold_s: 0.5,
        ..Settings::preset(Preset::P)
    };
    for (settings, seed) in [(wandering, 8059), (hasty, 8052), (held, 8070)] {
        let result = fly(&Trial {
            method: Method::Map,
            settings,
            seed,
        });
        assert!(
            result.landed && result.error_m < 1.0,
            "{seed}: {}",
            result.error_m
        );
    }
}
