//! Where the tag was: a curve through positions known at single moments.
//!
//! Between two points it is the cubic whose ends have the points' velocities (Hermite), and those
//! come from the parabola through a point and its two neighbours. Straight lines would put corners
//! into the velocity, by which the time offset is found, and would cut curves short by `a dt^2 / 8`.

use nalgebra::Vector3;

use crate::measurement::LARGEST_LENGTH_M;

/// A position known at a moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackPoint {
    /// Seconds on the clock of the track.
    pub t_s: f64,
    /// Local ENU frame, metres.
    pub position_m: Vector3<f64>,
}

/// Why points make no track.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum TrackFault {
    /// There is nothing to interpolate.
    #[error("{got} points at different times are too few; at least 2 are needed")]
    TooShort {
        /// How many points remain.
        got: usize,
    },
    /// A time is NaN or infinite.
    #[error("point {index}: the time is not a finite number")]
    Time {
        /// Its place in the slice that was given, from 0.
        index: usize,
    },
    /// A coordinate is NaN, infinite or absurdly large.
    #[error("point {index}: the position is not finite or absurdly large")]
    Position {
        /// Its place in the slice that was given, from 0.
        index: usize,
    },
}

/// Positions over time.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    points: Vec<TrackPoint>,
    /// One a point, m/s.
    velocities: Vec<Vector3<f64>>,
    reordered: usize,
    repeated: usize,
}

impl Track {
    /// Of points in any order. Of points at the same time the first given counts.
    ///
    /// # Errors
    /// [`TrackFault`] for numbers that cannot be meant and for fewer than two moments.
    pub fn new(points: &[TrackPoint]) -> Result<Self, TrackFault> {
        for (index, point) in points.iter().enumerate() {
            if !point.t_s.is_finite() {
                return Err(TrackFault::Time { index });
            }
            let usable = |length: &f64| length.abs() <= LARGEST_LENGTH_M;
            if !point.position_m.iter().all(usable) {
                return Err(TrackFault::Position { index });
            }
        }
        let late = |pair: &&[TrackPoint]| matches!(pair, [a, b] if b.t_s < a.t_s);
        let reordered = points.windows(2).filter(late).count();
        let mut points = points.to_vec();
        points.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
        let given = points.len();
        points.dedup_by(|later, first| later.t_s == first.t_s);
        if points.len() < 2 {
            return Err(TrackFault::TooShort { got: points.len() });
        }
        Ok(Self {
            repeated: given - points.len(),
            velocities: velocities(&points),
            points,
            reordered,
        })
    }

    /// Points in order of time, each time once.
    pub fn points(&self) -> &[TrackPoint] {
        &self.points
    }

    /// How many points came before an earlier one, and how many had the time of another.
    pub fn disorder(&self) -> (usize, usize) {
        (self.reordered, self.repeated)
    }

    /// Mean of the points: where the paper starts its search.
    pub fn mean_m(&self) -> Vector3<f64> {
        let sum: Vector3<f64> = self.points.iter().map(|point| point.position_m).sum();
        sum / self.points.len() as f64
    }

    /// Position and velocity (m, m/s) at a moment between two points that are no further apart than
    /// `max_gap_s`; `None` before, after and in longer gaps.
    pub fn at(&self, t_s: f64, max_gap_s: f64) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let after = self.points.partition_point(|point| point.t_s < t_s);
        let segment = after.saturating_sub(1);
        let (from, to) = (self.points.get(segment)?, self.points.get(segment + 1)?);
        let inside = (from.t_s..=to.t_s).contains(&t_s) && to.t_s - from.t_s <= max_gap_s;
        inside.then(|| self.on(segment, t_s))?
    }

    /// The same for any moment: gaps are bridged, and before and after the velocity of the end holds.
    /// `hint` is the segment of the last call and is set to that of this one.
    pub(super) fn anywhere(
        &self,
        t_s: f64,
        hint: &mut usize,
    ) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let (first, last) = (self.points.first()?, self.points.last()?);
        for (end, velocity) in [
            (first, self.velocities.first()?),
            (last, self.velocities.last()?),
        ] {
            let beyond = t_s - end.t_s;
            if (end.t_s == first.t_s && beyond < 0.0) || (end.t_s == last.t_s && beyond > 0.0) {
                return Some((end.position_m + velocity * beyond, *velocity));
            }
        }
        while self.points.get(*hint + 1).is_some_and(|p| p.t_s < t_s) {
            *hint += 1;
        }
        if self.points.get(*hint).is_none_or(|p| p.t_s > t_s) {
            let after = self.points.partition_point(|point| point.t_s < t_s);
            *hint = after.saturating_sub(1);
        }
        self.on(*hint, t_s)
    }

    /// The cubic between point `segment` and the next.
    fn on(&self, segment: usize, t_s: f64) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let (from, to) = (self.points.get(segment)?, self.points.get(segment + 1)?);
        let (v0, v1) = (
            self.velocities.get(segment)?,
            self.velocities.get(segment + 1)?,
        );
        let h = to.t_s - from.t_s;
        let u = (t_s - from.t_s) / h;
        let (p0, p1) = (from.position_m, to.position_m);
        let chord = (p1 - p0) / h;
        // p = p0 + h u (v0 + u (c2 + u c3)), the coefficients in m/s.
        let c2 = chord * 3.0 - v0 * 2.0 - v1;
        let c3 = v0 + v1 - chord * 2.0;
        let position = p0 + (v0 + (c2 + c3 * u) * u) * (h * u);
        let velocity = v0 + (c2 * 2.0 + c3 * (3.0 * u)) * u;
        Some((position, velocity))
    }
}

