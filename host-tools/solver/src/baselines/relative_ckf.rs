//! RP: the relative position by an adaptive cubature Kalman filter.

use std::collections::VecDeque;

use nalgebra::{SMatrix, SVector, Vector3};

use super::agreement::Agreement;
use super::cubature::CubatureFilter;
use super::homing::Homing;
use crate::ins_error::InsNoise;
use crate::navigation::{
    Command, Estimate, FirstGuess, InputFault, InputGate, InsSample, Navigator, Phase, RangeSample,
};

/// Time over which a change of distance is taken, seconds.
const CHANGE_S: f64 = 1.0;
/// Shortest change worth comparing, seconds.
const LEAST_CHANGE_S: f64 = 0.5;
/// Ranges remembered for that: a second of them at up to this rate.
const REMEMBERED: usize = 64;

/// Settings of [`RelativeCkf`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RelativeCkfOptions {
    /// Standard deviation of dead reckoning's velocity at the start, each horizontal axis, m/s.
    pub velocity_sigma_m_s: f64,
    /// White noise of the accelerometer, m/s/sqrt(s).
    pub velocity_random_walk: f64,
    /// Barometer drift, m/sqrt(s).
    pub height_random_walk: f64,
    /// Standard deviation of a range to begin with, metres.
    pub range_sigma_m: f64,
    /// Bounds of the adapted one, metres.
    pub range_sigma_bounds_m: [f64; 2],
    /// Forgetting factor of the adaptation, below 1.
    pub forgetting: f64,
    /// Least cosine between measured and predicted changes of distance at which a range is used.
    pub least_cosine: f64,
}

impl Default for RelativeCkfOptions {
    /// Sensors of the class that the paper's Table III describes; a memory of about 5 s.
    fn default() -> Self {
        Self {
            velocity_sigma_m_s: 0.02,
            velocity_random_walk: 0.01,
            height_random_walk: 0.01,
            range_sigma_m: 0.1,
            range_sigma_bounds_m: [0.03, 1.0],
            forgetting: 0.98,
            least_cosine: 0.8,
        }
    }
}

/// A cubature Kalman filter of the tag's position relative to the vehicle and of dead reckoning's
/// velocity error.
///
/// *Stated* (see [`super`]): a CKF fed by IMU and UWB, adaptive to variable noise; a reliability by
/// cosine similarity that decides whether a range is used and nothing else; perfect start for RP,
/// erroneous first guess for RP-Error. *Chosen*:
/// - State: the tag as dead reckoning sees it, `s = tag + p` (3; minus the reading of dead reckoning
///   it is the relative position), and the velocity error (2) that makes it drift.
/// - Noise of the ranges after Sage and Husa ("Adaptive filtering with unknown prior statistics",
///   1969), with innovation `e` and its variance `v` from the state:
///   `R <- (1 - d) R + d (e^2 - v)`, `d = (1 - b) / (1 - b^(k+1))`, kept within bounds.
/// - Reliability: the cosine between the last ten measured and predicted changes of distance over
///   one second, with the noise of ranges allowed for (`agreement.rs`).
///
/// RP-Error is the same filter with another start; how far it recovers depends on the
/// `start_sigma_m` it is given.
#[derive(Debug, Clone)]
pub struct RelativeCkf {
    options: RelativeCkfOptions,
    gate: InputGate,
    /// `s` (3), velocity error (2).
    filter: CubatureFilter<5>,
    /// Time the filter stands at.
    filter_s: Option<f64>,
    range_variance: f64,
    /// `b^(k+1)` of the adaptation.
    faded: f64,
    /// Time, dead reckoning and range of the last second.
    recent: VecDeque<(f64, Vector3<f64>, f64)>,
    agreement: Agreement,
    homing: Homing,
    updates: u64,
}

impl RelativeCkf {
    /// With the tag where `start` says, give or take `start_sigma_m` along each axis: its true
    /// place for RP, as the method's definition demands, the first guess for RP-Error.
    pub fn new(start: FirstGuess, start_sigma_m: f64, options: RelativeCkfOptions) -> Self {
        let (place, velocity) = (start_sigma_m, options.velocity_sigma_m_s);
        let sigmas = SVector::from([place, place, place, velocity, velocity]);
        let tag = start.tag_m;
        Self {
            options,
            gate: InputGate::default(),
            filter: CubatureFilter {
                mean: SVector::from([tag.x, tag.y, tag.z, 0.0, 0.0]),
                covariance: SMatrix::from_diagonal(&sigmas.component_mul(&sigmas)),
            },
            filter_s: None,
            range_variance: options.range_sigma_m.powi(2),
            faded: options.forgetting,
            recent: VecDeque::with_capacity(REMEMBERED),
            agreement: Agreement::new(options.range_sigma_m),
            homing: Homing::new(),
            updates: 0,
        }
    }

