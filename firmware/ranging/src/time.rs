//! The DW1000's clock: 40 bits that count 1/(128 x 499.2 MHz) = 15.650 ps and
//! wrap every 17.2 s (user manual, section 4.1.1).

/// Ticks a second: 128 x 499.2 MHz.
pub const TICKS_PER_SECOND: u64 = 63_897_600_000;

/// The clock has this many states; it wraps from `MODULUS - 1` to 0.
pub const MODULUS: u64 = 1 << 40;

/// Delayed transmissions start on multiples of this many ticks (8.01 ns): the
/// low nine bits of DX_TIME are ignored (user manual, section 7.2.12).
pub const DELAYED_GRID: u64 = 512;

/// A reading of a DW1000's clock: 40 bits, wrapping.
///
/// Readings have no order, only differences: see [`DeviceTime::since`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct DeviceTime(u64);

/// A span of device time in ticks of 15.650 ps, from 0 up to one wrap.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Ticks(u64);

impl DeviceTime {
    /// The reading with these low 40 bits; higher bits are dropped.
    pub const fn from_ticks(ticks: u64) -> Self {
        Self(ticks % MODULUS)
    }

    /// The reading with this value, or `None` if it needs more than 40 bits.
    pub const fn try_from_ticks(ticks: u64) -> Option<Self> {
        if ticks < MODULUS {
            Some(Self(ticks))
        } else {
            None
        }
    }

    /// The 40-bit value.
    pub const fn ticks(self) -> u64 {
        self.0
    }

    /// The span from `earlier` to `self`, right across a wrap as long as less
    /// than one wrap (17.2 s) lies between them.
    pub const fn since(self, earlier: Self) -> Ticks {
        Ticks(self.0.wrapping_sub(earlier.0) % MODULUS)
    }

    /// The reading `span` later.
    pub const fn after(self, span: Ticks) -> Self {
        Self::from_ticks(self.0 + span.0)
    }

    /// The last moment at or before this one at which a delayed transmission
    /// can start: a multiple of [`DELAYED_GRID`].
    ///
    /// The grid divides the modulus, so rounding never crosses a wrap.
    pub const fn on_delayed_grid(self) -> Self {
        Self(self.0 - self.0 % DELAYED_GRID)
    }
}

impl Ticks {
    /// A span of this many ticks; bits above 40 are dropped.
    pub const fn new(ticks: u64) -> Self {
        Self(ticks % MODULUS)
    }

    /// The number of ticks.
    pub const fn get(self) -> u64 {
        self.0
    }

    /// The span in whole ticks of `us` microseconds (rounded down).
    ///
    /// A microsecond is 63 897.6 ticks. Without a division of 64 bits, which on the board is a
    /// loop of some hundred instructions.
    pub const fn from_us(us: u32) -> Self {
        let whole = us as u64 * (TICKS_PER_SECOND / 1_000_000);
        let tenths = (us / 10 * 6 + us % 10 * 6 / 10) as u64;
        Self::new(whole + tenths)
    }

    /// The shortest span of whole ticks that is not below `ns` nanoseconds.
    pub const fn from_ns(ns: u64) -> Self {
        Self::new((ns as u128 * (TICKS_PER_SECOND / 100_000) as u128).div_ceil(10_000) as u64)
    }

    /// The span in whole nanoseconds (rounded up).
    pub const fn to_ns(self) -> u64 {
        (self.0 * 10_000).div_ceil(TICKS_PER_SECOND / 100_000)
    }

    /// The span in whole microseconds (rounded down).
    ///
    /// By a multiplication with the reciprocal, as in [`Ticks::from_us`]. Exact: it is too large
    /// by less than 2^-64, which 44 bits of tenths of ticks make less than a 638 976th.
    pub const fn to_us(self) -> u32 {
        const TENTHS_PER_US: u64 = TICKS_PER_SECOND / 100_000;
        const RECIPROCAL: u64 = u64::MAX / TENTHS_PER_US + 1;
        (((self.0 * 10) as u128 * RECIPROCAL as u128) >> 64) as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn spans_are_right_across_the_wrap() {
        let before = DeviceTime::from_ticks(MODULUS - 3);
        let after = DeviceTime::from_ticks(4);
        assert_eq!(after.since(before).get(), 7);
        assert_eq!(before.since(after).get(), MODULUS - 7);
    }

    #[test]
    fn a_microsecond_is_63897_6_ticks() {
        assert_eq!(Ticks::from_us(10).get(), 638_976);
        assert_eq!(Ticks::from_us(1).get(), 63_897);
        assert_eq!(Ticks::from_us(5_000_000).to_us(), 5_000_000);
    }

    #[test]
    fn nanoseconds_are_rounded_up() {
        // 1 ns is 63.9 ticks.
        assert_eq!(Ticks::from_ns(1).get(), 64);
        assert_eq!(Ticks::from_ns(10_000).get(), 638_976);
        assert_eq!(Ticks::from_us(10).to_ns(), 10_000);
        assert_eq!(Ticks::new(1).to_ns(), 1);
        assert_eq!(Ticks::new(MODULUS - 1).to_ns(), 17_207_401_026);
    }

    #[test]
    fn values_above_40_bits_are_refused() {
        assert!(DeviceTime::try_from_ticks(MODULUS).is_none());
        assert!(DeviceTime::try_from_ticks(MODULUS - 1).is_some());
    }

    proptest! {
        #[test]
        fn microseconds_are_converted_exactly(ticks in 0..MODULUS, us: u32) {
            prop_assert_eq!(u64::from(Ticks::new(ticks).to_us()), ticks * 10 / 638_976);
            let exact = u128::from(us) * 638_976 / 10 % u128::from(MODULUS);
            prop_assert_eq!(u128::from(Ticks::from_us(us).get()), exact);
        }

        #[test]
        fn whole_microseconds_are_where_they_should_be(us in 0u64..17_207_401) {
            // The hardest cases: right at a microsecond, and one tick before.
            let at = (us * 638_976).div_ceil(10);
            prop_assert_eq!(u64::from(Ticks::new(at).to_us()), us);
            if at > 0 {
                prop_assert_eq!(u64::from(Ticks::new(at - 1).to_us()), us.max(1) - 1);
            }
        }

        #[test]
        fn since_undoes_after(start in 0..MODULUS, span in 0..MODULUS) {
            let start = DeviceTime::from_ticks(start);
            let span = Ticks::new(span);
            prop_assert_eq!(start.after(span).since(start), span);
        }

        #[test]
        fn the_grid_is_at_most_511_ticks_early(t in 0..MODULUS) {
            let t = DeviceTime::from_ticks(t);
            let on_grid = t.on_delayed_grid();
            prop_assert!(t.since(on_grid).get() < DELAYED_GRID);
            prop_assert_eq!(on_grid.ticks() % DELAYED_GRID, 0);
        }
    }
}
