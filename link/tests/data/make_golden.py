"""Prints golden.txt: one line a frame, `NAME CRC_EXTRA hex`, as pymavlink 2.4.50 encodes it (dialect ardupilotmega, MAVLink 2).

    python3 -m venv venv && venv/bin/pip install pymavlink==2.4.50 && venv/bin/python make_golden.py > golden.txt
"""

import os

os.environ["MAVLINK20"] = "1"
from pymavlink.dialects.v20 import ardupilotmega as m


def sender(sequence):
    mav = m.MAVLink(None, srcSystem=7, srcComponent=191)
    mav.seq = sequence
    return mav


distances = [100 * j + 7 for j in range(72)]
zeros = [0.0] * 7
messages = [
    m.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3),
    m.MAVLink_system_time_message(1_700_000_000_123_456, 4_000_000_000),
    m.MAVLink_attitude_message(123456, 0.1, -0.2, 3.0, 0.01, -0.02, 0.5),
    m.MAVLink_attitude_quaternion_message(123457, 0.5, -0.5, 0.5, -0.5, 0.1, 0.2, 0.3, [1.0, 0.0, 0.0, 0.25]),
    m.MAVLink_local_position_ned_message(123458, 1.5, -2.5, -10.0, 0.25, -0.125, 0.0625),
    m.MAVLink_set_position_target_local_ned_message(
        99, 7, 1, 1, 0x05C7, 0, 0, 0, 1.5, -0.5, 0.25, 0, 0, 0, 0, -0.75
    ),
    m.MAVLink_position_target_local_ned_message(100, 1, 0x05C7, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11),
    m.MAVLink_command_long_message(7, 1, 511, 2, 32, 20000, 0, 0, 0, 0, 0),
    m.MAVLink_command_ack_message(400, 2, 50, -3, 255, 190),
    m.MAVLink_timesync_message(0x0102030405060708, -5),
    m.MAVLink_extended_sys_state_message(0, 2),
    m.MAVLink_named_value_float_message(5000, b"FH_BRG", 271.5),
    m.MAVLink_statustext_message(6, b"Foxhound: seeking", 0, 0),
    m.MAVLink_statustext_message(4, b"x" * 50, 513, 3),
    m.MAVLink_obstacle_distance_message(42, 0, distances, 5, 20, 4000, -5.0, 12.5, 12),
    m.MAVLink_obstacle_distance_message(42, 0, distances, 5, 20, 4000),
    m.MAVLink_distance_sensor_message(7, 20, 4000, 250, 0, 3, 100, 255, 0.5, 0.25, [0.5, -0.5, 0.5, -0.5], 99),
    m.MAVLink_obstacle_distance_3d_message(8, 0, 12, 513, 1.5, -2.5, 0.25, 0.5, 40.0),
]
for sequence, message in enumerate(messages):
    frame = message.pack(sender(sequence))
    print(message.get_type(), message.crc_extra, frame.hex())
