//! One filter: its unknowns, GNSS positions and ranges.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

use super::{Fate, FusionAnchor, TightOptions, UwbRange};
use crate::fusion::inertial::Imu;
use crate::fusion::loose::uere_m;
use crate::fusion::usable;
use crate::fusion::{GnssFix, ImuSample, Navigation, Timing, timing};
use crate::kernel::HUBER_95;
use crate::positioning::sigma_factor;

const G: usize = 9;
pub(super) const ANCHORS: usize = 12;
/// A share of ranges set aside above which the filter itself is doubted; a running mean.
const DOUBT: f64 = 0.7;
/// So long a coarse position waits for enough anchors at once, seconds.
pub(super) const PATIENCE_S: f64 = 0.5;

/// The filter.
#[derive(Debug, Clone)]
pub(super) struct Filter {
    pub(super) options: TightOptions,
    pub(super) state: Imu,
    pub(super) gnss_error: Vector3<f64>,
    gnss_sigma_m: f64,
    pub(super) anchors: Vec<FusionAnchor>,
    /// As they were given.
    pub(super) surveyed: Vec<FusionAnchor>,
    /// When ranges alone were last asked, seconds, and how often in a row they contradicted.
    pub(super) checked_s: f64,
    pub(super) strikes: u32,
    pub(super) coarse_since_s: Option<f64>,
    pub(super) suspect: Vec<bool>,
    /// Of each anchor: time, range, sigma.
    pub(super) last_ranges: Vec<Option<[f64; 3]>>,
    pub(super) set_aside_share: f64,
    pub(super) covariance: DMatrix<f64>,
    refused: u64,
}

impl Filter {
    /// Starts at a place (ENU, metres) with its standard deviation, at rest give or take 1 m/s.
    pub(super) fn new(
        options: TightOptions,
        anchors: &[FusionAnchor],
        t_s: f64,
        position_m: Vector3<f64>,
        sigma_m: f64,
    ) -> Self {
        let n = ANCHORS + 4 * anchors.len();
        let mut covariance = DMatrix::zeros(n, n);
        let gnss_sigma_m = options.gnss_scale * uere_m(2.0) * 2.0 / 3f64.sqrt();
        for i in 0..3 {
            covariance[(i, i)] = sigma_m * sigma_m;
            covariance[(3 + i, 3 + i)] = 1.0;
            covariance[(6 + i, 6 + i)] = options.imu.bias_sigma.powi(2);
            covariance[(G + i, G + i)] = gnss_sigma_m * gnss_sigma_m;
        }
        for (k, anchor) in anchors.iter().enumerate() {
            place_anchor(&mut covariance, k, anchor);
        }
        Self {
            state: Imu::new(options.imu, t_s, position_m, Vector3::zeros(), Vector3::z()),
            gnss_error: Vector3::zeros(),
            gnss_sigma_m,
            suspect: vec![false; anchors.len()],
            last_ranges: vec![None; anchors.len()],
            anchors: anchors.to_vec(),
            surveyed: anchors.to_vec(),
            checked_s: t_s,
            strikes: 0,
            coarse_since_s: None,
            set_aside_share: 0.0,
            covariance,
            options,
            refused: 0,
        }
    }

    /// Takes an inertial reading; false where it is older than the last.
    pub(super) fn on_imu(&mut self, sample: &ImuSample) -> bool {
        let before = self.state.t_s;
        let taken = self
            .state
            .read(sample, &Matrix3::identity(), &mut self.covariance);
        self.fade(self.state.t_s - before);
        self.refused += u64::from(!taken);
        taken
    }

