"""A PX4 made of pymavlink on the other end of `nova bridge`: what it is sent, beside what is true.

    pip install pymavlink==2.4.50 && python3 autopilot.py PATH/TO/nova [SECONDS [FILE.mcap]]

Two simulated boards: one circles on the vehicle, one is the tag on the ground. The autopilot flies the same circle and tells its places;
the bridge's ranges, landing places, waypoints, requests and times are read by pymavlink and held against the truth.
With a file's name the bridge records itself into it.
Ends with an error where one is wrong, or a message did not come.
"""
import json
import math
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time

os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil  # noqa: E402
from pymavlink.dialects.v20 import common as m  # noqa: E402

nova, seconds = sys.argv[1], float(sys.argv[2]) if len(sys.argv) > 2 else 60.0
record = ["--record", sys.argv[3]] if len(sys.argv) > 3 else []
# ENU; `nova simulate` moves a board at 1 m/s on its circle.
CENTRE, RADIUS, TAG = (0.0, 0.0, 12.0), 6.0, (2.0, 3.0, 0.0)


def free_port(kind):
    with socket.socket(socket.AF_INET, kind) as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def vehicle(t):
    angle = t / RADIUS
    return (CENTRE[0] + RADIUS * math.cos(angle), CENTRE[1] + RADIUS * math.sin(angle), CENTRE[2])


tcp, udp = free_port(socket.SOCK_STREAM), free_port(socket.SOCK_DGRAM)
place = lambda role, at: f"{role}@" + ",".join(str(number) for number in at)
boards = subprocess.Popen(
    [nova, "simulate", "--json", "--serve", f"tcp://127.0.0.1:{tcp}",
     "--board", place("anchor", CENTRE + (RADIUS,)), "--board", place("tag", TAG)],
    stdout=subprocess.PIPE, text=True)
boards.stdout.readline()
begin = time.monotonic()
autopilot = mavutil.mavlink_connection(f"udpin:127.0.0.1:{udp}", dialect="common", source_system=1, source_component=1)
lines = tempfile.TemporaryFile("w+")
bridge = subprocess.Popen(
    [nova, "bridge", "--json", "--fly", "--board", f"tcp://127.0.0.1:{tcp}", "--mavlink", f"udp:127.0.0.1:{udp}"] + record,
    stdout=lines, text=True)

came, worst, wrong = {}, {}, []


def check(name, off, allowed):
    worst[name] = max(worst.get(name, 0.0), off)
    if off > allowed:
        wrong.append(f"{name}: off by {off:.3f}, allowed {allowed}")


asked, beat, told, target = set(), 0.0, 0.0, None
while (t := time.monotonic() - begin) < seconds:
    boot_ms = int(1000 * t)
    if autopilot.target_system or came:
        if t >= beat:
            beat = t + 1.0
            autopilot.mav.heartbeat_send(m.MAV_TYPE_QUADROTOR, m.MAV_AUTOPILOT_PX4, 0, 0, m.MAV_STATE_ACTIVE)
        if t >= told:
            told = t + 1 / 30
            (x, y, z), angle = vehicle(t), t / RADIUS
            autopilot.mav.local_position_ned_send(boot_ms, y, x, -z, math.cos(angle), -math.sin(angle), 0)
            autopilot.mav.attitude_send(boot_ms, 0, 0, 0, 0, 0, 0)
    message = autopilot.recv_match(blocking=True, timeout=0.01)
    if message is None:
        continue
    kind, t = message.get_type(), time.monotonic() - begin
    came[kind] = came.get(kind, 0) + 1
    if kind == "HEARTBEAT":
        assert (message.type, message.autopilot) == (m.MAV_TYPE_ONBOARD_CONTROLLER, m.MAV_AUTOPILOT_INVALID)
    elif kind == "TIMESYNC":
        now_ns = int(1e9 * t)
        if message.tc1 == 0:
            autopilot.mav.timesync_send(now_ns, message.ts1)
    elif kind == "DISTANCE_SENSOR":
        assert message.orientation == m.MAV_SENSOR_ROTATION_CUSTOM
        # Metres for centimetres; a twentieth of a second of flight is 5 cm.
        check("DISTANCE_SENSOR, m", abs(0.01 * message.current_distance - math.dist(vehicle(t), TAG)), 0.5)
    elif kind == "LANDING_TARGET":
        assert (message.position_valid, message.frame) == (1, m.MAV_FRAME_LOCAL_NED)
        target = math.dist((message.y, message.x, -message.z), TAG)
        check("LANDING_TARGET, m", target, 3.0)
        check("LANDING_TARGET time, s", abs(1e-6 * message.time_usec - time.time()), 0.5)
    elif kind == "SET_POSITION_TARGET_LOCAL_NED":
        assert message.type_mask == 0b1101_1111_1000 and message.coordinate_frame == m.MAV_FRAME_LOCAL_NED
        assert all(math.isfinite(number) for number in (message.x, message.y, message.z))
    elif kind == "COMMAND_LONG":
        assert message.command == m.MAV_CMD_SET_MESSAGE_INTERVAL and abs(message.param2 - 1e6 / 30) < 1.0
        asked.add(int(message.param1))

bridge.send_signal(signal.SIGINT)
bridge.wait(timeout=30)
lines.seek(0)
end = json.loads(lines.read().splitlines()[-1])["end"]
boards.send_signal(signal.SIGINT)
boards.wait(timeout=30)
for kind in ["HEARTBEAT", "TIMESYNC", "DISTANCE_SENSOR", "LANDING_TARGET", "SET_POSITION_TARGET_LOCAL_NED", "COMMAND_LONG"]:
    print(f"{kind:<30} {came.get(kind, 0):>6}")
    if kind not in came:
        wrong.append(f"{kind}: none came")
for name, off in worst.items():
    print(f"{name:<30} off by {off:.3f} at most")
print(f"last landing place: off by {target if target is not None else math.nan:.3f} m")
print(f"asked for messages {sorted(asked)}; from the board's bytes to the datagram: {end['latency']}")
if target is None or target > 0.5:
    wrong.append("the last landing place is off")
if asked != {m.MAVLINK_MSG_ID_LOCAL_POSITION_NED, m.MAVLINK_MSG_ID_ATTITUDE}:
    wrong.append(f"asked for {asked}")
sys.exit("\n".join(wrong[:10]) if wrong else 0)
