//! What the range filter promises, whatever it is fed.
#![allow(clippy::unwrap_used)]

use nova_ranging::filter::{Estimate, FilterSettings, RangeFilter, RawRange, Treatment};
use nova_ranging::{Address, FilterBank};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const SIGMA_M: f64 = 0.05;

fn raw(at_us: u64, range_m: f32) -> RawRange {
    RawRange {
        at_us,
        range_m,
        nlos_probability: None,
    }
}

/// Gaussian enough: the sum of twelve.
fn normal(rng: &mut ChaCha8Rng) -> f64 {
    (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0
}

/// Feeds `count` ranges, `period_us` apart from `from_us` on, with noise.
fn feed(
    filter: &mut RangeFilter,
    rng: &mut ChaCha8Rng,
    (from_us, period_us, count): (u64, u64, u64),
    truth: impl Fn(f64) -> f64,
) -> Vec<(Treatment, Estimate, f64)> {
    (0..count)
        .map(|k| {
            let at_us = from_us + k * period_us;
            let truth_m = truth(at_us as f64 * 1e-6);
            let measured = truth_m + SIGMA_M * normal(rng);
            let (treatment, estimate) = filter.update(&raw(at_us, measured as f32));
            (treatment, estimate.unwrap(), truth_m)
        })
        .collect()
}

fn rms(errors: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = errors.fold((0.0, 0.0), |(sum, n), e| (sum + e * e, n + 1.0));
    f64::sqrt(sum / n)
}

fn errors(heard: &[(Treatment, Estimate, f64)]) -> impl Iterator<Item = f64> {
    heard
        .iter()
        .map(|(_, e, truth)| f64::from(e.range_m) - truth)
}

#[test]
fn at_rest_the_noise_falls_as_the_variance_says() {
    for period_us in [2_000, 10_000, 100_000] {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut filter = RangeFilter::new(FilterSettings::DEFAULT);
        let heard = feed(&mut filter, &mut rng, (0, period_us, 5_000), |_| 7.0);
        let settled = &heard[100..];
        let got = rms(errors(settled));
        let claimed = settled
            .iter()
            .map(|(_, e, _)| f64::from(e.variance_m2))
            .sum::<f64>();
        let claimed = (claimed / settled.len() as f64).sqrt();
        println!("every {period_us} us: rms {got:.4} m, claimed {claimed:.4} m");
        assert!(got < SIGMA_M, "{got}");
        assert!((0.8..1.25).contains(&(got / claimed)), "{got} {claimed}");
        let accepted = settled.iter().filter(|(t, ..)| *t == Treatment::Accepted);
        assert!(accepted.count() > settled.len() * 99 / 100);
    }
}

#[test]
fn a_moving_peer_is_followed_without_lag() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let mut filter = RangeFilter::new(FilterSettings::DEFAULT);
    // Up and down by 3 m, 1.9 m/s at most.
    let heard = feed(&mut filter, &mut rng, (0, 20_000, 3_000), |t| {
        8.0 + 3.0 * (t * std::f64::consts::TAU / 10.0).sin()
    });
    let settled = &heard[100..];
    assert!(rms(errors(settled)) < SIGMA_M);
    // A lag shows as an error along the rate.
    let along: f64 = settled
        .iter()
        .map(|(_, e, truth)| (f64::from(e.range_m) - truth) * f64::from(e.rate_m_per_s))
        .sum();
    let rates: f64 = settled
        .iter()
        .map(|(_, e, _)| f64::from(e.rate_m_per_s).powi(2))
        .sum();
    let lag_s = -along / rates;
    assert!(lag_s.abs() < 0.005, "{lag_s}");
}

#[test]
fn single_gross_errors_leave_the_estimate_where_it_is() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut filter = RangeFilter::new(FilterSettings::DEFAULT);
    feed(&mut filter, &mut rng, (0, 10_000, 200), |_| 5.0);
    for k in 0..200u64 {
        let at_us = 2_000_000 + k * 10_000;
        let gross = k % 3 == 0;
        let measured = if gross {
            5.0 + (k % 7) as f32 * 40.0 - 5.9
        } else {
            5.0
        };
        let (treatment, estimate) = filter.update(&raw(at_us, measured));
        assert_eq!(
            treatment == Treatment::RejectedOutlier,
            gross,
            "{k}: {treatment:?}"
        );
        assert!((estimate.unwrap().range_m - 5.0).abs() < 0.1);
    }
}

