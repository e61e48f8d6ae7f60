//! Explanations that are being tried: a search is spread over the next updates, so that none takes much longer than the others.

use super::elimination::Factor;
use super::hypothesis::Hypothesis;
use super::prior::Prior;
use super::record::{Growth, Record};

/// Slacks of the stages of a search, metres: from a start that may be far off first with ranges that are hardly
/// believed, then as they are.
pub(super) const FAR_OFF: &[f64] = &[3.0, 0.4, 0.0];
/// From a start that is nearly right.
pub(super) const NEARLY_RIGHT: &[f64] = &[0.0, 0.0];

/// An explanation on its way to a minimum.
#[derive(Debug, Clone)]
pub(super) struct Trial {
    hypothesis: Hypothesis,
    /// Slacks of the stages that are left.
    stages: &'static [f64],
}

impl Trial {
    pub(super) fn new(hypothesis: Hypothesis, stages: &'static [f64]) -> Self {
        Self { hypothesis, stages }
    }

    /// Goes on by a stage; whether there are more. `None` where it leads nowhere.
    pub(super) fn go_on(&mut self, record: &Record, factors: &mut Vec<Factor>) -> Option<bool> {
        let (&slack_m, rest) = self.stages.split_first()?;
        self.stages = rest;
        self.hypothesis.approach(slack_m, record, factors)?;
        Some(!rest.is_empty())
    }

    /// Where it came to, when there are no more stages.
    pub(super) fn result(self) -> Hypothesis {
        self.hypothesis
    }

    /// All stages at once.
    pub(super) fn conclude(
        mut self,
        record: &Record,
        factors: &mut Vec<Factor>,
    ) -> Option<Hypothesis> {
        while self.go_on(record, factors)? {}
        Some(self.hypothesis)
    }

    /// Follows the record after it took an observation.
    pub(super) fn follow(&mut self, growth: Growth, moved_by_s: f64) {
        self.hypothesis.follow(growth, moved_by_s);
    }

    /// Forgets the oldest knot; memory begins with `prior` now.
    pub(super) fn drop_first(&mut self, prior: Prior) {
        self.hypothesis.drop_first(prior);
    }
}
