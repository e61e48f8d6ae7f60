//! The tightly coupled filter: blocked paths, and anything at all as input. Whole flights
//! are in `flight/tests/vertiport.rs`.

#![allow(clippy::unwrap_used)] // the helpers below are tests as well

use nalgebra::{Matrix3, Vector3};
use nova_solver::fusion::{FusionAnchor, GnssFix, ImuSample, Tight, TightOptions, UwbRange};
use nova_solver::ins::GRAVITY_M_S2;
use nova_solver::positioning::Power;
use proptest::prelude::*;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

const ANCHORS: [Vector3<f64>; 6] = [
    Vector3::new(10.0, 12.0, 9.0),
    Vector3::new(12.0, 1.0, 1.0),
    Vector3::new(9.0, -13.0, 4.0),
    Vector3::new(-5.0, -8.0, 1.0),
    Vector3::new(-10.0, 2.0, 5.0),
    Vector3::new(-4.0, 9.0, 3.0),
];
const PLACE: Vector3<f64> = Vector3::new(1.0, -2.0, 10.0);
const CLEAR: Power = Power {
    rx_dbm: -80.0,
    first_path_dbm: -82.0,
};
const BLOCKED: Power = Power {
    rx_dbm: -80.0,
    first_path_dbm: -93.0,
};

/// As a survey leaves them that could not tell a place from a bias to a decimetre or two.
fn anchors() -> Vec<FusionAnchor> {
    ANCHORS
        .map(|position_m| FusionAnchor {
            position_m,
            covariance_m2: Matrix3::identity() * 0.01,
            bias_m: 0.0,
            bias_sigma_m: 0.2,
            position_bias_m2: Vector3::zeros(),
            range_sigma_m: 0.06,
        })
        .to_vec()
}

fn at_rest(t_s: f64) -> ImuSample {
    ImuSample {
        t_s,
        force_m_s2: Vector3::z() * GRAVITY_M_S2,
        enu_from_body: Matrix3::identity(),
    }
}

/// Ten seconds at rest; from the third on, for five, the first anchor's path is blocked. Largest error
/// of the position from then on (m).
fn beside_a_blocked_path(options: TightOptions, extra_m: f64, seed: u64) -> f64 {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut filter = Tight::new(options, &anchors(), 0.0, PLACE, 0.5);
    let mut worst = 0.0f64;
    for k in 0..1000usize {
        let t_s = 0.01 * k as f64;
        filter.on_imu(&at_rest(t_s));
        let Some(anchor) = (k % 10).checked_sub(4) else {
            continue;
        };
        let noise: f64 = StandardNormal.sample(&mut rng);
        let blocked = anchor == 0 && (3.0..8.0).contains(&t_s);
        let extra = if blocked { extra_m } else { 0.0 };
        filter.on_range(&UwbRange {
            t_s,
            anchor,
            range_m: (PLACE - ANCHORS[anchor]).norm() + 0.06 * noise + extra,
            sigma_m: 0.06,
            power: Some(if blocked { BLOCKED } else { CLEAR }),
        });
        if t_s > 3.0 {
            worst = worst.max((filter.navigation().position_m - PLACE).norm());
        }
    }
    worst
}

#[test]
fn ranges_of_a_blocked_path_do_less_harm_than_as_many_for_news() {
    let options = TightOptions::default();
    let as_news = TightOptions {
        blocked_memory_s: 1e-6,
        ..options
    };
    let (mut sum, mut sum_news) = (0.0, 0.0);
    for extra_m in [0.4, 0.5, 0.6] {
        for seed in 2025..2029 {
            let worst = beside_a_blocked_path(options, extra_m, seed);
            let worst_news = beside_a_blocked_path(as_news, extra_m, seed);
            println!("{extra_m}: {worst:.3}, each for news {worst_news:.3}");
            assert!(
                worst < worst_news + 0.05,
                "{extra_m} {seed}: {worst} {worst_news}"
            );
            (sum, sum_news) = (sum + worst, sum_news + worst_news);
        }
    }
    assert!(sum < 0.9 * sum_news, "{sum} {sum_news}");
}

#[derive(Debug, Clone)]
enum Event {
    Imu(f64, f64),
    Gnss(f64, [f64; 3], f64),
    Range(f64, usize, f64, f64, f64),
}

fn number(span: f64) -> impl Strategy<Value = f64> {
    prop_oneof![
        40 => -span..span,
        1 => Just(f64::NAN),
        1 => Just(f64::INFINITY),
        1 => Just(1e300),
    ]
}

fn any_event() -> impl Strategy<Value = Event> {
    prop_oneof![
        5 => (number(0.2), number(20.0)).prop_map(|(dt, f)| Event::Imu(dt, f)),
        1 => (number(0.4), prop::array::uniform3(number(30.0)), number(4.0)).prop_map(|(dt, p, d)| Event::Gnss(dt, p, d)),
        4 => (number(0.4), 0usize..8, number(40.0), number(0.3), number(100.0))
            .prop_map(|(dt, anchor, range, sigma, power)| Event::Range(dt, anchor, range, sigma, power)),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn whatever_comes_the_filter_has_a_place_and_a_covariance(events in prop::collection::vec(any_event(), 1..150)) {
        let mut filter = Tight::new(TightOptions::default(), &anchors(), 0.0, PLACE, 8.0);
        let mut t_s = 0.0;
        for event in events {
            match event {
                Event::Imu(dt, force) => {
                    // Time goes on by a little, unless it is no number.
                    let sample = ImuSample { force_m_s2: Vector3::new(0.0, force, 9.8), ..at_rest(t_s + dt) };
                    if dt.abs() < 1.0 {
                        t_s += dt.abs();
                        filter.on_imu(&ImuSample { t_s, ..sample });
                    } else if !dt.is_finite() {
                        prop_assert!(!filter.on_imu(&sample));
                    }
                }
                Event::Gnss(dt, place, pdop) => {
                    filter.on_gnss(&GnssFix { t_s: t_s + dt, position_m: place.into(), pdop });
                }
                Event::Range(dt, anchor, range_m, sigma_m, power) => {
                    let power = Some(Power { rx_dbm: -80.0, first_path_dbm: -80.0 - power });
                    filter.on_range(&UwbRange { t_s: t_s + dt, anchor, range_m, sigma_m, power });
                }
            }
        }
        let now = filter.navigation();
        prop_assert!(now.position_m.iter().chain(now.covariance_m2.iter()).all(|v| v.is_finite()), "{now:?}");
        prop_assert!(now.covariance_m2.diagonal().iter().all(|v| *v > 0.0));
    }
}
