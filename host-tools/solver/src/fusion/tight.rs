//! Tightly coupled: every range by itself, and what is not quite known among the unknowns.
//!
//! ```text
//! x = [p v b | g | a_1 c_1 | a_2 c_2 | ...]           9 + 3 + 4 n unknowns, local ENU
//!
//! GNSS   z = p + R l_g + g + noise                    g: first-order Gauss-Markov, multipath and delays
//! range  z = (1 + s) |p + R l_u - a_i| + c_i + noise  c_i: bias of anchor i
//! ```
//!
//! - `g` has the size that UERE and PDOP promise and hangs together over `gnss_memory_s`. The paper's
//!   filter takes each GNSS position for a fresh sample, and so believes a hundred wrong ones that agree.
//!   While UWB is at hand `g` is learnt; when UWB ends, the correction lives on and fades.
//! - Anchors start where the survey has them, with its covariance, and are known better as ranges come in.
//! - **Blocked ranges, live.** First the powers: a weak first path widens sigma
//!   ([`sigma_factor`](crate::positioning::sigma_factor)). Then the innovation: `NIS = nu^2 / S` beyond
//!   the gate sets the range aside; from Huber's limit on it is weighed down. A blocked anchor stays
//!   blocked for a while, so one that was set aside has to agree within two sigmas before it is believed
//!   again. If most ranges of a while are set aside, it is the filter that is wrong.
//! - **The other side.** Anchors at nearly one height see a mirror image below them. Twice a second five
//!   or more anchors are asked where the vehicle is, by themselves; three contradictions in a row, and
//!   the filter starts anew from their answer.
//! - **Far from linear.** After minutes of GNSS alone the position is known to ten metres, and a range
//!   to an anchor thirty metres away bends over that. Its mean and variance are then taken to second
//!   order, and as soon as five anchors are heard their ranges are solved together
//!   ([`locate`]) for a position, which is linear. The same happens when the
//!   filter has been found to be wrong.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

use super::inertial::{Imu, ImuNoise};
use super::loose::uere_m;
use super::{GnssFix, ImuSample, LeverArms, Navigation, Timing, timing};
use crate::kernel::HUBER_95;
use crate::multilateration::MultilaterationOptions;
use crate::positioning::{AnchorRange, locate};

/// An anchor as the survey has it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FusionAnchor {
    /// Local ENU frame, metres.
    pub position_m: Vector3<f64>,
    /// Square metres.
    pub covariance_m2: Matrix3<f64>,
    /// What its ranges read too long, metres.
    pub bias_m: f64,
    /// Standard deviation of that, metres.
    pub bias_sigma_m: f64,
    /// Covariance of the coordinates with the bias, square metres. An anchor surveyed from one side is
    /// further away or reads longer: which, nobody knows, but only one of the two.
    pub position_bias_m2: Vector3<f64>,
}

/// How to fuse ranges.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TightOptions {
    /// The inertial sensor.
    pub imu: ImuNoise,
    /// Antennas.
    pub arms: LeverArms,
    /// White part of a GNSS position along each axis, metres.
    pub gnss_white_m: f64,
    /// Time over which the rest of its error hangs together, seconds.
    pub gnss_memory_s: f64,
    /// Size of the rest in units of `uere(PDOP) PDOP / sqrt(3)`.
    pub gnss_scale: f64,
    /// Slope of ranges, metres per metre.
    pub slope: f64,
    /// NIS beyond which a range is set aside.
    pub gate: f64,
    /// False to take every range as it is.
    pub judge_ranges: bool,
}

impl Default for TightOptions {
    fn default() -> Self {
        Self {
            imu: ImuNoise::default(),
            arms: LeverArms::default(),
            gnss_white_m: 1.0,
            gnss_memory_s: 20.0,
            gnss_scale: 0.6,
            slope: 0.0,
            gate: 10.83, // 99.9 % of chi-square with one degree of freedom
            judge_ranges: true,
        }
    }
}

/// What became of a range.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fate {
    /// Used, with this NIS.
    Used(f64),
    /// Weighed down, with this NIS.
    Weighed(f64),
    /// Set aside as blocked, with this NIS.
    SetAside(f64),
    /// Kept, to be solved together with those of other anchors.
    Together,
    /// Its anchor, time or numbers cannot be used.
    Refused,
}

const G: usize = 9;
const ANCHORS: usize = 12;
/// A share of ranges set aside above which the filter itself is doubted; a running mean.
const DOUBT: f64 = 0.7;
/// With a standard deviation beyond this the position is too coarse for single ranges, metres.
const COARSE_M: f64 = 2.0;
/// So long a coarse position waits for enough anchors at once, seconds.
const PATIENCE_S: f64 = 0.5;
/// Ranges this old are solved together with new ones, seconds.
const TOGETHER_S: f64 = 0.15;