    fn predict(&mut self, t_s: f64) {
        let dt_s = t_s - self.filter_s.unwrap_or(t_s);
        self.filter_s = Some(t_s);
        if dt_s <= 0.0 {
            return;
        }
        let noise = InsNoise {
            velocity_random_walk: self.options.velocity_random_walk,
            acceleration_random_walk: 0.0,
            position_random_walk: 0.0,
            height_random_walk: self.options.height_random_walk,
            height_sigma_m: 0.0,
        };
        let (_, full) = noise.step(dt_s);
        let process = full.fixed_view::<5, 5>(0, 0).into_owned();
        self.filter.predict(
            |x| {
                let mut next = *x;
                next[0] += x[3] * dt_s;
                next[1] += x[4] * dt_s;
                next
            },
            &process,
        );
    }

    /// Whether the last changes of distance go with the motion.
    fn reliable(&mut self, ins_m: Vector3<f64>, sample: RangeSample) -> bool {
        while let Some(&(t_s, ..)) = self.recent.front()
            && (sample.t_s - t_s > CHANGE_S + 1e-9 || self.recent.len() == REMEMBERED)
        {
            self.recent.pop_front();
        }
        if let Some(&(t_s, ins_then_m, range_then_m)) = self.recent.front()
            && sample.t_s - t_s >= LEAST_CHANGE_S
        {
            let tag_m = self.seen_tag_m();
            let predicted_m = (tag_m - ins_m).norm() - (tag_m - ins_then_m).norm();
            self.agreement
                .push(sample.range_m - range_then_m, predicted_m);
        }
        self.recent.push_back((sample.t_s, ins_m, sample.range_m));
        self.agreement.cosine() >= self.options.least_cosine
    }

    fn update(&mut self, ins_m: Vector3<f64>, range_m: f64) {
        let expected = self
            .filter
            .expect(|x| (x.fixed_rows::<3>(0) - ins_m).norm());
        let Some(expected) = expected else {
            return;
        };
        let innovation = range_m - expected.mean;
        let newest = (1.0 - self.options.forgetting) / (1.0 - self.faded);
        self.faded *= self.options.forgetting;
        let seen = innovation * innovation - expected.variance;
        let [least, most] = self.options.range_sigma_bounds_m;
        self.range_variance = ((1.0 - newest) * self.range_variance + newest * seen)
            .clamp(least * least, most * most);
        self.filter.update(&expected, range_m, self.range_variance);
        self.updates += 1;
    }

    /// The tag as dead reckoning sees it.
    fn seen_tag_m(&self) -> Vector3<f64> {
        self.filter.mean.fixed_rows::<3>(0).into_owned()
    }

    fn steer(&mut self) {
        if let Some(now) = self.gate.last_ins() {
            let relative_m = self.seen_tag_m() - now.position_m;
            self.homing.steer(now.position_m, relative_m);
        }
    }
}

impl Navigator for RelativeCkf {
    fn on_ins(&mut self, sample: InsSample) -> Result<(), InputFault> {
        self.gate.admit_ins(sample)?;
        if self.filter_s.is_none() {
            self.filter_s = Some(sample.t_s);
            self.steer();
        }
        Ok(())
    }

    fn on_range(&mut self, sample: RangeSample) -> Result<(), InputFault> {
        self.gate.admit_range(sample)?;
        let Some(now) = self.gate.last_ins() else {
            return Ok(());
        };
        self.predict(sample.t_s);
        if self.reliable(now.position_m, sample) {
            self.update(now.position_m, sample.range_m);
        }
        self.steer();
        Ok(())
    }

    fn on_arrival(&mut self, command_id: u32) {
        self.homing.on_arrival(command_id, self.seen_tag_m());
    }

    fn command(&self) -> Command {
        self.homing.command()
    }

    fn estimate(&self) -> Option<Estimate> {
        let now = self.gate.last_ins()?;
        let covariance = self.filter.covariance.fixed_view::<3, 3>(0, 0);
        Some(Estimate {
            t_s: now.t_s,
            tag_m: self.seen_tag_m(),
            vehicle_m: now.position_m,
            relative_covariance_m2: Some(covariance.into_owned()),
            alternative_m: None,
            range_bias_m: None,
            range_sigma_m: Some(self.range_variance.sqrt()),
            doubts: self.gate.doubts(),
        })
    }

    fn phase(&self) -> Phase {
        self.homing.phase()
    }

    fn updates(&self) -> u64 {
        self.updates
    }
}
