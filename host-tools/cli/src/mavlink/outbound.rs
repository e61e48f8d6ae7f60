//! What we say to an autopilot.

use super::frames::{Attitude, centimetres, ned_from_enu, square_centimetres};
use super::vehicle::{Identity, Kind};
use clap::ValueEnum;
use mavlink::MessageData;
use mavlink::dialects::common::{
    ATTITUDE_DATA, COMMAND_LONG_DATA, DISTANCE_SENSOR_DATA, HEARTBEAT_DATA, LANDING_TARGET_DATA,
    LOCAL_POSITION_NED_DATA, LandingTargetType, MavAutopilot, MavBool, MavCmd, MavDistanceSensor,
    MavFrame, MavMessage, MavModeFlag, MavSensorOrientation, MavState, MavType,
    PositionTargetTypemask, SET_POSITION_TARGET_LOCAL_NED_DATA, TIMESYNC_DATA,
};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Farther a DW1000 does not range, centimetres.
const FARTHEST_CM: u16 = 30_000;

/// In which frame LANDING_TARGET says where the target is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum TargetFrame {
    /// From the autopilot's origin: what PX4 takes.
    LocalNed,
    /// From the vehicle, along its axes: what ArduPilot takes.
    BodyFrd,
    /// From the vehicle, along its heading.
    LocalFrd,
}

impl TargetFrame {
    /// What this autopilot takes.
    pub(crate) fn of(kind: Kind) -> Self {
        match kind {
            Kind::Px4 | Kind::Other => Self::LocalNed,
            Kind::ArduPilot => Self::BodyFrd,
        }
    }
}

/// A landing place as it is to be told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Target {
    /// When the vehicle was where the relative place counts from, our clock, seconds.
    pub(crate) t_s: f64,
    /// Number of the node.
    pub(crate) number: u8,
    /// From the vehicle, ENU, metres.
    pub(crate) relative_m: Vector3<f64>,
    /// From the autopilot's origin, by its own reckoning, ENU, metres.
    pub(crate) absolute_m: Vector3<f64>,
}

/// LANDING_TARGET; `None` where the frame needs an attitude and there is none.
pub(crate) fn landing_target(
    target: &Target,
    frame: TargetFrame,
    attitude: Option<Attitude>,
) -> Option<MavMessage> {
    let relative = ned_from_enu(target.relative_m);
    let (frame, place) = match frame {
        TargetFrame::LocalNed => (
            MavFrame::MAV_FRAME_LOCAL_NED,
            ned_from_enu(target.absolute_m),
        ),
        TargetFrame::BodyFrd => (MavFrame::MAV_FRAME_BODY_FRD, attitude?.body_frd(relative)),
        TargetFrame::LocalFrd => (MavFrame::MAV_FRAME_LOCAL_FRD, attitude?.local_frd(relative)),
    };
    // As a camera that looks down would see it, for receivers that know no other way: to the right and to the rear of
    // the image's centre.
    let (angle_x, angle_y) = attitude.map_or((0.0, 0.0), |attitude| {
        let frd = attitude.body_frd(relative);
        (frd.y.atan2(frd.z), (-frd.x).atan2(frd.z))
    });
    let [x, y, z] = [place.x, place.y, place.z].map(|part| part as f32);
    Some(MavMessage::LANDING_TARGET(LANDING_TARGET_DATA {
        time_usec: microseconds(target.t_s),
        angle_x: angle_x as f32,
        angle_y: angle_y as f32,
        distance: relative.norm() as f32,
        size_x: 0.0,
        size_y: 0.0,
        target_num: target.number,
        frame,
        x,
        y,
        z,
        // A node has no heading.
        q: [1.0, 0.0, 0.0, 0.0],
        mavtype: LandingTargetType::LANDING_TARGET_TYPE_RADIO_BEACON,
        position_valid: MavBool::MAV_BOOL_TRUE,
    }))
}

