"""pymavlink in the place of an autopilot that signs, and believes nothing that is not signed with the same key.

The first line is `{"port": N}`, where it can be reached by UDP. It is armed, in GUIDED from 2 s after it has heard somebody, and
goes where it is told to.
It ends when its standard input does, and says then what it took and what it refused.

Usage: signed_autopilot.py KEY, in hexadecimal digits
"""

import json
import math
import os
import socket
import sys
import threading
import time

os.environ["MAVLINK20"] = "1"
from pymavlink.dialects.v20 import ardupilotmega as mavlink  # noqa: E402

STEP_S = 0.02
LOITER, GUIDED = 5, 4
GIVEN_AFTER_S = 2.0
# 2015-01-01 in the time of Unix.
EPOCH_S = 1420070400

wire = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
wire.bind(("127.0.0.1", 0))
wire.setblocking(False)
mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
mav.signing.secret_key = bytes.fromhex(sys.argv[1])
mav.signing.sign_outgoing = True
mav.signing.timestamp = int((time.time() - EPOCH_S) * 1e5)

is_over = threading.Event()
threading.Thread(target=lambda: (os.read(0, 1), is_over.set()), daemon=True).start()
print(json.dumps({"port": wire.getsockname()[1]}), flush=True)

heard_at = None
companion, taken, refused, texts, fastest_mps = None, {}, 0, [], 0.0
position, velocity = [0.0, 0.0, -5.0], [0.0, 0.0, 0.0]
yaw, yaw_rate = 0.0, 0.0


def hear(data):
    global velocity, yaw_rate, fastest_mps, refused
    try:
        message = mav.decode(bytearray(data))
    except mavlink.MAVError as error:
        assert str(error) == "Invalid signature", error
        refused += 1
        return
    name = message.get_type()
    taken[name] = taken.get(name, 0) + 1
    if name == "SET_POSITION_TARGET_LOCAL_NED":
        velocity, yaw_rate = [message.vx, message.vy, message.vz], message.yaw_rate
        fastest_mps = max(fastest_mps, *map(abs, velocity))
    elif name == "STATUSTEXT":
        texts.append(message.text)


def say(message):
    if companion:
        wire.sendto(message.pack(mav), companion)
        mav.seq = (mav.seq + 1) % 256


begin, step = time.monotonic(), 0
while not is_over.is_set():
    try:
        while True:
            data, companion = wire.recvfrom(4096)
            heard_at = heard_at or time.monotonic()
            hear(data)
    except BlockingIOError:
        pass
    boot_ms = int(step * STEP_S * 1000)
    if step % 50 == 0:
        armed = mavlink.MAV_MODE_FLAG_SAFETY_ARMED | mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        mode = GUIDED if heard_at and time.monotonic() > heard_at + GIVEN_AFTER_S else LOITER
        say(mavlink.MAVLink_heartbeat_message(2, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, armed, mode, 4, 3))
    say(mavlink.MAVLink_local_position_ned_message(boot_ms, *position, *velocity))
    say(mavlink.MAVLink_attitude_message(boot_ms, 0, 0, yaw, 0, 0, yaw_rate))
    position = [x + v * STEP_S for x, v in zip(position, velocity)]
    yaw = (yaw + yaw_rate * STEP_S + math.pi) % (2 * math.pi) - math.pi
    step += 1
    time.sleep(max(0.0, begin + step * STEP_S - time.monotonic()))

end = {"position_ned_m": position, "velocity_ned_mps": velocity, "fastest_mps": fastest_mps}
print(json.dumps({"taken": taken, "refused": refused, "texts": texts, **end}), flush=True)
