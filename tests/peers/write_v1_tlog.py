"""Writes a telemetry log that begins with MAVLink 1 and goes on with MAVLink 2, packed by pymavlink; prints its counts by id."""

import json
import struct
import sys

from pymavlink.dialects.v10 import ardupilotmega as old
from pymavlink.dialects.v20 import ardupilotmega as new

counts, mavlink_1 = {}, 0
with open(sys.argv[1], "wb") as log:
    for dialect, each in ((old, 40), (new, 25)):
        link = dialect.MAVLink(None, 1, 1)
        for step in range(each):
            messages = [
                link.heartbeat_encode(2, 3, 81, 4, 4),
                link.attitude_encode(20 * step, 0.1, -0.2, 3.0, 0, 0, 0.5),
                link.local_position_ned_encode(20 * step, 1.0, step, -5.0, 0, 1, 0),
                link.statustext_encode(6, b"text %d" % step),
                link.param_value_encode(b"GUID_TIMEOUT", 3.0, 9, 900, step),
                link.distance_sensor_encode(20 * step, 5, 600, 254, 0, 10, 0, 0),
            ]
            for message in messages:
                # Bytes of the time stamp look like the start of frames.
                log.write(struct.pack(">Q", 0x0005_FDFE_0000_0000 + 20_000 * step))
                log.write(message.pack(link))
                link.seq = (link.seq + 1) % 256
                counts[str(message.get_msgId())] = counts.get(str(message.get_msgId()), 0) + 1
                mavlink_1 += dialect is old
print(json.dumps({"counts": counts, "mavlink_1": mavlink_1}))
