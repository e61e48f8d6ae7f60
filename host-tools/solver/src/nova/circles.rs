//! Where two circles meet.

use nalgebra::Vector2;

/// Centres nearer than this are one, metres.
const SAME_M: f64 = 1e-6;

/// What two distances from two centres leave open.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Meeting {
    /// The circles cross: one place on either side of the line through the centres.
    Twice([Vector2<f64>; 2]),
    /// They do not cross, as noise can have it: the place on the line through the centres midway
    /// between them.
    Nearly(Vector2<f64>),
    /// The centres are the same place.
    Nowhere,
}

/// Centres and radii in metres, radii not negative.
pub(super) fn meet(centres_m: [Vector2<f64>; 2], radii_m: [f64; 2]) -> Meeting {
    let [first, second] = centres_m;
    let [r1, r2] = radii_m;
    let apart = (second - first).norm();
    if apart < SAME_M {
        return Meeting::Nowhere;
    }
    let along = (second - first) / apart;
    if apart > r1 + r2 {
        // Each outside of the other.
        return Meeting::Nearly(first + along * (0.5 * (r1 + apart - r2)));
    }
    if apart < (r1 - r2).abs() {
        // One inside the other; they are closest on the side of the smaller one.
        let side = if r1 > r2 { 1.0 } else { -1.0 };
        return Meeting::Nearly(first + along * (0.5 * (side * r1 + apart + side * r2)));
    }
    let forward = (apart * apart + r1 * r1 - r2 * r2) / (2.0 * apart);
    let sideways = (r1 * r1 - forward * forward).max(0.0).sqrt();
    let left = Vector2::new(-along.y, along.x);
    let foot = first + along * forward;
    Meeting::Twice([foot + left * sideways, foot - left * sideways])
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn gap(place: Vector2<f64>, centre: Vector2<f64>, radius: f64) -> f64 {
        ((place - centre).norm() - radius).abs()
    }

    proptest! {
        #[test]
        fn crossings_lie_on_both_circles_and_near_misses_are_equally_near_to_both(
            x in -5.0..5.0, y in -5.0..5.0, r1 in 0.0..6.0, r2 in 0.0..6.0,
        ) {
            let centres = [Vector2::new(1.0, -2.0), Vector2::new(1.0 + x, -2.0 + y)];
            prop_assume!((centres[0] - centres[1]).norm() > 1e-3);
            match meet(centres, [r1, r2]) {
                Meeting::Twice(places) => for place in places {
                    prop_assert!(gap(place, centres[0], r1) < 1e-6);
                    prop_assert!(gap(place, centres[1], r2) < 1e-6);
                },
                Meeting::Nearly(place) => {
                    let gaps = [gap(place, centres[0], r1), gap(place, centres[1], r2)];
                    prop_assert!((gaps[0] - gaps[1]).abs() < 1e-9, "{:?}", gaps);
                    // No place has both gaps smaller: their sum is the distance of the circles.
                    let apart = (centres[0] - centres[1]).norm();
                    let distance = (apart - r1 - r2).max((r1 - r2).abs() - apart);
                    prop_assert!((gaps[0] + gaps[1] - distance).abs() < 1e-9);
                }
                Meeting::Nowhere => prop_assert!(false),
            }
        }
    }

    #[test]
    fn one_centre_leaves_everything_open() {
        let centre = Vector2::new(3.0, 4.0);
        assert_eq!(meet([centre, centre], [1.0, 1.0]), Meeting::Nowhere);
    }
}
