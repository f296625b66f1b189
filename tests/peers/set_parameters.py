"""A ground station made of pymavlink that lists, sets, reads back and stores the companion's parameters.

It speaks in lines: out goes `MILLISECONDS HEX`, the bytes that it sends and how long it then listens; back comes a line of
HEX, what the companion sent in that time. No clock is involved.

Usage: set_parameters.py TABLE.json, as `foxhound params --json` prints it
"""

import json
import math
import os
import sys

os.environ["MAVLINK20"] = "1"
from pymavlink import mavparm  # noqa: E402
from pymavlink.dialects.v20 import ardupilotmega as mavlink  # noqa: E402

VEHICLE, COMPANION = 1, 191
table = json.load(open(sys.argv[1]))["params"]


class Station:
    """As much of a mavfile as mavparm uses."""

    def __init__(self):
        self.out = bytearray()
        self.mav = mavlink.MAVLink(self, srcSystem=255, srcComponent=190)
        self.parser = mavlink.MAVLink(None)
        self.heard = []

    def write(self, data):
        self.out += data

    def listen(self, milliseconds):
        print(milliseconds, self.out.hex(), flush=True)
        self.out.clear()
        answer = bytes.fromhex(sys.stdin.readline().strip())
        for message in self.parser.parse_buffer(answer) or []:
            check(message.get_type() != "BAD_DATA", f"a frame: {message}", quiet=True)
            check((message.get_srcSystem(), message.get_srcComponent()) == (VEHICLE, COMPANION), "ours", quiet=True)
            self.heard.append(message)

    def recv_match(self, type=None, blocking=False, timeout=None):
        for _ in range(20):
            while self.heard:
                message = self.heard.pop(0)
                if message.get_type() == type:
                    return message
                if message.get_type() == "STATUSTEXT":
                    texts.append(message)
            self.listen(50)
        return None

    def param_set_send(self, name, value, parm_type=None):
        self.mav.param_set_send(VEHICLE, COMPANION, name.encode(), value, parm_type or mavlink.MAV_PARAM_TYPE_REAL32)


def check(condition, text, quiet=False):
    if not condition:
        print("FAILED:", text, file=sys.stderr)
        sys.exit(1)
    if not quiet:
        print("ok:", text, file=sys.stderr)


texts = []
station = Station()


def drain(kind):
    """Everything of that kind until the companion falls silent."""
    found = []
    while (message := station.recv_match(type=kind)) is not None:
        found.append(message)
    return found


# The list, to us and to all components.
for component in (COMPANION, mavlink.MAV_COMP_ID_ALL):
    station.mav.param_request_list_send(VEHICLE, component)
    values = drain("PARAM_VALUE")
    check([m.param_id for m in values] == [row["name"] for row in table], f"{len(values)} parameters by name")
    check(all(m.param_index == index and m.param_count == len(table) for index, m in enumerate(values)), "numbered")
    check(all(m.param_type == mavlink.MAV_PARAM_TYPE_REAL32 for m in values), "all of them REAL32")
    check(all(math.isclose(m.param_value, row["default"], rel_tol=1e-6) for m, row in zip(values, table)), "defaults")
station.mav.param_request_list_send(VEHICLE, 1)
check(not drain("PARAM_VALUE"), "a list of the autopilot's is not ours to tell")

# What mavparm thinks a parameter protocol is.
params = mavparm.MAVParmDict()
# At their ends these do not fit the defaults of others.
at_odds = {"FH_MARGIN_TGT", "FH_WAVELEN", "FH_ARR_SIDE", "FH_SMP_RATE", "FH_TONE", "FH_TONE_LO", "FH_TONE_HI", "FH_RADIUS",
           "FH_STALL_R", "FH_MARGIN_GRD"}
for row in table:
    wanted = row["min"] if row["whole"] and row["default"] != row["min"] else row["max"]
    if row["name"] in at_odds:
        wanted = row["default"]
    check(params.mavset(station, row["name"], wanted, retries=1), f"mavset {row['name']} {wanted:g}", quiet=True)
    check(math.isclose(params[row["name"]], wanted, rel_tol=1e-6, abs_tol=1e-9), f"{row['name']} is {wanted:g}", quiet=True)
    station.mav.param_request_read_send(VEHICLE, COMPANION, row["name"].encode(), -1)
    station.mav.param_request_read_send(VEHICLE, COMPANION, b"", row["index"])
    for message in drain("PARAM_VALUE"):
        read = (message.param_id, message.param_index)
        check(read == (row["name"], row["index"]), f"{read}", quiet=True)
        check(math.isclose(message.param_value, wanted, rel_tol=1e-6, abs_tol=1e-9), f"{message}", quiet=True)
    check(params.mavset(station, row["name"], row["default"], retries=1), f"{row['name']} back", quiet=True)
check(not texts, "all parameters set, acknowledged and read back")

# Refusals: the old value, and why.
for value, kind in ((99.0, 9), (float("nan"), 9), (float("inf"), 9), (2.0, 6)):
    station.param_set_send("FH_SPD_MAX", value, kind)
    (answer,) = drain("PARAM_VALUE")
    check(answer.param_value == 1.0, f"{value} of type {kind} is refused and {answer.param_value} stays")
    text = texts.pop().text
    check(text.startswith("FH_SPD_MAX") and "refused" in text, text)
station.param_set_send("FH_ARR_SIDE", 0.2)
check(math.isclose(drain("PARAM_VALUE")[0].param_value, 0.138, rel_tol=1e-6), "what does not fit the others is refused")
check([m.chunk_seq for m in texts] == [0, 1, 2] and len({m.id for m in texts} - {0}) == 1, "in three pieces of one text")
text = "".join(m.text for m in texts)
check(text.endswith("opposite directions are ambiguous"), text)

# The storage.
station.mav.command_long_send(VEHICLE, COMPANION, mavlink.MAV_CMD_PREFLIGHT_STORAGE, 0, 1, 0, 0, 0, 0, 0, 0)
(ack,) = drain("COMMAND_ACK")
check((ack.command, ack.result, ack.target_system, ack.target_component) == (245, 0, 255, 190), "saved")
station.mav.command_long_send(VEHICLE, COMPANION, mavlink.MAV_CMD_PREFLIGHT_STORAGE, 0, 2, 0, 0, 0, 0, 0, 0)
values = drain("PARAM_VALUE")
check([round(m.param_value, 3) for m in values] == [round(row["default"], 3) for row in table], "reset, and told")
print("all checks passed", file=sys.stderr)
