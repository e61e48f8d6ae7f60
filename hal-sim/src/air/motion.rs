//! Where a board is.

use std::fmt;

use crate::time::SimTime;

/// Position in metres, local ENU.
pub type Position = [f64; 3];

/// A board's position over true time.
pub enum Motion {
    /// Stays where it is.
    Fixed(Position),
    /// Follows a function of the time in seconds. It must give the same answer whenever it is asked about the same
    /// time, which may lie a few milliseconds ahead (a frame's RMARKER is placed when its preamble starts).
    Path(Box<dyn Fn(f64) -> Position>),
}

impl Motion {
    /// At rest.
    pub fn fixed(position_m: Position) -> Self {
        Motion::Fixed(position_m)
    }

    /// Moving along `path(t_s)`.
    pub fn path(path: impl Fn(f64) -> Position + 'static) -> Self {
        Motion::Path(Box::new(path))
    }

    /// Position at `t`.
    pub fn at(&self, t: SimTime) -> Position {
        match self {
            Motion::Fixed(position) => *position,
            Motion::Path(path) => path(t.as_s_f64()),
        }
    }
}

impl Default for Motion {
    fn default() -> Self {
        Motion::Fixed([0.0; 3])
    }
}

impl fmt::Debug for Motion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Motion::Fixed(position) => f.debug_tuple("Fixed").field(position).finish(),
            Motion::Path(_) => f.write_str("Path(..)"),
        }
    }
}

/// Straight-line distance in metres.
pub fn distance_m(a: Position, b: Position) -> f64 {
    a.iter()
        .zip(b)
        .map(|(a, b)| (a - b) * (a - b))
        .sum::<f64>()
        .sqrt()
}
