//! An extended Kalman filter of a listener's place and velocity from rounds of differences.
//!
//! ```text
//! x = [p v o_1 .. o_m],  p' = v,  v' = white noise of density q,  o_i' = -o_i / T + noise, N(0, tau^2)
//! z_k = |p_k - b| - |p_k - a| + o_b - o_a + noise,   p_k = p + v (t_k - t)
//! H_k = [w  w (t_k - t) | .. -1 at a, +1 at b ..]     w = (p_k - b) / |p_k - b| - (p_k - a) / |p_k - a|
//! R = diag(own^2) + sum s s^T                          s: what the round's poll and final bring into all
//! ```
//!
//! All differences of a round are taken together, with what their errors have in common. `o_i` is what an
//! anchor is off by (antenna delays, places, levels); without it a filter that hears a hundred rounds a second
//! would soon believe millimetres. It wanders (a Gauss-Markov process over `T`): as a constant it would be
//! learnt from what else is off by centimetres and changes with the place, and in weak geometry take
//! the height with it.
//!
//! A difference whose innovation is beyond the gate is set aside, one within but further out than Huber's
//! limit gets its sigma widened. After `patience` rounds in a row of which half or less fits it is the filter
//! that is wrong: its place is opened by what they say, and offsets are forgotten. The update is iterated
//! (Gauss-Newton about the prediction), since a wide open place lies metres from where hyperbolas are
//! straight.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

use super::Tracked;
use super::listening::{ListenedDifference, ListenedRound};
use super::tdoa::misfit;
use crate::kernel::HUBER_95;
use crate::measurement::LARGEST_LENGTH_M;

/// Offsets of so many anchors are kept; differences of further ones are refused.
const MOST_ANCHORS: usize = 64;
/// After longer gaps begin anew; what comes later than this is refused, seconds.
const LONGEST_GAP_S: f64 = 1e4;
/// Linearisations of an update, and the step that ends them, metres.
const ROUNDS: usize = 8;
const SETTLED_M: f64 = 1e-4;

/// How to filter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DifferenceFilterOptions {
    /// Root of the spectral density of acceleration, m/s^1.5 (per axis).
    pub acceleration: f64,
    /// Standard deviation that anchors' offsets are expected to have, metres; see
    /// [`TdoaOptions::offset_sigma_m`](super::TdoaOptions::offset_sigma_m).
    pub offset_sigma_m: f64,
    /// Time over which they wander, seconds.
    pub offset_memory_s: f64,
    /// Normalised innovation squared beyond which a difference is set aside.
    pub gate: f64,
    /// So many rounds in a row of which half or less fits, and the filter is opened.
    pub patience: u32,
}

impl Default for DifferenceFilterOptions {
    fn default() -> Self {
        Self {
            acceleration: 0.5,
            offset_sigma_m: 0.1,
            offset_memory_s: 10.0,
            gate: 10.83, // 99.9 % of chi-square with one degree of freedom
            patience: 20,
        }
    }
}

/// What became of a round's differences.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct RoundJudgement {
    /// Taken in.
    pub used: usize,
    /// Beyond the gate.
    pub set_aside: usize,
    /// Older than the filter, not a number, or of too many anchors.
    pub refused: usize,
    /// Normalised innovation squared of those taken in, together; as many degrees of freedom as were used.
    pub nis: f64,
}

/// The filter.
#[derive(Debug, Clone)]
pub struct DifferenceFilter {
    options: DifferenceFilterOptions,
    t_s: f64,
    x: DVector<f64>,
    p: DMatrix<f64>,
    /// Addresses of the anchors, in the order of their offsets.
    anchors: Vec<u16>,
    misfitting: u32,
}

/// A difference within the gate.
struct Fitting<'a> {
    of: &'a ListenedDifference,
    /// What Huber's limit adds to its variance.
    extra_m2: f64,
}

impl DifferenceFilter {
    /// Starts at a place with standard deviations of position (m) and velocity (m/s).
    pub fn new(
        options: DifferenceFilterOptions,
        t_s: f64,
        position_m: Vector3<f64>,
        covariance_m2: &Matrix3<f64>,
        speed_sigma: f64,
    ) -> Self {
        let mut x = DVector::zeros(6);
        x.fixed_rows_mut::<3>(0).copy_from(&position_m);
        let mut p = DMatrix::zeros(6, 6);
        p.fixed_view_mut::<3, 3>(0, 0).copy_from(covariance_m2);
        for i in 3..6 {
            p[(i, i)] = speed_sigma.powi(2);
        }
        Self {
            options,
            t_s,
            x,
            p,
            anchors: Vec::new(),
            misfitting: 0,
        }
    }

