//! Joint optimisation of trajectory and tag (paper Sec. IV-C).
//!
//! Eq. 9 weighs a trajectory's agreement with dead reckoning against its agreement with the ranges.
//! Instead of minimising it directly, the paper alternates: correct the trajectory for the tag as it
//! is believed to be, then fit the tag to the corrected trajectory, until the tag rests.
//!
//! # The algorithm, step by step
//! Given segments `j` with steps `t` (0.5 s apart; time, INS position, range or none), their ranges
//! (10 Hz), and the last tag `p`:
//!
//! 1. A new segment's trajectory begins as its INS positions, moved horizontally so that the first
//!    lies at the segment's start.
//! 2. For each segment:
//!    1. `v_INS(t)` and `m(t) = |v_UWB(t) - v_INS(t).u(t)|` for each step but the first, with `u` from
//!       `p` to the segment's last trajectory (`ema.rs`).
//!    2. `theta = argmin J` by Bayesian optimisation with 25 evaluations over `ln delta` in `[ln 0.01,
//!       ln 2]`, `beta_base` and `beta_raw` in `[beta_min, 1]`: first the last `theta` if there is
//!       one, then 8 points spread evenly, then where a Gaussian process promises the largest
//!       expected improvement (`tuning.rs`, [`crate::bayes_opt`]). `J` is the mean squared horizontal
//!       distance of the filtered trajectory from the nominal one.
//!    3. The new trajectory: Eq. 10 with that `theta` from the segment's start, `v_LPF(0)` being the
//!       nominal velocity (start to waypoint over duration); heights are the INS's.
//! 3. `p' = argmin` of Eq. 13 over all ranges of all segments by Adam from `p` (`adam.rs`,
//!    `tag_fit.rs`). A range is measured from the trajectory at its time: horizontally between
//!    steps by a straight line, in height where the INS was then. `L_j` is the length of the leg.
//! 4. If `|p' - p| < epsilon` or after `Max_opt` rounds stop; else `p = p'` and back to 2.
//!
//! Each segment starts at the waypoint of the one before: the vehicle was told to go there and said
//! that it had arrived. That is the "translation-only" correction; what drifts within a leg does not
//! carry over to the next.

use nalgebra::Vector3;

use super::adam::Adam;
use super::ema::{EmaParameters, EmaStart, Motion, filter, motions};
use super::parameters::Parameters;
use super::segment::{RangePoint, Segment};
use super::tag_fit::TagFit;
use super::tuning::{Task, Tuner};

/// Alternates between trajectory and tag. One optimiser serves one flight: it keeps the trajectory
/// from one call to the next, and its memory.
#[derive(Debug, Clone)]
pub struct JointOptimiser {
    max_alternations: u32,
    epsilon_m: f64,
    beta_min: f64,
    adam: Adam,
    tuner: Tuner,
    tracks: Vec<Track>,
    fit: TagFit,
    /// Of the segment at hand.
    motions: Vec<Motion>,
}

/// Corrected trajectory of a segment.
#[derive(Debug, Clone)]
struct Track {
    /// One a step.
    places_m: Vec<Vector3<f64>>,
    theta: Option<EmaParameters>,
}

/// What a joint optimisation found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointFit {
    /// The tag, metres; as it was given where there are fewer ranges than unknowns, or none of the
    /// places tried fits better.
    pub tag_m: Vector3<f64>,
    /// Rounds of correcting the trajectory and fitting the tag.
    pub alternations: u32,
    /// Whether the tag came to rest before rounds ran out.
    pub converged: bool,
}

impl JointOptimiser {
    /// For the beginning of a flight. `seed` shifts the points that the Bayesian optimisation tries.
    pub fn new(parameters: &Parameters, seed: u64) -> Self {
        Self {
            max_alternations: parameters.max_alternations,
            epsilon_m: parameters.epsilon_m,
            beta_min: parameters.beta_min,
            adam: Adam {
                learning_rate: parameters.adam_learning_rate,
                iterations: parameters.adam_iterations,
                velocity: parameters.adam_velocity,
            },
            tuner: Tuner::new(parameters.tuning_evaluations, parameters.beta_min, seed),
            tracks: Vec::new(),
            fit: TagFit::default(),
            motions: Vec::new(),
        }
    }

