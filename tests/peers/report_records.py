"""Unpacks the records of a flight's report, after the format in host-sim/src/record/report/pack.rs.

Usage: report_records.py FLIGHT.html    (prints the bytes that each kind of record takes)
"""

import base64
import gzip
import json
import pathlib
import re
import sys


def numbers(data, at, count):
    """Zigzag LEB128 numbers, and where they end."""
    values = []
    for _ in range(count):
        value = shift = 0
        while True:
            byte = data[at]
            at += 1
            value |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                break
        values.append((value >> 1) ^ -(value & 1))
    return values, at


def reader(shape, columns):
    """A function that returns the next value of a shape."""
    ((name, what),) = shape.items()
    if name == "nothing":
        return lambda: None
    if name == "list":
        lengths = columns.pop(0)
        each = reader(what, columns)
        return lambda: [each() for _ in range(next(lengths))]
    if name == "tuple":
        parts = [reader(part, columns) for part in what]
        return lambda: [part() for part in parts]
    if name == "fields":
        fields = [(field, columns.pop(0) if may_miss else None, reader(inner, columns)) for field, may_miss, inner in what]
        return lambda: {field: read() for field, present, read in fields if present is None or next(present)}
    values = columns.pop(0)
    if name == "flag":
        return lambda: next(values) == 1
    if name == "text":
        return lambda: what[next(values)]
    return lambda: next(values) / 10**what


def unpacked(page):
    """The line of JSON, and the bytes behind it."""
    packed = re.search(r'id="records">(.*?)</script>', page, re.S).group(1)
    head, data = gzip.decompress(base64.b64decode(packed)).split(b"\n", 1)
    return json.loads(head), data


def records_of(page):
    """All records: the header, kind by kind, the end."""
    head, data = unpacked(page)
    records, at = list(head["first"]), 0
    for table in head["tables"]:
        columns = []
        for column in table["columns"]:
            values, at = numbers(data, at, column["count"])
            for lag in reversed(column["lags"]):
                for index in range(lag, len(values)):
                    values[index] += values[index - lag]
            columns.append(iter(values))
        read = reader(table["shape"], columns)
        records += [{"kind": table["kind"], **read()} for _ in range(table["rows"])]
    assert at == len(data), (at, len(data))
    return records + head["last"]


def leaves(shape, path):
    """The names of the columns of a shape, in their order."""
    ((name, what),) = shape.items()
    if name == "list":
        return [path + ".length", *leaves(what, path)]
    if name == "tuple":
        return [leaf for index, part in enumerate(what) for leaf in leaves(part, f"{path}.{index}")]
    if name == "fields":
        named = ((field, may_miss, leaves(inner, f"{path}.{field}")) for field, may_miss, inner in what)
        return [leaf for field, may_miss, inner in named for leaf in [f"{path}.{field}?"] * may_miss + inner]
    return [] if name == "nothing" else [path]


def sizes(page):
    """Prints the compressed size of every kind and of its largest columns."""
    head, data = unpacked(page)
    at = 0
    print(f"page {len(page)} bytes, of which {len(gzip.compress(json.dumps(head).encode()))} header")
    for table in head["tables"]:
        begin, parts = at, []
        for name, column in zip(leaves(table["shape"], table["kind"]), table["columns"]):
            _, end = numbers(data, at, column["count"])
            parts.append((len(gzip.compress(data[at:end])), name, column["lags"]))
            at = end
        print(f"{table['kind']}: {table['rows']} records, {len(gzip.compress(data[begin:at]))} bytes")
        for size, name, lags in sorted(parts, reverse=True)[:8]:
            print(f"    {size} {name} {lags}")


if __name__ == "__main__":
    sizes(pathlib.Path(sys.argv[1]).read_text())
