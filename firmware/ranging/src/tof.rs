//! Time of flight from the six time stamps of a double-sided exchange.
//!
//! # Equation
//!
//! With the intervals
//!
//! ```text
//! Ra = t4 - t1   round time of the initiator   Db = t3 - t2   reply time of the responder
//! Rb = t6 - t3   round time of the responder   Da = t5 - t4   reply time of the initiator
//! ```
//!
//! the asymmetric formula (Neirynck, Luk, McLaughlin: "An alternative
//! double-sided two-way ranging method", WPNC 2016; DW1000 user manual, 12.3.2)
//!
//! ```text
//! T = (Ra Rb - Da Db) / (Ra + Rb + Da + Db)
//! ```
//!
//! needs no equal reply times: with clocks that run at 1 + ea and 1 + eb the
//! error is T (ea + eb) / 2, 2 mm at 100 m for two clocks 20 ppm fast. The
//! symmetric formula (Ra - Db + Rb - Da) / 4 errs by (ea - eb)(Db - Da) / 4
//! and the single-sided one, (Ra - Db) / 2, by eb Db / 2 or so: tens of metres
//! for replies of 200 ms. `tests/recorded.rs` shows both on recorded stamps.
//!
//! # Number type
//!
//! The two products are as large as 2^80 and nearly cancel. They are taken in
//! `i128`, exactly, and divided once in `f64`: the result is within one part in
//! 2^51 of the exact quotient for every input. On the board's Cortex-M4F, whose
//! floating-point unit has no double precision, this takes half the
//! instructions of `f64` throughout (678 against 1310): the products become a few
//! multiplications of 32 bits, whereas every operation on an `f64` is a call.
//! docs/number-types.md has the measurement, and why not `i64` or `f32`.

use crate::time::{DeviceTime, TICKS_PER_SECOND, Ticks};

/// Speed of light in air in m/s (refractive index 1.0003).
///
/// The default everywhere: the radio waves travel through air, and the vacuum
/// value reads 3 cm long at 100 m.
pub const SPEED_OF_LIGHT_AIR_M_PER_S: f64 = 299_702_547.0;

/// Speed of light in vacuum in m/s.
pub const SPEED_OF_LIGHT_VACUUM_M_PER_S: f64 = 299_792_458.0;

/// Two DW1000 crystals can differ by at most +-40 ppm when they keep to the
/// data sheet's +-20 ppm; stamps that say more than this are corrupt.
pub const MAX_CLOCK_OFFSET_PPM: f64 = 100.0;

/// The six antenna time stamps of one exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Stamps {
    /// t1: the poll leaves the initiator (initiator's clock).
    pub poll_tx: DeviceTime,
    /// t2: the poll reaches the responder (responder's clock).
    pub poll_rx: DeviceTime,
    /// t3: the response leaves the responder (responder's clock).
    pub response_tx: DeviceTime,
    /// t4: the response reaches the initiator (initiator's clock).
    pub response_rx: DeviceTime,
    /// t5: the final leaves the initiator (initiator's clock).
    pub final_tx: DeviceTime,
    /// t6: the final reaches the responder (responder's clock).
    pub final_rx: DeviceTime,
}

/// The four intervals of one exchange: all that the formula needs, and no two
/// of them from different clocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Intervals {
    /// Ra = t4 - t1, on the initiator's clock.
    pub initiator_round: Ticks,
    /// Da = t5 - t4, on the initiator's clock.
    pub initiator_reply: Ticks,
    /// Rb = t6 - t3, on the responder's clock.
    pub responder_round: Ticks,
    /// Db = t3 - t2, on the responder's clock.
    pub responder_reply: Ticks,
}

/// What one exchange tells.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TwoWay {
    /// Time of flight in ticks; negative when noise makes it so.
    pub time_of_flight_ticks: f64,
    /// How much faster the responder's clock runs than the initiator's, in
    /// parts per million.
    pub clock_offset_ppm: f64,
}

/// Why six stamps give no time of flight.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum TofError {
    /// One side's stamps are all equal: no time passed, nothing was measured.
    NoTimePassed,
    /// The two clocks would differ by this many ppm, more than any pair of
    /// working crystals: at least one stamp is wrong (or 17.2 s were exceeded).
    ClockOffset(f64),
}