/// DISTANCE_SENSOR: one range. `towards` is where the node is from the vehicle, ENU, as far as that is known. `None` where the
/// range does not fit the field.
///
/// Its direction is never one of the fixed ones: a range to a node said to point down would be taken for the height above ground.
pub(crate) fn distance_sensor(
    number: u8,
    range_m: f64,
    sigma_m: Option<f64>,
    boot_ms: u32,
    towards: Option<(Vector3<f64>, Attitude)>,
) -> Option<MavMessage> {
    // Noise makes short ranges negative.
    let positive_m = if range_m < 0.0 { 0.0 } else { range_m };
    let current_distance = centimetres(positive_m).filter(|cm| *cm <= FARTHEST_CM)?;
    Some(MavMessage::DISTANCE_SENSOR(DISTANCE_SENSOR_DATA {
        time_boot_ms: boot_ms,
        min_distance: 0,
        max_distance: FARTHEST_CM,
        current_distance,
        mavtype: MavDistanceSensor::MAV_DISTANCE_SENSOR_UNKNOWN,
        id: number,
        orientation: MavSensorOrientation::MAV_SENSOR_ROTATION_CUSTOM,
        covariance: sigma_m.map_or(u8::MAX, square_centimetres),
        horizontal_fov: 0.0,
        vertical_fov: 0.0,
        quaternion: towards.map_or([0.0; 4], |(enu, attitude)| {
            attitude.pointing(ned_from_enu(enu))
        }),
        signal_quality: 0,
    }))
}

/// SET_POSITION_TARGET_LOCAL_NED: fly there, by the autopilot's own reckoning, ENU.
pub(crate) fn position_target(to: Identity, place_m: Vector3<f64>, boot_ms: u32) -> MavMessage {
    use PositionTargetTypemask as Ignore;
    let ned = ned_from_enu(place_m);
    MavMessage::SET_POSITION_TARGET_LOCAL_NED(SET_POSITION_TARGET_LOCAL_NED_DATA {
        time_boot_ms: boot_ms,
        x: ned.x as f32,
        y: ned.y as f32,
        z: ned.z as f32,
        type_mask: Ignore::POSITION_TARGET_TYPEMASK_VX_IGNORE
            | Ignore::POSITION_TARGET_TYPEMASK_VY_IGNORE
            | Ignore::POSITION_TARGET_TYPEMASK_VZ_IGNORE
            | Ignore::POSITION_TARGET_TYPEMASK_AX_IGNORE
            | Ignore::POSITION_TARGET_TYPEMASK_AY_IGNORE
            | Ignore::POSITION_TARGET_TYPEMASK_AZ_IGNORE
            | Ignore::POSITION_TARGET_TYPEMASK_YAW_IGNORE
            | Ignore::POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE,
        target_system: to.system,
        target_component: to.component,
        coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED,
        ..SET_POSITION_TARGET_LOCAL_NED_DATA::default()
    })
}

/// HEARTBEAT of a companion computer.
pub(crate) fn heartbeat() -> MavMessage {
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode: 0,
        mavtype: MavType::MAV_TYPE_ONBOARD_CONTROLLER,
        autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
        base_mode: MavModeFlag::empty(),
        system_status: MavState::MAV_STATE_ACTIVE,
        mavlink_version: 3,
    })
}

/// TIMESYNC: what is your time?
pub(crate) fn time_question(ts1: i64) -> MavMessage {
    MavMessage::TIMESYNC(TIMESYNC_DATA {
        tc1: 0,
        ts1,
        ..TIMESYNC_DATA::default()
    })
}

/// TIMESYNC: ours is `tc1`, asked at `ts1`. Whoever asked knows it by that number.
pub(crate) fn time_answer(tc1: i64, ts1: i64) -> MavMessage {
    MavMessage::TIMESYNC(TIMESYNC_DATA {
        tc1,
        ts1,
        ..TIMESYNC_DATA::default()
    })
}

/// MAV_CMD_SET_MESSAGE_INTERVAL: tell where you are, and how you are turned, so often.
pub(crate) fn requests(to: Identity, rate_hz: f32) -> [MavMessage; 2] {
    [LOCAL_POSITION_NED_DATA::ID, ATTITUDE_DATA::ID].map(|id| {
        MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            command: MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
            param1: id as f32,
            param2: 1e6 / rate_hz,
            target_system: to.system,
            target_component: to.component,
            ..COMMAND_LONG_DATA::default()
        })
    })
}

