"""Reads a telemetry log as ground stations do: counts by pymavlink, one JSON object."""

import json
import os
import sys

os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil  # noqa: E402

log = mavutil.mavlink_connection(sys.argv[1], dialect="ardupilotmega")
counts, senders, bad, first_s, last_s = {}, set(), 0, None, None
while True:
    message = log.recv_match()
    if message is None:
        break
    name = message.get_type()
    if name == "BAD_DATA" or name.startswith("UNKNOWN"):
        bad += 1
        continue
    counts[name] = counts.get(name, 0) + 1
    senders.add(message.get_srcComponent() == 191)
    first_s = first_s or message._timestamp
    last_s = message._timestamp
print(json.dumps({"bad": bad, "directions": len(senders), "first_s": first_s, "last_s": last_s, "counts": counts}))
