//! Names of those that are compared.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

use crate::error::FlightError;

/// Who estimates where the target is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Estimator {
    /// The extended Kalman filter, the paper's baseline.
    Ekf,
    /// The factor graph without a kernel.
    Plain,
    /// The paper's: Cauchy's kernel on bearings.
    Robust,
    /// The same with kernels that begin wide at every sighting.
    Graduated,
    /// Motions and sights that take turns.
    Interacting,
}

/// Who keeps the distance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Controller {
    /// The control Lyapunov function alone.
    Clf,
    /// With barriers at the bounds themselves.
    Fixed,
    /// The paper's: barriers and dead zones by the covariance.
    Aware,
    /// The same with barriers that hold between samples.
    Sampled,
}

impl Estimator {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::Ekf,
        Self::Plain,
        Self::Robust,
        Self::Graduated,
        Self::Interacting,
    ];

    fn word(self) -> &'static str {
        match self {
            Self::Ekf => "ekf",
            Self::Plain => "plain",
            Self::Robust => "robust",
            Self::Graduated => "graduated",
            Self::Interacting => "interacting",
        }
    }
}

impl Controller {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Clf, Self::Fixed, Self::Aware, Self::Sampled];

    fn word(self) -> &'static str {
        match self {
            Self::Clf => "clf",
            Self::Fixed => "fixed",
            Self::Aware => "aware",
            Self::Sampled => "sampled",
        }
    }
}

impl fmt::Display for Estimator {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())
    }
}

impl fmt::Display for Controller {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())
    }
}

impl FromStr for Estimator {
    type Err = FlightError;

    fn from_str(word: &str) -> Result<Self, FlightError> {
        let known = Self::ALL.map(Self::word).join(", ");
        find(&Self::ALL, Self::word, "estimator", word, known)
    }
}

impl FromStr for Controller {
    type Err = FlightError;

    fn from_str(word: &str) -> Result<Self, FlightError> {
        let known = Self::ALL.map(Self::word).join(", ");
        find(&Self::ALL, Self::word, "controller", word, known)
    }
}

fn find<T: Copy>(
    all: &[T],
    name: fn(T) -> &'static str,
    kind: &'static str,
    word: &str,
    known: String,
) -> Result<T, FlightError> {
    all.iter()
        .copied()
        .find(|one| name(*one) == word)
        .ok_or_else(|| FlightError::UnknownWord {
            kind,
            word: word.to_owned(),
            known,
        })
}
