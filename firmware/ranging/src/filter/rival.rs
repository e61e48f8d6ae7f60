//! Ranges that were left out, as a second opinion.
//!
//! A gate alone never lets go: after a real jump (the peer was carried, the first values were wrong) everything would
//! be rejected for ever. So what is left out is held against what was left out before it. Values that follow each
//! other no faster than a peer can move gather votes; one that does not starts the count anew. Those likely not along
//! the line of sight have half a vote: a wall makes ranges that agree with each other, too.

use super::{FilterSettings, RawRange};

/// A run of rejected ranges that agree.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rival {
    range_m: f32,
    at_us: u64,
    half_votes: u16,
}

impl Rival {
    /// The rival after `raw` was rejected.
    pub(super) fn after(
        before: Option<Self>,
        raw: &RawRange,
        nlos: bool,
        settings: &FilterSettings,
    ) -> Self {
        let votes = before
            .filter(|rival| rival.agrees(raw, settings))
            .map_or(0, |rival| rival.half_votes);
        Self {
            range_m: raw.range_m,
            at_us: raw.at_us,
            half_votes: votes.saturating_add(if nlos { 1 } else { 2 }),
        }
    }

    /// Whether it has gathered enough votes.
    pub(super) fn has_won(&self, settings: &FilterSettings) -> bool {
        self.half_votes >= 2 * u16::from(settings.reacquire_after)
    }

    fn agrees(&self, raw: &RawRange, settings: &FilterSettings) -> bool {
        // Two values of equal noise: sqrt(2) sigma apart.
        let noise_m = settings.hard_gate_sigmas * core::f32::consts::SQRT_2 * settings.sigma_m;
        let t_s = raw.at_us.saturating_sub(self.at_us) as f32 * 1e-6;
        (raw.range_m - self.range_m).abs() <= settings.max_speed_m_per_s * t_s + noise_m
    }
}
