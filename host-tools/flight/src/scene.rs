//! What is there before the flight: the tag, the vehicle, and what was said about the tag.

use crate::settings::Settings;
use crate::streams::{Stream, generator, normal};
use nalgebra::{Vector2, Vector3};
use nova_solver::navigation::FirstGuess;
use rand::RngExt;
use std::f64::consts::TAU;

/// A flight's beginning. World and navigation frame are the same local ENU frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scene {
    /// The tag; the ground is at its height.
    pub tag_m: Vector3<f64>,
    /// Where the vehicle hovers at hand-over.
    pub start_m: Vector3<f64>,
    /// Where the tag is said to be.
    pub first_guess: FirstGuess,
}

impl Scene {
    /// The scene of the trial with this seed: the tag at the origin, the start in a random direction
    /// from it.
    pub fn new(settings: &Settings, seed: u64) -> Self {
        Self::around(Vector3::zeros(), settings, seed)
    }

    /// The same about a tag somewhere else.
    pub fn around(tag_m: Vector3<f64>, settings: &Settings, seed: u64) -> Self {
        let mut rng = generator(seed, Stream::Guess);
        let (r_mean_m, r_sigma_m, z_sigma_m) = settings.first_guess.spread_m();
        let start = polar(settings.distance_m, rng.random_range(0.0..TAU));
        let r_m = r_mean_m + r_sigma_m * normal(&mut rng);
        let guess = polar(r_m, rng.random_range(0.0..TAU));
        let guess_z_m = z_sigma_m * normal(&mut rng);
        Self {
            tag_m,
            start_m: tag_m + start.push(settings.altitude_m),
            first_guess: FirstGuess {
                tag_m: tag_m + guess.push(guess_z_m),
            },
        }
    }
}

fn polar(radius: f64, angle: f64) -> Vector2<f64> {
    Vector2::new(radius * angle.cos(), radius * angle.sin())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::FirstGuessQuality;
    use crate::streams::trial_seed;

    #[test]
    fn first_guesses_are_off_as_far_as_their_quality_says() {
        let n = 4000;
        for (quality, r_m, sigma_r_m, sigma_z_m) in [
            (FirstGuessQuality::Normal, 5.0f64, 2.0, 5.0),
            (FirstGuessQuality::VeryHigh, 20.0, 5.0, 20.0),
        ] {
            let settings = Settings {
                first_guess: quality,
                ..Settings::default()
            };
            let (mut horizontal, mut vertical, mut middle) = (0.0, 0.0, Vector2::zeros());
            for trial in 0..n {
                let scene = Scene::new(&settings, trial_seed(1, trial));
                let off = scene.first_guess.tag_m - scene.tag_m;
                horizontal += off.xy().norm_squared() / n as f64;
                vertical += off.z * off.z / n as f64;
                middle += off.xy() / n as f64;
            }
            let expected = r_m * r_m + sigma_r_m * sigma_r_m;
            assert!((horizontal / expected - 1.0).abs() < 0.06, "{horizontal}");
            let z = vertical / (sigma_z_m * sigma_z_m);
            assert!((z - 1.0).abs() < 4.0 * (2.0 / n as f64).sqrt());
            assert!(middle.norm() < 4.0 * (expected / n as f64).sqrt());
        }
    }

    #[test]
    fn the_start_is_as_far_and_high_as_was_set() {
        let settings = Settings {
            distance_m: 40.0,
            altitude_m: 35.0,
            ..Settings::default()
        };
        let tag_m = Vector3::new(1.0, 2.0, 3.0);
        for seed in 0..20 {
            let scene = Scene::around(tag_m, &settings, seed);
            let start = scene.start_m - tag_m;
            assert!((start.xy().norm() - 40.0).abs() < 1e-9);
            assert_eq!(start.z, 35.0);
        }
    }
}
