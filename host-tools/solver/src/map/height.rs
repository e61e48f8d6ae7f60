//! Heights of the path, smoothed.
//!
//! A barometer's reading is noisy from one moment to the next; the height of a vehicle is not. Were
//! readings taken as they come, a tag at the height of the flight would explain the ranges better
//! than the right one does: seen level, the noise of the height does not enter the distance, so the
//! residuals of such a phantom are smaller than those of the truth, range after range.
//!
//! Height `h` and its rate `v` follow
//!
//! ```text
//! h' = h + v dt + w_h,   v' = v + w_v,   reading = h + n
//! ```
//!
//! with gusts in `w_h` and manoeuvres in `w_v`; a Kalman filter goes forward, and each new reading
//! corrects the heights of the last seconds (Rauch, Tung and Striebel 1965).

use nalgebra::{Matrix2, Vector2};
use std::collections::VecDeque;

/// Gusts: a tenth of a second at 0.15 m/s, ten times a second, m/sqrt(s).
const GUSTS: f64 = 0.05;
/// Changes of the vertical rate, m/s/sqrt(s).
const MANOEUVRES: f64 = 0.3;
/// How far back a new reading reaches, seconds and readings.
const LAG_S: f64 = 2.0;
const LAG: usize = 32;
/// A rate not yet seen, m/s.
const FIRST_RATE: f64 = 1.0;

/// Height and rate with their covariance.
#[derive(Debug, Clone, Copy)]
struct State {
    mean: Vector2<f64>,
    covariance: Matrix2<f64>,
}

/// A reading and what was known at its time.
#[derive(Debug, Clone, Copy)]
struct Step {
    t_s: f64,
    /// Since the reading before.
    dt_s: f64,
    predicted: State,
    filtered: State,
}

/// Smooths the heights of a path as it grows.
#[derive(Debug, Clone)]
pub(super) struct HeightSmoother {
    steps: VecDeque<Step>,
}

impl HeightSmoother {
    pub(super) fn new() -> Self {
        Self {
            steps: VecDeque::with_capacity(LAG + 1),
        }
    }

    /// Takes a reading later than all before, with its noise.
    pub(super) fn add(&mut self, t_s: f64, height_m: f64, sigma_m: f64) {
        let variance = sigma_m * sigma_m;
        let dt_s = self.steps.back().map_or(0.0, |last| t_s - last.t_s);
        let predicted = match self.steps.back() {
            Some(last) => last.filtered.after(dt_s),
            None => State {
                mean: Vector2::new(height_m, 0.0),
                covariance: Matrix2::from_diagonal(&Vector2::new(
                    variance,
                    FIRST_RATE * FIRST_RATE,
                )),
            },
        };
        let filtered = predicted.given(height_m, variance);
        if self.steps.len() == LAG {
            self.steps.pop_front();
        }
        self.steps.push_back(Step {
            t_s,
            dt_s,
            predicted,
            filtered,
        });
    }

    /// Heights of the last readings, newest first, metres.
    pub(super) fn newest_first(&self) -> impl Iterator<Item = f64> {
        let newest_s = self.steps.back().map_or(0.0, |step| step.t_s);
        let mut later: Option<(Step, Vector2<f64>)> = None;
        self.steps
            .iter()
            .rev()
            .take_while(move |step| newest_s - step.t_s <= LAG_S)
            .map(move |step| {
                let mean = match &later {
                    None => step.filtered.mean,
                    Some((next, smoothed)) => step.filtered.smoothed(next, smoothed),
                };
                later = Some((*step, mean));
                mean.x
            })
    }
}

impl State {
    /// `dt_s` later.
    fn after(&self, dt_s: f64) -> Self {
        let step = Matrix2::new(1.0, dt_s, 0.0, 1.0);
        let (gusts, manoeuvres) = (GUSTS * GUSTS, MANOEUVRES * MANOEUVRES);
        let noise = Matrix2::new(
            gusts * dt_s + manoeuvres * dt_s.powi(3) / 3.0,
            manoeuvres * dt_s * dt_s / 2.0,
            manoeuvres * dt_s * dt_s / 2.0,
            manoeuvres * dt_s,
        );
        Self {
            mean: step * self.mean,
            covariance: step * self.covariance * step.transpose() + noise,
        }
    }

    /// With a reading.
    fn given(&self, height_m: f64, variance: f64) -> Self {
        let p = &self.covariance;
        let gain = p.column(0) / (p[(0, 0)] + variance).max(f64::MIN_POSITIVE);
        Self {
            mean: self.mean + gain * (height_m - self.mean.x),
            covariance: p - gain * p.row(0),
        }
    }

    /// With what the next step came to know.
    fn smoothed(&self, next: &Step, smoothed: &Vector2<f64>) -> Vector2<f64> {
        let step = Matrix2::new(1.0, next.dt_s, 0.0, 1.0);
        let Some(inverse) = next.predicted.covariance.try_inverse() else {
            return self.mean;
        };
        let gain = self.covariance * step.transpose() * inverse;
        self.mean + gain * (smoothed - next.predicted.mean)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, Normal};

    const SIGMA_M: f64 = 0.1;

    /// Root mean square errors of a winding descent, of heights two seconds old and of the newest,
    /// with readings ten times a second.
    fn errors_m() -> [f64; 2] {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let noise = Normal::new(0.0, SIGMA_M).unwrap();
        let truth = |t_s: f64| 30.0 - 0.6 * t_s + (0.5 * t_s).sin();
        let mut smoother = HeightSmoother::new();
        let (mut squares, mut count) = ([0.0; 2], 0.0);
        for i in 0..3000 {
            let t_s = 0.1 * f64::from(i);
            smoother.add(t_s, truth(t_s) + noise.sample(&mut rng), SIGMA_M);
            let heights: Vec<f64> = smoother.newest_first().collect();
            if i > 40 {
                let oldest_s = 0.1 * (heights.len() - 1) as f64;
                squares[0] += (heights[heights.len() - 1] - truth(t_s - oldest_s)).powi(2);
                squares[1] += (heights[0] - truth(t_s)).powi(2);
                count += 1.0;
            }
        }
        squares.map(|square: f64| (square / count).sqrt())
    }

    #[test]
    fn noise_of_a_descent_shrinks_to_a_third_and_the_newest_by_a_third() {
        let [settled_m, newest_m] = errors_m();
        assert!(settled_m < SIGMA_M / 3.0, "{settled_m}");
        assert!(newest_m < SIGMA_M / 1.5, "{newest_m}");
    }

    #[test]
    fn one_reading_is_taken_as_it_is() {
        let mut smoother = HeightSmoother::new();
        smoother.add(3.0, 12.5, SIGMA_M);
        assert_eq!(smoother.newest_first().collect::<Vec<_>>(), [12.5]);
    }

    #[test]
    fn silence_ends_the_reach_of_a_reading() {
        let mut smoother = HeightSmoother::new();
        for t_s in [0.0, 0.1, 9.0] {
            smoother.add(t_s, 10.0, SIGMA_M);
        }
        assert_eq!(smoother.newest_first().count(), 1);
    }

    #[test]
    fn readings_without_noise_stay_as_they_are() {
        let mut smoother = HeightSmoother::new();
        for i in 0..20 {
            smoother.add(0.1 * f64::from(i), f64::from(i * i), 0.0);
        }
        for (back, height_m) in smoother.newest_first().enumerate() {
            let i = 19 - back as i32;
            assert!(
                (height_m - f64::from(i * i)).abs() < 1e-6,
                "{i}: {height_m}"
            );
        }
    }
}
