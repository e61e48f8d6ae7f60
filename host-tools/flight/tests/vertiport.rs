//! The experiment with anchors that survey themselves, in small. `cargo run --release -p nova-flight
//! --example vertiport -- 100` prints it in full.

#![allow(clippy::unwrap_used)] // the helpers below are tests as well

use nalgebra::{Matrix3, Vector3};
use nova_flight::trial_seed;
use nova_flight::vertiport::{
    Air, Errors, Log, Method, Report, Route, anchors_m, in_area, navigate, path, run_experiment,
};
use nova_solver::fusion::{Fate, FusionAnchor, ImuNoise, Tight, TightOptions, UwbRange};

/// Horizontal and vertical of a row.
fn row(report: &Report, table: u8, name: &str) -> [f64; 2] {
    let found = report
        .rows
        .iter()
        .find(|r| r.table == table && r.name == name);
    let here = &found.unwrap().here;
    [here[0], here[1]]
}

#[test]
fn tables_of_the_paper_keep_their_order_and_ours_at_least_halve_the_errors() {
    let report = run_experiment(6, 1);
    assert_eq!(report.failed, 0);
    let anchors = |flight: u8, how: &str| {
        let name = format!("flight {flight}, {how}, against the truth");
        let here = &report.rows.iter().find(|r| r.name == name).unwrap().here;
        here.iter().map(|e| e * e).sum::<f64>().sqrt()
    };
    // Straight flights leave east and height open, the loop does not.
    assert!(anchors(1, "one by one") > 5.0 * anchors(3, "one by one"));
    assert!(anchors(2, "one by one") > 5.0 * anchors(3, "one by one"));
    assert!(anchors(3, "all at once") < 0.5 * anchors(3, "one by one"));
    assert!(anchors(1, "all at once") < 0.5 * anchors(1, "one by one"));
    for flight in 1..=3 {
        let of = |what: &str| row(&report, 6, &format!("flight {flight}, {what}"));
        let (gnss, loose, tight) = (of("GNSS/INS"), of("loose"), of("tight, joint survey"));
        for k in 0..2 {
            assert!(loose[k] < gnss[k], "{flight} {loose:?} {gnss:?}");
            assert!(tight[k] < 0.5 * loose[k], "{flight} {tight:?} {loose:?}");
            assert!(tight[k] < 0.30, "{flight} {tight:?}");
        }
        let uwb = |what: &str| {
            row(
                &report,
                8,
                &format!("flight {flight}, UWB alone, anchors {what}"),
            )
        };
        assert!(
            uwb("one by one")[0] < uwb("by GNSS")[0] && uwb("one by one")[1] < uwb("by GNSS")[1]
        );
    }
    let of = |what: &str| row(&report, 7, &format!("flight 1, {what}"));
    let (all, by_hand, live) = (
        of("loose, all ranges"),
        of("loose, blocked taken out by hand"),
        of("tight, judged live"),
    );
    assert!(by_hand[0] < all[0]);
    assert!(live[0] < by_hand[0] && live[1] < by_hand[1]);
    assert!(live[0] < of("tight, every range as it is")[0]);
}

/// Air in which the filter's model is true: no blocked paths, a level sensor, white noise.
fn honest_air() -> Air {
    Air {
        blocked_rate_hz: 0.0,
        lag_s: 0.0,
        attitude_sigma: 0.0,
        bias_sigma_m: 0.0,
        ..Air::of_flight(2)
    }
}

fn known_anchors() -> Vec<FusionAnchor> {
    anchors_m()
        .map(|position_m| FusionAnchor {
            position_m,
            covariance_m2: Matrix3::zeros(),
            bias_m: 0.0,
            bias_sigma_m: 0.0,
            position_bias_m2: Vector3::zeros(),
            range_sigma_m: 0.06,
        })
        .to_vec()
}

#[test]
fn innovations_are_as_large_as_the_filter_says() {
    let flown = path(Route::Loop);
    let options = TightOptions {
        imu: ImuNoise {
            acceleration: 0.003,
            bias_walk: 1e-5,
            bias_sigma: 0.05,
        },
        judge_ranges: false,
        ..TightOptions::default()
    };
    let (mut sum, mut n) = (0.0, 0.0);
    let (mut nees, mut moments) = (0.0, 0.0);
    for trial in 0..8 {
        let log = Log::new(&flown, &honest_air(), 1, trial_seed(3, trial));
        // Among the anchors: from afar, with one or two in reach, ranges are far from linear.
        let from = &flown[2000];
        let mut filter = Tight::new(options, &known_anchors(), from.t_s, from.position_m, 0.5);
        let mut ranges = log
            .ranges
            .iter()
            .skip_while(|r| r.t_s < from.t_s)
            .peekable();
        for sample in log.imu.iter().skip(2000) {
            filter.on_imu(sample);
            while let Some(range) = ranges.next_if(|r| r.t_s <= sample.t_s) {
                let range = UwbRange {
                    t_s: range.t_s,
                    anchor: range.anchor,
                    range_m: range.range_m,
                    sigma_m: 0.06,
                    power: None,
                };
                if let Fate::Used(nis) = filter.on_range(&range) {
                    (sum, n) = (sum + nis, n + 1.0);
                }
            }
        }
        let end = flown.last().unwrap();
        let now = filter.navigation();
        let error = now.position_m - end.position_m;
        nees += error.dot(&(now.covariance_m2.try_inverse().unwrap() * error));
        moments += 1.0;
    }
    // Sum of n chi-squares with one degree of freedom: mean 1, standard deviation sqrt(2 / n).
    let (mean, band) = (sum / n, 1.96 * f64::sqrt(2.0 / n));
    println!(
        "NIS {mean:.4}, band 1 +- {band:.4}, {n} ranges; NEES {:.2} of 3",
        nees / moments
    );
    assert!(n > 10_000.0);
    assert!((mean - 1.0).abs() < band, "{mean} {band}");
    // Eight times three degrees of freedom: 99.9 % lie between 8.1 and 51.
    assert!((8.1..51.0).contains(&nees), "{nees}");
}

