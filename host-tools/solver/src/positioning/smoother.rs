//! A track from single ranges when all of them are in: what came later tells of what was earlier.
//!
//! ```text
//! x = [p v | e_1 .. e_n | c],   z = |p - a_i| + e_i + c + white noise
//!
//! p' = v,  v' = white noise of density q^2;   e_i and c fade over `memory_s` (first-order Gauss-Markov)
//!
//!  ranges ─► forward: extended Kalman filter ─► backward: Bryson and Frazier ─┐
//!               ▲ linearised about the track found last                       │ a few rounds
//!               └─────────────────────────────────────────────────────────────┘
//! ```
//!
//! Errors of recorded ranges are mostly not white: antennas and reflections change as slowly as the vehicle
//! moves, so ten ranges of a second say hardly more than one. Taken for white, they make any filter too
//! sure by a factor of two to four. `e_i` is what is each anchor's own; `c` is common to all, along the
//! line of sight of anchors that stand together: clock, antenna's place, the track that surveyed them.
//!
//! Backward, with `H`, `K`, `S`, `nu` of each update (Bierman, "Factorization methods for discrete
//! sequential estimation", 1977, sec. X.3; no covariance is inverted, so known heights do no harm):
//!
//! ```text
//! l <- -H^T nu / S + (I - K H)^T l,     L <- H^T H / S + (I - K H)^T L (I - K H)      over an update
//! l <- F^T l,                           L <- F^T L F                                  over time
//! x_s = x - P l,                        P_s = P - P L P                               after an update
//! ```

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

use super::Tracked;
use crate::error::SolveError;
use crate::kernel::HUBER_95;
use crate::measurement::RangeMeasurement;

/// How to smooth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SmootherOptions {
    /// Root of the spectral density of acceleration, m/s^1.5 (per axis).
    pub acceleration: f64,
    /// The tag's height where it is known, metres: the track then lies in the plane.
    pub height_m: Option<f64>,
    /// Standard deviation of an anchor's own slow error, metres.
    pub slow_sigma_m: f64,
    /// Standard deviation of the slow error that all anchors share, metres.
    pub common_sigma_m: f64,
    /// Time over which slow errors hang together, seconds.
    pub memory_s: f64,
    /// NIS beyond which a range is set aside.
    pub gate: f64,
    /// Rounds of linearisation.
    pub rounds: u32,
}

impl Default for SmootherOptions {
    fn default() -> Self {
        Self {
            acceleration: 0.4,
            height_m: None,
            slow_sigma_m: 0.03,
            common_sigma_m: 0.05,
            memory_s: 1.5,
            gate: 10.83, // 99.9 % of chi-square with one degree of freedom
            rounds: 4,
        }
    }
}

/// The track at the time of a range.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Smoothed {
    /// By all ranges.
    pub by_all: Tracked,
    /// By those up to this one: what was known live, linearised about the whole.
    pub so_far: Tracked,
    /// False where the range was set aside.
    pub used: bool,
}

/// The track at each of the ranges, in order of time. `position_m` of a measurement is the anchor's; its
/// sigma the white part of the noise. Starts at a place, with standard deviations of position (m) and
/// speed (m/s).
///
/// # Errors
/// [`SolveError`] for numbers and options that cannot be meant, and for no ranges at all.
pub fn smooth(
    ranges: &[RangeMeasurement],
    start_m: Vector3<f64>,
    [position_sigma_m, speed_sigma]: [f64; 2],
    options: &SmootherOptions,
) -> Result<Vec<Smoothed>, SolveError> {
    check(options, start_m, [position_sigma_m, speed_sigma])?;
    for (index, range) in ranges.iter().enumerate() {
        (range.validate()).map_err(|fault| SolveError::BadMeasurement { index, fault })?;
    }
    let mut ranges = ranges.to_vec();
    ranges.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
    let Some(first) = ranges.first() else {
        return Err(SolveError::TooFewMeasurements {
            got: 0,
            unknowns: 4,
        });
    };
    let model = Model::new(&ranges, options);
    let mut mean = DVector::zeros(model.size());
    for i in 0..model.axes {
        mean[i] = start_m[i];
    }
    let start = Step {
        dt: 0.0,
        covariance: model.start(position_sigma_m, speed_sigma),
        mean,
        update: None,
    };
    let start_s = first.t_s;
    let mut about: Option<Vec<Vector3<f64>>> = None;
    for _ in 1..options.rounds.max(1) {
        let forward = model.forward(&ranges, &start, start_s, about.as_deref());
        let back = model.backward(&forward);
        about = Some(back.iter().map(|(x, _)| model.place(x)).collect());
    }
    let forward = model.forward(&ranges, &start, start_s, about.as_deref());
    let back = model.backward(&forward);
    let all = ranges.iter().zip(&forward).zip(&back);
    let smoothed: Vec<Smoothed> = all
        .map(|((range, step), (x, p))| Smoothed {
            by_all: model.tracked(range.t_s, x, p),
            so_far: model.tracked(range.t_s, &step.mean, &step.covariance),
            used: step.update.is_some(),
        })
        .collect();
    let finite = |s: &Smoothed| s.by_all.position_m.iter().all(|v| v.is_finite());
    if smoothed.iter().all(finite) {
        Ok(smoothed)
    } else {
        Err(SolveError::Diverged)
    }
}

