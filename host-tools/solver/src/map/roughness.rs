//! How noisy ranges and reckoned heights are, told from their roughness alone.
//!
//! The second difference `x_i - 2 x_(i+1) + x_(i+2)` of white noise has six times its variance, and
//! sees next to nothing of a flight: at ten ranges a second and 1 m/s a circle of 1 m radius adds 1
//! cm. So the noise of a range is known without knowing where the tag is, and no explanation can talk
//! it up or down. What lies beyond three standard deviations is left out, as outliers are, and a window of
//! ten seconds follows noise that changes with distance.
//!
//! Gusts that dead reckoning does not see roughen ranges too: steps of `q_p sqrt(dt)` from range to range,
//! seen along the line of sight, add `q_p^2 dt u_h^2 / 3` to the variance, with `u_h` the horizontal part of
//! the direction to the tag. What the noise of the range alone is thus depends on the gusts that an
//! explanation believes in; a [`Roughness`] keeps how much that is for gusts of strength one.

/// Second differences in the window.
const WINDOW: usize = 101;
/// Median of the absolute value of a standard normal.
const NORMAL_MEDIAN: f64 = 0.674_489_750_196_081_7;
/// The data sheet counts as much as this many differences.
const PRIOR_COUNT: f64 = 8.0;
/// Differences beyond this many standard deviations are left out, and the variance that a standard normal
/// keeps then.
const CUT: f64 = 3.0;
const CUT_VARIANCE: f64 = 0.973_3;
/// How often that is done, beginning with the median. One outlier in ten touches three differences in
/// ten, and the median is half too large then.
const ROUNDS: usize = 5;

/// A running estimate of white noise.
#[derive(Debug, Clone)]
pub(super) struct Roughness {
    data_sheet: f64,
    last: [f64; 2],
    seen: usize,
    differences: [f64; WINDOW],
    /// What gusts add to the variance of each, over the square of their strength.
    gusts_s: [f64; WINDOW],
}

impl Roughness {
    /// Of noise that is said to have this standard deviation.
    pub(super) fn new(data_sheet: f64) -> Self {
        Self {
            data_sheet,
            last: [0.0; 2],
            seen: 0,
            differences: [0.0; WINDOW],
            gusts_s: [0.0; WINDOW],
        }
    }

    /// Takes the next of a series of evenly spaced values; the standard deviation of its noise.
    /// `gusts_s` is what the square of the strength of gusts is worth in this value's variance.
    pub(super) fn add(&mut self, value: f64, gusts_s: f64) -> f64 {
        if self.seen >= 2 {
            let place = (self.seen - 2) % WINDOW;
            self.differences[place] = (value - 2.0 * self.last[1] + self.last[0]).abs();
            self.gusts_s[place] = gusts_s;
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
        let mut sigma = *median / NORMAL_MEDIAN;
        for _ in 0..ROUNDS {
            let inside = || known.iter().filter(|d| **d <= CUT * sigma);
            let square: f64 = inside().map(|d| d * d).sum();
            sigma = (square / (inside().count().max(1) as f64 * CUT_VARIANCE)).sqrt();
        }
        let measured = (sigma / 6f64.sqrt()).max(f64::MIN_POSITIVE);
        let weight = count as f64 / (count as f64 + PRIOR_COUNT);
        measured.powf(weight) * self.data_sheet.powf(1.0 - weight)
    }

    /// What gusts add to the variance, over the square of their strength: mean of the window.
    pub(super) fn gusts_s(&self) -> f64 {
        let count = self.seen.saturating_sub(2).min(WINDOW);
        self.gusts_s.iter().take(count).sum::<f64>() / count.max(1) as f64
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
                roughness.add(30.0 - 0.8 * t_s + noise.sample(&mut rng) + late, 0.0)
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
    fn one_wild_value_in_twenty_does_not_raise_it_by_a_tenth() {
        assert!(
            (0.95..1.1).contains(&(estimated(true) / 0.1)),
            "{}",
            estimated(true)
        );
    }

    #[test]
    fn gusts_of_known_strength_can_be_told_from_noise() {
        const DT_S: f64 = 0.1;
        let (white_m, gusts, level) = (0.03, 0.11, 0.8_f64);
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let noise = Normal::new(0.0, white_m).unwrap();
        let gust = Normal::new(0.0, gusts * DT_S.sqrt() * level).unwrap();
        let mut roughness = Roughness::new(white_m);
        let mut place_m = 20.0;
        let (mut rough, mut alone) = (0.0, 0.0);
        for i in 0..4000 {
            place_m += gust.sample(&mut rng);
            let sigma_m =
                roughness.add(place_m + noise.sample(&mut rng), level * level * DT_S / 3.0);
            if i >= 100 {
                rough += sigma_m.powi(2) / 3900.0;
                alone += (sigma_m.powi(2) - gusts.powi(2) * roughness.gusts_s()) / 3900.0;
            }
        }
        assert!(rough > 1.2 * white_m.powi(2), "{rough}");
        assert!((alone / white_m.powi(2) - 1.0).abs() < 0.1, "{alone}");
    }
}
