//! What lies on the platform: a marker in a marker (Miranda et al. 2022, Fig. 6).

use nalgebra::Vector2;

/// Cells along a side, the black border among them.
const CELLS: f64 = 6.0;
/// Inner cells of DICT_4X4_50, rows from above; 1 is white: numbers 2 and 7.
const LARGE: [[u8; 4]; 4] = [[0, 0, 1, 1], [0, 0, 1, 1], [0, 0, 1, 0], [1, 1, 0, 1]];
const SMALL: [[u8; 4]; 4] = [[1, 1, 0, 0], [0, 1, 0, 0], [1, 1, 1, 1], [0, 0, 1, 0]];
/// Half of the white platform, metres.
const PLATFORM_M: f64 = 0.5;
/// How much light comes back.
const WHITE: f64 = 0.9;
const BLACK: f64 = 0.05;

/// Two square markers of OpenCV's dictionary DICT_4X4_50, the small one in a white cell of the large one. The frame's origin is the middle of the
/// large one, x to its right, y to its top.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NestedMarker {
    /// Side of the large one, metres.
    pub large_m: f64,
    /// Side of the small one, metres.
    pub small_m: f64,
}

impl Default for NestedMarker {
    fn default() -> Self {
        Self {
            large_m: 0.8,
            small_m: 0.09,
        }
    }
}

impl NestedMarker {
    /// Number of the large one in its dictionary.
    pub const LARGE_ID: u32 = 2;
    /// Number of the small one.
    pub const SMALL_ID: u32 = 7;

    /// The middle of the small one: a white cell beside the middle.
    pub fn small_centre_m(&self) -> Vector2<f64> {
        Vector2::repeat(0.5 * self.large_m / CELLS)
    }

    /// Corners of a marker, clockwise from the upper left; `None` for a number that is neither's.
    pub fn corners_m(&self, id: u32) -> Option<[Vector2<f64>; 4]> {
        let (centre, side) = match id {
            Self::LARGE_ID => (Vector2::zeros(), self.large_m),
            Self::SMALL_ID => (self.small_centre_m(), self.small_m),
            _ => return None,
        };
        let corner = |x: f64, y: f64| centre + Vector2::new(x, y) * (0.5 * side);
        Some([
            corner(-1.0, 1.0),
            corner(1.0, 1.0),
            corner(1.0, -1.0),
            corner(-1.0, -1.0),
        ])
    }

    /// The part of the light that comes back from a place of the platform; `None` beside it.
    pub(super) fn albedo(&self, place_m: Vector2<f64>) -> Option<f64> {
        if place_m.amax() > PLATFORM_M {
            return None;
        }
        let small = cell(place_m - self.small_centre_m(), self.small_m, &SMALL);
        let white = match small {
            Some(white) => white,
            None => cell(place_m, self.large_m, &LARGE).unwrap_or(true),
        };
        Some(if white { WHITE } else { BLACK })
    }
}

/// Whether a marker is white there; `None` beside it.
fn cell(from_centre_m: Vector2<f64>, side_m: f64, inner: &[[u8; 4]; 4]) -> Option<bool> {
    let column = (from_centre_m.x / side_m + 0.5) * CELLS;
    let row = (0.5 - from_centre_m.y / side_m) * CELLS;
    let inside = |index: f64| (0.0..CELLS).contains(&index);
    if !(inside(column) && inside(row)) {
        return None;
    }
    // The border is black.
    let bit = (row as usize)
        .checked_sub(1)
        .and_then(|row| inner.get(row))
        .zip((column as usize).checked_sub(1))
        .and_then(|(cells, column)| cells.get(column));
    Some(bit == Some(&1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_small_marker_lies_in_a_white_cell_of_the_large_one_with_room_around_it() {
        let marker = NestedMarker::default();
        let [upper_left, ..] = marker.corners_m(NestedMarker::SMALL_ID).unwrap();
        let outside = upper_left + Vector2::new(-0.01, 0.01);
        assert_eq!(marker.albedo(outside), Some(WHITE));
        let inside = upper_left + Vector2::new(0.005, -0.005);
        assert_eq!(marker.albedo(inside), Some(BLACK));
        assert!(cell(marker.small_centre_m(), marker.large_m, &LARGE).unwrap());
    }

    #[test]
    fn beside_the_platform_there_is_ground() {
        let marker = NestedMarker::default();
        assert_eq!(marker.albedo(Vector2::new(0.51, 0.0)), None);
        assert_eq!(marker.albedo(Vector2::new(0.49, 0.0)), Some(WHITE));
        assert_eq!(marker.albedo(Vector2::new(0.39, 0.39)), Some(BLACK));
    }
}