fn microseconds(s: f64) -> u64 {
    // Saturates; NaN gives 0.
    (s * 1e6) as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn target() -> Target {
        Target {
            t_s: 1_790_000_000.25,
            number: 7,
            relative_m: Vector3::new(3.0, 4.0, -12.0),
            absolute_m: Vector3::new(100.0, 50.0, 1.0),
        }
    }

    fn level(yaw_rad: f64) -> Option<Attitude> {
        Attitude::from_euler(0.0, 0.0, yaw_rad)
    }

    fn told(frame: TargetFrame, attitude: Option<Attitude>) -> Option<LANDING_TARGET_DATA> {
        match landing_target(&target(), frame, attitude)? {
            MavMessage::LANDING_TARGET(data) => Some(data),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn each_frame_says_the_same_place_its_own_way() {
        let local = told(TargetFrame::LocalNed, None).unwrap();
        assert_eq!((local.x, local.y, local.z), (50.0, 100.0, -1.0));
        assert_eq!(
            (local.distance, local.time_usec),
            (13.0, 1_790_000_000_250_000)
        );
        assert_eq!(local.position_valid, MavBool::MAV_BOOL_TRUE);
        // Heading east: 3 m ahead, the north on the left.
        let east = level(std::f64::consts::FRAC_PI_2);
        let body = told(TargetFrame::BodyFrd, east).unwrap();
        let near = |a: f32, b: f32| (a - b).abs() < 1e-5;
        assert!(near(body.x, 3.0) && near(body.y, -4.0) && near(body.z, 12.0));
        assert!(
            near(body.angle_x, (-4.0f32).atan2(12.0)) && near(body.angle_y, (-3.0f32).atan2(12.0))
        );
        assert_eq!(told(TargetFrame::BodyFrd, None), None);
        assert_eq!(told(TargetFrame::LocalFrd, None), None);
    }

    #[test]
    fn autopilots_get_the_frame_that_they_take() {
        assert_eq!(TargetFrame::of(Kind::Px4), TargetFrame::LocalNed);
        assert_eq!(TargetFrame::of(Kind::ArduPilot), TargetFrame::BodyFrd);
    }

    #[test]
    fn a_range_is_told_in_centimetres_and_never_as_a_height() {
        let Some(MavMessage::DISTANCE_SENSOR(told)) =
            distance_sensor(3, 12.345, Some(0.05), 9, None)
        else {
            panic!();
        };
        assert_eq!(
            (told.current_distance, told.covariance, told.id),
            (1235, 25, 3)
        );
        assert_eq!(
            told.orientation,
            MavSensorOrientation::MAV_SENSOR_ROTATION_CUSTOM
        );
        assert_eq!(told.quaternion, [0.0; 4]);
        for range_m in [300.01, f64::NAN, f64::INFINITY] {
            assert_eq!(
                distance_sensor(3, range_m, None, 9, None),
                None,
                "{range_m}"
            );
        }
    }

    /// What pymavlink makes of the same values: tests/mavlink/frames.py.
    #[test]
    fn every_message_is_to_the_byte_what_pymavlink_makes_of_it() {
        let made: Vec<(String, String)> =
            serde_json::from_str(include_str!("../../tests/mavlink/frames.json")).unwrap();
        let to = Identity {
            system: 1,
            component: 1,
            kind: Kind::Px4,
        };
        let banked = Attitude::from_euler(0.0, 0.0, std::f64::consts::FRAC_PI_2);
        let east = Vector3::new(5.0, 0.0, 0.0);
        let [place, attitude] = requests(to, 30.0);
        let said = [
            ("heartbeat", heartbeat()),
            ("time question", time_question(1_790_000_000_123_456_789)),
            ("time answer", time_answer(1_790_000_000_223_456_789, 42)),
            (
                "range",
                distance_sensor(3, 12.345, Some(0.05), 90_000, None).unwrap(),
            ),
            (
                "range with direction",
                distance_sensor(200, 0.07, None, 1, banked.map(|a| (east, a))).unwrap(),
            ),
            (
                "target, local NED",
                landing_target(&target(), TargetFrame::LocalNed, None).unwrap(),
            ),
            (
                "target, local FRD",
                landing_target(&target(), TargetFrame::LocalFrd, level(0.0)).unwrap(),
            ),
            (
                "target, body FRD",
                landing_target(&target(), TargetFrame::BodyFrd, level(0.0)).unwrap(),
            ),
            (
                "fly",
                position_target(to, Vector3::new(1.5, -2.25, 30.0), 4_000_000_000),
            ),
            ("ask for places", place),
            ("ask for attitudes", attitude),
        ];
        assert_eq!(made.len(), said.len());
        let mut outgoing = super::super::stream::Outgoing::of(1, 191);
        for ((name, wanted), (ours, message)) in made.iter().zip(&said) {
            assert_eq!(name, ours);
            let hex: String = (outgoing.pack(message).iter())
                .map(|byte| format!("{byte:02x}"))
                .collect();
            assert_eq!(&hex, wanted, "{name}");
        }
    }
}
