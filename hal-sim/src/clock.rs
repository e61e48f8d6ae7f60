//! Crystals: true time to device time and back.
//!
//! A clock runs at `1 + ppm + drift t` of its nominal rate. All arithmetic is integer (i128) with 2^-16 tick
//! resolution, so hours after the start a conversion is still good to a thousandth of a tick; an f64 of the
//! absolute phase would be off by whole ticks. Rates up to +-1000 ppm and drifts up to +-1 ppm/s stay within i128
//! for the whole range of [`SimTime`].

use crate::time::{FS_PER_S, FS_PER_US, SimTime};

/// Ticks of the DW1000's 40-bit counter before it wraps (17.2 s).
pub const COUNTER_WRAP: u64 = 1 << 40;

/// Fractional bits of a [`Phase`].
const PHASE_FRACTION: u32 = 16;
/// 63.8976 GHz in ticks a femtosecond is 624 / 9 765 625.
const TICKS_NUM: i128 = 624;
const TICKS_DEN: i128 = 9_765_625;
/// Rates are held in units of 1e-18.
const RATE_ONE: i128 = 1_000_000_000_000_000_000;
const RATE_PER_PPM: f64 = 1e12;

/// How a board's DW1000 crystal runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClockConfig {
    /// Counter value when the chip's clock starts (power-up or reset). The real chip starts at 0; other values let
    /// a test begin near the wrap or give each board its own epoch.
    pub offset_ticks: u64,
    /// Frequency error at the start, in ppm, with the crystal trim at mid-range (FS_XTALT = 0x10).
    pub ppm: f64,
    /// Change of the frequency error in ppm per second.
    pub drift_ppm_per_s: f64,
}

impl Default for ClockConfig {
    fn default() -> Self {
        ClockConfig {
            offset_ticks: 0,
            ppm: 0.0,
            drift_ppm_per_s: 0.0,
        }
    }
}

/// Device time that does not wrap, in units of 2^-16 tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Phase(i128);

impl Phase {
    /// From whole ticks.
    pub const fn from_ticks(ticks: i128) -> Self {
        Phase(ticks << PHASE_FRACTION)
    }

    /// Whole ticks, rounded down.
    pub const fn ticks(self) -> i128 {
        self.0 >> PHASE_FRACTION
    }

    /// Whole ticks, rounded to nearest.
    pub const fn ticks_rounded(self) -> i128 {
        (self.0 + (1 << (PHASE_FRACTION - 1))) >> PHASE_FRACTION
    }

    /// The 40-bit counter reading, rounded down.
    pub const fn counter(self) -> u64 {
        wrap(self.ticks())
    }

    /// Ticks with their fraction, for differences small enough for f64.
    pub fn ticks_f64(self) -> f64 {
        self.0 as f64 / (1u64 << PHASE_FRACTION) as f64
    }

    /// Moves by a whole number of ticks.
    pub const fn plus_ticks(self, ticks: i128) -> Self {
        Phase(self.0 + (ticks << PHASE_FRACTION))
    }

    /// Moves by a fractional number of ticks (well below 2^40 of them).
    pub fn plus_ticks_f64(self, ticks: f64) -> Self {
        Phase(self.0 + (ticks * (1u64 << PHASE_FRACTION) as f64).round() as i128)
    }

    /// Difference `self - earlier` in ticks.
    pub fn since(self, earlier: Phase) -> f64 {
        Phase(self.0 - earlier.0).ticks_f64()
    }
}

/// Folds ticks into the 40 bits of the counter.
pub const fn wrap(ticks: i128) -> u64 {
    ticks.rem_euclid(COUNTER_WRAP as i128) as u64
}

/// The DW1000's time base.
#[derive(Debug, Clone, Copy)]
pub struct DeviceClock {
    /// The moment at which `phase0` and `rate` hold.
    epoch: SimTime,
    phase0: Phase,
    rate_1e18: i128,
    drift_1e18_per_s: i128,
}

impl DeviceClock {
    /// A clock that shows `config.offset_ticks` at `start`.
    pub fn new(config: &ClockConfig, start: SimTime) -> Self {
        let ppm = config.ppm + config.drift_ppm_per_s * start.as_s_f64();
        DeviceClock {
            epoch: start,
            phase0: Phase::from_ticks(i128::from(config.offset_ticks % COUNTER_WRAP)),
            rate_1e18: (ppm * RATE_PER_PPM).round() as i128,
            drift_1e18_per_s: (config.drift_ppm_per_s * RATE_PER_PPM).round() as i128,
        }
    }