#[test]
fn clocks_set_back_and_late_ranges_are_told_apart() {
    let mut filter = RangeFilter::new(FilterSettings::DEFAULT);
    assert_eq!(filter.update(&raw(60_000_000, 4.0)).0, Treatment::Started);
    assert_eq!(
        filter.update(&raw(59_999_000, 4.0)).0,
        Treatment::RejectedInvalid
    );
    assert_eq!(filter.update(&raw(60_000_000, 4.0)).0, Treatment::Accepted);
    assert_eq!(filter.update(&raw(10, 4.0)).0, Treatment::Started);
    // A silence, too.
    assert_eq!(filter.update(&raw(4_000_010, 4.0)).0, Treatment::Accepted);
    assert_eq!(filter.update(&raw(9_500_010, 40.0)).0, Treatment::Started);
}

#[test]
fn likely_nlos_ranges_pull_less_and_long_ones_are_left_out() {
    let settled = || {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let mut filter = RangeFilter::new(FilterSettings::DEFAULT);
        feed(&mut filter, &mut rng, (0, 100_000, 100), |_| 5.0);
        filter
    };
    let after = |range_m, nlos_probability| {
        let (treatment, estimate) = settled().update(&RawRange {
            at_us: 10_000_000,
            range_m,
            nlos_probability,
        });
        (treatment, estimate.unwrap().range_m)
    };
    let (free, free_m) = after(5.15, Some(0.1));
    let (behind, behind_m) = after(5.15, Some(0.9));
    assert_eq!(
        (free, behind),
        (Treatment::Accepted, Treatment::DownWeighted)
    );
    assert!(behind_m < free_m, "{behind_m} {free_m}");
    assert_eq!(after(7.0, Some(0.9)).0, Treatment::RejectedNlos);
    // No wall makes a range shorter: that is noise until it is gross.
    assert_eq!(after(4.0, Some(0.9)).0, Treatment::DownWeighted);
    assert_eq!(after(7.0, None).0, Treatment::RejectedOutlier);
}

#[test]
fn peers_do_not_disturb_each_other_and_the_longest_silent_makes_room() {
    let mut bank: FilterBank<2> = FilterBank::new(FilterSettings::DEFAULT);
    let (a, b, c) = (Address(1), Address(2), Address(3));
    assert_eq!(bank.update(a, &raw(0, 5.0)).0, Treatment::Started);
    assert_eq!(bank.update(b, &raw(10, 50.0)).0, Treatment::Started);
    assert_eq!(bank.update(a, &raw(1_000, 5.0)).0, Treatment::Accepted);
    assert_eq!(bank.update(b, &raw(1_010, 50.0)).0, Treatment::Accepted);
    assert_eq!(bank.update(a, &raw(2_000, 5.0)).0, Treatment::Accepted);
    assert_eq!(bank.update(c, &raw(2_010, 500.0)).0, Treatment::Started);
    assert_eq!(bank.update(a, &raw(3_000, 5.0)).0, Treatment::Accepted);
    assert_eq!(bank.update(b, &raw(3_010, 50.0)).0, Treatment::Started);
}

#[test]
fn settings_that_cannot_work_are_named() {
    let wrong = FilterSettings {
        hard_gate_sigmas: 2.0,
        ..FilterSettings::DEFAULT
    };
    let error = wrong.check().unwrap_err();
    assert_eq!(
        error.to_string(),
        "hard_gate_sigmas = 2 is not between 3 and 1000"
    );
    let nan = FilterSettings {
        sigma_m: f32::NAN,
        ..FilterSettings::DEFAULT
    };
    assert_eq!(nan.check().unwrap_err().name, "sigma_m");
    assert_eq!(FilterSettings::DEFAULT.check(), Ok(()));
}

/// Any settings that [`FilterSettings::check`] lets pass.
fn settings() -> impl Strategy<Value = FilterSettings> {
    (
        (0.001f32..10.0, 1.0f32..10.0, 1e-4f32..1e4),
        (1.0f32..10.0, 1.0f32..10.0),
        (2u8..=100, 0.1f32..1_000.0, 0.05f32..60.0),
    )
        .prop_map(
            |((sigma, nlos, agility), (soft, hard), (after, speed, silence))| FilterSettings {
                sigma_m: sigma,
                nlos_sigma_m: sigma * nlos,
                agility_m2_per_s3: agility,
                soft_gate_sigmas: soft,
                hard_gate_sigmas: soft * hard,
                reacquire_after: after,
                max_speed_m_per_s: speed,
                silence_s: silence,
            },
        )
        .prop_filter("legal", |settings| settings.check().is_ok())
}