fn check(
    options: &SmootherOptions,
    start_m: Vector3<f64>,
    sigmas: [f64; 2],
) -> Result<(), SolveError> {
    let positive = [
        ("acceleration", options.acceleration),
        ("memory_s", options.memory_s),
        ("gate", options.gate),
        ("position_sigma_m", sigmas[0]),
        ("speed_sigma", sigmas[1]),
    ];
    for (name, value) in positive {
        if !(value > 0.0 && value.is_finite()) {
            let why = "not positive and finite";
            return Err(SolveError::BadOption { name, why });
        }
    }
    for (name, value) in [
        ("slow_sigma_m", options.slow_sigma_m),
        ("common_sigma_m", options.common_sigma_m),
    ] {
        if !(value >= 0.0 && value.is_finite()) {
            let why = "negative or not finite";
            return Err(SolveError::BadOption { name, why });
        }
    }
    let finite = start_m
        .iter()
        .chain(&options.height_m)
        .all(|v| v.is_finite());
    if finite {
        Ok(())
    } else {
        let (name, why) = ("start_m or height_m", "not finite");
        Err(SolveError::BadOption { name, why })
    }
}

struct Model<'a> {
    options: &'a SmootherOptions,
    /// 2 where the height is known, else 3.
    axes: usize,
    anchors: usize,
    /// Of each range, its anchor's number.
    numbers: Vec<usize>,
}

/// After a range.
#[derive(Clone)]
struct Step {
    /// Since the one before, seconds.
    dt: f64,
    mean: DVector<f64>,
    covariance: DMatrix<f64>,
    /// `None` where it was set aside.
    update: Option<Update>,
}

#[derive(Clone)]
struct Update {
    h: DVector<f64>,
    gain: DVector<f64>,
    innovation: f64,
    variance: f64,
}

impl<'a> Model<'a> {
    fn new(ranges: &[RangeMeasurement], options: &'a SmootherOptions) -> Self {
        let mut places: Vec<Vector3<f64>> = Vec::new();
        let numbers = (ranges.iter())
            .map(|range| {
                (places.iter().position(|a| *a == range.position_m)).unwrap_or_else(|| {
                    places.push(range.position_m);
                    places.len() - 1
                })
            })
            .collect();
        Self {
            options,
            axes: if options.height_m.is_some() { 2 } else { 3 },
            anchors: places.len(),
            numbers,
        }
    }

    fn size(&self) -> usize {
        2 * self.axes + self.anchors + 1
    }

    /// Variance of a slow error: the last is the common one.
    fn slow_variance(&self, i: usize) -> f64 {
        if i + 1 == self.size() {
            self.options.common_sigma_m.powi(2)
        } else {
            self.options.slow_sigma_m.powi(2)
        }
    }

    fn start(&self, position_sigma_m: f64, speed_sigma: f64) -> DMatrix<f64> {
        let mut p = DMatrix::zeros(self.size(), self.size());
        for i in 0..self.axes {
            p[(i, i)] = position_sigma_m.powi(2);
            p[(self.axes + i, self.axes + i)] = speed_sigma.powi(2);
        }
        for i in 2 * self.axes..self.size() {
            p[(i, i)] = self.slow_variance(i);
        }
        p
    }

    fn place(&self, x: &DVector<f64>) -> Vector3<f64> {
        Vector3::new(x[0], x[1], self.options.height_m.unwrap_or(x[2]))
    }

    fn transition(&self, dt: f64) -> DMatrix<f64> {
        let mut f = DMatrix::identity(self.size(), self.size());
        let keep = (-dt / self.options.memory_s).exp();
        for i in 0..self.axes {
            f[(i, self.axes + i)] = dt;
        }
        for i in 2 * self.axes..self.size() {
            f[(i, i)] = keep;
        }
        f
    }

