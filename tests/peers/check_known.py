"""Checks the framer's table of published messages against pymavlink's generated dialects and its definitions.

Usage: check_known.py < table, one message a line: ID CRC_EXTRA SHORTEST
"""

import importlib
import os
import sys

os.environ["MAVLINK20"] = "1"
sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "link", "dialect"))
sys.dont_write_bytecode = True
import make_known  # noqa: E402

table = {}
for line in sys.stdin:
    number, *row = map(int, line.split())
    table[number] = tuple(row)

compared = 0
# What pymavlink's generator wrote for Python, which is what it checks frames with.
for dialect in ("minimal", "common", "ardupilotmega", "development", "all"):
    for number, kind in importlib.import_module(f"pymavlink.dialects.v20.{dialect}").mavlink_map.items():
        extra = table[number][0]
        assert extra == kind.crc_extra, (dialect, kind.msgname, extra, kind.crc_extra)
        compared += 1
# The lengths without extensions are only in the definitions.
for number, (extra, shortest, name) in make_known.pymavlinks().items():
    assert table[number] == (extra, shortest), (name, table[number])

print(f"{compared} comparisons, {len(table)} messages of which pymavlink knows {len(make_known.pymavlinks())}")
assert compared > 1000
print("all checks passed")