    /// Takes a position from GNSS; the normalised innovation squared and the log-likelihood, `None` where
    /// it cannot be used.
    pub(super) fn on_gnss(&mut self, fix: &GnssFix) -> Option<(f64, f64)> {
        let sound = fix.position_m.iter().all(|v| usable(*v)) && fix.pdop > 0.0 && usable(fix.pdop);
        let Some(age) = self.age(fix.t_s).filter(|_| sound) else {
            self.refused += 1;
            return None;
        };
        self.gnss_sigma_m = self.options.gnss_scale * uere_m(fix.pdop) * fix.pdop / 3f64.sqrt();
        let arm = self.state.attitude() * self.options.arms.gnss_m;
        let (mut nis, mut spread) = (0.0, 1.0);
        let white = self.options.gnss_white_m.powi(2);
        // White noise is the same along all axes: one axis after the other is all at once.
        for i in 0..3 {
            let predicted = (self.state.p + arm - self.state.v * age + self.gnss_error)[i];
            let innovation = fix.position_m[i] - predicted;
            let mut h = DVector::zeros(self.covariance.nrows());
            h[i] = 1.0;
            h[3 + i] = -age;
            h[G + i] = 1.0;
            let ph = &self.covariance * &h;
            let s = h.dot(&ph) + white;
            nis += innovation * innovation / s;
            spread *= s / white;
            self.correct(&ph, s, innovation);
        }
        Some((nis, -0.5 * (nis + f64::ln(spread))))
    }

    /// Takes a range. Returns what became of it and its log-likelihood beside that of a range that was
    /// known beforehand.
    pub(super) fn on_range(&mut self, range: &UwbRange) -> (Fate, f64) {
        let UwbRange {
            t_s,
            anchor,
            range_m,
            ..
        } = *range;
        let (sigma_m, slow2) = self.noise(range);
        let sound = usable(range_m) && sigma_m > 0.0 && usable(sigma_m);
        let age = self.age(t_s).filter(|_| sound);
        let (Some(age), Some(known)) = (age, self.anchors.get(anchor).copied()) else {
            self.refused += 1;
            return (Fate::Refused, 0.0);
        };
        let arm = self.state.attitude() * self.options.arms.uwb_m;
        let away = self.state.p + arm - self.state.v * age - known.position_m;
        let distance = away.norm();
        if distance <= 0.0 {
            self.refused += 1;
            return (Fate::Refused, 0.0);
        }
        let stretch = 1.0 + self.options.slope;
        let line = away / distance;
        let u = line * stretch;
        let at = ANCHORS + 4 * anchor;
        self.remember(anchor, t_s, range_m, sigma_m);
        if self.contradicted(t_s) && self.start_anew(t_s) {
            return (Fate::Together, 0.0);
        }
        if self.coarse() {
            // A first range that is blocked would be believed: wait for company, if there is any.
            let since_s = *self.coarse_since_s.get_or_insert(t_s);
            if self.start_anew(t_s) || t_s - since_s < PATIENCE_S {
                return (Fate::Together, 0.0);
            }
        } else {
            self.coarse_since_s = None;
        }
        let ph = self.project(&u, age, at);
        let own = u.dot(&Vector3::new(ph[0], ph[1], ph[2]))
            - age * u.dot(&Vector3::new(ph[3], ph[4], ph[5]))
            - u.dot(&Vector3::new(ph[at], ph[at + 1], ph[at + 2]))
            + ph[at + 3];
        // Second order: with h'' = (I - l l^T) / |d|, the mean is 1/2 tr(h'' P) longer and the variance
        // 1/2 tr(h'' P h'' P) more. P is that of tag and anchor apart.
        let apart = self.covariance.fixed_view::<3, 3>(0, 0)
            + self.covariance.fixed_view::<3, 3>(at, at)
            - self.covariance.fixed_view::<3, 3>(0, at)
            - self.covariance.fixed_view::<3, 3>(at, 0);
        let bend = (Matrix3::identity() - line * line.transpose()) * apart / distance;
        let innovation = range_m - stretch * (distance + 0.5 * bend.trace()) - known.bias_m;
        let s = own + sigma_m * sigma_m + 0.5 * (bend * bend).trace();
        let nis = innovation * innovation / s;
        // One that is blocked contradicts no more than one that is just set aside.
        let bounded = if self.options.judge_ranges {
            nis.min(self.options.gate)
        } else {
            nis
        };
        let likelihood = -0.5 * (bounded + f64::ln(s / (sigma_m * sigma_m)));
        let mut weighed = false;
        let mut s_used = s;
        if self.options.judge_ranges {
            let suspect = self.suspect.get(anchor).copied().unwrap_or(false);
            let gate = if suspect { 4.0 } else { self.options.gate };
            let aside = nis > gate;
            self.set_aside_share += 0.03 * (f64::from(u8::from(aside)) - self.set_aside_share);
            if let Some(suspect) = self.suspect.get_mut(anchor) {
                *suspect = aside;
            }
            if aside {
                if self.set_aside_share > DOUBT && !self.start_anew(t_s) {
                    self.open(innovation.abs());
                }
                return (Fate::SetAside(nis), likelihood);
            }
            let widen = (nis.sqrt() / HUBER_95).max(1.0);
            weighed = widen > 1.0 || slow2 > 0.0;
            s_used = s * widen + slow2;
        }
        self.correct(&ph, s_used, innovation);
        let fate = if weighed {
            Fate::Weighed(nis)
        } else {
            Fate::Used(nis)
        };
        (fate, likelihood)
    }

