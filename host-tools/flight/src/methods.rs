//! The methods by name.

use crate::error::FlightError;
use crate::settings::{LambdaWeighs, Plan, Settings};
use crate::slalom::Slalom;
use nova_solver::baselines::{RelativeCkf, RelativeCkfOptions, SingleAnchor, SingleAnchorOptions};
use nova_solver::map::{self, MapNavigator, MapOptions};
use nova_solver::navigation::{FirstGuess, Navigator};
use nova_solver::nova::{self, NovaNavigator, NovaOptions, Parameters, Variant};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// A way to navigate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Method {
    /// The paper's.
    Nova,
    /// Maximum a posteriori over the whole flight.
    Map,
    /// Ablation (paper Table IV): first guess only.
    V1,
    /// Multilateration every metre.
    V2,
    /// Multilateration at half of the remaining distance.
    V2Prime,
    /// V2' with exploratory flight.
    V3,
    /// V3 with joint optimisation.
    V4,
    /// V3 with trajectory planning.
    V5,
    /// V5 with joint optimisation.
    V6,
    /// V6 with the two-step descent: the same as `Nova`.
    V7,
    /// Baseline "SA": tracking from a single anchor.
    Sa,
    /// Baseline "RP": cubature Kalman filter for the relative position.
    Rp,
    /// Baseline "RP-Error": the same from the first guess.
    RpError,
    /// Table I: a prescribed path and one multilateration.
    Slalom,
}

/// How far the start of a cubature Kalman filter is off along each axis, metres: as good as the
/// vehicle's own, and as the first guess of the paper's Table III (5 m aside and 5 m in height).
const PERFECT_START_SIGMA_M: f64 = 0.05;
const GUESSED_START_SIGMA_M: f64 = 5.0;

impl Method {
    /// All of them.
    pub const ALL: [Self; 14] = [
        Self::Nova,
        Self::Map,
        Self::V1,
        Self::V2,
        Self::V2Prime,
        Self::V3,
        Self::V4,
        Self::V5,
        Self::V6,
        Self::V7,
        Self::Sa,
        Self::Rp,
        Self::RpError,
        Self::Slalom,
    ];

    /// Its name on command lines and in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Nova => "nova",
            Self::Map => "map",
            Self::V1 => "v1",
            Self::V2 => "v2",
            Self::V2Prime => "v2p",
            Self::V3 => "v3",
            Self::V4 => "v4",
            Self::V5 => "v5",
            Self::V6 => "v6",
            Self::V7 => "v7",
            Self::Sa => "sa",
            Self::Rp => "rp",
            Self::RpError => "rp-error",
            Self::Slalom => "slalom",
        }
    }

    /// Whether the method is defined as one that knows where the tag is at the start: "SA and RP assume
    /// perfect initialization" (paper, section V). Its first guess has to be the tag's true place.
    pub fn starts_from_truth(self) -> bool {
        matches!(self, Self::Sa | Self::Rp)
    }

    /// A navigator that begins a flight.
    pub fn navigator(self, settings: &Settings, first_guess: FirstGuess) -> Box<dyn Navigator> {
        let relative = |start_sigma_m| {
            RelativeCkf::new(first_guess, start_sigma_m, RelativeCkfOptions::default())
        };
        let paper = |variant| -> Box<dyn Navigator> {
            Box::new(NovaNavigator::new(
                first_guess,
                nova_options(settings, variant),
            ))
        };
        match self {
            Self::Slalom => Box::new(Slalom::new(first_guess)),
            Self::V1 => paper(Variant::V1),
            Self::V2 => paper(Variant::V2),
            Self::V2Prime => paper(Variant::V2Prime),
            Self::V3 => paper(Variant::V3),
            Self::V4 => paper(Variant::V4),
            Self::V5 => paper(Variant::V5),
            Self::V6 => paper(Variant::V6),
            Self::V7 | Self::Nova => paper(Variant::V7),
            Self::Map => Box::new(MapNavigator::new(first_guess, map_options(settings))),
            Self::Sa => Box::new(SingleAnchor::new(
                first_guess,
                SingleAnchorOptions::default(),
            )),
            Self::Rp => Box::new(relative(PERFECT_START_SIGMA_M)),
            Self::RpError => Box::new(relative(GUESSED_START_SIGMA_M)),
        }
    }
}

/// Tables II and IV, with speed, rate of ranges and the planner's weight as set.
fn nova_options(settings: &Settings, variant: Variant) -> NovaOptions {
    let plain = NovaOptions::variant(variant);
    NovaOptions {
        parameters: Parameters {
            speed_m_s: settings.speed_m_s,
            uwb_interval_s: 1.0 / settings.uwb_rate_hz,
            lambda: settings.lambda,
            ..plain.parameters
        },
        lambda_weighs: match settings.lambda_weighs {
            LambdaWeighs::Travel => nova::LambdaWeighs::Travel,
            LambdaWeighs::Dop => nova::LambdaWeighs::Dop,
        },
        ..plain
    }
}

/// What the navigator is told: speed and plan. Of the sensors it has to find out for itself.
fn map_options(settings: &Settings) -> MapOptions {
    MapOptions {
        speed_m_s: settings.speed_m_s,
        plan: match settings.plan {
            Plan::Careful => map::Plan::Careful,
            Plan::Fast => map::Plan::Fast,
        },
        ..MapOptions::default()
    }
}

impl fmt::Display for Method {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.name())
    }
}

impl FromStr for Method {
    type Err = FlightError;

    fn from_str(word: &str) -> Result<Self, FlightError> {
        let found = Self::ALL.into_iter().find(|method| method.name() == word);
        found.ok_or_else(|| FlightError::UnknownWord {
            kind: "method",
            word: word.to_owned(),
            known: Self::ALL.map(Self::name).join(", "),
        })
    }
}

impl TryFrom<String> for Method {
    type Error = FlightError;

    fn try_from(word: String) -> Result<Self, FlightError> {
        word.parse()
    }
}

impl From<Method> for String {
    fn from(method: Method) -> Self {
        method.name().to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_method_is_found_by_its_name() {
        for method in Method::ALL {
            assert_eq!(method.to_string().parse(), Ok(method));
        }
        let unknown = "warp".parse::<Method>().unwrap_err().to_string();
        assert!(
            unknown.contains("warp") && unknown.contains("map"),
            "{unknown}"
        );
    }
}
