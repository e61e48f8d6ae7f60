//! Trajectory correction by a reliability-based moving average (paper Sec. IV-C).
//!
//! ```text
//! v_LPF(t) = beta_t v_INS(t) + (1 - beta_t) v_LPF(t-1)                                   (10)
//! v_UWB(t) = (D_UWB(t) - D_UWB(t-1)) / dt                                                (11)
//! rho_t    = exp(-|v_UWB(t) - v_INS(t).u(t)| / delta)                                    (12a)
//! beta_t   = max(beta_base rho_t, beta_min)   where D_UWB(t) and D_UWB(t-1) are there    (12b)
//!          = beta_raw                         otherwise
//! p_UAV(t) = p_UAV(t-1) + v_LPF(t) dt
//! ```
//!
//! Left open by the paper, and taken so:
//! - **Sign.** The distance grows with motion away from the tag, so here `u` points from the tag to
//!   the vehicle. With `u` towards the tag, as printed, consistent readings would differ by twice
//!   their size.
//! - **Height.** `v_INS` is the difference of neighbouring INS positions. Its vertical part counts in
//!   Eq. 12a, as a descent changes the distance too; the filter itself is horizontal, because height
//!   comes from the barometer (Eq. 1).
//! - **Direction.** `u(t)` is seen from the last corrected trajectory, so it does not depend on the
//!   parameters that are being tuned.

use nalgebra::{Vector2, Vector3};

use super::segment::Segment;

/// `theta`: the parameters of one segment's filter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EmaParameters {
    /// `delta`: disagreement of radial velocities that lowers reliability to 1/e, m/s.
    pub delta_m_s: f64,
    /// `beta_base`: weight of an INS velocity that the ranges confirm, 0 to 1.
    pub beta_base: f64,
    /// `beta_raw`: weight where ranges are missing, 0 to 1.
    pub beta_raw: f64,
}

impl EmaParameters {
    /// `beta_t`.
    #[inline]
    fn weight(&self, mismatch_m_s: Option<f64>, beta_min: f64) -> f64 {
        match mismatch_m_s {
            Some(mismatch) => {
                let reliability = (-mismatch / self.delta_m_s).exp();
                (self.beta_base * reliability).max(beta_min)
            }
            None => self.beta_raw,
        }
    }
}

/// What the INS says about one step, and what the ranges say to that.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Motion {
    pub(super) dt_s: f64,
    /// `v_INS(t)`, horizontal, m/s.
    pub(super) velocity_m_s: Vector2<f64>,
    /// `|v_UWB - v_INS.u|`, m/s; `None` where a range is missing.
    pub(super) mismatch_m_s: Option<f64>,
}

/// Motions of a segment from each step to the next, given a trajectory (one place a step) and a tag.
pub(super) fn motions(
    segment: &Segment,
    track_m: &[Vector3<f64>],
    tag_m: Vector3<f64>,
    into: &mut Vec<Motion>,
) {
    into.clear();
    let pairs = segment.steps.iter().zip(segment.steps.iter().skip(1));
    for ((before, step), vehicle_m) in pairs.zip(track_m.iter().skip(1)) {
        let dt_s = step.t_s - before.t_s;
        let velocity = (step.reckoned_m - before.reckoned_m) / dt_s;
        let away = (vehicle_m - tag_m).try_normalize(0.0);
        let mismatch_m_s = match (before.range, step.range, away) {
            (Some(first), Some(second), Some(u)) if second.t_s > first.t_s => {
                let by_range = (second.range_m - first.range_m) / (second.t_s - first.t_s);
                Some((by_range - velocity.dot(&u)).abs())
            }
            _ => None,
        };
        into.push(Motion {
            dt_s,
            velocity_m_s: velocity.xy(),
            mismatch_m_s,
        });
    }
}

/// Where the filter begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct EmaStart {
    /// `p_UAV` before the first motion, metres.
    pub(super) position_m: Vector2<f64>,
    /// `v_LPF` before it, m/s.
    pub(super) velocity_m_s: Vector2<f64>,
}

