"""Boots the firmware image in QEMU without the simulator and plays a GUIDED, armed autopilot in the air on UART0.

With no antenna frame there is nothing to follow: the companion must beat at 1 Hz and stream zero velocity at 20 Hz.

Usage: free_run.py IMAGE.elf
"""

import os
import socket
import subprocess
import sys
import time

os.environ["MAVLINK20"] = "1"
from pymavlink.dialects.v20 import ardupilotmega as mavlink  # noqa: E402

from checks import check  # noqa: E402

SECONDS = 8.0
WALL_SECONDS = 120.0
GUIDED, ARMED = 4, 128


listener = socket.socket()
listener.bind(("127.0.0.1", 0))
listener.listen(1)
port = listener.getsockname()[1]
# Its clock counts instructions: on a busy machine the image's time is slower, and no beat is left out.
qemu = subprocess.Popen(
    ["qemu-system-arm", "-M", "mps2-an386", "-display", "none", "-monitor", "none", "-icount", "shift=8"]
    + ["-serial", f"tcp:127.0.0.1:{port}", "-serial", "null", "-kernel", sys.argv[1]],
    stdout=subprocess.DEVNULL,
)
try:
    listener.settimeout(WALL_SECONDS)
    line, _ = listener.accept()
    line.settimeout(0.02)
    encoder, decoder = mavlink.MAVLink(None, 1, 1), mavlink.MAVLink(None)
    heard, beat_at, now_s = [], 0.0, 0.0
    begin = time.monotonic()
    while now_s < SECONDS and time.monotonic() - begin < WALL_SECONDS:
        if time.monotonic() >= beat_at:
            beat_at = time.monotonic() + 1.0
            beat = mavlink.MAVLink_heartbeat_message(2, 3, 1 | ARMED, GUIDED, 4, 3)
            in_air = mavlink.MAVLink_extended_sys_state_message(0, mavlink.MAV_LANDED_STATE_IN_AIR)
            line.sendall(beat.pack(encoder) + in_air.pack(encoder))
        try:
            data = line.recv(4096)
        except TimeoutError:
            continue
        for message in decoder.parse_buffer(data) or []:
            now_s = getattr(message, "time_boot_ms", 1000 * now_s) / 1000
            # What comes at once on a busy machine may be later.
            if now_s < SECONDS:
                heard.append((now_s, message))
finally:
    qemu.kill()

check(all(m.get_type() != "BAD_DATA" for _, m in heard), f"{len(heard)} frames, none damaged")
beats = [t for t, m in heard if m.get_type() == "HEARTBEAT"]
check(SECONDS - 1 <= len(beats) <= SECONDS + 1, f"{len(beats)} heartbeats in {SECONDS} s")
targets = [(t, m) for t, m in heard if m.get_type() == "SET_POSITION_TARGET_LOCAL_NED"]
late = [t for t, _ in targets if t > 2.0]
rate = len(late) / (SECONDS - 2.0)
check(18.0 <= rate <= 22.0, f"setpoints at {rate:.1f} Hz")
still = all((m.vx, m.vy, m.vz, m.yaw_rate) == (0.0, 0.0, 0.0, 0.0) for _, m in targets)
check(still, "every setpoint asks for no motion")
check(all((m.type_mask, m.coordinate_frame) == (0x05C7, 1) for _, m in targets), "mask 0x05C7, frame LOCAL_NED")
print("all checks passed")
