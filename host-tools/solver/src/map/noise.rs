//! What the navigator takes the measurements to be worth. It starts from data sheets and is adapted
//! in flight ([`super::roughness`], [`super::tuning`]).

use crate::ins_error::InsNoise;

/// Strength of every noise in the model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseModel {
    /// Growth of the error of dead reckoning.
    pub ins: InsNoise,
    /// Noise of a range until its roughness has been measured, metres.
    pub range_sigma_m: f64,
    /// Probability that a range is an outlier.
    pub outlier_probability: f64,
}

impl NoiseModel {
    /// Data-sheet figures of a consumer IMU (500 ug/sqrt(Hz), 3000 ug bias instability), a
    /// barometer and a DW1000.
    pub fn data_sheet() -> Self {
        Self {
            ins: InsNoise {
                velocity_random_walk: 7.7e-3,
                acceleration_random_walk: 3e-4,
                position_random_walk: 3e-3,
                height_random_walk: 5e-3,
                height_sigma_m: 0.05,
            },
            range_sigma_m: 0.1,
            outlier_probability: 0.02,
        }
    }
}