/// The filter.
#[derive(Debug, Clone)]
pub struct Tight {
    options: TightOptions,
    state: Imu,
    gnss_error: Vector3<f64>,
    gnss_sigma_m: f64,
    anchors: Vec<FusionAnchor>,
    /// As they were given.
    surveyed: Vec<FusionAnchor>,
    /// When ranges alone were last asked, seconds, and how often in a row they contradicted.
    checked_s: f64,
    strikes: u32,
    coarse_since_s: Option<f64>,
    suspect: Vec<bool>,
    /// Of each anchor: time, range, sigma.
    last_ranges: Vec<Option<[f64; 3]>>,
    set_aside_share: f64,
    covariance: DMatrix<f64>,
    refused: u64,
}

impl Tight {
    /// Starts at a place (ENU, metres) with its standard deviation, at rest give or take 1 m/s.
    pub fn new(
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
    pub fn on_imu(&mut self, sample: &ImuSample) -> bool {
        let before = self.state.t_s;
        let taken = self
            .state
            .read(sample, &Matrix3::identity(), &mut self.covariance);
        self.fade(self.state.t_s - before);
        self.refused += u64::from(!taken);
        taken
    }

    /// Takes a position from GNSS; the normalised innovation squared, `None` where it cannot be used.
    pub fn on_gnss(&mut self, fix: &GnssFix) -> Option<f64> {
        let sound =
            fix.position_m.iter().all(|v| v.is_finite()) && fix.pdop > 0.0 && fix.pdop.is_finite();
        let Some(age) = self.age(fix.t_s).filter(|_| sound) else {
            self.refused += 1;
            return None;
        };
        self.gnss_sigma_m = self.options.gnss_scale * uere_m(fix.pdop) * fix.pdop / 3f64.sqrt();
        let arm = self.state.attitude() * self.options.arms.gnss_m;
        let mut nis = 0.0;
        // White noise is the same along all axes: one axis after the other is all at once.
        for i in 0..3 {
            let predicted = (self.state.p + arm - self.state.v * age + self.gnss_error)[i];
            let innovation = fix.position_m[i] - predicted;
            let mut h = DVector::zeros(self.covariance.nrows());
            h[i] = 1.0;
            h[3 + i] = -age;
            h[G + i] = 1.0;
            let ph = &self.covariance * &h;
            let s = h.dot(&ph) + self.options.gnss_white_m.powi(2);
            nis += innovation * innovation / s;
            self.correct(&ph, s, innovation);
        }
        Some(nis)
    }

    /// Takes a range to the anchor of this number, with its standard deviation (metres).
    pub fn on_range(&mut self, t_s: f64, anchor: usize, range_m: f64, sigma_m: f64) -> Fate {
        let sound = range_m.is_finite() && sigma_m > 0.0 && sigma_m.is_finite();
        let age = self.age(t_s).filter(|_| sound);
        let (Some(age), Some(known)) = (age, self.anchors.get(anchor).copied()) else {
            self.refused += 1;
            return Fate::Refused;
        };
        let arm = self.state.attitude() * self.options.arms.uwb_m;
        let away = self.state.p + arm - self.state.v * age - known.position_m;
        let distance = away.norm();
        if distance <= 0.0 {
            self.refused += 1;
            return Fate::Refused;
        }
        let stretch = 1.0 + self.options.slope;
        let line = away / distance;
        let u = line * stretch;
        let at = ANCHORS + 4 * anchor;
        self.remember(anchor, t_s, range_m, sigma_m);
        if self.contradicted(t_s) && self.start_anew(t_s) {
            return Fate::Together;
        }
        if self.coarse() {
            // A first range that is blocked would be believed: wait for company, if there is any.
            let since_s = *self.coarse_since_s.get_or_insert(t_s);
            if self.start_anew(t_s) || t_s - since_s < PATIENCE_S {
                return Fate::Together;
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
                return Fate::SetAside(nis);
            }
            let widen = (nis.sqrt() / HUBER_95).max(1.0);
            weighed = widen > 1.0;
            s_used = s * widen;
        }
        self.correct(&ph, s_used, innovation);
        if weighed {
            Fate::Weighed(nis)
        } else {
            Fate::Used(nis)
        }
    }

    /// The estimate now.
    pub fn navigation(&self) -> Navigation {
        Navigation {
            t_s: self.state.t_s,
            position_m: self.state.p,
            velocity: self.state.v,
            covariance_m2: self.covariance.fixed_view::<3, 3>(0, 0).into_owned(),
            bias_m_s2: self.state.b,
        }
    }

    /// Anchors as they are known now.
    pub fn anchors(&self) -> Vec<FusionAnchor> {
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
    pub fn refused(&self) -> u64 {
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
        let pull = innovation / s;
        let three = |at: usize| Vector3::new(ph[at], ph[at + 1], ph[at + 2]) * pull;
        self.state.p += three(0);
        self.state.v += three(3);
        self.state.b += three(6);
        self.gnss_error += three(G);
        for (k, anchor) in self.anchors.iter_mut().enumerate() {
            let at = ANCHORS + 4 * k;
            anchor.position_m += three(at);
            anchor.bias_m += ph[at + 3] * pull;
        }
        self.covariance.ger(-1.0 / s, ph, ph, 1.0);
        // Rounding must not make a variance negative.
        for i in 0..self.covariance.nrows() {
            let diagonal = &mut self.covariance[(i, i)];
            *diagonal = diagonal.max(1e-12);
        }
    }

    fn remember(&mut self, anchor: usize, t_s: f64, range_m: f64, sigma_m: f64) {
        if let Some(last) = self.last_ranges.get_mut(anchor) {
            *last = Some([t_s, range_m, sigma_m]);
        }
    }

    fn coarse(&self) -> bool {
        let variance: f64 = (0..3).map(|i| self.covariance[(i, i)]).sum();
        variance > COARSE_M * COARSE_M
    }

    /// The position that the last ranges of five anchors or more agree on, its covariance, and whether no
    /// other disagrees, from the anchors as they were surveyed: independent of the filter but for its velocity over a moment.
    fn alone(&self, t_s: f64) -> Option<(Vector3<f64>, Matrix3<f64>, bool)> {
        // Of four, one that is blocked does not show.
        const AT_LEAST: usize = 5;
        let velocity = self.state.v;
        let ranges: Vec<AnchorRange> = (self.last_ranges.iter().zip(&self.surveyed))
            .filter_map(|(last, known)| {
                let [then_s, range_m, sigma_m] = (*last)?;
                let age = t_s - then_s;
                (age.abs() <= TOGETHER_S).then_some(AnchorRange {
                    // As if the anchor had moved instead of the vehicle.
                    anchor_m: known.position_m + velocity * age,
                    range_m: (range_m - known.bias_m) / (1.0 + self.options.slope),
                    sigma_m,
                })
            })
            .collect();
        if ranges.len() < AT_LEAST {
            return None;
        }
        let found = locate(&ranges, &MultilaterationOptions::default())
            .ok()?
            .found;
        let sharp = found.covariance_m2.trace() < COARSE_M * COARSE_M;
        let arm = self.state.attitude() * self.options.arms.uwb_m;
        (found.observable() && found.used >= AT_LEAST && sharp).then_some((
            found.position_m - arm,
            found.covariance_m2,
            found.rejected == 0,
        ))
    }

    /// Whether five anchors or more have by themselves said three times that the vehicle is elsewhere: on
    /// the other side of the anchors' plane, as a rule.
    fn contradicted(&mut self, t_s: f64) -> bool {
        const EVERY_S: f64 = 0.5;
        const STRIKES: u32 = 3;
        /// 99.9 % of chi-square with three degrees of freedom.
        const APART: f64 = 16.27;
        if t_s - self.checked_s < EVERY_S {
            return false;
        }
        let Some((place, covariance, _)) = self.alone(t_s) else {
            return false;
        };
        self.checked_s = t_s;
        let apart = place - self.state.p;
        let own = self.covariance.fixed_view::<3, 3>(0, 0).into_owned();
        let s = own + covariance + Matrix3::identity() * 0.1;
        let beyond = (s.cholesky()).is_some_and(|s| apart.dot(&s.solve(&apart)) > APART);
        self.strikes = if beyond { self.strikes + 1 } else { 0 };
        self.strikes >= STRIKES
    }

    /// Takes the position from the last ranges of five anchors or more, where they agree on one, and the
    /// anchors as they were surveyed.
    fn start_anew(&mut self, t_s: f64) -> bool {
        let Some((place, covariance, agreed)) = self.alone(t_s) else {
            return false;
        };
        self.state.p = place;
        self.forget(0, 3);
        let speed2 = self.state.v.norm_squared() * TOGETHER_S * TOGETHER_S;
        // Five that agree while the sixth does not may be the wrong five.
        let doubt2 = if agreed { 0.01 } else { 1.0 };
        let around = covariance + Matrix3::identity() * (doubt2 + speed2);
        self.covariance.view_mut((0, 0), (3, 3)).copy_from(&around);
        for i in 3..6 {
            self.covariance[(i, i)] += 1.0;
        }
        self.forget(ANCHORS, self.covariance.nrows() - ANCHORS);
        self.anchors.copy_from_slice(&self.surveyed);
        for (k, anchor) in self.surveyed.iter().enumerate() {
            place_anchor(&mut self.covariance, k, anchor);
        }
        self.last_ranges.fill(None);
        self.suspect.fill(false);
        self.set_aside_share = 0.0;
        self.strikes = 0;
        true
    }

    fn forget(&mut self, from: usize, count: usize) {
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

fn place_anchor(covariance: &mut DMatrix<f64>, number: usize, anchor: &FusionAnchor) {
    let at = ANCHORS + 4 * number;
    (covariance.view_mut((at, at), (3, 3))).copy_from(&anchor.covariance_m2);
    for i in 0..3 {
        covariance[(at + i, at + 3)] = anchor.position_bias_m2[i];
        covariance[(at + 3, at + i)] = anchor.position_bias_m2[i];
    }
    covariance[(at + 3, at + 3)] = anchor.bias_sigma_m.powi(2);
}
