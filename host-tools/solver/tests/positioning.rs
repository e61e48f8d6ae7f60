//! A tag located from anchors: made, and recorded (see tests/recorded.rs for where recordings are).

#![allow(clippy::unwrap_used)] // the helpers below are tests as well

mod recordings;

use std::collections::BTreeMap;

use nalgebra::Vector3;
use nova_solver::multilateration::Height;
use nova_solver::positioning::{
    AnchorRange, FixError, Judgement, RangeFilter, RangeFilterOptions, closed_form, locate,
};
use nova_solver::{MultilaterationOptions, SolveError};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use recordings::{columns, data};

fn ranges(anchors: &[Vector3<f64>], tag: Vector3<f64>) -> Vec<AnchorRange> {
    anchors
        .iter()
        .map(|anchor| AnchorRange {
            anchor_m: *anchor,
            range_m: (tag - anchor).norm(),
            sigma_m: 0.1,
        })
        .collect()
}

const SIX: [Vector3<f64>; 6] = [
    Vector3::new(10.0, 12.0, 9.0),
    Vector3::new(12.0, 1.0, 1.0),
    Vector3::new(9.0, -13.0, 4.0),
    Vector3::new(-5.0, -8.0, 1.0),
    Vector3::new(-10.0, 2.0, 5.0),
    Vector3::new(-4.0, 9.0, 3.0),
];

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn closed_form_of_clean_ranges_is_exact(
        x in -15.0..15.0, y in -15.0..15.0, z in -5.0..20.0, flat in any::<bool>(),
    ) {
        let tag = Vector3::new(x, y, z);
        let anchors: Vec<_> = SIX.iter().map(|a| if flat { Vector3::new(a.x, a.y, 2.0) } else { *a }).collect();
        let found = closed_form(&ranges(&anchors, tag), None);
        let mirror = Vector3::new(x, y, 4.0 - z);
        prop_assert_eq!(found.len(), if flat { 2 } else { 1 });
        let nearest = found.iter().map(|p| (p - tag).norm()).fold(f64::INFINITY, f64::min);
        prop_assert!(nearest < 1e-6, "{:?}", found);
        if flat {
            prop_assert!(found.iter().any(|p| (p - mirror).norm() < 1e-6));
        }
        let known = closed_form(&ranges(&anchors, tag), Some(z));
        prop_assert_eq!(known.len(), 1);
        prop_assert!((known[0] - tag).norm() < 1e-6);
    }
}

/// Six ranges for three unknowns, one of them blocked, anchors nearly in a plane: now and then five
/// agree on a wrong place. Then nothing in the ranges shows it.
#[test]
fn one_blocked_range_of_six_is_borne_by_97_of_100_fixes() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let (mut near, mut honest) = (0, 0);
    const CASES: u32 = 1000;
    for _ in 0..CASES {
        let tag = Vector3::new(
            rng.random_range(-8.0..8.0),
            rng.random_range(-8.0..8.0),
            rng.random_range(2.0..15.0),
        );
        let mut given = ranges(&SIX, tag);
        given[rng.random_range(0..6)].range_m += rng.random_range(1.0..20.0);
        let fix = locate(&given, &MultilaterationOptions::default()).unwrap();
        let error = fix.found.position_m - tag;
        let nees = error.dot(&(fix.found.covariance_m2.try_inverse().unwrap() * error));
        near += u32::from(error.norm() < 0.3);
        honest += u32::from(error.norm() < 0.3 || nees < 25.0);
    }
    println!("of {CASES}: {near} within 0.3 m, {honest} within that or five sigma");
    assert!(honest >= CASES * 97 / 100, "{near} {honest}");
}

#[test]
fn too_few_anchors_are_refused_and_a_height_makes_three_enough() {
    let tag = Vector3::new(1.0, 2.0, 5.0);
    let options = MultilaterationOptions::default();
    let three = ranges(&SIX[..3], tag);
    assert_eq!(
        locate(&three, &options),
        Err(FixError::TooFewAnchors { got: 3, needed: 4 })
    );
    let twice: Vec<_> = three.iter().chain(&three).copied().collect();
    assert_eq!(
        locate(&twice, &options),
        Err(FixError::TooFewAnchors { got: 3, needed: 4 })
    );
    let at_height = MultilaterationOptions {
        height: Height::Known(5.0),
        ..options
    };
    let fix = locate(&three, &at_height).unwrap();
    assert!((fix.found.position_m - tag).norm() < 1e-4);
    let mut bad = ranges(&SIX, tag);
    bad[4].range_m = f64::NAN;
    assert!(matches!(
        locate(&bad, &options),
        Err(FixError::Solve(SolveError::BadMeasurement { index: 4, .. }))
    ));
}

