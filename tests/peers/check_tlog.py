"""Reads a flight's tlog with pymavlink and checks what the companion sent.

Usage: check_tlog.py FLIGHT.tlog
"""

import math
import os
import struct
import sys

os.environ["MAVLINK20"] = "1"
from pymavlink.dialects.v20 import ardupilotmega as mavlink  # noqa: E402

from checks import check  # noqa: E402

COMPANION = 191
LOCAL_NED = 1
VELOCITY_AND_YAW_RATE = 0x05C7


def frames(path):
    """(microseconds, message) of every frame; pymavlink checks length, id and CRC of each."""
    data = open(path, "rb").read()
    parser = mavlink.MAVLink(None)
    at = 0
    while at < len(data):
        (stamp,) = struct.unpack(">Q", data[at : at + 8])
        magic, length, incompat = data[at + 8], data[at + 9], data[at + 10]
        assert magic == 0xFD, f"byte {at + 8}: {magic:#x} is no start of a MAVLink 2 frame"
        size = 12 + length + (13 if incompat & 1 else 0)
        parsed = parser.parse_buffer(data[at + 8 : at + 8 + size])
        assert parsed and len(parsed) == 1, f"byte {at}: pymavlink reads {parsed}"
        assert parsed[0].get_type() != "BAD_DATA", f"byte {at}: {parsed[0]}"
        yield stamp, parsed[0]
        at += 8 + size


def finite(message):
    values = [getattr(message, name) for name in message.get_fieldnames()]
    return all(math.isfinite(v) for v in values if isinstance(v, float))


ours, setpoints, beats, intervals = {}, [], [], set()
sequence_ok, last_sequence = True, None
mode_since = None
for stamp, message in frames(sys.argv[1]):
    if message.get_srcComponent() != COMPANION:
        if message.get_type() == "HEARTBEAT" and message.custom_mode == 4 and message.base_mode & 128:
            mode_since = stamp if mode_since is None else mode_since
        continue
    check_system = message.get_srcSystem()
    assert check_system == 1, message
    if last_sequence is not None:
        sequence_ok &= message.get_seq() == (last_sequence + 1) % 256
    last_sequence = message.get_seq()
    name = message.get_type()
    ours[name] = ours.get(name, 0) + 1
    assert finite(message), message
    if name == "SET_POSITION_TARGET_LOCAL_NED":
        setpoints.append((stamp, message))
    elif name == "HEARTBEAT":
        beats.append((stamp, message))
    elif name == "COMMAND_LONG":
        check(message.command == 511, "the only command is SET_MESSAGE_INTERVAL")
        intervals.add(int(message.param1))

print("companion sent", ours)
check(sequence_ok, "sequence numbers have no gap")
check(len(setpoints) > 100, f"{len(setpoints)} setpoints")
check(all(m.coordinate_frame == LOCAL_NED for _, m in setpoints), "frame LOCAL_NED in every setpoint")
check(all(m.type_mask == VELOCITY_AND_YAW_RATE for _, m in setpoints), "type_mask 0x05C7 in every setpoint")
check(all((m.target_system, m.target_component) == (1, 1) for _, m in setpoints), "addressed to the autopilot")
ignored = ("x", "y", "z", "afx", "afy", "afz", "yaw")
check(all(getattr(m, f) == 0.0 for _, m in setpoints for f in ignored), "ignored fields are zero")
speeds = [math.hypot(m.vx, m.vy) for _, m in setpoints]
check(max(speeds) <= 1.001 and max(speeds) > 0.3, f"speeds up to {max(speeds):.3f} m/s")
check(all(abs(m.vz) < 0.05 for _, m in setpoints), "the altitude is kept")
span = (setpoints[-1][0] - setpoints[0][0]) / 1e6
rate = (len(setpoints) - 1) / span
check(abs(rate - 20.0) < 0.5, f"setpoints at {rate:.2f} Hz")
gaps = [(b[0] - a[0]) / 1e6 for a, b in zip(setpoints, setpoints[1:])]
check(max(gaps) <= 0.101, f"longest gap between setpoints {max(gaps):.3f} s")
check(mode_since is not None and setpoints[0][0] >= mode_since, "no setpoint before GUIDED and armed")
span = (beats[-1][0] - beats[0][0]) / 1e6
check(abs((len(beats) - 1) / span - 1.0) < 0.1, f"{len(beats)} heartbeats in {span:.1f} s")
check(all(m.type == 18 and m.autopilot == 8 for _, m in beats), "heartbeat of an onboard controller, no autopilot")
check({32, 30} <= intervals, f"message intervals asked for: {sorted(intervals)}")
names = {"NAMED_VALUE_FLOAT", "STATUSTEXT"}
check(names <= set(ours), f"{sorted(names)} are there")
print("all checks passed")
