//! An extended Kalman filter of position and velocity from single ranges.
//!
//! ```text
//! x = [p v],  p' = v,  v' = white noise of density q           F = [I dt I; 0 I]
//! z = |p - a| + noise,  H = [u^T 0]                            u = (p - a) / |p - a|
//! nu = z - h,  S = H P H^T + sigma^2,  NIS = nu^2 / S
//! ```
//!
//! A range whose NIS lies beyond the gate is set aside; one within, but further out than Huber's
//! limit, gets its sigma widened so that it pulls as one at the limit. After `patience` ranges in a row
//! beyond the gate it is the filter that is wrong: its position covariance is opened by what they say.

use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

use super::AnchorRange;
use crate::kernel::HUBER_95;

/// How to filter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RangeFilterOptions {
    /// Root of the spectral density of acceleration, m/s^1.5 (per axis).
    pub acceleration: f64,
    /// NIS beyond which a range is set aside.
    pub gate: f64,
    /// So many in a row and the filter is opened instead.
    pub patience: u32,
    /// The tag's height where it is known, metres: the filter then moves in the plane.
    pub height_m: Option<f64>,
    /// False to take every range as it is: a plain extended Kalman filter.
    pub judge_ranges: bool,
}

impl Default for RangeFilterOptions {
    fn default() -> Self {
        Self {
            acceleration: 0.5,
            gate: 10.83, // 99.9 % of chi-square with one degree of freedom
            patience: 20,
            height_m: None,
            judge_ranges: true,
        }
    }
}

/// Position and velocity at a moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tracked {
    /// Seconds.
    pub t_s: f64,
    /// Metres.
    pub position_m: Vector3<f64>,
    /// Metres per second.
    pub velocity: Vector3<f64>,
    /// Of the position, square metres.
    pub covariance_m2: Matrix3<f64>,
}

/// What became of a range.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Judgement {
    /// Used with its sigma times this (1 or more).
    Used(f64),
    /// Beyond the gate.
    SetAside,
    /// Older than the filter's time, or not a number.
    Refused,
}

/// The filter.
#[derive(Debug, Clone, PartialEq)]
pub struct RangeFilter {
    options: RangeFilterOptions,
    t_s: f64,
    x: Vector6<f64>,
    p: Matrix6<f64>,
    outliers_in_a_row: u32,
}

impl RangeFilter {
    /// Starts at a place with standard deviations of position (m) and velocity (m/s).
    pub fn new(
        options: RangeFilterOptions,
        t_s: f64,
        position_m: Vector3<f64>,
        position_sigma_m: f64,
        speed_sigma: f64,
    ) -> Self {
        let mut x = Vector6::zeros();
        x.fixed_rows_mut::<3>(0).copy_from(&position_m);
        let (pp, vv) = (position_sigma_m.powi(2), speed_sigma.powi(2));
        let mut p = Matrix6::from_diagonal(&Vector6::new(pp, pp, pp, vv, vv, vv));
        if let Some(height) = options.height_m {
            x[2] = height;
            p[(2, 2)] = 0.0;
            p[(5, 5)] = 0.0;
        }
        Self {
            options,
            t_s,
            x,
            p,
            outliers_in_a_row: 0,
        }
    }

    /// Takes one range; those of one moment one after the other. Returns what became of it and its
    /// normalised innovation squared.
    pub fn update(&mut self, t_s: f64, range: &AnchorRange) -> (Judgement, f64) {
        let sound = range.anchor_m.iter().all(|v| v.is_finite())
            && range.range_m.is_finite()
            && range.sigma_m > 0.0
            && range.sigma_m.is_finite();
        if !sound || t_s.is_nan() || t_s < self.t_s {
            return (Judgement::Refused, f64::NAN);
        }
        self.predict(t_s);
        let away = self.x.fixed_rows::<3>(0) - range.anchor_m;
        let distance = away.norm();
        if distance <= 0.0 {
            return (Judgement::SetAside, f64::NAN);
        }
        let mut h = Vector6::zeros();
        h.fixed_rows_mut::<3>(0).copy_from(&(away / distance));
        let ph = self.p * h;
        let own = h.dot(&ph);
        let r = range.sigma_m.powi(2);
        let innovation = range.range_m - distance;
        let nis = innovation * innovation / (own + r);
        if self.options.judge_ranges && nis > self.options.gate {
            self.outliers_in_a_row += 1;
            if self.outliers_in_a_row >= self.options.patience {
                self.outliers_in_a_row = 0;
                self.open(innovation.abs());
            }
            return (Judgement::SetAside, nis);
        }
        self.outliers_in_a_row = 0;
        // psi(r) = k for |r| > k, as a weight on the variance of the whole innovation.
        let limit = if self.options.judge_ranges {
            HUBER_95
        } else {
            f64::INFINITY
        };
        let widen = (nis.sqrt() / limit).max(1.0);
        let r = (own + r) * widen - own;
        let gain = ph / (own + r);
        self.x += gain * innovation;
        // Joseph's form keeps the covariance positive.
        let keep = Matrix6::identity() - gain * h.transpose();
        self.p = keep * self.p * keep.transpose() + gain * gain.transpose() * r;
        (Judgement::Used((r / range.sigma_m.powi(2)).sqrt()), nis)
    }

    /// The state at the time of the last range.
    pub fn state(&self) -> Tracked {
        Tracked {
            t_s: self.t_s,
            position_m: self.x.fixed_rows::<3>(0).into_owned(),
            velocity: self.x.fixed_rows::<3>(3).into_owned(),
            covariance_m2: self.p.fixed_view::<3, 3>(0, 0).into_owned(),
        }
    }

    fn predict(&mut self, t_s: f64) {
        let dt = t_s - self.t_s;
        self.t_s = t_s;
        let mut f = Matrix6::identity();
        let mut q = Matrix6::zeros();
        let density = self.options.acceleration.powi(2);
        let axes = if self.options.height_m.is_some() {
            2
        } else {
            3
        };
        for i in 0..axes {
            f[(i, i + 3)] = dt;
            q[(i, i)] = density * dt.powi(3) / 3.0;
            q[(i, i + 3)] = density * dt.powi(2) / 2.0;
            q[(i + 3, i)] = q[(i, i + 3)];
            q[(i + 3, i + 3)] = density * dt;
        }
        self.x = f * self.x;
        self.p = f * self.p * f.transpose() + q;
    }

    fn open(&mut self, by_m: f64) {
        let axes = if self.options.height_m.is_some() {
            2
        } else {
            3
        };
        for i in 0..axes {
            self.p[(i, i)] += by_m * by_m;
        }
    }
}
