//! What all trackers of a target have in common.

use super::motion::Belief;
use super::sighting::{Sighting, SightingFault};

/// Somebody who follows a target by sightings.
pub trait Tracker {
    /// Takes a sighting.
    ///
    /// # Errors
    /// [`SightingFault`]: nothing of it was used, and it was counted.
    fn observe(&mut self, sighting: &Sighting) -> Result<(), SightingFault>;

    /// What is believed at the time of the last sighting; the prior before the first.
    fn belief(&self) -> Belief;

    /// What became of the sightings.
    fn counts(&self) -> Counts;
}

impl<T: Tracker + ?Sized> Tracker for Box<T> {
    fn observe(&mut self, sighting: &Sighting) -> Result<(), SightingFault> {
        (**self).observe(sighting)
    }

    fn belief(&self) -> Belief {
        (**self).belief()
    }

    fn counts(&self) -> Counts {
        (**self).counts()
    }
}

/// What became of sightings.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Used.
    pub used: u64,
    /// Refused because a number could not be meant.
    pub bad: u64,
    /// Refused because they came in the wrong order.
    pub out_of_order: u64,
    /// Refused because too much time had passed.
    pub after_gap: u64,
}

impl Counts {
    pub(crate) fn note(&mut self, outcome: &Result<(), SightingFault>) {
        match outcome {
            Ok(()) => self.used += 1,
            Err(SightingFault::Order { .. }) => self.out_of_order += 1,
            Err(SightingFault::Gap { .. }) => self.after_gap += 1,
            Err(_) => self.bad += 1,
        }
    }

    /// All that were refused.
    pub fn refused(&self) -> u64 {
        self.bad + self.out_of_order + self.after_gap
    }
}