    /// Takes the differences of one round.
    pub fn update(&mut self, round: &ListenedRound) -> RoundJudgement {
        let mut judged = RoundJudgement::default();
        let mut sound: Vec<&ListenedDifference> = Vec::with_capacity(round.differences.len());
        for one in &round.differences {
            let in_time = (0.0..=LONGEST_GAP_S).contains(&(one.t_s - self.t_s));
            if is_sound(one) && in_time && self.knows(one.addresses) {
                sound.push(one);
            } else {
                judged.refused += 1;
            }
        }
        let Some(t_s) = sound.iter().map(|one| one.t_s).reduce(f64::max) else {
            return judged;
        };
        self.predict(t_s);
        let count = sound.len();
        let mut fitting: Vec<Fitting<'_>> = Vec::with_capacity(count);
        let mut off_m: Vec<f64> = Vec::with_capacity(count);
        for of in sound {
            let (h, innovation) = self.linearise(of, &self.x);
            let own = h.dot(&(&self.p * &h)).max(0.0);
            let variance = own + of.difference.sigma_m.powi(2);
            let nis = innovation.powi(2) / variance;
            off_m.push(innovation.abs());
            if nis <= self.options.gate {
                // psi(r) = k for |r| > k, as more variance of its own.
                let wider = (nis.sqrt() / HUBER_95).max(1.0);
                let extra_m2 = variance * (wider - 1.0);
                fitting.push(Fitting { of, extra_m2 });
            }
        }
        if 2 * fitting.len() <= count {
            self.misfitting += 1;
            if self.misfitting >= self.options.patience {
                self.misfitting = 0;
                off_m.sort_by(f64::total_cmp);
                self.open(off_m.get(count / 2).copied().unwrap_or(0.0));
                fitting.clear();
            }
        } else {
            self.misfitting = 0;
        }
        if let Some(nis) = self.take(&fitting) {
            judged.used = fitting.len();
            judged.nis = nis;
        }
        judged.set_aside = count - judged.used;
        judged
    }

    /// The state at the time of the last round.
    pub fn state(&self) -> Tracked {
        Tracked {
            t_s: self.t_s,
            position_m: self.x.fixed_rows::<3>(0).into_owned(),
            velocity: self.x.fixed_rows::<3>(3).into_owned(),
            covariance_m2: self.p.fixed_view::<3, 3>(0, 0).into_owned(),
        }
    }

    /// Whether both anchors are known, or could be taken in.
    fn knows(&mut self, addresses: [u16; 2]) -> bool {
        for address in addresses {
            if self.anchors.contains(&address) {
                continue;
            }
            if self.anchors.len() >= MOST_ANCHORS {
                return false;
            }
            let n = self.x.len();
            self.anchors.push(address);
            self.x = std::mem::replace(&mut self.x, DVector::zeros(0)).push(0.0);
            let p = std::mem::replace(&mut self.p, DMatrix::zeros(0, 0));
            self.p = p.resize(n + 1, n + 1, 0.0);
            self.p[(n, n)] = self.options.offset_sigma_m.powi(2);
        }
        true
    }

    fn column(&self, address: u16) -> Option<usize> {
        (self.anchors.iter().position(|a| *a == address)).map(|i| 6 + i)
    }

    /// Gradient and innovation of a difference about `x`.
    fn linearise(&self, of: &ListenedDifference, x: &DVector<f64>) -> (DVector<f64>, f64) {
        let before_s = of.t_s - self.t_s;
        let place = x.fixed_rows::<3>(0) + x.fixed_rows::<3>(3) * before_s;
        let (misfit_m, w) = misfit(&of.difference, &place);
        let mut h = DVector::zeros(x.len());
        h.fixed_rows_mut::<3>(0).copy_from(&w);
        h.fixed_rows_mut::<3>(3).copy_from(&(w * before_s));
        let mut innovation = -misfit_m;
        for (address, sign) in of.addresses.into_iter().zip([-1.0, 1.0]) {
            if let Some(column) = self.column(address) {
                h[column] += sign;
                innovation -= sign * x[column];
            }
        }
        (h, innovation)
    }

