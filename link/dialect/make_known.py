"""Prints link/src/framer/table.rs: id, CRC_EXTRA and lengths of every published message.

    git clone https://github.com/mavlink/mavlink && git -C mavlink checkout de1e078a3a7c53c9262a95b7417959a0f8bf4150
    python3 -m venv venv && venv/bin/pip install pymavlink==2.4.50
    venv/bin/python make_known.py mavlink/message_definitions/v1.0 > ../src/framer/table.rs

The messages are those of all.xml (common, ardupilotmega, development and the vendors' dialects) in the folders named and
in pymavlink's own. Where two sets know a message they must agree on everything but later extensions.
"""

import contextlib
import os
import sys

import pymavlink
from pymavlink.generator import mavparse


def messages(folder, root="all.xml"):
    """id -> (CRC_EXTRA, length without extensions, length with them, name), with all includes."""
    found, files, seen = {}, [root], set()
    while files:
        name = files.pop()
        if name in seen:
            continue
        seen.add(name)
        with contextlib.redirect_stdout(sys.stderr):
            xml = mavparse.MAVXML(os.path.join(folder, name), mavparse.PROTOCOL_2_0)
        files += xml.include
        for message in xml.message:
            extra = mavparse.message_checksum(message)
            found[message.id] = (extra, message.wire_min_length, message.wire_length, message.name)
    return found


def pymavlinks():
    return messages(os.path.join(os.path.dirname(pymavlink.__file__), "dialects", "v20"))


def merged(sets):
    table = {}
    for one in sets:
        for number, (extra, shortest, longest, name) in one.items():
            was = table.get(number, (extra, shortest, longest, name))
            assert was[:2] == (extra, shortest), f"{number}: {was} or {(extra, shortest, longest, name)}"
            table[number] = (extra, shortest, max(longest, was[2]), name)
    return dict(sorted(table.items()))


def array(doc, name, kind, values):
    print(f"\n/// {doc}\npub(super) static {name}: [{kind}; COUNT] = [")
    line = "   "
    for value in values:
        if len(line) + len(f" {value},") > 119:  # as rustfmt breaks lines
            print(line)
            line = "   "
        line += f" {value},"
    print(line + "\n];")


if __name__ == "__main__":
    table = merged([messages(folder) for folder in sys.argv[1:]] + [pymavlinks()])
    print("//! Every published message. Written by `dialect/make_known.py`, which says from what; not by hand.\n")
    print("/// How many there are.")
    print(f"pub(super) const COUNT: usize = {len(table)};")
    array("Message ids, ascending.", "IDS", "u16", table)
    rows = list(table.values())
    array("The byte that fixes a message's layout, in the order of [`IDS`].", "EXTRAS", "u8", [row[0] for row in rows])
    array("Length of the payload without extensions.", "SHORTEST", "u8", [row[1] for row in rows])
    array("Length of the payload with all extensions that were known.", "LONGEST", "u8", [row[2] for row in rows])
