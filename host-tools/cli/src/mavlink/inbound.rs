//! What an autopilot says, in SI units and our axes.

use super::frames::{
    Attitude, deg_from_e7, enu_from_ned, m_from_mm, m_s2_from_mg, pa_from_hpa, rad_s_from_mrad,
};
use mavlink::dialects::common::{GpsFixType, MavMessage};
use nalgebra::Vector3;
use serde::Serialize;

/// One reading of the vehicle's sensors or of its own estimate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Reading {
    /// ATTITUDE: turned by yaw about down, pitch about right, roll about forward.
    Attitude {
        roll_rad: f64,
        pitch_rad: f64,
        yaw_rad: f64,
    },
    /// LOCAL_POSITION_NED: its own estimate from its own origin, ENU.
    Local {
        position_m: [f64; 3],
        velocity_m_s: [f64; 3],
    },
    /// HIGHRES_IMU or SCALED_IMU: specific force and turning rate along forward, right, down.
    Imu {
        force_m_s2: [f64; 3],
        rate_rad_s: [f64; 3],
    },
    /// SCALED_PRESSURE, or HIGHRES_IMU of autopilots that send no other.
    Barometer { pressure_pa: f64 },
    /// GPS_RAW_INT with a fix in three dimensions; height above the geoid.
    Gps {
        lat_deg: f64,
        lon_deg: f64,
        height_m: f64,
        /// Horizontal, as the receiver says.
        sigma_m: Option<f64>,
    },
}

/// When a reading was taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Taken {
    /// On the autopilot's clock, microseconds.
    Boot(u64),
    /// The message does not say, or on another clock.
    Unknown,
}

/// A message holds numbers that are none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct NotFinite;

/// The readings in a message; none in those that we do not use.
pub(crate) fn readings(message: &MavMessage) -> Result<Vec<(Taken, Reading)>, NotFinite> {
    let ms = |ms: u32| Taken::Boot(u64::from(ms) * 1000);
    let found = match message {
        MavMessage::ATTITUDE(m) => vec![(
            ms(m.time_boot_ms),
            Reading::Attitude {
                roll_rad: m.roll.into(),
                pitch_rad: m.pitch.into(),
                yaw_rad: m.yaw.into(),
            },
        )],
        MavMessage::LOCAL_POSITION_NED(m) => vec![(
            ms(m.time_boot_ms),
            Reading::Local {
                position_m: enu_from_ned(vector([m.x, m.y, m.z])).into(),
                velocity_m_s: enu_from_ned(vector([m.vx, m.vy, m.vz])).into(),
            },
        )],
        MavMessage::HIGHRES_IMU(m) => {
            let taken = micros(m.time_usec);
            let imu = Reading::Imu {
                force_m_s2: vector([m.xacc, m.yacc, m.zacc]).into(),
                rate_rad_s: vector([m.xgyro, m.ygyro, m.zgyro]).into(),
            };
            let pressure_pa = pa_from_hpa(m.abs_pressure);
            vec![(taken, imu), (taken, Reading::Barometer { pressure_pa })]
        }
        MavMessage::SCALED_IMU(m) => vec![(
            ms(m.time_boot_ms),
            Reading::Imu {
                force_m_s2: [m.xacc, m.yacc, m.zacc].map(m_s2_from_mg),
                rate_rad_s: [m.xgyro, m.ygyro, m.zgyro].map(rad_s_from_mrad),
            },
        )],
        MavMessage::SCALED_PRESSURE(m) => vec![(
            ms(m.time_boot_ms),
            Reading::Barometer {
                pressure_pa: pa_from_hpa(m.press_abs),
            },
        )],
        MavMessage::GPS_RAW_INT(m) if has_place(m.fix_type) => vec![(
            micros(m.time_usec),
            Reading::Gps {
                lat_deg: deg_from_e7(m.lat),
                lon_deg: deg_from_e7(m.lon),
                height_m: m_from_mm(m.alt),
                // Millimetres; 0 from receivers that do not say.
                sigma_m: (m.h_acc > 0).then(|| f64::from(m.h_acc) * 1e-3),
            },
        )],
        _ => Vec::new(),
    };
    if found.iter().all(|(_, reading)| reading.is_finite()) {
        Ok(found)
    } else {
        Err(NotFinite)
    }
}