    /// The estimate now.
    pub(super) fn navigation(&self) -> Navigation {
        Navigation {
            t_s: self.state.t_s,
            position_m: self.state.p,
            velocity: self.state.v,
            covariance_m2: self.covariance.fixed_view::<3, 3>(0, 0).into_owned(),
            bias_m_s2: self.state.b,
        }
    }

    /// Anchors as they are known now.
    pub(super) fn anchors(&self) -> Vec<FusionAnchor> {
        (self.anchors.iter().enumerate())
            .map(|(k, anchor)| {
                let at = ANCHORS + 4 * k;
                FusionAnchor {
                    covariance_m2: self.covariance.fixed_view::<3, 3>(at, at).into_owned(),
                    bias_sigma_m: self.covariance[(at + 3, at + 3)].max(0.0).sqrt(),
                    position_bias_m2: self.covariance.fixed_view::<3, 1>(at, at + 3).into_owned(),
                    ..*anchor
                }
            })
            .collect()
    }

    /// Readings and measurements that could not be used.
    pub(super) fn refused(&self) -> u64 {
        self.refused
    }

    /// How long ago a measurement was; the state is held until one that is ahead.
    fn age(&mut self, t_s: f64) -> Option<f64> {
        match timing(self.state.t_s, t_s) {
            Timing::Ago(age) => Some(age),
            Timing::Ahead(ahead) => {
                self.state
                    .hold_until(t_s, &Matrix3::identity(), &mut self.covariance);
                self.fade(ahead);
                Some(0.0)
            }
            Timing::Refused => None,
        }
    }

    /// `g' = g e^(-dt/T)`, with noise that keeps its size.
    fn fade(&mut self, dt: f64) {
        if dt <= 0.0 {
            return;
        }
        let keep = (-dt / self.options.gnss_memory_s).exp();
        self.gnss_error *= keep;
        for i in G..G + 3 {
            for k in 0..self.covariance.nrows() {
                self.covariance[(k, i)] *= keep;
            }
            for k in 0..self.covariance.nrows() {
                self.covariance[(i, k)] *= keep;
            }
            self.covariance[(i, i)] += self.gnss_sigma_m.powi(2) * (1.0 - keep * keep);
        }
    }

    /// `P h` for the row `[u, -age u, 0 | 0 | .. -u, 1 ..]` of a range.
    fn project(&self, u: &Vector3<f64>, age: f64, at: usize) -> DVector<f64> {
        let n = self.covariance.nrows();
        let mut ph = DVector::zeros(n);
        for i in 0..3 {
            ph.axpy(u[i], &self.covariance.column(i), 1.0);
            if age > 0.0 {
                ph.axpy(-age * u[i], &self.covariance.column(3 + i), 1.0);
            }
            ph.axpy(-u[i], &self.covariance.column(at + i), 1.0);
        }
        ph.axpy(1.0, &self.covariance.column(at + 3), 1.0);
        ph
    }

