//! Loosely coupled, as in the paper: positions of GNSS and of UWB are the measurements.
//!
//! State and covariance in ECEF (Eq. 23). A position `z` (Eq. 28) is compared with the state's (Eq. 29,
//! 30); its noise is `sigma_UERE^2 PDOP^2 / 3` along each axis for GNSS, `sigma_UERE^2` for UWB:
//!
//! | PDOP | > 5 | > 3 | <= 3 | UWB |
//! |---|---|---|---|---|
//! | sigma_UERE (m) | 15 | 10 | 8 | 0.1 |
//!
//! The paper says that GNSS noise depends on UERE and DOP, not how; the above is the usual reading.

use nalgebra::{DMatrix, Matrix3, SMatrix, Vector3};

use super::inertial::{Imu, ImuNoise};
use super::{GnssFix, ImuSample, LeverArms, Navigation, Timing, timing};
use crate::geodesy::LocalFrame;

/// How to fuse positions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LooseOptions {
    /// The inertial sensor.
    pub imu: ImuNoise,
    /// Antennas.
    pub arms: LeverArms,
    /// Standard deviation of UWB's positions along each axis, metres.
    pub uwb_uere_m: f64,
}

impl Default for LooseOptions {
    fn default() -> Self {
        Self {
            imu: ImuNoise::default(),
            arms: LeverArms::default(),
            uwb_uere_m: 0.1,
        }
    }
}

/// User equivalent range error of GNSS by PDOP, metres: Table 1.
pub fn uere_m(pdop: f64) -> f64 {
    if pdop > 5.0 {
        15.0
    } else if pdop > 3.0 {
        10.0
    } else {
        8.0
    }
}

/// The filter.
#[derive(Debug, Clone)]
pub struct Loose {
    options: LooseOptions,
    frame: LocalFrame,
    state: Imu,
    covariance: DMatrix<f64>,
    refused: u64,
}

impl Loose {
    /// Starts at a place (ENU, metres) with its standard deviation, at rest give or take 1 m/s.
    pub fn new(
        options: LooseOptions,
        frame: LocalFrame,
        t_s: f64,
        position_m: Vector3<f64>,
        sigma_m: f64,
    ) -> Self {
        let up = frame.ecef_from_enu() * Vector3::z();
        let state = Imu::new(
            options.imu,
            t_s,
            frame.ecef_m(&position_m),
            Vector3::zeros(),
            up,
        );
        let mut covariance = DMatrix::zeros(9, 9);
        for i in 0..3 {
            covariance[(i, i)] = sigma_m * sigma_m;
            covariance[(3 + i, 3 + i)] = 1.0;
            covariance[(6 + i, 6 + i)] = options.imu.bias_sigma.powi(2);
        }
        Self {
            options,
            frame,
            state,
            covariance,
            refused: 0,
        }
    }

    /// Takes an inertial reading; false where it is older than the last.
    pub fn on_imu(&mut self, sample: &ImuSample) -> bool {
        let taken = self
            .state
            .read(sample, self.frame.ecef_from_enu(), &mut self.covariance);
        self.refused += u64::from(!taken);
        taken
    }

    /// Takes a position from GNSS. Returns the normalised innovation squared; `None` where its time or
    /// numbers cannot be used.
    pub fn on_gnss(&mut self, fix: &GnssFix) -> Option<f64> {
        if !(fix.pdop > 0.0 && fix.pdop.is_finite()) {
            self.refused += 1;
            return None;
        }
        let sigma = uere_m(fix.pdop) * fix.pdop / 3f64.sqrt();
        self.on_position(fix.t_s, fix.position_m, sigma, self.options.arms.gnss_m)
    }

    /// Takes a position from UWB, likewise.
    pub fn on_uwb(&mut self, t_s: f64, position_m: Vector3<f64>) -> Option<f64> {
        self.on_position(
            t_s,
            position_m,
            self.options.uwb_uere_m,
            self.options.arms.uwb_m,
        )
    }

    fn on_position(
        &mut self,
        t_s: f64,
        position_m: Vector3<f64>,
        sigma: f64,
        arm: Vector3<f64>,
    ) -> Option<f64> {
        let age = match timing(self.state.t_s, t_s) {
            Timing::Ago(age) if position_m.iter().all(|v| v.is_finite()) => age,
            Timing::Ahead(_) if position_m.iter().all(|v| v.is_finite()) => {
                let turn = *self.frame.ecef_from_enu();
                self.state.hold_until(t_s, &turn, &mut self.covariance);
                0.0
            }
            _ => {
                self.refused += 1;
                return None;
            }
        };
        let arm = self.frame.ecef_from_enu() * (self.state.attitude() * arm);
        let predicted = self.state.p + arm - self.state.v * age;
        let innovation = self.frame.ecef_m(&position_m) - predicted;
        let mut h = SMatrix::<f64, 3, 9>::zeros();
        for i in 0..3 {
            h[(i, i)] = 1.0;
            h[(i, 3 + i)] = -age;
        }
        let p: SMatrix<f64, 9, 9> = self.covariance.fixed_view::<9, 9>(0, 0).into_owned();
        let r = Matrix3::identity() * (sigma * sigma);
        let s = h * p * h.transpose() + r;
        let inverse = s.cholesky()?.inverse();
        let gain = p * h.transpose() * inverse;
        let step = gain * innovation;
        self.state.p += step.fixed_rows::<3>(0);
        self.state.v += step.fixed_rows::<3>(3);
        self.state.b += step.fixed_rows::<3>(6);
        let keep = SMatrix::<f64, 9, 9>::identity() - gain * h;
        let next = keep * p * keep.transpose() + gain * r * gain.transpose();
        self.covariance
            .copy_from(&((next + next.transpose()) * 0.5));
        Some(innovation.dot(&(inverse * innovation)))
    }

    /// The estimate now, in ENU.
    pub fn navigation(&self) -> Navigation {
        let turn = self.frame.ecef_from_enu();
        let covariance: Matrix3<f64> = self.covariance.fixed_view::<3, 3>(0, 0).into_owned();
        Navigation {
            t_s: self.state.t_s,
            position_m: self.frame.enu_m(&self.state.p),
            velocity: turn.tr_mul(&self.state.v),
            covariance_m2: turn.transpose() * covariance * turn,
            bias_m_s2: self.state.b,
        }
    }

    /// Readings and positions that could not be used.
    pub fn refused(&self) -> u64 {
        self.refused
    }
}