proptest! {
    /// The gate lets go: after a jump to anywhere the filter is there after
    /// `reacquire_after` ranges, and not one earlier.
    #[test]
    fn a_real_jump_is_believed_after_exactly_the_set_number_of_ranges(
        to in prop_oneof![0.0f32..3.0, 9.0f32..500.0], period_us in 1_000u64..20_000,
        after in 2u8..12, seed: u64,
    ) {
        let settings = FilterSettings { reacquire_after: after, ..FilterSettings::DEFAULT };
        let mut filter = RangeFilter::new(settings);
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        feed(&mut filter, &mut rng, (0, 10_000, 100), |_| 6.0);
        let jump = (1_000_000, period_us, u64::from(after));
        let heard = feed(&mut filter, &mut rng, jump, |_| to.into());
        let (rejected, last) = heard.split_at(usize::from(after) - 1);
        prop_assert!(rejected.iter().all(|(t, ..)| *t == Treatment::RejectedOutlier), "{heard:?}");
        prop_assert_eq!(last[0].0, Treatment::Reacquired);
        prop_assert!((last[0].1.range_m - to).abs() < 0.5, "{:?}", last);
    }

    /// With long times between ranges the gate opens by itself before that;
    /// then the way is gentler and takes some ranges more.
    #[test]
    fn a_real_jump_is_survived_at_any_rate(
        to in 0.0f32..500.0, period_us in 1_000u64..5_000_000, seed: u64,
    ) {
        let mut filter = RangeFilter::new(FilterSettings::DEFAULT);
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        feed(&mut filter, &mut rng, (0, 10_000, 100), |_| 6.0);
        let heard = feed(&mut filter, &mut rng, (1_000_000, period_us, 40), |_| to.into());
        let (_, last, _) = heard[39];
        prop_assert!((last.range_m - to).abs() < 0.3, "{last:?}");
    }

    /// Values that are left out and do not agree with each other never win.
    #[test]
    fn garbage_never_wins(seed: u64) {
        let mut filter = RangeFilter::new(FilterSettings::DEFAULT);
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        feed(&mut filter, &mut rng, (0, 10_000, 100), |_| 6.0);
        for k in 0..100u64 {
            // Each 20 m from the one before.
            let range_m = 40.0 + 20.0 * (k % 5) as f32 + rng.random::<f32>();
            let (treatment, estimate) = filter.update(&raw(1_000_000 + k * 10_000, range_m));
            prop_assert_eq!(treatment, Treatment::RejectedOutlier);
            prop_assert!((estimate.unwrap().range_m - 6.0).abs() < 2.0);
        }
    }

    /// Whatever comes in: what goes out is finite, the variance positive, and
    /// the gap after which it came bounds what the filter believes.
    #[test]
    fn nothing_that_comes_in_breaks_the_filter(
        settings in settings(),
        ranges in prop::collection::vec(
            (prop_oneof![0u64..3_000_000, any::<u64>()],
             prop_oneof![-2.0f32..2_100.0, any::<u32>().prop_map(f32::from_bits)],
             prop::option::of(prop_oneof![0.0f32..1.0, any::<u32>().prop_map(f32::from_bits)])),
            1..200),
    ) {
        let mut filter = RangeFilter::new(settings);
        let mut at_us = 0u64;
        let mut started = false;
        for (step_us, range_m, nlos_probability) in ranges {
            at_us = at_us.wrapping_add(step_us);
            let (treatment, estimate) = filter.update(&RawRange { at_us, range_m, nlos_probability });
            let possible = FilterSettings::POSSIBLE_M.contains(&range_m);
            prop_assert!(possible || treatment == Treatment::RejectedInvalid);
            started |= possible;
            prop_assert_eq!(estimate.is_some(), started);
            if let Some(e) = estimate {
                prop_assert!(e.range_m.is_finite() && e.rate_m_per_s.is_finite(), "{e:?}");
                prop_assert!(e.variance_m2.is_finite() && e.variance_m2 > 0.0, "{e:?}");
            }
        }
    }

    /// A long run of equal ranges at any rate keeps the filter well-conditioned.
    #[test]
    fn a_long_run_does_not_wear_the_filter_out(settings in settings(), period_us in 0u64..40_000) {
        let mut filter = RangeFilter::new(settings);
        for k in 0..2_000u64 {
            let (_, estimate) = filter.update(&raw(k * period_us, 12.5));
            let e = estimate.unwrap();
            prop_assert!((e.range_m - 12.5).abs() < 0.01, "{k}: {e:?}");
            prop_assert!(e.variance_m2 > 0.0, "{k}: {e:?}");
        }
    }
}
