"""pymavlink's side of signing. Reads orders, a line each, and answers each with a line.

    key HEX                               a new peer with this key             -> ok
    read HEX                              does it take this frame?             -> taken NAME | refused
    sign SEED LINK TIMESTAMP SYSTEM COMP  any message, signed by it            -> HEX
    setup HEX TIMESTAMP SYSTEM COMP       SETUP_SIGNING with a key, unsigned   -> HEX
"""

import os
import random
import struct
import sys

os.environ["MAVLINK20"] = "1"
from pymavlink.dialects.v20 import ardupilotmega as mavlink  # noqa: E402


def peer(key):
    mav = mavlink.MAVLink(None)
    mav.signing.secret_key = bytes.fromhex(key)
    return mav


def number(source):
    """Any float but a signalling NaN, which Python does not keep."""
    bits = source.choice([source.getrandbits(32), 0, 0x3F800000, 0x7F7FFFFF, 0x80000000])
    (value,) = struct.unpack("<f", struct.pack("<I", bits))
    return 0.0 if value != value else value


def message(source):
    kind = source.randrange(5)
    if kind == 0:
        return mavlink.MAVLink_heartbeat_message(2, 3, source.getrandbits(8), source.getrandbits(32), 4, 3)
    if kind == 1:
        return mavlink.MAVLink_local_position_ned_message(source.getrandbits(32), *[number(source) for _ in range(6)])
    if kind == 2:
        return mavlink.MAVLink_attitude_message(source.getrandbits(32), *[number(source) for _ in range(6)])
    if kind == 3:
        distances = [source.getrandbits(16) for _ in range(72)]
        return mavlink.MAVLink_obstacle_distance_message(source.getrandbits(64), 0, distances, 5, 20, 4000, 0.0, 0.0, 12)
    # Not in our dialect.
    return mavlink.MAVLink_tunnel_message(1, 191, 5, 128, [source.getrandbits(8) for _ in range(128)])


def answer(state, words):
    order, rest = words[0], words[1:]
    if order == "key":
        state["mav"] = peer(rest[0])
        state["key"] = rest[0]
        return "ok"
    if order == "read":
        try:
            read = state["mav"].decode(bytearray.fromhex(rest[0]))
        except mavlink.MAVError as error:
            assert str(error) == "Invalid signature", error
            return "refused"
        return f"taken {read.get_type()}"
    if order == "sign":
        seed, link, timestamp, system, component = map(int, rest)
        source = random.Random(seed)
        # Signing must not touch what was heard.
        mav = peer(state["key"])
        mav.srcSystem, mav.srcComponent, mav.seq = system, component, seed & 255
        mav.signing.sign_outgoing = True
        mav.signing.link_id, mav.signing.timestamp = link, timestamp
        return message(source).pack(mav).hex()
    if order == "setup":
        key, timestamp, system, component = rest[0], *map(int, rest[1:])
        return mavlink.MAVLink_setup_signing_message(system, component, bytes.fromhex(key), timestamp).pack(
            mavlink.MAVLink(None, 255, 190)
        ).hex()
    raise ValueError(order)


def main():
    state = {}
    for line in sys.stdin:
        print(answer(state, line.split()), flush=True)


main()
