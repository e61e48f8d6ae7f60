//! What the measurements of a fit are worth, all sources of error together; the equations are in the text of [`super`].

use crate::noise::NoiseFit;

/// What the measurements of a fit are worth.
pub(super) struct Trust {
    pub(super) noise: NoiseFit,
    /// `sigma_sys^2 sum 1 / sigma^2`.
    pub(super) systematic: f64,
    /// Probability that a measurement which looks sound is an outlier.
    pub(super) outlier_rate: f64,
    /// Largest whitened residual that passes for sound.
    pub(super) limit: f64,
    /// Variance beyond which a direction counts as not measured.
    pub(super) unmeasured_m2: f64,
}

impl Trust {
    /// `f` of the module's text.
    pub(super) fn variance_factor(&self) -> f64 {
        self.noise.variance_factor + self.systematic
    }

    /// What turns the weight of prior knowledge into that of residuals whitened at `scale`.
    pub(super) fn prior_factor(&self, scale: f64) -> f64 {
        self.variance_factor() / (scale * scale)
    }

    /// `g` of the module's text for a measurement of the given leverage.
    pub(super) fn hidden_outlier(&self, leverage: f64) -> f64 {
        // A fit that rests on one measurement alone hides an outlier of any size; ten times the
        // limit is where this stops.
        let seen = (1.0 - leverage).clamp(0.1, 1.0);
        self.outlier_rate * self.limit * self.limit * (1.0 / (seen * seen) - 1.0)
    }
}
