//! The landing by one tag: NOVA's navigator in place of four anchors.
//!
//! ```text
//!   autopilot's place, until the tag is heard ─┐
//!   velocities, from then on ──────────────────┼► dead reckoning ─► MapNavigator ─► place from the platform,
//!   autopilot's height, smoothed ──────────────┘        ranges ───┘                 where it may be leant on
//! ```
//!
//! A range to one tag tells a distance and no direction. Directions come from the flight: that is why the descent
//! circles ([`super::Circling`]). What the navigator says each time rests on the same ranges as what it said before, so the landing
//! filter is told a larger covariance: as if the same had been said [`SingleTagOptions::repeated`] times.

use super::filter::Measurement;
use crate::map::{MapNavigator, MapOptions};
use crate::navigation::{FirstGuess, InsSample, Navigator, RangeSample, horizontal_sigma_m};
use nalgebra::Vector3;

/// How fast the reckoned height is drawn to the autopilot's, seconds: in between vertical velocities carry it, which are smooth.
const HEIGHT_S: f64 = 2.0;
/// The first guess is good to a metre or two, so the navigator need not wait before it takes its explanations together, seconds.
const MIXTURE_AFTER_S: f64 = 2.0;

/// What is known beforehand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SingleTagOptions {
    /// Where the tag lies on the platform, from its centre, metres.
    pub tag_m: Vector3<f64>,
    /// How far the autopilot's place may be off along each horizontal axis, metres.
    pub place_sigma_m: f64,
    /// The same in height, metres.
    pub height_sigma_m: f64,
    /// How far the autopilot's velocity may be off along each axis, m/s.
    pub velocity_sigma_m_s: f64,
    /// Settings of the navigator; what is said above goes over them.
    pub navigator: MapOptions,
    /// Over how many of its places the navigator's error stays the same.
    pub repeated: f64,
}

impl Default for SingleTagOptions {
    fn default() -> Self {
        Self {
            tag_m: Vector3::zeros(),
            place_sigma_m: 1.5,
            height_sigma_m: 2.25,
            velocity_sigma_m_s: 0.1,
            navigator: MapOptions {
                mixture_after_s: MIXTURE_AFTER_S,
                ..MapOptions::default()
            },
            repeated: 20.0,
        }
    }
}

/// Places from the ranges to one tag.
#[derive(Debug, Clone)]
pub struct SingleTag {
    options: SingleTagOptions,
    navigator: MapNavigator,
    reckoned_m: Option<Vector3<f64>>,
    is_heard: bool,
    /// When the autopilot last told its place.
    autopilot_s: f64,
}

impl SingleTag {
    /// Nothing heard yet.
    pub fn new(options: SingleTagOptions) -> Self {
        let navigator = MapOptions {
            guess_sigma_horizontal_m: options.place_sigma_m,
            guess_sigma_vertical_m: options.height_sigma_m,
            initial_velocity_sigma: options.velocity_sigma_m_s,
            ..options.navigator
        };
        let guess = FirstGuess {
            tag_m: options.tag_m,
        };
        Self {
            navigator: MapNavigator::new(guess, navigator),
            options,
            reckoned_m: None,
            is_heard: false,
            autopilot_s: 0.0,
        }
    }

    /// The autopilot's place, in the frame of the delivery, metres. Once the tag has been heard only its height is taken, slowly:
    /// GPS wanders, and a reckoned path must not jump. Numbers that are none are ignored.
    pub fn autopilot(&mut self, t_s: f64, position_m: &Vector3<f64>) {
        if !is_finite(position_m) {
            return;
        }
        match &mut self.reckoned_m {
            Some(reckoned_m) if self.is_heard => {
                let share = 1.0 - (-(t_s - self.autopilot_s).max(0.0) / HEIGHT_S).exp();
                reckoned_m.z += share * (position_m.z - reckoned_m.z);
            }
            reckoned_m => *reckoned_m = Some(*position_m),
        }
        self.autopilot_s = t_s;
    }

    /// The vehicle has moved for `dt_s` seconds with this velocity, m/s; it is `t_s` now. Numbers that are none are ignored.
    pub fn moved(&mut self, t_s: f64, velocity_m_s: &Vector3<f64>, dt_s: f64) {
        let Some(reckoned_m) = &mut self.reckoned_m else {
            return;
        };
        let position_m = *reckoned_m + velocity_m_s * dt_s;
        if !is_finite(&position_m) {
            return;
        }
        *reckoned_m = position_m;
        if self.is_heard {
            // A reading that is refused leaves the navigator as it was, and the gap that it makes is among its doubts.
            let _ = self.navigator.on_ins(InsSample { t_s, position_m });
        }
    }

