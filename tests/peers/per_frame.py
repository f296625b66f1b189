"""pymavlink as the other end of a link, one frame at a time.

Usage: per_frame.py read              frames from standard input, one a line in hexadecimal
       per_frame.py write SEED COUNT ID...   COUNT frames of each message, with random fields

Prints one JSON object a line: what pymavlink says the frame holds, and the frame as pymavlink writes it from that. Field
values are lists of strings: decimal integers, the bytes of text, and the bit patterns of floats as f32:xxxxxxxx.
"""

import json
import os
import random
import re
import struct
import sys

os.environ["MAVLINK20"] = "1"
from pymavlink.dialects.v20 import all as mavlink  # noqa: E402

INTEGERS = {"b": 8, "h": 16, "i": 32, "q": 64}


def layout(kind):
    """Name, struct letter and count of every field, in the order of the wire."""
    tokens = re.findall(r"(\d*)([a-zA-Z])", kind.unpacker.format)
    for name, (count, letter) in zip(kind.ordered_fieldnames, tokens, strict=True):
        yield name, letter, int(count or 1)


def as_text(letter, value):
    if letter in "fd":
        bits = struct.pack(">" + letter, value).hex()
        return f"{'f32' if letter == 'f' else 'f64'}:{bits}"
    return str(value)


def describe(message, sequence, system, component):
    fields = {}
    for name, letter, count in layout(type(message)):
        if letter == "s":
            values = list(getattr(message, f"_{name}_raw").ljust(count, b"\0"))
        else:
            value = getattr(message, name)
            values = value if isinstance(value, (list, tuple)) else [value]
        fields[name] = [as_text(letter, value) for value in values]
    sender = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
    sender.seq = sequence
    frame = bytes(message.pack(sender)).hex()
    report = {"name": message.get_type(), "header": [system, component, sequence], "fields": fields, "frame": frame}
    print(json.dumps(report))


def read():
    for line in sys.stdin:
        frame = bytes.fromhex(line.strip())
        heard = mavlink.MAVLink(None).parse_buffer(frame)
        assert heard and len(heard) == 1 and heard[0].get_type() != "BAD_DATA", f"{line}: {heard}"
        message = heard[0]
        assert bytes(message.get_msgbuf()) == frame, line
        describe(message, message.get_seq(), message.get_srcSystem(), message.get_srcComponent())


def any_value(letter, draw):
    if letter in "fd":
        size = 4 if letter == "f" else 8
        # Infinities, a NaN that says something, the greatest, the least above zero, minus zero, and anything.
        special = ["7f800000", "ff800000", "7fc01234", "ffffffff", "7f7fffff", "00000001", "80000000", "00000000"]
        if letter == "d":
            special = ["7ff0000000000000", "fff8000000001234", "7fefffffffffffff", "0000000000000001", "8" + "0" * 15]
        bits = bytes.fromhex(draw.choice(special)) if draw.random() < 0.4 else draw.randbytes(size)
        value = struct.unpack(">" + letter, bits)[0]
        return value
    bits = INTEGERS[letter.lower()]
    low, high = (0, 2**bits - 1) if letter.isupper() else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    return draw.choice([low, high, 0]) if draw.random() < 0.4 else draw.randint(low, high)


def write(seed, count, ids):
    draw = random.Random(seed)
    for number in ids:
        kind = mavlink.mavlink_map[number]
        for index in range(count):
            values = {}
            # From some field on zeros, which the wire does not carry; the first time all.
            zeros_from = 0 if index == 0 else draw.randint(0, 2 * len(kind.fieldnames))
            for at, (name, letter, length) in enumerate(layout(kind)):
                if letter == "s":
                    text = draw.randbytes(draw.choice([length, draw.randint(0, length)]))
                    values[name] = b"" if at >= zeros_from else text
                    continue
                some = [0 if at >= zeros_from else any_value(letter, draw) for _ in range(length)]
                values[name] = some if length > 1 else some[0]
            message = kind(*(values[name] for name in kind.fieldnames))
            describe(message, draw.randrange(256), draw.randrange(256), draw.randrange(256))


if sys.argv[1] == "read":
    read()
else:
    write(int(sys.argv[2]), int(sys.argv[3]), [int(number) for number in sys.argv[4:]])