    /// Corrects the trajectory over all segments of the flight so far and finds the tag, beginning at
    /// `tag_m`. Segments seen in earlier calls must be the same.
    pub fn optimise(&mut self, segments: &[Segment], tag_m: Vector3<f64>) -> JointFit {
        let mut found = JointFit {
            tag_m,
            alternations: 0,
            converged: false,
        };
        while found.alternations < self.max_alternations && !found.converged {
            self.correct_trajectory(segments, found.tag_m);
            let before_m = found.tag_m;
            found.tag_m = self.fit.solve(before_m, &self.adam).unwrap_or(before_m);
            found.alternations += 1;
            found.converged = (found.tag_m - before_m).norm() < self.epsilon_m;
        }
        found
    }

    /// The first half of a round: the trajectory for a tag that is given. [`Self::loss_m`] then
    /// refers to it.
    pub fn correct_trajectory(&mut self, segments: &[Segment], tag_m: Vector3<f64>) {
        self.tracks.truncate(segments.len());
        let known = self.tracks.len();
        self.tracks
            .extend(segments.iter().skip(known).map(Track::uncorrected));
        for (segment, track) in segments.iter().zip(&mut self.tracks) {
            motions(segment, &track.places_m, tag_m, &mut self.motions);
            let nominal = EmaStart {
                position_m: segment.start_m().xy(),
                velocity_m_s: segment.nominal_velocity_m_s().xy(),
            };
            let task = Task {
                motions: &self.motions,
                nominal,
            };
            let theta = self.tuner.tune(&task, track.theta);
            track.theta = Some(theta);
            let mut places = track.places_m.iter_mut().skip(1);
            filter(&self.motions, &theta, self.beta_min, nominal, |_, xy| {
                if let Some(place) = places.next() {
                    (place.x, place.y) = (xy.x, xy.y);
                }
            });
        }
        let rows = segments.iter().zip(&self.tracks);
        self.fit.fill(rows.flat_map(|(segment, track)| {
            let weight = 1.0 / segment.length_m();
            let placed =
                move |range: &RangePoint| Some((track.place_of(range)?, range.range_m, weight));
            segment.ranges.iter().filter_map(placed)
        }));
    }

    /// The loss of Eq. 13 for a tag at `place_m` with the last corrected trajectory, metres.
    pub fn loss_m(&self, place_m: Vector3<f64>) -> f64 {
        self.fit.loss(&place_m)
    }

    /// Corrected trajectory of a segment, by its index: one place a step, metres. Empty before the
    /// segment has been seen.
    pub fn track_m(&self, segment: usize) -> &[Vector3<f64>] {
        self.tracks
            .get(segment)
            .map_or(&[], |track| track.places_m.as_slice())
    }

    /// Parameters of a segment's filter, by its index.
    pub fn theta(&self, segment: usize) -> Option<EmaParameters> {
        self.tracks.get(segment)?.theta
    }
}

impl Track {
    /// Dead reckoning, moved horizontally to the segment's start.
    fn uncorrected(segment: &Segment) -> Self {
        let first_m = segment.steps.first().map(|step| step.reckoned_m);
        let mut shift = first_m.map_or_else(Vector3::zeros, |m| segment.start_m() - m);
        shift.z = 0.0;
        Self {
            places_m: segment.steps.iter().map(|s| s.reckoned_m + shift).collect(),
            theta: None,
        }
    }

