//! The tag from dead reckoning as it is (paper Eq. 4): the coarse fix after the exploratory flight,
//! and all there is in the variants without joint optimisation.
//!
//! ```text
//! p_tag = argmin_p sum_t (|p - p_INS(t)| - D_UWB(t))^2
//! ```
//!
//! Downhill from where the tag is believed to be: mirror images may fit as well, and the last belief
//! is all that the paper has to tell them apart. [`crate::multilaterate`] looks for them.

use nalgebra::Vector3;

use super::segment::Segment;
use crate::kernel::Kernel;
use crate::lm::{LmOptions, minimise};
use crate::range_model::{RangeProblem, Sample, State, Unknowns};

const UNKNOWNS: Unknowns = Unknowns {
    free: [true, true, true, false],
    prior_bias: 0.0,
    prior_weight: 0.0,
};

/// The nearest minimum to `tag_m`, by Levenberg-Marquardt. `None` with fewer ranges than unknowns.
pub(super) fn fit(segments: &[Segment], tag_m: Vector3<f64>) -> Option<Vector3<f64>> {
    let ranges = segments.iter().flat_map(|segment| &segment.ranges);
    let samples: Vec<Sample> = ranges
        .map(|range| Sample {
            position: range.reckoned_m - tag_m,
            range: range.range_m,
            inv_sigma: 1.0,
        })
        .collect();
    if samples.len() < UNKNOWNS.count() {
        return None;
    }
    let problem = RangeProblem {
        samples: &samples,
        unknowns: &UNKNOWNS,
        kernel: Kernel::None,
        scale: 1.0,
        prior_factor: 1.0,
    };
    let end = minimise(&problem, State::zeros(), &LmOptions::default());
    Some(tag_m + end.x.xyz())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nova::open_loop::{Drift, TAG, flown};

    #[test]
    fn exact_readings_give_the_tag_back() {
        let found = fit(&flown(&Drift::none()), TAG + Vector3::new(3.0, -4.0, 2.0)).unwrap();
        assert!((found - TAG).norm() < 1e-3, "{found}");
    }

    #[test]
    fn the_vertical_plane_of_the_exploratory_flight_leaves_the_side_to_the_guess() {
        let explored = &flown(&Drift::none())[..2];
        let across = (explored[1].goal_m() - explored[1].start_m()).normalize();
        let normal = Vector3::new(-across.y, across.x, 0.0);
        let mirrored = TAG - normal * (2.0 * normal.dot(&(TAG - explored[0].start_m())));
        let offset = Vector3::new(1.0, 1.0, 1.0);
        for tag in [TAG, mirrored] {
            let found = fit(explored, tag + offset).unwrap();
            assert!((found - tag).norm() < 0.1, "{found} {tag}");
        }
    }

    #[test]
    fn too_few_ranges_give_nothing() {
        assert_eq!(fit(&[], Vector3::zeros()), None);
    }
}
