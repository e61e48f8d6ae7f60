//! The navigator as the command line sets it up.

use super::pairing::Heard;
use crate::error::bad_input;
use crate::place::Triple;
use anyhow::Result;
use nova_solver::map::{MapNavigator, MapOptions};
use nova_solver::navigation::{FirstGuess, InsSample, Navigator};
use serde::{Deserialize, Serialize};

/// What the navigator is told beforehand.
#[derive(Clone, Debug, clap::Args, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct NavigatorOptions {
    /// Where the tag is said to be, ENU metres. Without it: anywhere as far away as the first range.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    #[serde(default, skip_serializing_if = "Option::is_none")]
    first_guess: Option<Triple>,
    /// How far --first-guess may be off along each axis, metres (one sigma).
    #[arg(long, value_name = "M", requires = "first_guess")]
    #[serde(default, skip_serializing_if = "Option::is_none")]
    guess_sigma: Option<f64>,
    /// Constant error of ranges to expect, metres.
    #[arg(
        long,
        value_name = "M",
        default_value_t = 0.0,
        allow_negative_numbers = true
    )]
    range_bias: f64,
    /// How far the constant error may be from that, metres (one sigma).
    #[arg(long, value_name = "M", default_value_t = 0.15)]
    range_bias_sigma: f64,
    /// Speed of the vehicle, m/s.
    #[arg(long, value_name = "M_PER_S", default_value_t = 1.0)]
    speed: f64,
    /// A waypoint this near has been reached, metres.
    #[arg(long, value_name = "M", default_value_t = 0.2)]
    pub(crate) arrival_radius: f64,
}

impl NavigatorOptions {
    /// Whether all numbers can be used.
    pub(crate) fn check(&self) -> Result<()> {
        for (name, value) in [
            ("--range-bias-sigma", Some(self.range_bias_sigma)),
            ("--speed", Some(self.speed)),
            ("--arrival-radius", Some(self.arrival_radius)),
            ("--guess-sigma", self.guess_sigma),
        ] {
            if value.is_some_and(|v| !(v.is_finite() && v > 0.0)) {
                return Err(bad_input!("{name} must be more than 0"));
            }
        }
        if !self.range_bias.is_finite() {
            return Err(bad_input!("--range-bias must be a finite number"));
        }
        Ok(())
    }

    /// A navigator for a node first heard here.
    pub(crate) fn navigator(&self, place: &InsSample, heard: &Heard) -> Box<dyn Navigator> {
        let defaults = MapOptions::default();
        let anywhere_m = heard.range.range_m.clamp(1.0, 200.0);
        let (guess_m, sigma_m) = match self.first_guess {
            Some(Triple(guess_m)) => (guess_m, self.guess_sigma),
            None => (place.position_m, Some(anywhere_m)),
        };
        let options = MapOptions {
            // An anchor on a wall may be above the flight; then a first guess tells it from its image.
            tag_below_flight: self.first_guess.is_none(),
            speed_m_s: self.speed,
            bias_prior_m: self.range_bias,
            bias_sigma_m: self.range_bias_sigma,
            guess_sigma_horizontal_m: sigma_m.unwrap_or(defaults.guess_sigma_horizontal_m),
            guess_sigma_vertical_m: sigma_m.unwrap_or(defaults.guess_sigma_vertical_m),
            ..defaults
        };
        Box::new(MapNavigator::new(FirstGuess { tag_m: guess_m }, options))
    }
}
