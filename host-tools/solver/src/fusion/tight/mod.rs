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
//!   ([`sigma_factor`](crate::positioning::sigma_factor)), and as long as a path stays blocked all its
//!   ranges together say no more than one. Then the innovation: `NIS = nu^2 / S` beyond
//!   the gate sets the range aside; from Huber's limit on it is weighed down. A blocked anchor stays
//!   blocked for a while, so one that was set aside has to agree within two sigmas before it is believed
//!   again. If most ranges of a while are set aside, it is the filter that is wrong.
//! - **The other side.** Anchors at nearly one height see a mirror image below them. Twice a second five
//!   or more anchors are asked where the vehicle is, by themselves; three contradictions in a row, and
//!   the filter starts anew from their answer.
//! - **Far from linear.** After minutes of GNSS alone the position is known to ten metres, and a range
//!   to an anchor thirty metres away bends over that. As soon as five anchors are heard their ranges are
//!   solved together ([`locate`](crate::positioning::locate)) for a position, which is linear; the same
//!   happens when the filter has been found to be wrong. With fewer the position is cut into slices
//!   along the direction in which it is known worst, each a filter of its own that ranges and GNSS weigh
//!   ([`slices`]); a range's mean and variance are taken to second order.
//!
//! ```text
//!  mod.rs  Tight: one filter, or a few slices ─► filter.rs   unknowns, GNSS, a range
//!                                              ─► together.rs the anchors by themselves: start anew, the other side
//!                                              ─► slices.rs   cut, weigh, merge
//! ```

mod filter;
mod slices;
mod together;

use nalgebra::{Matrix3, Vector3};

use self::filter::Filter;
use self::slices::Slices;
use super::inertial::ImuNoise;
use super::{GnssFix, ImuSample, LeverArms, Navigation, UwbRange};

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
    /// How far its ranges scattered in the survey, metres; the filter goes by the sigma of each range.
    pub range_sigma_m: f64,
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
    /// Time over which the errors of ranges along a blocked path hang together, seconds.
    pub blocked_memory_s: f64,
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
            blocked_memory_s: 3.0,
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

/// The filter.
#[derive(Debug, Clone)]
pub struct Tight {
    slices: Slices,
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
        Self {
            slices: Slices::one(Filter::new(options, anchors, t_s, position_m, sigma_m)),
        }
    }

    /// Takes an inertial reading; false where it is older than the last.
    pub fn on_imu(&mut self, sample: &ImuSample) -> bool {
        self.slices.all(|filter| filter.on_imu(sample))
    }

    /// Takes a position from GNSS; the normalised innovation squared, `None` where it cannot be used.
    pub fn on_gnss(&mut self, fix: &GnssFix) -> Option<f64> {
        self.slices.weigh(|filter| {
            let said = filter.on_gnss(fix);
            let nis = said.map(|(nis, _)| nis);
            (nis, said.map_or(0.0, |(_, likelihood)| likelihood))
        })
    }

    /// Takes a range; what became of it.
    pub fn on_range(&mut self, range: &UwbRange) -> Fate {
        self.slices.cut_where_coarse(range.t_s);
        self.slices.weigh(|filter| filter.on_range(range))
    }

    /// The estimate now: the likeliest slice's, its covariance with what the others say.
    pub fn navigation(&self) -> Navigation {
        self.slices.navigation()
    }

    /// Anchors as they are known now.
    pub fn anchors(&self) -> Vec<FusionAnchor> {
        self.slices.likeliest().anchors()
    }

    /// Readings and measurements that could not be used.
    pub fn refused(&self) -> u64 {
        self.slices.likeliest().refused()
    }
}
