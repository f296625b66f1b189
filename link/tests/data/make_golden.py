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
    m.MAVLink_sys_status_message(1, 2, 3, 500, 11100, -1, 87, 4, 5, 6, 7, 8, 9, 10, 11, 12),
    m.MAVLink_param_request_read_message(7, 191, b"FH_SPEED", -1),
    m.MAVLink_param_request_list_message(7, 0),
    m.MAVLink_param_value_message(b"FH_SIXTEEN_LONG_", 1.25, 9, 40, 39),
    m.MAVLink_param_set_message(7, 191, b"FH_SPEED", 2.5, 9),
    m.MAVLink_gps_global_origin_message(473977418, -85455938, 488000, 1_700_000_000_123_456),
    m.MAVLink_rc_channels_message(77, 16, *range(1001, 1019), 200),
    m.MAVLink_request_data_stream_message(7, 1, 6, 4, 1),
    m.MAVLink_command_int_message(7, 191, 0, 192, 0, 0, 1, 2, 3, 4, -5, 6, 7.5),
    m.MAVLink_battery_status_message(1, 2, 3, -400, list(range(10)), -5, -6, -7, -1, 8, 3, [1, 2, 3, 4], 9, 10),
    m.MAVLink_autopilot_version_message(2**40 + 3, 4, 5, 6, 7, range(8), range(8, 16), range(16, 24), 8, 9, 2**50, range(18)),
    m.MAVLink_landing_target_message(
        2**40, 3, 12, 0.5, -0.25, 4.5, 0.125, 0.0625, 1.5, -2.5, 3.5, [0.5, -0.5, 0.5, -0.5], 1, 1
    ),
    m.MAVLink_fence_status_message(1, 2, 3, 4, 5),
    m.MAVLink_ekf_status_report_message(0x33F, 0.125, 0.25, 0.5, 1.0, 2.0, 4.0),
    m.MAVLink_estimator_status_message(2**40, 0x33F, 0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0),
    m.MAVLink_debug_vect_message(b"FH_DIR", 2**40, 0.5, -0.25, 0.125),
    m.MAVLink_setup_signing_message(7, 191, range(32), 2**40),
    m.MAVLink_odometry_message(
        2**40, 1, 12, 1, 2, 3, [0.5, -0.5, 0.5, -0.5], 4, 5, 6, 7, 8, 9, range(21), range(21, 42), 10, 11, -1
    ),
]
for sequence, message in enumerate(messages):
    frame = message.pack(sender(sequence))
    print(message.get_type(), message.crc_extra, frame.hex())
