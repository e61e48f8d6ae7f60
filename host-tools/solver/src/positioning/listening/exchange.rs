//! A difference of distances from one exchange that a third node hears.
//!
//! ```text
//!  initiator I   t1 poll          t4              t5 final              Ra = t4 - t1,  Da = t5 - t4
//!                  │ ╲          ╱ │                 │ ╲
//!  responder R     │   t2 ──── t3 │                 │   t6              Db = t3 - t2,  Rb = t6 - t3
//!                  ╲          ╲   ╱                 ╲
//!  listener L       l1         l2                    l3                 its own clock
//! ```
//!
//! Poll and final give the initiator's clock in the listener's, whatever the offset and rate of the two. On
//! the initiator's clock, counted from the poll, with spans `S = Ra + Da` and `S' = Rb + Db` of both
//! sides:
//!
//! ```text
//! u = (l2 - l1) S / (l3 - l1)        = t3 - t1 + (|LR| - |LI|) / c
//! e = (Ra + Db S / S') / 2           = t3 - t1          since Ra = e + T and Db S / S' = e - T
//! |LR| - |LI| = c (u - e)
//! ```
//!
//! The way between the two, `T`, drops out: neither their places nor a time of flight is needed, the bias of
//! receive stamps at one level enters `Ra` and `Db` with opposite signs, and of antenna delays half the
//! difference of the two nodes' sums remains, an offset of each anchor as [`locate_tdoa`](super::super::locate_tdoa) has them
//! among its unknowns. Left at first order: the result is in ticks of the initiator, its crystal's error
//! times the difference (20 ppm of 10 m: 0.2 mm). A crystal's drift `a` bends `u` by `a (l2 - l1) (l3 - l2) /
//! 2`, far below a tick; even motion of the listener cancels, as `u` lies on the line between poll and final.
//!
//! Each receive stamp has noise `s` (metres); with `f = (l2 - l1) / (l3 - l1)` and `g = Db / S'`
//!
//! ```text
//! sigma^2 = s^2 [1 + (1 - f)^2 + f^2]  +  s^2 [1 + (1 - g)^2 + g^2] / 4
//!                    `- poll and final: all differences of a round share these
//! ```
//!
//! 1.4 s where replies are equally long.

/// Ticks of the DW1000's clock before it wraps.
const CLOCK_TICKS: u64 = 1 << 40;
/// Metres that a signal travels in air in a tick, 1 / (128 x 499.2 MHz).
pub const METRES_PER_TICK: f64 = 299_702_547.0 / 63_897_600_000.0;
/// Clocks of crystals are not further apart.
const MOST_PPM: f64 = 100.0;

/// One side's intervals, in ticks of its clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SideIntervals {
    /// Ra or Rb: from sending to hearing the answer.
    pub round_ticks: u64,
    /// Da or Db: from hearing to answering.
    pub reply_ticks: u64,
}

/// An exchange as a listener has it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HeardExchange {
    /// The listener's stamps of poll, response and final: ticks of its clock, 40 bits.
    pub heard_ticks: [u64; 3],
    /// Ra, Da.
    pub initiator: SideIntervals,
    /// Rb, Db.
    pub responder: SideIntervals,
}

/// How much further the responder is than the initiator.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeardDifference {
    /// Distance to the responder less that to the initiator, metres.
    pub difference_m: f64,
    /// Distance between the two by their own intervals, metres.
    pub between_m: f64,
    /// Noise in multiples of that of a receive stamp: what this exchange has for itself.
    pub own: f64,
    /// The same of poll and final, which all exchanges of a round share.
    pub shared: [f64; 2],
}

/// Why an exchange gives no difference.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum ExchangeFault {
    /// An interval is none of a 40-bit clock, or no time passed from poll to final.
    #[error("intervals that no clock shows")]
    Intervals,
    /// The response was not heard between poll and final.
    #[error("stamps out of order")]
    Order,
    /// Two clocks are further apart than 100 ppm: stamps or intervals are of different rounds, or
    /// damaged.
    #[error("clocks further apart than crystals run")]
    Clocks,
}

impl HeardExchange {
    /// The difference.
    ///
    /// # Errors
    /// [`ExchangeFault`].
    pub fn difference(&self) -> Result<HeardDifference, ExchangeFault> {
        let [l1, l2, l3] = self.heard_ticks;
        let (a, b) = (self.initiator, self.responder);
        if [a, b]
            .iter()
            .any(|side| side.round_ticks >= CLOCK_TICKS || side.reply_ticks >= CLOCK_TICKS)
            || self.heard_ticks.iter().any(|stamp| *stamp >= CLOCK_TICKS)
        {
            return Err(ExchangeFault::Intervals);
        }
        // All below 2^41, which f64 holds exactly.
        let span = (a.round_ticks + a.reply_ticks) as f64;
        let responder_span = (b.round_ticks + b.reply_ticks) as f64;
        let since_poll = |stamp: u64| stamp.wrapping_sub(l1) % CLOCK_TICKS;
        let (response, last) = (since_poll(l2), since_poll(l3));
        if span <= 0.0 || responder_span <= 0.0 {
            return Err(ExchangeFault::Intervals);
        }
        if response == 0 || response >= last {
            return Err(ExchangeFault::Order);
        }
        let (response, last) = (response as f64, last as f64);
        let apart = |of: f64| (of / span - 1.0).abs() > MOST_PPM * 1e-6;
        if apart(last) || apart(responder_span) {
            return Err(ExchangeFault::Clocks);
        }
        let round = a.round_ticks as f64;
        let reply = b.reply_ticks as f64 * (span / responder_span);
        // What is large cancels before it is scaled: the clocks' rates move what is left by parts in a million.
        let since = response * (span / last);
        let (f, g) = (response / last, b.reply_ticks as f64 / responder_span);
        Ok(HeardDifference {
            difference_m: (since - 0.5 * (round + reply)) * METRES_PER_TICK,
            between_m: 0.5 * (round - reply) * METRES_PER_TICK,
            own: (1.0 + 0.25 * (1.0 + (1.0 - g).powi(2) + g * g)).sqrt(),
            shared: [1.0 - f, f],
        })
    }
}
