//! What a sighting may be: clear, a bearing that is an outlier of its own, or blocked sight that lasts.

use super::options::InteractingOptions;
use crate::tracking::sighting::{Bearing, Range, Sighting};

pub(super) const SIGHTS: usize = 3;
const CLEAR: usize = 0;
const OUTLIER: usize = 1;
pub(super) const BLOCKED: usize = 2;

/// A sighting as one of these would have it.
pub(super) struct Seen {
    pub(super) sighting: Sighting,
    /// `-1/2 ln |R|`, up to a constant.
    pub(super) log_scale: f64,
}

/// The sighting with the noise of this sight. Blocked, a range is late by an exponential distance: its
/// mean is taken off, its standard deviation is as much.
pub(super) fn as_seen(o: &InteractingOptions, sighting: &Sighting, sight: usize) -> Seen {
    let mut seen = *sighting;
    if let Some(range) = &mut seen.range
        && sight == BLOCKED
    {
        *range = Range {
            range_m: range.range_m - o.late_m,
            sigma_m: range.sigma_m.hypot(o.late_m),
        };
    }
    if let Some(bearing) = &mut seen.bearing {
        let wild = match sight {
            CLEAR => 0.0,
            OUTLIER => o.outlier_sigma_rad,
            _ => o.blocked_sigma_rad,
        };
        *bearing = Bearing {
            sigma_rad: bearing.sigma_rad.max(wild),
            ..*bearing
        };
    }
    let attitude = seen.pose.attitude_covariance.trace() / 3.0;
    let range = seen.range.map_or(0.0, |r| r.sigma_m.ln());
    let bearing = seen
        .bearing
        .map_or(0.0, |b| (b.sigma_rad * b.sigma_rad + attitude).ln());
    Seen {
        sighting: seen,
        log_scale: -range - bearing,
    }
}

/// Probabilities some time later, before anything is seen.
pub(super) fn after(o: &InteractingOptions, before: &[f64; SIGHTS], dt_s: f64) -> [f64; SIGHTS] {
    let stays = (-dt_s / o.blocked_for_s).exp();
    let begins = 1.0 - (-dt_s / o.blocked_every_s).exp();
    let blocked = before[BLOCKED] * stays + (1.0 - before[BLOCKED]) * begins;
    with_blocked(o, blocked)
}

/// How often each is met in the long run.
pub(super) fn long_run(o: &InteractingOptions) -> [f64; SIGHTS] {
    with_blocked(o, o.blocked_for_s / (o.blocked_for_s + o.blocked_every_s))
}

fn with_blocked(o: &InteractingOptions, blocked: f64) -> [f64; SIGHTS] {
    let open = 1.0 - blocked;
    [open * (1.0 - o.outliers), open * o.outliers, blocked]
}
