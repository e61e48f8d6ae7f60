//! What is seen of a target from a moving place: how far, and in which direction.

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

/// A distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range {
    /// Metres.
    pub range_m: f64,
    /// Standard deviation of its noise.
    pub sigma_m: f64,
}

/// A direction, as a unit vector in the sensor's frame: an antenna array's azimuth and elevation, two
/// receivers with one clock, or a camera give the same.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bearing {
    /// Unit vector from sensor to target.
    pub direction: Vector3<f64>,
    /// Standard deviation of its noise along each of two directions across it, radians.
    pub sigma_rad: f64,
}

impl Bearing {
    /// From azimuth (from x towards y) and elevation (from the x-y plane towards z), radians; eq. 21.
    pub fn from_angles(azimuth_rad: f64, elevation_rad: f64, sigma_rad: f64) -> Self {
        let (sa, ca) = azimuth_rad.sin_cos();
        let (se, ce) = elevation_rad.sin_cos();
        Self {
            direction: Vector3::new(ce * ca, ce * sa, se),
            sigma_rad,
        }
    }

    /// Azimuth and elevation, radians; eq. 11. Towards the zenith the azimuth means nothing and is 0.
    pub fn angles(&self) -> (f64, f64) {
        let d = &self.direction;
        (d.y.atan2(d.x), d.z.atan2(d.x.hypot(d.y)))
    }
}

/// Where the sensor is and how it is turned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorPose {
    /// In the global frame, metres.
    pub position_m: Vector3<f64>,
    /// Turns vectors of the global frame into those of the sensor, `R_SE`.
    pub to_sensor: UnitQuaternion<f64>,
    /// Covariance of the attitude's error as a rotation vector in the sensor's frame, rad^2; zero where
    /// the attitude is taken for known, as the paper does.
    pub attitude_covariance: Matrix3<f64>,
}

impl SensorPose {
    /// An attitude that is known.
    pub fn known(position_m: Vector3<f64>, to_sensor: UnitQuaternion<f64>) -> Self {
        Self {
            position_m,
            to_sensor,
            attitude_covariance: Matrix3::zeros(),
        }
    }
}

/// All that is seen at one moment. Either reading may be missing, and both: then only time passes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// Seconds on any clock.
    pub t_s: f64,
    /// The sensor.
    pub pose: SensorPose,
    /// How far.
    pub range: Option<Range>,
    /// In which direction.
    pub bearing: Option<Bearing>,
}

/// Why a sighting was refused. Nothing of it is used.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SightingFault {
    /// A number is NaN or infinite.
    #[error("{what} is not a finite number")]
    NotFinite {
        /// Which.
        what: &'static str,
    },
    /// A distance of nothing, or less.
    #[error("a range of {range_m} m: must be above 0")]
    Range {
        /// The distance.
        range_m: f64,
    },
    /// A standard deviation that is not above 0.
    #[error("{what} has a standard deviation of {sigma}: must be above 0")]
    Sigma {
        /// Of what.
        what: &'static str,
        /// What was given.
        sigma: f64,
    },
    /// A direction whose vector is not of length 1.
    #[error("the bearing's vector has a length of {length}: must be 1")]
    Direction {
        /// Its length.
        length: f64,
    },
    /// It is not newer than the one before.
    #[error("time {t_s} s does not come after {last_s} s")]
    Order {
        /// Its time.
        t_s: f64,
        /// Time of the last sighting that was used.
        last_s: f64,
    },
    /// It is so much newer than the one before that nothing of that still holds.
    #[error("{gap_s} s without a sighting: more than the {most_s} s that can be bridged")]
    Gap {
        /// Seconds since the last one.
        gap_s: f64,
        /// The longest.
        most_s: f64,
    },
}

impl Sighting {
    /// Whether all its numbers can be meant.
    pub fn check(&self) -> Result<(), SightingFault> {
        let finite = |what, fine: bool| match fine {
            true => Ok(()),
            false => Err(SightingFault::NotFinite { what }),
        };
        let all = |v: &Vector3<f64>| v.iter().all(|c| c.is_finite());
        finite("time", self.t_s.is_finite())?;
        finite("the sensor's place", all(&self.pose.position_m))?;
        let turn = self.pose.to_sensor.coords;
        finite(
            "the sensor's attitude",
            turn.iter().all(|c| c.is_finite()) && (turn.norm() - 1.0).abs() < 1e-6,
        )?;
        let attitude = &self.pose.attitude_covariance;
        finite(
            "the attitude's covariance",
            attitude.iter().all(|c| c.is_finite()),
        )?;
        if let Some(least) = attitude.diagonal().iter().copied().find(|v| *v < 0.0) {
            return Err(SightingFault::Sigma {
                what: "the attitude",
                sigma: least,
            });
        }
        if let Some(Range { range_m, sigma_m }) = self.range {
            finite("the range", range_m.is_finite() && sigma_m.is_finite())?;
            if range_m <= 0.0 {
                return Err(SightingFault::Range { range_m });
            }
            positive("the range", sigma_m)?;
        }
        if let Some(Bearing {
            direction,
            sigma_rad,
        }) = self.bearing
        {
            finite("the bearing", all(&direction) && sigma_rad.is_finite())?;
            positive("the bearing", sigma_rad)?;
            let length = direction.norm();
            if (length - 1.0).abs() > 1e-6 {
                return Err(SightingFault::Direction { length });
            }
        }
        Ok(())
    }

    /// Where the target is by this sighting alone, if it has both readings.
    pub fn place_m(&self) -> Option<Vector3<f64>> {
        let direction = self.pose.to_sensor.inverse() * self.bearing?.direction;
        Some(self.pose.position_m + direction * self.range?.range_m)
    }
}

fn positive(what: &'static str, sigma: f64) -> Result<(), SightingFault> {
    if sigma > 0.0 {
        Ok(())
    } else {
        Err(SightingFault::Sigma { what, sigma })
    }
}