    /// One scalar measurement: `x += P h / s nu`, `P -= P h h^T P / s`, symmetric by construction.
    fn correct(&mut self, ph: &DVector<f64>, s: f64, innovation: f64) {
        self.step(ph, innovation / s);
        self.covariance.ger(-1.0 / s, ph, ph, 1.0);
        self.floor();
    }

    /// Moves all unknowns along a direction.
    fn step(&mut self, along: &DVector<f64>, by: f64) {
        let three = |at: usize| Vector3::new(along[at], along[at + 1], along[at + 2]) * by;
        self.state.p += three(0);
        self.state.v += three(3);
        self.state.b += three(6);
        self.gnss_error += three(G);
        for (k, anchor) in self.anchors.iter_mut().enumerate() {
            let at = ANCHORS + 4 * k;
            anchor.position_m += three(at);
            anchor.bias_m += along[at + 3] * by;
        }
    }

    /// Rounding must not make a variance negative.
    fn floor(&mut self) {
        for i in 0..self.covariance.nrows() {
            let diagonal = &mut self.covariance[(i, i)];
            *diagonal = diagonal.max(1e-12);
        }
    }

    /// Standard deviation of a range by its powers (metres); and the variance by which one of many that
    /// are wrong together has to be widened, so that all of them say no more than one (m^2).
    fn noise(&self, range: &UwbRange) -> (f64, f64) {
        let factor = match range.power {
            Some(power) if self.options.judge_ranges => sigma_factor(power),
            _ => 1.0,
        };
        let sigma_m = range.sigma_m * factor;
        let last_s = (self.last_ranges.get(range.anchor).copied().flatten()).map(|[t_s, ..]| t_s);
        let apart_s = last_s.map_or(f64::INFINITY, |last_s| range.t_s - last_s);
        let together = (self.options.blocked_memory_s / apart_s).clamp(1.0, 100.0);
        let blocked2 = sigma_m * sigma_m - range.sigma_m * range.sigma_m;
        (sigma_m, blocked2 * (together - 1.0))
    }

    fn remember(&mut self, anchor: usize, t_s: f64, range_m: f64, sigma_m: f64) {
        if let Some(last) = self.last_ranges.get_mut(anchor) {
            *last = Some([t_s, range_m, sigma_m]);
        }
    }

    /// `x += m d`, `P -= (1 - k^2) d d^T`: a slice of the whole.
    pub(super) fn shift(&mut self, d: &DVector<f64>, m: f64, narrow2: f64) {
        self.step(d, m);
        self.covariance.ger(-(1.0 - narrow2), d, d, 1.0);
        self.floor();
    }

    pub(super) fn forget(&mut self, from: usize, count: usize) {
        for i in from..from + count {
            self.covariance.row_mut(i).fill(0.0);
            self.covariance.column_mut(i).fill(0.0);
        }
    }

    fn open(&mut self, by_m: f64) {
        self.set_aside_share = 0.0;
        for i in 0..3 {
            self.covariance[(i, i)] += by_m * by_m;
            self.covariance[(3 + i, 3 + i)] += 1.0;
        }
        self.suspect.fill(false);
    }
}

pub(super) fn place_anchor(covariance: &mut DMatrix<f64>, number: usize, anchor: &FusionAnchor) {
    let at = ANCHORS + 4 * number;
    (covariance.view_mut((at, at), (3, 3))).copy_from(&anchor.covariance_m2);
    for i in 0..3 {
        covariance[(at + i, at + 3)] = anchor.position_bias_m2[i];
        covariance[(at + 3, at + i)] = anchor.position_bias_m2[i];
    }
    covariance[(at + 3, at + 3)] = anchor.bias_sigma_m.powi(2);
}
