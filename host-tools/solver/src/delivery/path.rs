//! The path: up, a quarter circle, along, a quarter circle, down (Sec. 4.1, Eq. 1, 16, 17).
//!
//! ```text
//!      S2  ╭─────────────── S3 ───────────────╮  S4        z = h
//!          │ r                              r │
//!      ────┤                                  ├────        z = h - r
//!      S1  │                                  │  S5
//!        start (-d, 0, 0)                 goal (0, 0, 0)
//! ```

use nalgebra::Vector3;

/// Which part of space, and so of the path (Eq. 1).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Sector {
    /// S1: the climb.
    Climb,
    /// S2: from climb to cruise.
    FirstArc,
    /// S3: the cruise.
    Cruise,
    /// S4: from cruise to descent.
    SecondArc,
    /// S5: the descent.
    Descent,
}

/// Numbers that make no path.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PathFault {
    /// Height, radius or distance is not a positive number of reasonable size.
    #[error("{name} is {value} m: it has to be between 0.1 m and 100 km")]
    NotALength {
        /// Which.
        name: &'static str,
        /// Its value, metres.
        value: f64,
    },
    /// The arcs do not fit: radius above the height, or two radii beyond the distance.
    #[error("arcs of {radius_m} m do not fit between {separation_m} m at {height_m} m of height")]
    ArcsDoNotFit {
        /// r.
        radius_m: f64,
        /// h.
        height_m: f64,
        /// d.
        separation_m: f64,
    },
    /// Start and goal are at one place on the map.
    #[error(
        "start and goal are {separation_m} m apart on the map: no direction leads from one to the other"
    )]
    TooClose {
        /// How far apart, metres.
        separation_m: f64,
    },
}

/// The path between two places on the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeliveryPath {
    height_m: f64,
    radius_m: f64,
    separation_m: f64,
}

/// The second surface of the path at a place: its value (Eq. 17) and its gradient, a unit vector in the xz plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Surface {
    pub(super) value_m: f64,
    pub(super) gradient: Vector3<f64>,
}

impl DeliveryPath {
    /// A path `height_m` above the ground with arcs of `radius_m` between places `separation_m` apart: h, r, d.
    ///
    /// # Errors
    /// [`PathFault`] where they make no path.
    pub fn new(height_m: f64, radius_m: f64, separation_m: f64) -> Result<Self, PathFault> {
        for (name, value) in [
            ("the height", height_m),
            ("the radius", radius_m),
            ("the distance", separation_m),
        ] {
            if !(0.1..=1e5).contains(&value) {
                return Err(PathFault::NotALength { name, value });
            }
        }
        if radius_m > height_m || 2.0 * radius_m > separation_m {
            return Err(PathFault::ArcsDoNotFit {
                radius_m,
                height_m,
                separation_m,
            });
        }
        Ok(Self {
            height_m,
            radius_m,
            separation_m,
        })
    }

    /// Height of the cruise, h, metres.
    pub fn height_m(&self) -> f64 {
        self.height_m
    }

    /// Where it begins.
    pub fn start_m(&self) -> Vector3<f64> {
        Vector3::new(-self.separation_m, 0.0, 0.0)
    }

    /// The sector of a place (Eq. 1).
    pub fn sector(&self, place_m: &Vector3<f64>) -> Sector {
        let (h, r, d) = (self.height_m, self.radius_m, self.separation_m);
        let (x, z) = (place_m.x, place_m.z);
        if z <= h - r {
            if x <= -0.5 * d {
                Sector::Climb
            } else {
                Sector::Descent
            }
        } else if x < -d + r {
            Sector::FirstArc
        } else if x <= -r {
            Sector::Cruise
        } else {
            Sector::SecondArc
        }
    }

    /// The Lyapunov function V = (alpha_1^2 + alpha_2^2) / 2 (below Eq. 18), square metres.
    pub fn lyapunov_m2(&self, place_m: &Vector3<f64>) -> f64 {
        0.5 * (place_m.y.powi(2) + self.surface(place_m).value_m.powi(2))
    }

    /// Distance to the path as the surfaces measure it: sqrt(2 V), metres.
    pub fn distance_m(&self, place_m: &Vector3<f64>) -> f64 {
        (2.0 * self.lyapunov_m2(place_m)).sqrt()
    }

    /// Length of the path from its begin to the point beside the place, metres.
    pub fn along_m(&self, place_m: &Vector3<f64>) -> f64 {
        let (h, r, d) = (self.height_m, self.radius_m, self.separation_m);
        let quarter_m = 0.5 * std::f64::consts::PI * r;
        let cruise_m = d - 2.0 * r;
        match self.sector(place_m) {
            Sector::Climb => place_m.z,
            Sector::FirstArc => {
                let angle = (place_m.z - h + r).atan2(-d + r - place_m.x);
                h - r + r * angle.clamp(0.0, 0.5 * std::f64::consts::PI)
            }
            Sector::Cruise => h - r + quarter_m + place_m.x + d - r,
            Sector::SecondArc => {
                let angle = (place_m.x + r).atan2(place_m.z - h + r);
                let turned_m = r * angle.clamp(0.0, 0.5 * std::f64::consts::PI);
                h - r + quarter_m + cruise_m + turned_m
            }
            Sector::Descent => h - r + 2.0 * quarter_m + cruise_m + h - r - place_m.z,
        }
    }

    /// Where each sector ends along the path, metres, in order.
    pub(super) fn ends_m(&self) -> [f64; 5] {
        let (h, r, d) = (self.height_m, self.radius_m, self.separation_m);
        let quarter_m = 0.5 * std::f64::consts::PI * r;
        let mut so_far = 0.0;
        [h - r, quarter_m, d - 2.0 * r, quarter_m, h - r].map(|length_m| {
            so_far += length_m;
            so_far
        })
    }

    /// alpha_2 and its gradient (Eq. 17). In the centre of an arc, where the gradient has no direction, the one that leads
    /// out through the middle of the arc is taken.
    pub(super) fn surface(&self, place_m: &Vector3<f64>) -> Surface {
        let (h, r, d) = (self.height_m, self.radius_m, self.separation_m);
        let flat = |value_m, gradient| Surface { value_m, gradient };
        let arc = |centre_x: f64, outwards: f64| {
            let from_centre = Vector3::new(place_m.x - centre_x, 0.0, place_m.z - h + r);
            let middle = Vector3::new(outwards, 0.0, 1.0).normalize();
            Surface {
                value_m: from_centre.norm() - r,
                gradient: from_centre.try_normalize(1e-9).unwrap_or(middle),
            }
        };
        match self.sector(place_m) {
            Sector::Climb => flat(-place_m.x - d, -Vector3::x()),
            Sector::FirstArc => arc(-d + r, -1.0),
            Sector::Cruise => flat(place_m.z - h, Vector3::z()),
            Sector::SecondArc => arc(-r, 1.0),
            Sector::Descent => flat(place_m.x, Vector3::x()),
        }
    }
}