    /// Joint update; the normalised innovation squared. `None` where there is nothing, or numbers have run out.
    fn take(&mut self, fitting: &[Fitting<'_>]) -> Option<f64> {
        let (n, m) = (self.x.len(), fitting.len());
        if m == 0 {
            return None;
        }
        let shared = DMatrix::from_fn(m, 2, |i, k| {
            fitting.get(i).map_or(0.0, |one| one.of.shared_m[k])
        });
        let mut r = &shared * shared.transpose();
        for (i, one) in fitting.iter().enumerate() {
            r[(i, i)] = one.of.difference.sigma_m.powi(2) + one.extra_m2;
        }
        let mut about = self.x.clone();
        let mut last = None;
        for _ in 0..ROUNDS {
            let (mut h, mut nu) = (DMatrix::zeros(m, n), DVector::zeros(m));
            for (i, one) in fitting.iter().enumerate() {
                let (gradient, innovation) = self.linearise(one.of, &about);
                // What the prediction would have been short of in this linearisation.
                nu[i] = innovation + gradient.dot(&(&about - &self.x));
                h.set_row(i, &gradient.transpose());
            }
            let ph = &self.p * h.transpose();
            let s = (&h * &ph + &r).cholesky()?;
            let gain = s.solve(&ph.transpose()).transpose();
            let next = &self.x + &gain * &nu;
            if !next.iter().all(|v| v.abs() <= LARGEST_LENGTH_M) {
                return None;
            }
            let step = (&next - &about).amax();
            about = next;
            last = Some((h, gain, nu.dot(&s.solve(&nu))));
            if step < SETTLED_M {
                break;
            }
        }
        let (h, gain, nis) = last?;
        self.x = about;
        // Joseph's form keeps the covariance positive.
        let keep = DMatrix::identity(n, n) - &gain * h;
        self.p = &keep * &self.p * keep.transpose() + &gain * r * gain.transpose();
        Some(nis)
    }

    /// Makes the place doubtful by so much, and forgets the offsets.
    fn open(&mut self, by_m: f64) {
        let n = self.x.len();
        for i in 6..n {
            self.x[i] = 0.0;
            self.p.row_mut(i).fill(0.0);
            self.p.column_mut(i).fill(0.0);
            self.p[(i, i)] = self.options.offset_sigma_m.powi(2);
        }
        for i in 0..3 {
            self.p[(i, i)] += by_m.min(LARGEST_LENGTH_M.sqrt()).powi(2);
        }
    }

    fn predict(&mut self, t_s: f64) {
        let dt = t_s - self.t_s;
        self.t_s = t_s;
        let mut f = DMatrix::identity(self.x.len(), self.x.len());
        for i in 0..3 {
            f[(i, i + 3)] = dt;
        }
        let keeps = (-dt / self.options.offset_memory_s).exp();
        for i in 6..self.x.len() {
            f[(i, i)] = keeps;
        }
        self.x = &f * &self.x;
        self.p = &f * &self.p * f.transpose();
        let fresh_m2 = self.options.offset_sigma_m.powi(2) * (1.0 - keeps * keeps);
        for i in 6..self.x.len() {
            self.p[(i, i)] += fresh_m2;
        }
        let density = self.options.acceleration.powi(2);
        for i in 0..3 {
            self.p[(i, i)] += density * dt.powi(3) / 3.0;
            self.p[(i, i + 3)] += density * dt.powi(2) / 2.0;
            self.p[(i + 3, i)] += density * dt.powi(2) / 2.0;
            self.p[(i + 3, i + 3)] += density * dt;
        }
    }
}

fn is_sound(one: &ListenedDifference) -> bool {
    let d = &one.difference;
    let length = |v: f64| v.abs() <= LARGEST_LENGTH_M;
    let shared: f64 = one.shared_m.iter().map(|v| v * v).sum();
    one.t_s.is_finite()
        && d.anchors_m.iter().flatten().all(|v| length(*v))
        && length(d.difference_m)
        && d.sigma_m > 0.0
        && length(d.sigma_m)
        && shared <= d.sigma_m.powi(2) * (1.0 + 1e-9)
}
