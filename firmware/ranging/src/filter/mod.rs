//! The range filter: what to think of the raw ranges to one peer.
//!
//! ```text
//!                 no number, or none that can be          ► rejected, invalid
//!  raw range ──►  first, or first after a silence         ► started
//!                 beyond the hard gate ─┬─ again and again, agreeing with each other ► re-acquired
//!                                       └─ else           ► rejected (outlier, NLOS)
//!                 beyond the soft gate, or likely NLOS    ► down-weighted
//!                 else                                    ► accepted
//! ```
//!
//! | file | what |
//! |---|---|
//! | `mod.rs` | the gates |
//! | `kalman.rs` | range and range rate, the Kalman filter |
//! | `rival.rs` | whether what was left out agrees with itself: the way over a real jump |
//! | `settings.rs` | what can be set |
//! | `bank.rs` | one filter a peer |
//!
//! A raw range that is left out still leaves its mark: the variance grows with the time until the next good one. What
//! the filter takes away is noise and gross errors; a bias that stays it cannot see. docs/range-filter.md has measurements.

mod bank;
mod kalman;
mod rival;
mod settings;

pub use bank::FilterBank;
pub use settings::{FilterSettings, SettingsError};

use crate::nlos;
use kalman::Kalman;
use rival::Rival;

/// The filter for the ranges to one peer.
#[derive(Clone, Copy, Debug)]
pub struct RangeFilter {
    settings: FilterSettings,
    track: Option<Track>,
}

/// What the filter knows once it has started.
#[derive(Clone, Copy, Debug)]
struct Track {
    state: Kalman,
    at_us: u64,
    rival: Option<Rival>,
}

/// A raw range.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct RawRange {
    /// When it was so, in microseconds of any clock that does not run backwards.
    pub at_us: u64,
    /// In metres.
    pub range_m: f32,
    /// How probable it is that the line of sight was blocked, if judged.
    pub nlos_probability: Option<f32>,
}

/// What the filter thinks.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Estimate {
    /// Range in metres.
    pub range_m: f32,
    /// How fast it grows, in m/s.
    pub rate_m_per_s: f32,
    /// Variance of the range, in square metres.
    pub variance_m2: f32,
}

/// What the filter did with a raw range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Treatment {
    /// The first one, or the first after a silence.
    Started,
    /// Weighed in full.
    Accepted,
    /// Weighed less: improbable, or likely not along the line of sight.
    DownWeighted,
    /// Left out: beyond the hard gate.
    RejectedOutlier,
    /// Left out: likely not along the line of sight, and too long besides.
    RejectedNlos,
    /// Left out: no number, none that can be, or from the past.
    RejectedInvalid,
    /// The filter starts anew with it: several were left out and agree.
    Reacquired,
}

impl RangeFilter {
    /// A filter that knows nothing yet.
    pub const fn new(settings: FilterSettings) -> Self {
        Self {
            settings,
            track: None,
        }
    }

    /// Takes a raw range; returns what became of it, and what the filter
    /// thinks now for the time of that range (nothing before the first valid one).
    pub fn update(&mut self, raw: &RawRange) -> (Treatment, Option<Estimate>) {
        update(&mut self.track, &self.settings, raw)
    }
}

/// [`RangeFilter::update`] with the settings apart, which all peers share.
fn update(
    track: &mut Option<Track>,
    settings: &FilterSettings,
    raw: &RawRange,
) -> (Treatment, Option<Estimate>) {
    let treatment = treat(track, settings, raw);
    (treatment, track.map(|track| track.state.estimate()))
}

fn treat(place: &mut Option<Track>, settings: &FilterSettings, raw: &RawRange) -> Treatment {
    if !FilterSettings::POSSIBLE_M.contains(&raw.range_m) {
        return Treatment::RejectedInvalid;
    }
    let fresh = Track {
        state: Kalman::at(raw.range_m, settings),
        at_us: raw.at_us,
        rival: None,
    };
    let silence_us = settings.silence_us();
    let track = match place {
        // One from the past is late; one from long ago means that the clock was set back.
        Some(track) if raw.at_us.abs_diff(track.at_us) <= silence_us => track,
        _ => {
            *place = Some(fresh);
            return Treatment::Started;
        }
    };
    let Some(since_us) = raw.at_us.checked_sub(track.at_us) else {
        return Treatment::RejectedInvalid;
    };
    track
        .state
        .predict(since_us as f32 * 1e-6, settings.agility_m2_per_s3);
    track.at_us = raw.at_us;

    let nlos = raw.nlos_probability.is_some_and(|p| p >= nlos::LIKELY);
    let sigma_m = if nlos {
        settings.nlos_sigma_m
    } else {
        settings.sigma_m
    };
    let innovation = track.state.innovation(raw.range_m, sigma_m);
    // A wall makes ranges longer, never shorter.
    let too_long = nlos && innovation.difference_m > 0.0;
    let gate = if too_long {
        settings.soft_gate_sigmas
    } else {
        settings.hard_gate_sigmas
    };
    if innovation.sigmas_squared() > gate * gate {
        let rival = Rival::after(track.rival, raw, nlos, settings);
        if rival.has_won(settings) {
            *track = fresh;
            return Treatment::Reacquired;
        }
        track.rival = Some(rival);
        return if too_long {
            Treatment::RejectedNlos
        } else {
            Treatment::RejectedOutlier
        };
    }
    track.rival = None;
    let soft = settings.soft_gate_sigmas;
    track.state.correct(&innovation, soft);
    if nlos || innovation.sigmas_squared() > soft * soft {
        Treatment::DownWeighted
    } else {
        Treatment::Accepted
    }
}
