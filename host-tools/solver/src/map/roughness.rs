//! How noisy ranges and reckoned heights are, told from their roughness alone.
//!
//! The second difference `x_i - 2 x_(i+1) + x_(i+2)` of white noise has six times its variance, and
//! sees next to nothing of a flight: at ten ranges a second and 1 m/s a circle of 1 m radius adds 1
//! cm. So the noise of a range is known without knowing where the tag is, and no explanation can talk
//! it up or down. Clipping at three standard deviations, by the median, forgives outliers, and a window of
//! ten seconds follows noise that changes with distance.

/// Second differences in the window.
const WINDOW: usize = 101;
/// Median of the absolute value of a standard normal.
const NORMAL_MEDIAN: f64 = 0.674_489_750_196_081_7;
/// The data sheet counts as much as this many differences.
const PRIOR_COUNT: f64 = 8.0;
/// Differences beyond this many standard deviations count as that many.
const CLIP: f64 = 3.0;

/// A running estimate of white noise.
#[derive(Debug, Clone)]
pub(super) struct Roughness {
    data_sheet: f64,
    last: [f64; 2],
    seen: usize,
    differences: [f64; WINDOW],
}

impl Roughness {
    /// Of noise that is said to have this standard deviation.
    pub(super) fn new(data_sheet: f64) -> Self {
        Self {
            data_sheet,
            last: [0.0; 2],
            seen: 0,
            differences: [0.0; WINDOW],
        }
    }

    /// Takes the next of a series of evenly spaced values; the standard deviation of its noise.
    pub(super) fn add(&mut self, value: f64) -> f64 {
        if self.seen >= 2 {
            self.differences[(self.seen - 2) % WINDOW] =
                (value - 2.0 * self.last[1] + self.last[0]).abs();
        }
        self.last = [self.last[1], value];
        self.seen += 1;
        self.sigma()
    }

    /// The standard deviation of the noise.
    pub(super) fn sigma(&self) -> f64 {
        let count = self.seen.saturating_sub(2).min(WINDOW);
        let mut sorted = self.differences;
        let Some(known) = sorted.get_mut(..count).filter(|known| !known.is_empty()) else {
            return self.data_sheet;
        };
        let (_, median, _) = known.select_nth_unstable_by(count / 2, f64::total_cmp);
        let clip = CLIP * *median / NORMAL_MEDIAN;
        let square = known.iter().map(|d| d.min(clip).powi(2)).sum::<f64>() / count as f64;
        let measured = (square / 6.0).sqrt().max(f64::MIN_POSITIVE);
        let weight = count as f64 / (count as f64 + PRIOR_COUNT);
        measured.powf(weight) * self.data_sheet.powf(1.0 - weight)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, Normal};

    /// Mean estimate over a long series of noise on a moving signal.
    fn estimated(outliers: bool) -> f64 {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let noise = Normal::new(0.0, 0.1).unwrap();
        let mut roughness = Roughness::new(0.1);
        let sum: f64 = (0..4000)
            .map(|i| {
                let t_s = 0.1 * f64::from(i);
                let late = if outliers && i % 20 == 0 { 5.0 } else { 0.0 };
                roughness.add(30.0 - 0.8 * t_s + noise.sample(&mut rng) + late)
            })
            .skip(100)
            .sum();
        sum / 3900.0
    }

    #[test]
    fn white_noise_on_a_moving_signal_is_measured() {
        assert!(
            (estimated(false) / 0.1 - 1.0).abs() < 0.05,
            "{}",
            estimated(false)
        );
    }

    #[test]
    fn one_wild_value_in_twenty_does_not_double_it() {
        assert!(
            (1.0..2.0).contains(&(estimated(true) / 0.1)),
            "{}",
            estimated(true)
        );
    }
}