/// Slope at each point of the parabola through it and its neighbours; at the ends of the chord.
fn velocities(points: &[TrackPoint]) -> Vec<Vector3<f64>> {
    let chord = |a: &TrackPoint, b: &TrackPoint| (b.position_m - a.position_m) / (b.t_s - a.t_s);
    let inner = points.windows(3).filter_map(|three| match three {
        [a, b, c] => {
            let (before, after) = (b.t_s - a.t_s, c.t_s - b.t_s);
            Some((chord(a, b) * after + chord(b, c) * before) / (before + after))
        }
        _ => None,
    });
    let end = |pair: Option<&[TrackPoint]>| match pair {
        Some([a, b]) => Some(chord(a, b)),
        _ => None,
    };
    end(points.get(..2))
        .into_iter()
        .chain(inner)
        .chain(end(points.get(points.len().saturating_sub(2)..)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn point(t_s: f64, x: f64, y: f64, z: f64) -> TrackPoint {
        TrackPoint {
            t_s,
            position_m: Vector3::new(x, y, z),
        }
    }

    #[test]
    fn points_out_of_order_are_sorted_and_counted() {
        let track = Track::new(&[
            point(2.0, 2.0, 0.0, 0.0),
            point(0.0, 0.0, 0.0, 0.0),
            point(1.0, 1.0, 0.0, 0.0),
            point(1.0, 9.0, 0.0, 0.0),
        ])
        .unwrap();
        assert_eq!(track.disorder(), (1, 1));
        let (p, v) = track.at(1.5, 1.0).unwrap();
        assert!((p.x - 1.5).abs() < 1e-12 && (v.x - 1.0).abs() < 1e-12);
    }

    #[test]
    fn gaps_and_times_outside_have_no_position() {
        let track = Track::new(&[
            point(0.0, 0.0, 0.0, 0.0),
            point(1.0, 1.0, 0.0, 0.0),
            point(9.0, 9.0, 0.0, 0.0),
        ])
        .unwrap();
        assert!(track.at(0.5, 2.0).is_some() && track.at(0.0, 2.0).is_some());
        for t_s in [-0.1, 5.0, 9.1, f64::NAN] {
            assert!(track.at(t_s, 2.0).is_none(), "{t_s}");
        }
    }

    #[test]
    fn faults_name_the_point() {
        let good = point(0.0, 0.0, 0.0, 0.0);
        assert_eq!(Track::new(&[good]), Err(TrackFault::TooShort { got: 1 }));
        assert_eq!(
            Track::new(&[good, point(f64::NAN, 0.0, 0.0, 0.0)]),
            Err(TrackFault::Time { index: 1 })
        );
        assert_eq!(
            Track::new(&[good, point(1.0, 0.0, f64::INFINITY, 0.0)]),
            Err(TrackFault::Position { index: 1 })
        );
    }

    proptest! {
        #[test]
        fn parabolas_are_followed_exactly_between_inner_points(
            a in -2.0..2.0f64, b in -5.0..5.0f64, t in 1.0..8.0f64, steps in prop::collection::vec(0.2..1.5f64, 12),
        ) {
            let mut at = 0.0f64;
            let points: Vec<_> = steps.iter().map(|step| {
                at += step;
                point(at, b * at + a * at * at, 0.0, -at)
            }).collect();
            let track = Track::new(&points).unwrap();
            let inner = points[1].t_s..=points[10].t_s;
            prop_assume!(inner.contains(&t));
            let (p, v) = track.at(t, 2.0).unwrap();
            prop_assert!((p.x - b * t - a * t * t).abs() < 1e-9 && (v.x - b - 2.0 * a * t).abs() < 1e-9);
            let mut hint = (steps.len() as f64 * (t - 1.0) / 7.0) as usize;
            let (q, _) = track.anywhere(t, &mut hint).unwrap();
            prop_assert!((p - q).norm() < 1e-9);
        }
    }
}
