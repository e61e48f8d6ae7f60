//! True time of the simulation.
//!
//! [`SimTime`] counts femtoseconds since the start in 64 bits, which ends after 5.12 hours. A femtosecond is
//! 1/15650 of a DW1000 tick and 0.3 µm of light, so that rounding to it never shows.

use core::ops::{Add, AddAssign, Sub};

/// Femtoseconds in a second.
pub const FS_PER_S: u64 = 1_000_000_000_000_000;
/// Femtoseconds in a microsecond.
pub const FS_PER_US: u64 = 1_000_000_000;
/// Femtoseconds in a nanosecond.
pub const FS_PER_NS: u64 = 1_000_000;
/// Frequency of the DW1000's time stamp counter in Hz: 128 x 499.2 MHz (User Manual 7.2.8).
pub const TICKS_PER_S: u64 = 63_897_600_000;

/// A moment in true time: femtoseconds since the simulation started.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct SimTime(u64);

impl SimTime {
    /// The start of the simulation.
    pub const ZERO: SimTime = SimTime(0);
    /// The last moment that can be represented, 5.12 hours after the start.
    pub const MAX: SimTime = SimTime(u64::MAX);

    /// From femtoseconds.
    pub const fn from_fs(fs: u64) -> Self {
        SimTime(fs)
    }

    /// From nanoseconds; saturates at [`SimTime::MAX`].
    pub const fn from_ns(ns: u64) -> Self {
        SimTime(ns.saturating_mul(FS_PER_NS))
    }

    /// From microseconds; saturates at [`SimTime::MAX`].
    pub const fn from_us(us: u64) -> Self {
        SimTime(us.saturating_mul(FS_PER_US))
    }

    /// From milliseconds; saturates at [`SimTime::MAX`].
    pub const fn from_ms(ms: u64) -> Self {
        SimTime(ms.saturating_mul(1000 * FS_PER_US))
    }

    /// From seconds; negative and NaN become zero, too large saturates.
    pub fn from_s_f64(s: f64) -> Self {
        SimTime((s * FS_PER_S as f64) as u64)
    }

    /// Femtoseconds since the start.
    pub const fn as_fs(self) -> u64 {
        self.0
    }

    /// Seconds since the start.
    pub fn as_s_f64(self) -> f64 {
        self.0 as f64 / FS_PER_S as f64
    }

    /// Time from `earlier` to `self`, zero when `earlier` is later.
    pub const fn since(self, earlier: SimTime) -> SimDuration {
        SimDuration(self.0.saturating_sub(earlier.0))
    }
}

/// A span of true time in femtoseconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct SimDuration(u64);

impl SimDuration {
    /// No time.
    pub const ZERO: SimDuration = SimDuration(0);

    /// From femtoseconds.
    pub const fn from_fs(fs: u64) -> Self {
        SimDuration(fs)
    }

    /// From nanoseconds; saturates.
    pub const fn from_ns(ns: u64) -> Self {
        SimDuration(ns.saturating_mul(FS_PER_NS))
    }

    /// From microseconds; saturates.
    pub const fn from_us(us: u64) -> Self {
        SimDuration(us.saturating_mul(FS_PER_US))
    }

    /// From milliseconds; saturates.
    pub const fn from_ms(ms: u64) -> Self {
        SimDuration(ms.saturating_mul(1000 * FS_PER_US))
    }

    /// From seconds; negative and NaN become zero, too large saturates.
    pub fn from_s_f64(s: f64) -> Self {
        SimDuration((s * FS_PER_S as f64) as u64)
    }

    /// Femtoseconds.
    pub const fn as_fs(self) -> u64 {
        self.0
    }

    /// Seconds.
    pub fn as_s_f64(self) -> f64 {
        self.0 as f64 / FS_PER_S as f64
    }

    /// Time that `bits` take on a wire of `bits_per_s`.
    pub fn of_bits(bits: u64, bits_per_s: u32) -> Self {
        let fs = u128::from(bits) * u128::from(FS_PER_S) / u128::from(bits_per_s.max(1));
        SimDuration(u64::try_from(fs).unwrap_or(u64::MAX))
    }

    /// A whole number of these spans, saturating.
    pub const fn times(self, n: u64) -> Self {
        SimDuration(self.0.saturating_mul(n))
    }
}

impl Add<SimDuration> for SimTime {
    type Output = SimTime;
    fn add(self, d: SimDuration) -> SimTime {
        SimTime(self.0.saturating_add(d.0))
    }
}

impl AddAssign<SimDuration> for SimTime {
    fn add_assign(&mut self, d: SimDuration) {
        *self = *self + d;
    }
}

impl Add for SimDuration {
    type Output = SimDuration;
    fn add(self, d: SimDuration) -> SimDuration {
        SimDuration(self.0.saturating_add(d.0))
    }
}

impl AddAssign for SimDuration {
    fn add_assign(&mut self, d: SimDuration) {
        *self = *self + d;
    }
}

impl Sub<SimDuration> for SimTime {
    type Output = SimTime;
    fn sub(self, d: SimDuration) -> SimTime {
        SimTime(self.0.saturating_sub(d.0))
    }
}