    /// Adds what a time brings of unknown.
    fn spread(&self, p: &mut DMatrix<f64>, dt: f64) {
        let q = self.options.acceleration.powi(2);
        for i in 0..self.axes {
            let v = self.axes + i;
            p[(i, i)] += q * dt.powi(3) / 3.0;
            p[(i, v)] += q * dt * dt / 2.0;
            p[(v, i)] += q * dt * dt / 2.0;
            p[(v, v)] += q * dt;
        }
        let fresh = 1.0 - (-2.0 * dt / self.options.memory_s).exp();
        for i in 2 * self.axes..self.size() {
            p[(i, i)] += self.slow_variance(i) * fresh;
        }
    }

    /// A step a range, linearised about these places; without them about its own predictions.
    fn forward(
        &self,
        ranges: &[RangeMeasurement],
        start: &Step,
        start_s: f64,
        about: Option<&[Vector3<f64>]>,
    ) -> Vec<Step> {
        let mut steps: Vec<Step> = Vec::with_capacity(ranges.len());
        let mut last_s = start_s;
        for (k, (range, number)) in ranges.iter().zip(&self.numbers).enumerate() {
            let before = steps.last().unwrap_or(start);
            let dt = range.t_s - last_s;
            last_s = range.t_s;
            let f = self.transition(dt);
            let mut mean = &f * &before.mean;
            let mut covariance = &f * &before.covariance * f.transpose();
            self.spread(&mut covariance, dt);
            let at = about.and_then(|about| about.get(k)).copied();
            let update = self.update(range, *number, at, &mut mean, &mut covariance);
            steps.push(Step {
                dt,
                mean,
                covariance,
                update,
            });
        }
        steps
    }

    fn update(
        &self,
        range: &RangeMeasurement,
        number: usize,
        about: Option<Vector3<f64>>,
        mean: &mut DVector<f64>,
        p: &mut DMatrix<f64>,
    ) -> Option<Update> {
        let at = about.unwrap_or_else(|| self.place(mean));
        let away = at - range.position_m;
        let distance = away.norm();
        let u = away.try_normalize(0.0)?;
        let (own, common) = (2 * self.axes + number, self.size() - 1);
        let mut h = DVector::zeros(self.size());
        for i in 0..self.axes {
            h[i] = u[i];
        }
        h[own] = 1.0;
        h[common] = 1.0;
        let moved = u.dot(&(self.place(mean) - at));
        let innovation = range.range_m - (distance + moved + mean[own] + mean[common]);
        let ph = &*p * &h;
        let s = h.dot(&ph) + range.sigma_m.powi(2);
        let nis = innovation * innovation / s;
        if nis.is_nan() || nis > self.options.gate {
            return None;
        }
        let variance = s * (nis.sqrt() / HUBER_95).max(1.0);
        let gain = &ph / variance;
        *mean += &gain * innovation;
        p.ger(-1.0, &gain, &ph, 1.0);
        Some(Update {
            h,
            gain,
            innovation,
            variance,
        })
    }

    /// Mean and covariance by all ranges, of each step.
    fn backward(&self, steps: &[Step]) -> Vec<(DVector<f64>, DMatrix<f64>)> {
        let n = self.size();
        let (mut l, mut big_l) = (DVector::zeros(n), DMatrix::zeros(n, n));
        let mut back = Vec::with_capacity(steps.len());
        for step in steps.iter().rev() {
            let p = &step.covariance;
            back.push((&step.mean - p * &l, p - p * &big_l * p));
            if let Some(Update {
                h,
                gain,
                innovation,
                variance,
            }) = &step.update
            {
                let keep = DMatrix::identity(n, n) - gain * h.transpose();
                l = keep.tr_mul(&l) - h * (innovation / variance);
                big_l = keep.tr_mul(&big_l) * &keep + h * h.transpose() / *variance;
            }
            let f = self.transition(step.dt);
            l = f.tr_mul(&l);
            big_l = f.tr_mul(&big_l) * &f;
        }
        back.reverse();
        back
    }

    fn tracked(&self, t_s: f64, x: &DVector<f64>, p: &DMatrix<f64>) -> Tracked {
        let mut tracked = Tracked {
            t_s,
            position_m: self.place(x),
            velocity: Vector3::zeros(),
            covariance_m2: Matrix3::zeros(),
        };
        for i in 0..self.axes {
            tracked.velocity[i] = x[self.axes + i];
            for k in 0..self.axes {
                tracked.covariance_m2[(i, k)] = 0.5 * (p[(i, k)] + p[(k, i)]);
            }
        }
        tracked
    }
}
