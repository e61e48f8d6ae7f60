//! One door for all measurements: what is unusable is refused, what is suspicious is remembered.

use super::{Doubts, InputFault, InsSample, RangeSample};
use nalgebra::Vector3;

/// Longest silence that is nothing to mention, seconds.
const GAP_S: f64 = 2.0;
/// How long a gap is remembered, seconds.
const MEMORY_S: f64 = 10.0;
/// Longest time a reading may repeat itself. Barometer and accelerometer noise make two readings of
/// a live INS differ even at rest.
const FROZEN_S: f64 = 2.0;
/// Oldest dead reckoning a range may be paired with.
const PAIR_S: f64 = 1.0;

/// Checks order and sanity of what arrives, and keeps what is needed for [`Doubts`].
#[derive(Debug, Clone, Default)]
pub struct InputGate {
    last_ins: Option<InsSample>,
    last_range_s: Option<f64>,
    /// Since when dead reckoning has had its present value.
    unchanged_since_s: f64,
    last_gap_end_s: Option<f64>,
}

impl InputGate {
    /// Lets a reading of dead reckoning in.
    ///
    /// # Errors
    /// [`InputFault`]; nothing has changed then.
    pub fn admit_ins(&mut self, sample: InsSample) -> Result<(), InputFault> {
        sample.validate()?;
        match self.last_ins {
            Some(last) => {
                after(sample.t_s, last.t_s)?;
                self.note_gap(last.t_s, sample.t_s);
                if !same(&sample.position_m, &last.position_m) {
                    self.unchanged_since_s = sample.t_s;
                }
            }
            None => self.unchanged_since_s = sample.t_s,
        }
        self.last_ins = Some(sample);
        Ok(())
    }

    /// Lets a range in.
    ///
    /// # Errors
    /// [`InputFault`]; nothing has changed then.
    pub fn admit_range(&mut self, sample: RangeSample) -> Result<(), InputFault> {
        sample.validate()?;
        if let Some(last_s) = self.last_range_s {
            after(sample.t_s, last_s)?;
        }
        let near = |ins: InsSample| (0.0..=PAIR_S).contains(&(sample.t_s - ins.t_s));
        if !self.last_ins.is_some_and(near) {
            return Err(InputFault::NoInsNearby { t_s: sample.t_s });
        }
        if let Some(last_s) = self.last_range_s {
            self.note_gap(last_s, sample.t_s);
        }
        self.last_range_s = Some(sample.t_s);
        Ok(())
    }

    /// The newest admitted reading of dead reckoning.
    pub fn last_ins(&self) -> Option<InsSample> {
        self.last_ins
    }

    /// What arrival times and frozen readings speak against an estimate. The other doubts are for
    /// the navigator to fill in.
    pub fn doubts(&self) -> Doubts {
        let Some(last) = self.last_ins else {
            return Doubts::default();
        };
        let now_s = self.last_range_s.map_or(last.t_s, |t_s| t_s.max(last.t_s));
        let silent = self.last_range_s.is_some_and(|t_s| now_s - t_s > GAP_S);
        let recent = |end_s: f64| now_s - end_s < MEMORY_S;
        Doubts {
            gap: silent || self.last_gap_end_s.is_some_and(recent),
            frozen_ins: last.t_s - self.unchanged_since_s > FROZEN_S,
            ..Doubts::default()
        }
    }

    fn note_gap(&mut self, from_s: f64, to_s: f64) {
        if to_s - from_s > GAP_S {
            self.last_gap_end_s = Some(to_s);
        }
    }
}

/// Equal to the last bit.
fn same(a: &Vector3<f64>, b: &Vector3<f64>) -> bool {
    a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits())
}

fn after(t_s: f64, last_s: f64) -> Result<(), InputFault> {
    if t_s > last_s {
        Ok(())
    } else {
        Err(InputFault::TimeNotIncreasing { t_s, last_s })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ins(t_s: f64) -> InsSample {
        InsSample {
            t_s,
            position_m: Vector3::new(t_s, 0.0, 30.0),
        }
    }

    fn range(t_s: f64) -> RangeSample {
        RangeSample { t_s, range_m: 20.0 }
    }

    #[test]
    fn time_going_back_is_refused_and_changes_nothing() {
        let mut gate = InputGate::default();
        gate.admit_ins(ins(1.0)).unwrap();
        gate.admit_range(range(1.0)).unwrap();
        for t_s in [1.0, 0.5] {
            let fault = Err(InputFault::TimeNotIncreasing { t_s, last_s: 1.0 });
            assert_eq!(gate.admit_ins(ins(t_s)), fault);
            assert_eq!(gate.admit_range(range(t_s)), fault);
        }
        assert_eq!(gate.last_ins(), Some(ins(1.0)));
        gate.admit_range(range(1.1)).unwrap();
    }

    #[test]
    fn nan_and_infinity_are_refused() {
        let mut gate = InputGate::default();
        gate.admit_ins(ins(1.0)).unwrap();
        for bad in [f64::NAN, f64::INFINITY] {
            assert_eq!(gate.admit_ins(ins(bad)), Err(InputFault::NotFinite));
            assert_eq!(gate.admit_range(range(bad)), Err(InputFault::NotFinite));
            let sample = RangeSample {
                t_s: 2.0,
                range_m: bad,
            };
            assert_eq!(gate.admit_range(sample), Err(InputFault::NotFinite));
        }
    }

    #[test]
    fn a_range_without_dead_reckoning_nearby_is_refused() {
        let mut gate = InputGate::default();
        let fault = |t_s| Err(InputFault::NoInsNearby { t_s });
        assert_eq!(gate.admit_range(range(0.0)), fault(0.0));
        gate.admit_ins(ins(1.0)).unwrap();
        assert_eq!(gate.admit_range(range(2.5)), fault(2.5));
        gate.admit_range(range(1.5)).unwrap();
    }

    #[test]
    fn a_gap_is_remembered_for_ten_seconds() {
        let mut gate = InputGate::default();
        gate.admit_ins(ins(0.0)).unwrap();
        gate.admit_ins(ins(3.0)).unwrap();
        assert!(gate.doubts().gap);
        for i in 4..=12 {
            gate.admit_ins(ins(f64::from(i))).unwrap();
        }
        assert!(gate.doubts().gap);
        gate.admit_ins(ins(13.5)).unwrap();
        assert!(!gate.doubts().gap);
    }

    #[test]
    fn dead_reckoning_that_repeats_itself_is_called_frozen_until_it_moves() {
        let mut gate = InputGate::default();
        for i in 0..30 {
            let sample = InsSample {
                t_s: 0.1 * f64::from(i),
                position_m: Vector3::new(1.0, 2.0, 3.0),
            };
            gate.admit_ins(sample).unwrap();
        }
        assert!(gate.doubts().frozen_ins);
        gate.admit_ins(ins(3.0)).unwrap();
        assert!(!gate.doubts().frozen_ins);
    }
}
