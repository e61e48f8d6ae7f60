//! What a vehicle believes about its own position.

use nalgebra::Vector3;
use rand::Rng;
use rand_distr::{Distribution, Normal, NormalError};

/// A positioning system with white errors, such as RTK-GNSS in the open or
/// motion capture: every reading is off by an independent Gaussian amount.
#[derive(Clone, Copy, Debug)]
pub struct Positioning {
    error: Normal<f64>,
}

impl Positioning {
    /// Readings with this standard deviation along each axis, in metres.
    ///
    /// # Errors
    /// If `sigma_m` is negative or not a number.
    pub fn new(sigma_m: f64) -> Result<Self, NormalError> {
        if sigma_m < 0.0 {
            return Err(NormalError::BadVariance);
        }
        Normal::new(0.0, sigma_m).map(|error| Self { error })
    }

    /// A reading of `true_position_m`.
    pub fn read(&self, true_position_m: Vector3<f64>, rng: &mut impl Rng) -> Vector3<f64> {
        true_position_m.map(|coordinate| coordinate + self.error.sample(rng))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn readings_scatter_by_sigma_about_the_truth() {
        let truth = Vector3::new(10.0, -20.0, 30.0);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let system = Positioning::new(0.02).unwrap();
        let n = 20_000;
        let errors: Vec<_> = (0..n)
            .map(|_| system.read(truth, &mut rng) - truth)
            .collect();
        for axis in 0..3 {
            let mean = errors.iter().map(|e| e[axis]).sum::<f64>() / f64::from(n);
            let rms = (errors.iter().map(|e| e[axis] * e[axis]).sum::<f64>() / f64::from(n)).sqrt();
            // Four standard errors of mean and of standard deviation.
            assert!(mean.abs() < 4.0 * 0.02 / f64::from(n).sqrt());
            assert!((rms / 0.02 - 1.0).abs() < 4.0 / (2.0 * f64::from(n)).sqrt());
        }
    }

    #[test]
    fn a_negative_sigma_is_refused() {
        assert!(Positioning::new(-1.0).is_err());
        assert!(Positioning::new(f64::NAN).is_err());
    }
}
