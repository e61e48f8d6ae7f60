//! Dead reckoning at the very time of each range.

use crate::peer::Peer;
use nova_solver::navigation::{InsSample, RangeSample};
use std::collections::VecDeque;

/// A range to one node.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Heard {
    pub(crate) peer: Peer,
    pub(crate) range: RangeSample,
}

/// What became of a range.
#[derive(Debug, PartialEq)]
pub(crate) enum Outcome {
    /// The vehicle was here when the range was taken.
    Paired(InsSample, Heard),
    /// Dead reckoning does not reach it.
    Unpaired(Heard),
}

/// Longest time between two readings between which a straight line is believed, and longest wait
/// for the later of them.
const LONGEST_GAP_S: f64 = 1.0;

/// How long readings are kept for ranges that come late.
const MEMORY_S: f64 = 10.0;

/// Holds ranges back until dead reckoning has passed them, so that the vehicle's place can be
/// interpolated: two streams, each in its order, may arrive in any mixture.
#[derive(Default)]
pub(crate) struct Pairing {
    readings: VecDeque<InsSample>,
    waiting: VecDeque<Heard>,
    newest_range_s: Option<f64>,
}

impl Pairing {
    /// Takes a reading; its time must be after that of the last one.
    pub(crate) fn ins(&mut self, sample: InsSample) {
        let forget = |old: &InsSample| old.t_s < sample.t_s - MEMORY_S;
        while self.readings.front().is_some_and(forget) {
            self.readings.pop_front();
        }
        self.readings.push_back(sample);
    }

    /// Time of the last reading.
    pub(crate) fn last_ins_s(&self) -> Option<f64> {
        self.readings.back().map(|reading| reading.t_s)
    }

    /// Takes a range.
    pub(crate) fn range(&mut self, heard: Heard) {
        let t_s = heard.range.t_s;
        let place = self.waiting.partition_point(|w| w.range.t_s <= t_s);
        self.waiting.insert(place, heard);
        self.newest_range_s = Some(self.newest_range_s.map_or(t_s, |newest| newest.max(t_s)));
    }

    /// The next range whose fate is known.
    pub(crate) fn next(&mut self) -> Option<Outcome> {
        let t_s = self.waiting.front()?.range.t_s;
        let reached = self.last_ins_s().is_some_and(|last_s| t_s <= last_s);
        let given_up = (self.newest_range_s).is_some_and(|newest_s| newest_s - t_s > LONGEST_GAP_S);
        if !reached && !given_up {
            return None;
        }
        let position = self.at(t_s);
        let heard = self.waiting.pop_front()?;
        Some(match position {
            Some(sample) => Outcome::Paired(sample, heard),
            None => Outcome::Unpaired(heard),
        })
    }

    /// Ranges that wait in vain: there will be no more readings.
    pub(crate) fn rest(&mut self) -> impl Iterator<Item = Heard> {
        self.waiting.drain(..)
    }

    fn at(&self, t_s: f64) -> Option<InsSample> {
        let after = self.readings.partition_point(|reading| reading.t_s <= t_s);
        let before = *self.readings.get(after.checked_sub(1)?)?;
        if before.t_s == t_s {
            return Some(before);
        }
        let after = self.readings.get(after)?;
        let gap_s = after.t_s - before.t_s;
        let part = (t_s - before.t_s) / gap_s;
        (gap_s <= LONGEST_GAP_S).then(|| InsSample {
            t_s,
            // Equal readings stay equal to the last digit: a frozen INS is recognised by that.
            position_m: before.position_m + (after.position_m - before.position_m) * part,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    fn ins(t_s: f64) -> InsSample {
        InsSample {
            t_s,
            position_m: Vector3::new(2.0 * t_s, 1.0, 30.0),
        }
    }

    fn heard(t_s: f64) -> Heard {
        Heard {
            peer: Peer::Number(7),
            range: RangeSample { t_s, range_m: 5.0 },
        }
    }

    #[test]
    fn a_range_waits_until_dead_reckoning_has_passed_it() {
        let mut pairing = Pairing::default();
        pairing.ins(ins(1.0));
        pairing.range(heard(1.25));
        assert_eq!(pairing.next(), None);
        pairing.ins(ins(1.5));
        assert_eq!(
            pairing.next(),
            Some(Outcome::Paired(ins(1.25), heard(1.25)))
        );
        assert_eq!(pairing.next(), None);
    }

    #[test]
    fn ranges_leave_in_order_of_time_whichever_way_they_came() {
        let mut pairing = Pairing::default();
        pairing.ins(ins(0.0));
        for t_s in [0.3, 0.1, 0.2] {
            pairing.range(heard(t_s));
        }
        pairing.ins(ins(0.5));
        let times: Vec<f64> = std::iter::from_fn(|| pairing.next())
            .map(|outcome| match outcome {
                Outcome::Paired(sample, heard) => {
                    assert_eq!(sample.t_s, heard.range.t_s);
                    sample.t_s
                }
                Outcome::Unpaired(heard) => panic!("{heard:?}"),
            })
            .collect();
        assert_eq!(times, [0.1, 0.2, 0.3]);
    }

    #[test]
    fn nothing_is_interpolated_over_a_long_gap_nor_before_the_first_reading() {
        let mut pairing = Pairing::default();
        pairing.range(heard(0.5));
        pairing.ins(ins(1.0));
        assert_eq!(pairing.next(), Some(Outcome::Unpaired(heard(0.5))));
        pairing.range(heard(2.0));
        pairing.ins(ins(2.5));
        assert_eq!(pairing.next(), Some(Outcome::Unpaired(heard(2.0))));
    }

    #[test]
    fn ranges_do_not_wait_for_dead_reckoning_that_has_ended() {
        let mut pairing = Pairing::default();
        pairing.ins(ins(1.0));
        pairing.range(heard(1.5));
        pairing.range(heard(2.0));
        assert_eq!(pairing.next(), None);
        pairing.range(heard(2.75));
        assert_eq!(pairing.next(), Some(Outcome::Unpaired(heard(1.5))));
        assert_eq!(pairing.next(), None);
        let rest: Vec<Heard> = pairing.rest().collect();
        assert_eq!(rest, [heard(2.0), heard(2.75)]);
    }
}