/// Largest ratio of error to sigma (the root of NEES) over moments in a span of time, and the largest
/// sigma there.
fn in_span(air: &Air, from_s: f64, to_s: f64) -> (f64, f64) {
    let flown = path(Route::Loop);
    let (mut ratio, mut sigma) = (0.0f64, 0.0f64);
    for trial in 0..4 {
        let log = Log::new(&flown, air, 1, trial_seed(5, trial));
        let (positions, _) = navigate(
            Method::Tight { judge_ranges: true },
            &log,
            &known_anchors(),
            [0.0; 2],
        );
        for (t_s, place, covariance) in positions {
            let moment = &flown[((t_s * 100.0).round() as usize).min(flown.len() - 1)];
            if (from_s..to_s).contains(&t_s) {
                let error = place - moment.position_m - moment.velocity * (t_s - moment.t_s);
                let nees = error.dot(&(covariance.try_inverse().unwrap() * error));
                ratio = ratio.max(nees.sqrt());
                sigma = sigma.max(covariance.trace().sqrt());
            }
        }
    }
    (ratio, sigma)
}

#[test]
fn outages_are_told_by_the_covariance() {
    let whole = Air {
        bias_sigma_m: 0.0,
        lag_s: 0.0,
        ..Air::of_flight(2)
    };
    let (_, sigma_before) = in_span(&whole, 30.0, 90.0);
    // GNSS gone for the last minute and more: UWB carries on.
    let without_gnss = Air {
        gnss_until_s: 25.0,
        ..whole
    };
    let (ratio, sigma) = in_span(&without_gnss, 30.0, 90.0);
    println!("no GNSS for 60 s: error at most {ratio:.2} sigma, sigma at most {sigma:.2} m");
    assert!(
        ratio < 5.0 && sigma < 2.0 * sigma_before + 0.3,
        "{ratio} {sigma} {sigma_before}"
    );
    // UWB gone for 20 s: what is left is GNSS that is metres off and an inertial sensor.
    let without_uwb = Air {
        uwb_gap_s: [40.0, 60.0],
        ..whole
    };
    let (ratio, sigma) = in_span(&without_uwb, 41.0, 60.0);
    println!("no UWB for 20 s: error at most {ratio:.2} sigma, sigma at most {sigma:.2} m");
    assert!(ratio < 5.0, "{ratio}");
    assert!(sigma > 5.0 * sigma_before, "{sigma} {sigma_before}");
    // And it is found again.
    let (ratio, sigma) = in_span(&without_uwb, 63.0, 80.0);
    assert!(
        ratio < 5.0 && sigma < 2.0 * sigma_before + 0.3,
        "{ratio} {sigma}"
    );
}

#[test]
fn third_route_stays_long_in_the_anchored_area_and_the_others_pass_through() {
    let seconds = |route| {
        path(route)
            .iter()
            .filter(|m| in_area(&m.position_m))
            .count() as f64
            / 100.0
    };
    assert!(seconds(Route::Loop) > 60.0);
    assert!((5.0..30.0).contains(&seconds(Route::North)));
    assert!(seconds(Route::NorthSouth) > 1.5 * seconds(Route::North));
    for route in Route::ALL {
        for pair in path(route).windows(2) {
            let [a, b] = [&pair[0], &pair[1]];
            assert!((b.position_m - a.position_m).norm() <= 0.03 && a.velocity.norm() < 3.0);
        }
    }
}

#[test]
fn errors_count_the_area_alone_where_asked() {
    let flown = path(Route::North);
    let off = Vector3::new(3.0, 4.0, -2.0);
    let positions: Vec<_> = flown
        .iter()
        .step_by(10)
        .map(|m| (m.t_s, m.position_m + off, Matrix3::zeros()))
        .collect();
    let (all, area) = (
        Errors::of(&positions, &flown, false),
        Errors::of(&positions, &flown, true),
    );
    assert!(area.moments > 0 && area.moments < all.moments);
    for k in 0..2 {
        assert!(
            (all.rmse_m[k] - [5.0, 2.0][k]).abs() < 1e-9
                && (area.max_m[k] - [5.0, 2.0][k]).abs() < 1e-9
        );
    }
}