/// Runs the filter and hands out the place after each motion.
#[inline]
pub(super) fn filter(
    motions: &[Motion],
    theta: &EmaParameters,
    beta_min: f64,
    start: EmaStart,
    mut place: impl FnMut(&Motion, Vector2<f64>),
) {
    let (mut position_m, mut velocity_m_s) = (start.position_m, start.velocity_m_s);
    for motion in motions {
        let beta = theta.weight(motion.mismatch_m_s, beta_min);
        velocity_m_s += (motion.velocity_m_s - velocity_m_s) * beta;
        position_m += velocity_m_s * motion.dt_s;
        place(motion, position_m);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::navigation::{InsSample, RangeSample};
    use crate::nova::{Parameters, SegmentRecorder};

    const TAG: Vector3<f64> = Vector3::new(20.0, 0.0, 0.0);
    const BETA_MIN: f64 = 0.15;

    /// A leg along x at 1 m/s, ranged at each step; dead reckoning is too fast by `excess_m_s`.
    fn leg(excess_m_s: f64, ranges: bool) -> Segment {
        let start = Vector3::new(0.0, 0.0, 10.0);
        let reckoned = |t_s: f64| InsSample {
            t_s,
            position_m: start + Vector3::x() * (t_s * (1.0 + excess_m_s)),
        };
        let goal = start + Vector3::x() * 5.0;
        let mut recorder = SegmentRecorder::new(start, goal, reckoned(0.0), &Parameters::default());
        for i in 1..=50 {
            let t_s = 0.1 * f64::from(i);
            recorder.push_ins(reckoned(t_s));
            if ranges {
                let range_m = (start + Vector3::x() * t_s - TAG).norm();
                recorder.push_range(RangeSample { t_s, range_m });
            }
        }
        recorder.finish()
    }

    /// Where the vehicle truly was at the steps.
    fn truth(segment: &Segment) -> Vec<Vector3<f64>> {
        let place = |t_s: f64| segment.start_m() + Vector3::x() * t_s;
        segment.steps.iter().map(|step| place(step.t_s)).collect()
    }

    fn motions_of(segment: &Segment) -> Vec<Motion> {
        let mut found = Vec::new();
        motions(segment, &truth(segment), TAG, &mut found);
        found
    }

    #[test]
    fn the_mismatch_is_the_radial_part_of_the_velocity_error() {
        for error_m_s in [0.0, 0.3] {
            let segment = leg(error_m_s, true);
            let motions = motions_of(&segment);
            for (motion, place) in motions.iter().zip(truth(&segment).iter().skip(1)) {
                let radial = error_m_s * (TAG - place).normalize().x;
                let mismatch = motion.mismatch_m_s.unwrap();
                // The range changes along a chord, the velocity counts along its end's tangent.
                assert!((mismatch - radial).abs() < 0.02, "{mismatch} {radial}");
            }
        }
        assert!(
            motions_of(&leg(0.3, false))
                .iter()
                .all(|m| m.mismatch_m_s.is_none())
        );
    }

    #[test]
    fn the_filter_is_equation_10_written_out() {
        let motions = motions_of(&leg(0.3, true));
        let theta = EmaParameters {
            delta_m_s: 0.2,
            beta_base: 0.8,
            beta_raw: 0.5,
        };
        let start = EmaStart {
            position_m: Vector2::new(0.0, 0.0),
            velocity_m_s: Vector2::new(1.0, 0.0),
        };
        let (mut velocity, mut x) = (1.0, 0.0);
        let mut expected = motions.iter().map(|m| {
            let beta = match m.mismatch_m_s {
                Some(mismatch) => (0.8 * (-mismatch / 0.2_f64).exp()).max(BETA_MIN),
                None => 0.5,
            };
            velocity = beta * m.velocity_m_s.x + (1.0 - beta) * velocity;
            x += velocity * m.dt_s;
            x
        });
        filter(&motions, &theta, BETA_MIN, start, |_, place| {
            assert!((place.x - expected.next().unwrap()).abs() < 1e-12);
        });
        assert_eq!(expected.next(), None);
    }

    #[test]
    fn doubtful_velocities_weigh_beta_min_and_unranged_ones_beta_raw() {
        let theta = EmaParameters {
            delta_m_s: 0.01,
            beta_base: 0.9,
            beta_raw: 0.4,
        };
        assert_eq!(theta.weight(Some(5.0), BETA_MIN), BETA_MIN);
        assert_eq!(theta.weight(Some(0.0), BETA_MIN), 0.9);
        assert_eq!(theta.weight(None, BETA_MIN), 0.4);
    }

    #[test]
    fn a_tag_at_the_vehicle_has_no_direction_and_counts_as_unranged() {
        let segment = leg(0.0, true);
        let track: Vec<_> = segment.steps.iter().map(|s| s.reckoned_m).collect();
        let mut found = Vec::new();
        motions(&segment, &track, track[2], &mut found);
        assert_eq!(found[1].mismatch_m_s, None);
        assert!(found[2].mismatch_m_s.is_some());
    }
}
