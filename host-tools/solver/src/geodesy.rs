//! Geodetic coordinates (WGS 84), ECEF, and local ENU frames.
//!
//! The conversions are those of `map_3d`; what is here is types that cannot be confused and angles in
//! degrees.

use map_3d::{Ellipsoid, ecef2geodetic, enu2uvw, geodetic2ecef};
use nalgebra::{Matrix3, Vector3};

/// A place on the WGS 84 ellipsoid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Geodetic {
    /// Latitude, degrees north.
    pub lat_deg: f64,
    /// Longitude, degrees east.
    pub lon_deg: f64,
    /// Height above the ellipsoid, metres.
    pub height_m: f64,
}

/// The coordinates are no place on Earth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("no place: latitudes are -90 to 90, longitudes -180 to 360 degrees, heights -10 to 100 km")]
pub struct NoPlace;

impl Geodetic {
    /// Checked coordinates.
    ///
    /// # Errors
    /// [`NoPlace`] for what is not finite or out of range.
    pub fn new(lat_deg: f64, lon_deg: f64, height_m: f64) -> Result<Self, NoPlace> {
        let sound = (-90.0..=90.0).contains(&lat_deg)
            && (-180.0..=360.0).contains(&lon_deg)
            && (-1e4..=1e5).contains(&height_m);
        sound
            .then_some(Self {
                lat_deg,
                lon_deg,
                height_m,
            })
            .ok_or(NoPlace)
    }

    /// Earth-centred, earth-fixed, metres.
    pub fn ecef_m(&self) -> Vector3<f64> {
        let (x, y, z) = geodetic2ecef(
            self.lat_deg.to_radians(),
            self.lon_deg.to_radians(),
            self.height_m,
            Ellipsoid::WGS84,
        );
        Vector3::new(x, y, z)
    }

    /// The place at these ECEF coordinates, metres.
    pub fn from_ecef_m(ecef_m: &Vector3<f64>) -> Self {
        let (lat, lon, height_m) = ecef2geodetic(ecef_m.x, ecef_m.y, ecef_m.z, Ellipsoid::WGS84);
        Self {
            lat_deg: lat.to_degrees(),
            lon_deg: lon.to_degrees(),
            height_m,
        }
    }
}

/// East, north and up at a place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalFrame {
    origin: Geodetic,
    origin_ecef_m: Vector3<f64>,
    /// Columns: east, north, up in ECEF.
    ecef_from_enu: Matrix3<f64>,
}

impl LocalFrame {
    /// With its origin there.
    pub fn at(origin: Geodetic) -> Self {
        let (lat, lon) = (origin.lat_deg.to_radians(), origin.lon_deg.to_radians());
        let axis = |e: f64, n: f64, u: f64| {
            let (x, y, z) = enu2uvw(e, n, u, lat, lon);
            Vector3::new(x, y, z)
        };
        Self {
            origin,
            origin_ecef_m: origin.ecef_m(),
            ecef_from_enu: Matrix3::from_columns(&[
                axis(1.0, 0.0, 0.0),
                axis(0.0, 1.0, 0.0),
                axis(0.0, 0.0, 1.0),
            ]),
        }
    }

    /// Its origin.
    pub fn origin(&self) -> Geodetic {
        self.origin
    }

    /// Turns vectors: `v_ecef = R v_enu`. `R_L^G` of the paper's Eq. 25.
    pub fn ecef_from_enu(&self) -> &Matrix3<f64> {
        &self.ecef_from_enu
    }

    /// A place in this frame as ECEF, metres.
    pub fn ecef_m(&self, enu_m: &Vector3<f64>) -> Vector3<f64> {
        self.origin_ecef_m + self.ecef_from_enu * enu_m
    }

    /// An ECEF place in this frame, metres.
    pub fn enu_m(&self, ecef_m: &Vector3<f64>) -> Vector3<f64> {
        self.ecef_from_enu.tr_mul(&(ecef_m - self.origin_ecef_m))
    }

    /// A geodetic place in this frame, metres.
    pub fn enu_of(&self, place: &Geodetic) -> Vector3<f64> {
        self.enu_m(&place.ecef_m())
    }

    /// A place in this frame as geodetic coordinates.
    pub fn geodetic(&self, enu_m: &Vector3<f64>) -> Geodetic {
        Geodetic::from_ecef_m(&self.ecef_m(enu_m))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn equator_at_greenwich_is_one_earth_radius_along_x() {
        let place = Geodetic::new(0.0, 0.0, 0.0).unwrap();
        assert!((place.ecef_m() - Vector3::new(6_378_137.0, 0.0, 0.0)).norm() < 1e-6);
        let frame = LocalFrame::at(place);
        assert!((frame.ecef_from_enu() * Vector3::z() - Vector3::x()).norm() < 1e-12);
        assert!((frame.ecef_from_enu() * Vector3::x() - Vector3::y()).norm() < 1e-12);
    }

    #[test]
    fn what_is_no_place_is_refused() {
        for (lat, lon, h) in [
            (91.0, 0.0, 0.0),
            (0.0, 400.0, 0.0),
            (0.0, 0.0, 1e6),
            (f64::NAN, 0.0, 0.0),
        ] {
            assert_eq!(Geodetic::new(lat, lon, h), Err(NoPlace));
        }
    }

    proptest! {
        #[test]
        fn there_and_back_ends_within_a_tenth_of_a_millimetre(
            lat in -89.0..89.0, lon in -179.0..179.0, h in -100.0..5000.0,
            e in -2000.0..2000.0, n in -2000.0..2000.0, u in -500.0..500.0,
        ) {
            let frame = LocalFrame::at(Geodetic::new(lat, lon, h).unwrap());
            let enu = Vector3::new(e, n, u);
            let back = frame.enu_of(&frame.geodetic(&enu));
            prop_assert!((back - enu).norm() < 1e-4, "{back}");
            prop_assert!((frame.enu_m(&frame.ecef_m(&enu)) - enu).norm() < 1e-8);
        }
    }
}