#[test]
fn filter_refuses_the_past_sets_a_wild_range_aside_and_follows() {
    let options = RangeFilterOptions::default();
    let mut filter = RangeFilter::new(options, 0.0, Vector3::new(0.5, 0.0, 5.0), 1.0, 1.0);
    let place = |t: f64| Vector3::new(0.5 * t, 0.2 * t, 5.0 + 0.1 * t);
    for k in 1..600 {
        let t = 0.02 * f64::from(k);
        let mut range = ranges(&SIX, place(t))[k as usize % 6];
        if k == 500 {
            range.range_m += 3.0;
            assert_eq!(filter.update(t, &range).0, Judgement::SetAside);
            continue;
        }
        assert!(
            matches!(filter.update(t, &range).0, Judgement::Used(_)),
            "{k}"
        );
    }
    let state = filter.state();
    assert!((state.position_m - place(state.t_s)).norm() < 0.05);
    let range = ranges(&SIX, place(1.0))[0];
    assert_eq!(filter.update(1.0, &range).0, Judgement::Refused);
    assert_eq!(filter.update(f64::NAN, &range).0, Judgement::Refused);
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

#[test]
fn recorded_spots_among_blocked_anchors_are_found_within_35_cm() {
    let Some(path) = data("C_nlos_dw1000/iiot19.csv") else {
        return;
    };
    type Readings = (Vector3<f64>, Vec<f64>);
    let mut spots: BTreeMap<i64, (Vector3<f64>, BTreeMap<i64, Readings>)> = BTreeMap::new();
    let names = [
        "location",
        "x_tag_mm",
        "y_tag_mm",
        "z_tag_mm",
        "anchor",
        "x_anchor_mm",
        "y_anchor_mm",
        "z_anchor_mm",
        "range_mm",
    ];
    for [spot, x, y, z, anchor, ax, ay, az, range] in columns(&path, names) {
        let tag = Vector3::new(x, y, z) / 1000.0;
        let spot = spots
            .entry(spot as i64)
            .or_insert_with(|| (tag, BTreeMap::new()));
        let place = Vector3::new(ax, ay, az) / 1000.0;
        let readings = (spot.1.entry(anchor as i64)).or_insert_with(|| (place, Vec::new()));
        readings.1.push(range / 1000.0);
    }
    assert!(spots.len() >= 7);
    for (spot, (tag, anchors)) in &mut spots {
        let given: Vec<_> = anchors
            .values_mut()
            .map(|(anchor_m, ranges)| AnchorRange {
                anchor_m: *anchor_m,
                range_m: median(ranges),
                // The powers are no help here: weighing by them makes the worst spots worse.
                sigma_m: 0.05,
            })
            .collect();
        // In the plane: the tag's height is that of its tripod.
        let options = MultilaterationOptions {
            height: Height::Known(tag.z),
            ..MultilaterationOptions::default()
        };
        let fix = locate(&given, &options).unwrap();
        let error = (fix.found.position_m - *tag).xy();
        let sigma = fix.found.sigma_m.xy();
        println!(
            "| {spot} | {} | {} | {:.3} | {:.3} |",
            given.len(),
            fix.found.rejected,
            error.norm(),
            sigma.norm()
        );
        assert!(error.norm() <= 0.35, "{spot}: {error}");
        let horizontal = fix
            .found
            .covariance_m2
            .fixed_view::<2, 2>(0, 0)
            .into_owned();
        let nees = error.dot(&(horizontal.try_inverse().unwrap() * error));
        assert!(nees < 13.8, "{spot}: {nees}"); // 99.9 % of chi-square with 2
    }
}

#[test]
fn recorded_robot_in_a_labyrinth_is_followed() {
    let (Some(ranges), Some(truth)) = (
        data("D2_labyrinth_2d/ranges.csv"),
        data("D2_labyrinth_2d/truth.csv"),
    ) else {
        return;
    };
    let rows = columns(&ranges, ["t_s", "range_m", "ax_m", "ay_m"]);
    let at = |row: &[f64; 4]| AnchorRange {
        anchor_m: Vector3::new(row[2], row[3], 0.0),
        range_m: row[1],
        sigma_m: 0.1,
    };
    let in_plane = MultilaterationOptions {
        height: Height::Known(0.0),
        ..MultilaterationOptions::default()
    };
    let first: Vec<_> = rows[..8].iter().map(at).collect();
    let start = locate(&first, &in_plane).unwrap().found.position_m;
    let options = RangeFilterOptions {
        height_m: Some(0.0),
        ..RangeFilterOptions::default()
    };
    let mut filter = RangeFilter::new(options, rows[0][0], start, 0.2, 0.2);
    let (mut squares, mut n) = (0.0, 0.0);
    for (row, truth) in rows.iter().zip(columns(&truth, ["t_s", "x_m", "y_m"])) {
        filter.update(row[0], &at(row));
        assert_eq!(row[0], truth[0]);
        let p = filter.state().position_m;
        squares += (p.x - truth[1]).powi(2) + (p.y - truth[2]).powi(2);
        n += 1.0;
    }
    let rmse = f64::sqrt(squares / n);
    println!("labyrinth: RMSE {rmse:.3} m over {n} ranges");
    assert!(rmse < 0.25, "{rmse}");
}