    /// A range; the place that follows from all of them, where it may be leant on.
    pub fn range(&mut self, t_s: f64, range_m: f64) -> Option<Measurement> {
        self.is_heard = true;
        self.navigator.on_range(RangeSample { t_s, range_m }).ok()?;
        let estimate = self.navigator.estimate()?;
        let covariance_m2 = estimate.relative_covariance_m2?;
        // Doubts about the geometry are for those who know nothing beforehand: here half of what was known is enough to say more.
        let told = horizontal_sigma_m(&covariance_m2) < 0.5 * self.options.place_sigma_m;
        let doubts = &estimate.doubts;
        let sound = told && !(doubts.ambiguous || doubts.gap || doubts.frozen_ins);
        sound.then(|| Measurement::Uwb {
            position_m: estimate.vehicle_m - estimate.tag_m + self.options.tag_m,
            covariance_m2: covariance_m2 * self.options.repeated,
        })
    }
}

fn is_finite(vector: &Vector3<f64>) -> bool {
    vector.iter().all(|length| length.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    /// Down from 12 m in circles of a quarter of the height, with an autopilot that is off: its last place and the truth then.
    fn descended(off_m: Vector3<f64>, seed: u64) -> (Measurement, Vector3<f64>) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let at = |tick: u32| {
            let t_s = 0.01 * f64::from(tick);
            let z = 12.0 - 0.7 * t_s;
            let (sin, cos) = (0.9 * t_s).sin_cos();
            Vector3::new(0.25 * z * cos - 0.3, 0.25 * z * sin + 0.2, z)
        };
        let mut tag = SingleTag::new(SingleTagOptions::default());
        let mut last = None;
        for tick in 1..1600 {
            let (t_s, truth) = (0.01 * f64::from(tick), at(tick));
            let velocity = (truth - at(tick - 1)) / 0.01 + Vector3::new(0.03, -0.03, 0.02);
            tag.moved(t_s, &velocity, 0.01);
            if tick % 10 == 1 {
                tag.autopilot(t_s, &(truth + off_m));
            }
            if tick % 5 == 0
                && let Some(place) = tag.range(t_s, truth.norm() + 0.02 + 0.05 * normal())
            {
                last = Some((place, truth));
            }
        }
        last.unwrap()
    }

    #[test]
    fn places_are_from_the_platform_however_far_the_autopilot_is_off_and_as_good_as_they_say() {
        let mut nees = 0.0;
        for seed in 0..10 {
            let side = if seed % 2 == 0 { 1.0 } else { -1.0 };
            let off_m = Vector3::new(1.3 * side, -0.9, 1.1 * side);
            let (place, truth) = descended(off_m, 9000 + seed);
            let Measurement::Uwb {
                position_m,
                covariance_m2,
            } = place
            else {
                panic!("{place:?}");
            };
            let error = (position_m - truth).xy();
            let covariance_m2 = covariance_m2 / SingleTagOptions::default().repeated;
            let sigma_m = horizontal_sigma_m(&covariance_m2);
            println!("{seed}: {:.3} m off, sigma {sigma_m:.3} m", error.norm());
            assert!(error.norm() < 0.5 && sigma_m < 0.3);
            let horizontal = covariance_m2.fixed_view::<2, 2>(0, 0).into_owned();
            nees += error.dot(&horizontal.cholesky().unwrap().solve(&error)) / 10.0;
        }
        println!("NEES {nees:.2} of two numbers");
        // Chi-square of twenty numbers, one in a thousand, over ten.
        assert!(nees < 4.5);
    }

    proptest! {
        #[test]
        fn wild_numbers_give_no_place_that_is_none(events in proptest::collection::vec((0..3u8, any::<f64>(), -20.0..20.0f64), 0..200)) {
            let mut tag = SingleTag::new(SingleTagOptions::default());
            for (i, (kind, wild, tame)) in events.into_iter().enumerate() {
                let t_s = if tame > 19.0 { wild } else { 0.05 * i as f64 };
                let number = if tame < -15.0 { wild } else { tame };
                match kind {
                    0 => tag.autopilot(t_s, &Vector3::new(number, tame, 10.0)),
                    1 => tag.moved(t_s, &Vector3::new(tame, number, -0.5), 0.05),
                    _ => if let Some(Measurement::Uwb { position_m, .. }) = tag.range(t_s, number) {
                        prop_assert!(is_finite(&position_m));
                    }
                }
            }
        }
    }
}