    /// Device time at `t`. Also defined before the clock's start, as if it had run already.
    pub fn phase_at(&self, t: SimTime) -> Phase {
        let dt = i128::from(t.as_fs()) - i128::from(self.epoch.as_fs());
        let drifted = self.drift_1e18_per_s * dt / (2 * i128::from(FS_PER_S));
        let stretched = dt + dt * (self.rate_1e18 + drifted) / RATE_ONE;
        Phase(self.phase0.0 + ((stretched * TICKS_NUM) << PHASE_FRACTION).div_euclid(TICKS_DEN))
    }

    /// The 40-bit counter at `t`.
    pub fn counter_at(&self, t: SimTime) -> u64 {
        self.phase_at(t).counter()
    }

    /// True time at which the clock shows `phase`; clamped to the range of [`SimTime`].
    pub fn time_of(&self, phase: Phase) -> SimTime {
        // Newton's method with the nominal slope: each round shrinks the error by the clock's ppm.
        let mut t = self.epoch;
        for _ in 0..8 {
            let missing = phase.0 - self.phase_at(t).0;
            let step = (missing * TICKS_DEN / TICKS_NUM) >> PHASE_FRACTION;
            if step == 0 {
                break;
            }
            let next = i128::from(t.as_fs()) + step;
            t = SimTime::from_fs(next.clamp(0, i128::from(u64::MAX)) as u64);
        }
        t
    }

    /// First phase at or after `now` at which the 40-bit counter shows `counter`.
    pub fn next_phase_of(&self, now: SimTime, counter: u64) -> Phase {
        let current = self.phase_at(now);
        let ahead = wrap(i128::from(counter) - current.ticks());
        let phase = Phase::from_ticks(current.ticks() + i128::from(ahead));
        if phase < current {
            phase.plus_ticks(i128::from(COUNTER_WRAP))
        } else {
            phase
        }
    }

    /// Rate error at `t` in ppm.
    pub fn ppm_at(&self, t: SimTime) -> f64 {
        let dt_s = t.as_s_f64() - self.epoch.as_s_f64();
        (self.rate_1e18 as f64 + self.drift_1e18_per_s as f64 * dt_s) / RATE_PER_PPM
    }

    /// Shifts the rate by `ppm` from `now` on (crystal trim), without a jump of the phase.
    pub fn shift_rate(&mut self, now: SimTime, ppm: f64) {
        let rate_ppm = self.ppm_at(now) + ppm;
        self.phase0 = self.phase_at(now);
        self.epoch = now;
        self.rate_1e18 = (rate_ppm * RATE_PER_PPM).round() as i128;
    }
}

/// The microcontroller's clock: microseconds since boot, with its own crystal error.
#[derive(Debug, Clone, Copy)]
pub struct McuClock {
    boot: SimTime,
    rate_1e18: i128,
}

impl McuClock {
    /// A clock that shows 0 at `boot` and runs `ppm` fast.
    pub fn new(boot: SimTime, ppm: f64) -> Self {
        McuClock {
            boot,
            rate_1e18: RATE_ONE + (ppm * RATE_PER_PPM).round() as i128,
        }
    }

    /// Microseconds since boot at `t`.
    pub fn us_at(&self, t: SimTime) -> u64 {
        let fs = i128::from(t.since(self.boot).as_fs()) * self.rate_1e18 / RATE_ONE;
        (fs / i128::from(FS_PER_US)) as u64
    }

    /// First moment at which the clock shows `us`.
    pub fn time_of(&self, us: u64) -> SimTime {
        // Rounded up, so that `us_at(time_of(us)) == us` and a sleep never ends early.
        let fs = i128::from(us) * i128::from(FS_PER_US);
        let scaled = fs.saturating_mul(RATE_ONE);
        let true_fs = (scaled + self.rate_1e18 - 1) / self.rate_1e18;
        let t = i128::from(self.boot.as_fs()).saturating_add(true_fs);
        SimTime::from_fs(u64::try_from(t).unwrap_or(u64::MAX))
    }
}
