"""The frames that `nova bridge` sends, made by pymavlink from values written down here in MAVLink's own units.

    pip install pymavlink==2.4.50 && python3 frames.py > frames.json

A test in src/mavlink/outbound.rs compares ours with them, byte by byte.
"""
import json
import math
import os

os.environ["MAVLINK20"] = "1"
from pymavlink.dialects.v20 import common as m  # noqa: E402

mav = m.MAVLink(None, srcSystem=1, srcComponent=191)
unit = [1.0, 0.0, 0.0, 0.0]
# From the vehicle, NED: 3 m east, 4 m north, 12 m below. It looks north.
relative = dict(
    angle_x=math.atan2(3, 12), angle_y=math.atan2(-4, 12), distance=13.0, size_x=0.0, size_y=0.0,
    q=unit, type=m.LANDING_TARGET_TYPE_RADIO_BEACON, position_valid=1,
)
target = dict(time_usec=1_790_000_000_250_000, target_num=7)
# Position alone counts.
position_alone = 0b1101_1111_1000
messages = [
    ("heartbeat", m.MAVLink_heartbeat_message(
        m.MAV_TYPE_ONBOARD_CONTROLLER, m.MAV_AUTOPILOT_INVALID, 0, 0, m.MAV_STATE_ACTIVE, 3)),
    ("time question", m.MAVLink_timesync_message(0, 1_790_000_000_123_456_789)),
    ("time answer", m.MAVLink_timesync_message(1_790_000_000_223_456_789, 42)),
    ("range", m.MAVLink_distance_sensor_message(
        90_000, 0, 30_000, 1235, m.MAV_DISTANCE_SENSOR_UNKNOWN, 3, m.MAV_SENSOR_ROTATION_CUSTOM, 25)),
    # The node is 5 m east of a vehicle that looks east: straight ahead.
    ("range with direction", m.MAVLink_distance_sensor_message(
        1, 0, 30_000, 7, m.MAV_DISTANCE_SENSOR_UNKNOWN, 200, m.MAV_SENSOR_ROTATION_CUSTOM, 255, quaternion=unit)),
    # Seen without an attitude there are no angles.
    ("target, local NED", m.MAVLink_landing_target_message(
        **target, **{**relative, "angle_x": 0.0, "angle_y": 0.0}, frame=m.MAV_FRAME_LOCAL_NED, x=50.0, y=100.0, z=-1.0)),
    ("target, local FRD", m.MAVLink_landing_target_message(
        **target, **relative, frame=m.MAV_FRAME_LOCAL_FRD, x=4.0, y=3.0, z=12.0)),
    ("target, body FRD", m.MAVLink_landing_target_message(
        **target, **relative, frame=m.MAV_FRAME_BODY_FRD, x=4.0, y=3.0, z=12.0)),
    ("fly", m.MAVLink_set_position_target_local_ned_message(
        4_000_000_000, 1, 1, m.MAV_FRAME_LOCAL_NED, position_alone, -2.25, 1.5, -30.0, 0, 0, 0, 0, 0, 0, 0, 0)),
    ("ask for places", m.MAVLink_command_long_message(
        1, 1, m.MAV_CMD_SET_MESSAGE_INTERVAL, 0, m.MAVLINK_MSG_ID_LOCAL_POSITION_NED, 1e6 / 30, 0, 0, 0, 0, 0)),
    ("ask for attitudes", m.MAVLink_command_long_message(
        1, 1, m.MAV_CMD_SET_MESSAGE_INTERVAL, 0, m.MAVLINK_MSG_ID_ATTITUDE, 1e6 / 30, 0, 0, 0, 0, 0)),
]
frames = []
for name, message in messages:
    frames.append([name, message.pack(mav).hex()])
    mav.seq = (mav.seq + 1) % 256
print(json.dumps(frames, indent=1))