impl core::fmt::Display for TofError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::NoTimePassed => f.write_str("no time passes between the time stamps of one side"),
            Self::ClockOffset(ppm) => write!(
                f,
                "the clocks would differ by {ppm:.0} ppm (at most {MAX_CLOCK_OFFSET_PPM:.0} are possible): a time stamp is wrong"
            ),
        }
    }
}

impl core::error::Error for TofError {}

impl From<&Stamps> for Intervals {
    fn from(s: &Stamps) -> Self {
        Self {
            initiator_round: s.response_rx.since(s.poll_tx),
            initiator_reply: s.final_tx.since(s.response_rx),
            responder_round: s.final_rx.since(s.response_tx),
            responder_reply: s.response_tx.since(s.poll_rx),
        }
    }
}

impl TwoWay {
    /// Evaluates the asymmetric formula; see the [module](self) for the
    /// equation.
    ///
    /// # Errors
    /// [`TofError`] where the stamps cannot come from two working clocks.
    pub fn from_intervals(i: &Intervals) -> Result<Self, TofError> {
        let [ra, da, rb, db] = [
            i.initiator_round,
            i.initiator_reply,
            i.responder_round,
            i.responder_reply,
        ]
        // Below 2^40: the conversion keeps the value, and sums stay below 2^42.
        .map(|interval| interval.get() as i64);

        // Both sides saw the same span from poll to final: t5 - t1 and t6 - t2.
        let (initiator_span, responder_span) = (ra + da, rb + db);
        if initiator_span == 0 || responder_span == 0 {
            return Err(TofError::NoTimePassed);
        }
        let clock_offset_ppm =
            (responder_span - initiator_span) as f64 / initiator_span as f64 * 1e6;
        if clock_offset_ppm.abs() > MAX_CLOCK_OFFSET_PPM {
            return Err(TofError::ClockOffset(clock_offset_ppm));
        }

        let wide = i128::from;
        let difference = wide(ra) * wide(rb) - wide(da) * wide(db);
        Ok(Self {
            time_of_flight_ticks: difference as f64 / (initiator_span + responder_span) as f64,
            clock_offset_ppm,
        })
    }

    /// [`TwoWay::from_intervals`] of the intervals between `stamps`.
    ///
    /// # Errors
    /// As there.
    pub fn from_stamps(stamps: &Stamps) -> Result<Self, TofError> {
        Self::from_intervals(&Intervals::from(stamps))
    }

