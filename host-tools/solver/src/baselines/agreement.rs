//! Do the ranges change as the motion says they should?
//!
//! Over the last ranges, the measured changes of distance `a_i` and those that dead reckoning and
//! the present estimate predict, `b_i`, are compared by their cosine:
//!
//! ```text
//!           sum a_i b_i + c
//! cos = -------------------------------------,   c = n * 2 sigma^2
//!       sqrt(sum a_i^2 + c) sqrt(sum b_i^2 + c)
//! ```
//!
//! With `c` the noise of `n` differences two silences agree: where a vehicle flies across the line
//! of sight neither changes, and their quotient would be one of noise.

/// The last changes of distance, measured and predicted.
#[derive(Debug, Clone)]
pub(super) struct Agreement {
    /// Measured and predicted change, the oldest overwritten first.
    changes: [(f64, f64); Self::CHANGES],
    count: usize,
    /// Of one range, metres.
    sigma_m: f64,
}

impl Agreement {
    /// Changes compared: a second of them at ten ranges a second.
    pub(super) const CHANGES: usize = 10;

    pub(super) fn new(sigma_m: f64) -> Self {
        Self {
            changes: [(0.0, 0.0); Self::CHANGES],
            count: 0,
            sigma_m,
        }
    }

    /// Adds a change.
    pub(super) fn push(&mut self, measured_m: f64, predicted_m: f64) {
        self.changes[self.count % Self::CHANGES] = (measured_m, predicted_m);
        self.count += 1;
    }

    /// The cosine above, -1 to 1; 1 before there is anything to compare.
    pub(super) fn cosine(&self) -> f64 {
        let changes = &self.changes[..self.count.min(Self::CHANGES)];
        let noise = changes.len() as f64 * 2.0 * self.sigma_m * self.sigma_m;
        let sum = |of: fn(&(f64, f64)) -> f64| changes.iter().map(of).sum::<f64>() + noise;
        let (measured, predicted) = (sum(|(a, _)| a * a), sum(|(_, b)| b * b));
        if measured > 0.0 && predicted > 0.0 {
            sum(|(a, b)| a * b) / (measured * predicted).sqrt()
        } else {
            1.0
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cosine(changes: impl Iterator<Item = (f64, f64)>) -> f64 {
        let mut agreement = Agreement::new(0.05);
        for (measured, predicted) in changes {
            agreement.push(measured, predicted);
        }
        agreement.cosine()
    }

    #[test]
    fn equal_changes_agree_and_opposite_ones_do_not() {
        assert!((cosine((0..30).map(|_| (0.9, 0.9))) - 1.0).abs() < 1e-12);
        assert!(cosine((0..30).map(|_| (0.9, -0.9))) < -0.9);
    }

    #[test]
    fn silence_agrees_with_silence_but_not_with_motion() {
        assert!(cosine((0..30).map(|i| (0.02 * f64::from(i % 3 - 1), 0.0))) > 0.9);
        assert!(cosine((0..30).map(|_| (0.0, 0.9))) < 0.2);
        assert_eq!(cosine(std::iter::empty()), 1.0);
    }

    #[test]
    fn only_the_last_changes_count() {
        let late = (0..30).map(|i| if i < 20 { (0.9, -0.9) } else { (0.9, 0.9) });
        assert!(cosine(late) > 0.99);
    }
}