    /// Where a range was measured.
    fn place_of(&self, range: &RangePoint) -> Option<Vector3<f64>> {
        let from = self.places_m.get(range.step)?;
        let to = self.places_m.get(range.step + 1).unwrap_or(from);
        let mut place = from.lerp(to, range.part);
        place.z = range.reckoned_m.z;
        Some(place)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nova::open_loop::{Drift, TAG, flown};

    fn optimiser() -> JointOptimiser {
        JointOptimiser::new(&Parameters::default(), 0)
    }

    fn guess() -> Vector3<f64> {
        TAG + Vector3::new(3.0, -4.0, 2.0)
    }

    #[test]
    fn without_errors_tag_and_trajectory_are_found() {
        let segments = flown(&Drift::none());
        let mut joint = optimiser();
        let fit = joint.optimise(&segments, guess());
        assert!(fit.converged && (fit.tag_m - TAG).norm() < 0.1, "{fit:?}");
        for (j, segment) in segments.iter().enumerate() {
            let end = joint.track_m(j).last().unwrap();
            assert!((end - segment.goal_m()).norm() < 0.05, "{j}: {end}");
        }
    }

    #[test]
    fn drifting_dead_reckoning_is_corrected_towards_the_plan() {
        let segments = flown(&Drift::strong());
        let mut joint = optimiser();
        let fit = joint.optimise(&segments, guess());
        for (j, segment) in segments.iter().enumerate() {
            let reckoned = segment.steps.last().unwrap().reckoned_m;
            let shift = segment.start_m() - segment.steps[0].reckoned_m;
            let uncorrected = (reckoned + shift - segment.goal_m()).xy().norm();
            let corrected = (joint.track_m(j).last().unwrap() - segment.goal_m())
                .xy()
                .norm();
            assert!(
                corrected <= uncorrected + 0.02,
                "{j}: {corrected} {uncorrected}"
            );
        }
        let by_reckoning = crate::nova::multilateration::fit(&segments, guess()).unwrap();
        let [joint_m, reckoned_m] = [fit.tag_m, by_reckoning].map(|p| (p - TAG).xy().norm());
        assert!(joint_m < 0.5 * reckoned_m, "{joint_m} {reckoned_m}");
    }

    #[test]
    fn the_same_flight_gives_the_same_numbers() {
        let segments = flown(&Drift::strong());
        let fits = [(); 2].map(|()| optimiser().optimise(&segments, guess()));
        assert_eq!(fits[0], fits[1]);
    }

    #[test]
    fn a_growing_flight_keeps_its_earlier_trajectory_in_memory() {
        let segments = flown(&Drift::strong());
        let mut joint = optimiser();
        let mut tag_m = guess();
        for n in 2..=segments.len() {
            tag_m = joint.optimise(&segments[..n], tag_m).tag_m;
            assert!(joint.theta(n - 1).is_some() && joint.theta(n).is_none());
        }
        assert!((tag_m - TAG).xy().norm() < 1.0, "{tag_m}");
    }

    #[test]
    fn without_enough_ranges_the_tag_stays() {
        let mut joint = optimiser();
        let fit = joint.optimise(&[], guess());
        assert!(fit.converged && fit.tag_m == guess());
        let mut segments = flown(&Drift::none());
        for segment in &mut segments {
            segment.ranges.clear();
        }
        assert_eq!(joint.optimise(&segments, guess()).tag_m, guess());
    }

    #[test]
    fn rounds_end_at_max_opt() {
        let restless = Parameters {
            epsilon_m: 0.0,
            ..Parameters::default()
        };
        let segments = flown(&Drift::none());
        let fit = JointOptimiser::new(&restless, 0).optimise(&segments, guess());
        assert_eq!((fit.alternations, fit.converged), (20, false));
    }

    #[test]
    fn the_truth_has_a_smaller_loss_than_its_mirror_image() {
        let segments = flown(&Drift::strong());
        let mut joint = optimiser();
        joint.correct_trajectory(&segments, TAG);
        let mirrored = Vector3::new(TAG.x, -TAG.y, TAG.z);
        assert!(joint.loss_m(TAG) < 0.1 * joint.loss_m(mirrored));
    }
}