    /// Range in metres for waves that travel at `speed_m_per_s`; signed.
    pub fn range_m(&self, speed_m_per_s: f64) -> f64 {
        self.time_of_flight_ticks / TICKS_PER_SECOND as f64 * speed_m_per_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::MODULUS;
    use num_bigint::BigInt;
    use num_rational::BigRational;
    use proptest::prelude::*;

    fn intervals(ra: u64, da: u64, rb: u64, db: u64) -> Intervals {
        Intervals {
            initiator_round: Ticks::new(ra),
            initiator_reply: Ticks::new(da),
            responder_round: Ticks::new(rb),
            responder_reply: Ticks::new(db),
        }
    }

    fn exact_ticks(ra: u64, da: u64, rb: u64, db: u64) -> BigRational {
        let big = |v: u64| BigInt::from(v);
        BigRational::new(
            big(ra) * big(rb) - big(da) * big(db),
            big(ra) + big(rb) + big(da) + big(db),
        )
    }

    #[test]
    fn equal_clocks_give_the_time_of_flight_exactly() {
        // 2000 ticks of flight, replies of 100 000 and 300 000 ticks.
        let t = TwoWay::from_intervals(&intervals(104_000, 300_000, 304_000, 100_000)).unwrap();
        assert_eq!(t.time_of_flight_ticks, 2000.0);
        assert_eq!(t.clock_offset_ppm, 0.0);
    }

    #[test]
    fn noise_can_make_the_result_negative() {
        let t = TwoWay::from_intervals(&intervals(99_990, 100_000, 99_990, 100_000)).unwrap();
        assert!(t.time_of_flight_ticks < -4.9);
    }

    #[test]
    fn stamps_without_time_between_them_are_refused() {
        let t = DeviceTime::from_ticks(5);
        let s = Stamps {
            poll_tx: t,
            poll_rx: t,
            response_tx: t,
            response_rx: t,
            final_tx: t,
            final_rx: t,
        };
        assert_eq!(TwoWay::from_stamps(&s), Err(TofError::NoTimePassed));
    }

    #[test]
    fn impossible_clocks_are_refused() {
        let e = TwoWay::from_intervals(&intervals(1_000_000, 1_000_000, 1_100_000, 1_000_000));
        assert!(matches!(e, Err(TofError::ClockOffset(p)) if p > 40_000.0));
    }

    proptest! {
        /// Any start of either clock, replies up to 4 s, clocks +-20 ppm: the
        /// result is the true time of flight to within stamp rounding.
        #[test]
        fn drift_and_wraps_do_not_matter(
            start_a in 0..MODULUS, start_b in 0..MODULUS,
            tof in 0.0..25_000.0f64,
            reply_b in 10_000.0..4.0 * TICKS_PER_SECOND as f64,
            reply_a in 10_000.0..4.0 * TICKS_PER_SECOND as f64,
            ppm_a in -20.0..20.0f64, ppm_b in -20.0..20.0f64,
        ) {
            // True times of the six events, in ticks of a perfect clock. The
            // clocks are evaluated as start + t + t*ppm so that f64 rounding
            // of the large sums stays far below a tick.
            let t2 = tof;
            let t3 = t2 + reply_b;
            let t4 = t3 + tof;
            let t5 = t4 + reply_a;
            let t6 = t5 + tof;
            let read = |start: u64, ppm: f64, t: f64| {
                DeviceTime::from_ticks(start + (t + t * ppm * 1e-6).round() as u64)
            };
            let s = Stamps {
                poll_tx: read(start_a, ppm_a, 0.0),
                poll_rx: read(start_b, ppm_b, t2),
                response_tx: read(start_b, ppm_b, t3),
                response_rx: read(start_a, ppm_a, t4),
                final_tx: read(start_a, ppm_a, t5),
                final_rx: read(start_b, ppm_b, t6),
            };
            let got = TwoWay::from_stamps(&s).unwrap();
            let expected = tof * (1.0 + (ppm_a + ppm_b) / 2.0 * 1e-6);
            // Each of six stamps is rounded by at most half a tick.
            prop_assert!((got.time_of_flight_ticks - expected).abs() < 1.0,
                "{} {}", got.time_of_flight_ticks, expected);
            let offset = ((1.0 + ppm_b * 1e-6) / (1.0 + ppm_a * 1e-6) - 1.0) * 1e6;
            let rounding = 2e6 / (reply_a + reply_b);
            prop_assert!((got.clock_offset_ppm - offset).abs() < rounding + 1e-6);
        }

        /// Over the whole range of 40-bit intervals the quotient is the exact
        /// rational number to 2^-51.
        #[test]
        fn arithmetic_is_exact_over_all_40_bit_intervals(
            ra in 1..MODULUS, da in 1..MODULUS, offset_ppm in -99.0..99.0f64,
            split in 0.0..1.0f64,
        ) {
            let span = ((ra + da) as f64 * (1.0 + offset_ppm * 1e-6)) as u64;
            let rb = ((span as f64 * split) as u64).clamp(1, MODULUS - 1);
            let db = (span - rb.min(span)).clamp(1, MODULUS - 1);
            prop_assume!(rb + db == span);
            let got = TwoWay::from_intervals(&intervals(ra, da, rb, db)).unwrap();
            let exact = exact_ticks(ra, da, rb, db);
            let got = BigRational::from_float(got.time_of_flight_ticks).unwrap();
            let error = got - &exact;
            let limit = exact * BigRational::new(BigInt::from(1), BigInt::from(1u64 << 51));
            let (error, limit) = (error.numer().magnitude() * limit.denom().magnitude(),
                                  limit.numer().magnitude() * error.denom().magnitude());
            prop_assert!(error <= limit);
        }
    }
}