impl Reading {
    /// How the vehicle is turned, if this says so.
    pub(crate) fn attitude(&self) -> Option<Attitude> {
        match *self {
            Self::Attitude {
                roll_rad,
                pitch_rad,
                yaw_rad,
            } => Attitude::from_euler(roll_rad, pitch_rad, yaw_rad),
            _ => None,
        }
    }

    fn is_finite(&self) -> bool {
        let all = |numbers: &[f64]| numbers.iter().all(|number| number.is_finite());
        match self {
            Self::Attitude {
                roll_rad,
                pitch_rad,
                yaw_rad,
            } => all(&[*roll_rad, *pitch_rad, *yaw_rad]),
            Self::Local {
                position_m,
                velocity_m_s,
            } => all(position_m) && all(velocity_m_s),
            Self::Imu {
                force_m_s2,
                rate_rad_s,
            } => all(force_m_s2) && all(rate_rad_s),
            Self::Barometer { pressure_pa } => pressure_pa.is_finite(),
            // From integers.
            Self::Gps { .. } => true,
        }
    }
}

/// Times "since 1970 or since the start" are told apart by their size: three years.
fn micros(time_usec: u64) -> Taken {
    const LONGEST_UPTIME_US: u64 = 100_000_000_000_000;
    if (1..LONGEST_UPTIME_US).contains(&time_usec) {
        Taken::Boot(time_usec)
    } else {
        Taken::Unknown
    }
}

fn has_place(fix: GpsFixType) -> bool {
    use GpsFixType as Fix;
    matches!(
        fix,
        Fix::GPS_FIX_TYPE_3D_FIX
            | Fix::GPS_FIX_TYPE_DGPS
            | Fix::GPS_FIX_TYPE_RTK_FLOAT
            | Fix::GPS_FIX_TYPE_RTK_FIXED
            | Fix::GPS_FIX_TYPE_PPP
    )
}

fn vector(parts: [f32; 3]) -> Vector3<f64> {
    parts.map(f64::from).into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink::dialects::common::{
        GPS_RAW_INT_DATA, HIGHRES_IMU_DATA, LOCAL_POSITION_NED_DATA, SCALED_IMU_DATA,
    };

    #[test]
    fn a_place_north_east_and_below_is_told_east_north_up() {
        let message = MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
            time_boot_ms: 1500,
            x: 10.0,
            y: 2.0,
            z: -30.0,
            vx: 1.0,
            vy: -0.5,
            vz: 0.25,
        });
        let local = Reading::Local {
            position_m: [2.0, 10.0, 30.0],
            velocity_m_s: [-0.5, 1.0, -0.25],
        };
        assert_eq!(
            readings(&message),
            Ok(vec![(Taken::Boot(1_500_000), local)])
        );
    }

    #[test]
    fn units_are_si() {
        let imu = MavMessage::SCALED_IMU(SCALED_IMU_DATA {
            zacc: -1000,
            zgyro: 500,
            ..SCALED_IMU_DATA::default()
        });
        let found = readings(&imu).unwrap();
        let [
            (
                _,
                Reading::Imu {
                    force_m_s2,
                    rate_rad_s,
                },
            ),
        ] = found[..]
        else {
            panic!();
        };
        assert_eq!((force_m_s2[2], rate_rad_s[2]), (-9.806_65, 0.5));
        let gps = |fix_type| {
            MavMessage::GPS_RAW_INT(GPS_RAW_INT_DATA {
                time_usec: 1_790_000_000_000_000,
                lat: 481_000_000,
                lon: -115_000_000,
                alt: 520_250,
                h_acc: 1200,
                fix_type,
                ..GPS_RAW_INT_DATA::default()
            })
        };
        let found = readings(&gps(GpsFixType::GPS_FIX_TYPE_3D_FIX)).unwrap();
        let place = Reading::Gps {
            lat_deg: 481_000_000.0 * 1e-7,
            lon_deg: -115_000_000.0 * 1e-7,
            height_m: 520.25,
            sigma_m: Some(1.2),
        };
        // Seconds since 1970 are not the autopilot's clock.
        assert_eq!(found, [(Taken::Unknown, place)]);
        assert_eq!(readings(&gps(GpsFixType::GPS_FIX_TYPE_NO_FIX)), Ok(vec![]));
    }

    #[test]
    fn numbers_that_are_none_are_refused() {
        let message = MavMessage::HIGHRES_IMU(HIGHRES_IMU_DATA {
            zgyro: f32::NAN,
            ..HIGHRES_IMU_DATA::default()
        });
        assert_eq!(readings(&message), Err(NotFinite));
    }
}
