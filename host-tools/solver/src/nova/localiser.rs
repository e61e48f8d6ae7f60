//! Where the tag is, by the method that a variant uses.

use nalgebra::Vector3;

use super::joint::JointOptimiser;
use super::multilateration;
use super::options::NovaOptions;
use super::segment::Segment;
use super::variants::LocalisationMethod;

/// Finds the tag from the segments flown so far.
#[derive(Debug, Clone)]
pub(super) struct Localiser {
    method: LocalisationMethod,
    joint: JointOptimiser,
    updates: u64,
}

impl Localiser {
    pub(super) fn new(options: &NovaOptions) -> Self {
        Self {
            method: options.switches.localisation,
            joint: JointOptimiser::new(&options.parameters, options.seed),
            updates: 0,
        }
    }

    /// How often the tag has been computed anew.
    pub(super) fn updates(&self) -> u64 {
        self.updates
    }

    /// The coarse fix that follows the exploratory flight; the first guess where nothing is located.
    pub(super) fn coarse(&mut self, segments: &[Segment], guess_m: Vector3<f64>) -> Vector3<f64> {
        if self.method == LocalisationMethod::None {
            return guess_m;
        }
        self.updates += 1;
        multilateration::fit(segments, guess_m).unwrap_or(guess_m)
    }

    /// The tag at a waypoint, given the last belief.
    pub(super) fn refine(&mut self, segments: &[Segment], tag_m: Vector3<f64>) -> Vector3<f64> {
        match self.method {
            LocalisationMethod::None => tag_m,
            LocalisationMethod::Multilateration => self.coarse(segments, tag_m),
            LocalisationMethod::Joint => {
                self.updates += 1;
                self.joint.optimise(segments, tag_m).tag_m
            }
        }
    }

    /// The candidates in order of the mid-flight loss (Eq. 13) over the whole flight, and the losses,
    /// metres; `tag_m` is the belief that the trajectory is corrected with.
    pub(super) fn rank(
        &mut self,
        segments: &[Segment],
        tag_m: Vector3<f64>,
        candidates_m: [Vector3<f64>; 2],
    ) -> [(Vector3<f64>, f64); 2] {
        self.updates += 1;
        self.joint.correct_trajectory(segments, tag_m);
        let [first, second] = candidates_m.map(|place| (place, self.joint.loss_m(place)));
        if second.1 < first.1 {
            [second, first]
        } else {
            [first, second]
        }
    }
}
