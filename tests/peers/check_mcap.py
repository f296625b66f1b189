"""Reads a flight's MCAP file with the package of its makers and checks what is in it.

Usage: check_mcap.py FLIGHT.mcap LAYOUT.json
"""

import base64
import importlib
import json
import math
import re
import struct
import sys
from collections import Counter

from google.protobuf.descriptor import FieldDescriptor as Field
from jsonschema import Draft202012Validator
from mcap.reader import make_reader

from checks import check

TYPES = {
    Field.TYPE_DOUBLE: "number",
    Field.TYPE_FIXED32: "integer",
    Field.TYPE_INT32: "integer",
    Field.TYPE_ENUM: "integer",
    Field.TYPE_BOOL: "boolean",
    Field.TYPE_STRING: "string",
    Field.TYPE_BYTES: "string",
}
TIMES = ("google.protobuf.Timestamp", "google.protobuf.Duration")


def published(name):
    """What Foxglove publishes as the definition of its message."""
    short = name.removeprefix("foxglove.")
    return getattr(importlib.import_module(f"foxglove_schemas_protobuf.{short}_pb2"), short)


def compare(schema, descriptor, where):
    """Whether a schema has the fields of a message, all of them, with their types."""
    names = {field.name for field in descriptor.fields}
    assert set(schema["properties"]) == names, f"{where}: {set(schema['properties']) ^ names}"
    for field in descriptor.fields:
        ours, here = schema["properties"][field.name], f"{where}.{field.name}"
        if field.is_repeated:
            assert ours["type"] == "array", here
            if ours.get("maxItems") == 0:
                continue
            ours = ours["items"]
        if field.type != Field.TYPE_MESSAGE:
            assert ours["type"] == TYPES[field.type], here
            assert ("contentEncoding" in ours) == (field.type == Field.TYPE_BYTES), here
        elif field.message_type.full_name in TIMES:
            assert set(ours["properties"]) == {"sec", "nsec"}, here
        else:
            assert ours["type"] == "object", here
            compare(ours, field.message_type, here)


def turned(q):
    """Where the x axis points after a rotation."""
    x, y, z, w = q["x"], q["y"], q["z"], q["w"]
    return (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y))


def apart_deg(a, b):
    return abs((a - b + 180) % 360 - 180)


def compass_deg(east, north):
    return math.degrees(math.atan2(east, north))


schemas, messages, times = {}, {}, []
with open(sys.argv[1], "rb") as file:
    reader = make_reader(file, validate_crcs=True)
    summary = reader.get_summary()
    for schema, channel, message in reader.iter_messages():
        assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
        schemas[channel.topic] = (schema.name, json.loads(schema.data))
        messages.setdefault(channel.topic, []).append((message, json.loads(message.data)))
        times.append(message.log_time)
    metadata = {each.name: each.metadata for each in reader.iter_metadata()}
    attachments = {each.name: json.loads(each.data) for each in reader.iter_attachments()}

check(times == sorted(times) and times[0] == 0, f"{len(times)} messages in the order of time")
check(summary.statistics.message_count == len(times), "as many as its summary says")
topics = {channel.topic for channel in summary.channels.values()}
check(topics == set(messages), f"every one of {len(topics)} topics has messages {topics - set(messages)}")
for topic, all_of_it in messages.items():
    name, schema = schemas[topic]
    Draft202012Validator.check_schema(schema)
    validator = Draft202012Validator(schema)
    for number, (message, content) in enumerate(all_of_it):
        error = next(validator.iter_errors(content), None)
        assert error is None, f"{topic} {number}: {error}"
        assert message.sequence == number, topic
        stamps = [content["timestamp"]] if "timestamp" in content else []
        stamps += [entity["timestamp"] for entity in content.get("entities", [])]
        assert all(stamp["sec"] * 10**9 + stamp["nsec"] == message.log_time for stamp in stamps), topic
print("ok: every message is as its schema says, none is missing, and all say the time at which they stand")

known = sorted({name for name, _ in schemas.values() if name.startswith("foxglove.")})
for name, schema in schemas.values():
    if name in known:
        compare(schema, published(name).DESCRIPTOR, name)
print(f"ok: {known} have the fields that Foxglove publishes")
check(published("foxglove.PackedElementField").NumericType.Value("FLOAT32") == 7, "7 is single precision")
check(published("foxglove.LinePrimitive").Type.Value("LINE_STRIP") == 0, "0 is a strip")
levels = published("foxglove.Log").Level
check([levels.Name(level) for level in (2, 3, 4)] == ["INFO", "WARNING", "ERROR"], "2, 3, 4 are the levels")

content = {topic: [each for _, each in all_of_it] for topic, all_of_it in messages.items()}
for transform, pose, vehicle in zip(content["/tf"], content["/pose"], content["/vehicle"], strict=True):
    at = transform["translation"]
    assert (at, transform["rotation"]) == (pose["pose"]["position"], pose["pose"]["orientation"])
    assert (at["x"], at["y"], at["z"]) == (vehicle["east_m"], vehicle["north_m"], vehicle["up_m"])
    east, north, up = turned(transform["rotation"])
    assert apart_deg(compass_deg(east, north), vehicle["yaw_deg"]) < 0.01, vehicle
    assert abs(math.degrees(math.asin(up)) - vehicle["pitch_deg"]) < 0.01, vehicle
print("ok: the nose is drawn where the compass says, and up where the pitch says")

# Beside an autopilot steps are left out when the machine is busy: such seconds are not looked at.
vehicle, times_s = content["/vehicle"], [message.log_time * 1e-9 for message, _ in messages["/vehicle"]]
whole = [k for k in range(len(vehicle) - 50) if abs(times_s[k + 50] - times_s[k] - 1) < 0.005]
check(len(whole) > 0.3 * (len(vehicle) - 50), f"{len(whole)} of {len(vehicle) - 50} seconds are whole")
off = [
    math.hypot(*(vehicle[k + 50][f"{axis}_m"] - vehicle[k][f"{axis}_m"]
                 - sum(a[f"{axis}_mps"] + b[f"{axis}_mps"] for a, b in zip(vehicle[k : k + 50], vehicle[k + 1 : k + 51])) / 100
                 for axis in ("east", "north")))
    for k in whole
]
check(max(off) < 0.03, f"places are the sum of velocities within {max(off):.3f} m a second")

beacon = content["/scene/world"][-1]["entities"][0]["spheres"][0]["pose"]["position"]
pointed = []
for update in content["/scene/moment"]:
    for arrow in update["entities"][0]["arrows"]:
        if arrow["color"]["b"] > 0.7:
            at, (east, north, _) = arrow["pose"]["position"], turned(arrow["pose"]["orientation"])
            truth = compass_deg(beacon["x"] - at["x"], beacon["y"] - at["y"])
            pointed.append(apart_deg(compass_deg(east, north), truth))
# A bearing is off by its own error, more so near the beacon; one that is turned or mirrored by far more.
check(len(pointed) > 50 and max(pointed) < 5.0, f"{len(pointed)} arrows point at the beacon within {max(pointed):.2f} deg")

for grid, plan in zip(content["/potential"], content["/plan"], strict=True):
    data = base64.b64decode(grid["data"], validate=True)
    columns, rows = grid["column_count"], len(data) // grid["row_stride"]
    assert len(data) == rows * grid["row_stride"] and columns * grid["cell_stride"] == grid["row_stride"]
    corner, cell = grid["pose"]["position"], grid["cell_size"]
    middle = corner["x"] + 0.5 * columns * cell["x"], corner["y"] + 0.5 * rows * cell["y"]
    start, target = plan["start"], plan["target"]
    assert math.dist(middle, (start["east_m"], start["north_m"])) < 0.01
    values = struct.unpack(f"<{2 * rows * columns}f", data)
    assert all(map(math.isfinite, values))
    # Without obstacles the potential is least where the target is, or nearest to it.
    if not plan["obstacles"]:
        least = min(range(rows * columns), key=lambda k: values[2 * k + 1])
        row, column = divmod(least, columns)
        place = corner["x"] + (column + 0.5) * cell["x"], corner["y"] + (row + 0.5) * cell["y"]
        assert math.dist(place, (target["east_m"], target["north_m"])) < 0.75 * cell["x"], (place, target)
print("ok: the potential lies around the start of its plan, and the target lowest")

layout = json.load(open(sys.argv[2], encoding="utf-8"))
used, paths = set(), set()


def leaves(tree):
    if isinstance(tree, str):
        return [tree]
    return leaves(tree["first"]) + leaves(tree["second"])


check(sorted(leaves(layout["layout"])) == sorted(layout["configById"]), "the layout has every panel once")
for config in layout["configById"].values():
    used |= set(config.get("topics", {})) | ({config["topicToRender"]} if "topicToRender" in config else set())
    paths |= {path["value"] for path in config.get("paths", [])} | ({config["topicPath"]} if "topicPath" in config else set())
for path in sorted(paths):
    topic, *fields = path.split(".")
    used.add(topic)
    schema = schemas[topic][1]
    for field in fields:
        name, is_list = re.fullmatch(r"(\w+)(\[:\])?", field).groups()
        schema = schema["properties"][name]
        schema = schema["items"] if is_list else schema
    assert not fields or schema["type"] in ("number", "integer", "string"), path
check(used <= topics, f"it shows {sorted(used)}")

errors = [each["error_deg"] for each in content["/bearing"] if each["valid"] and "error_deg" in each]
way = [(each["east_m"], each["north_m"]) for each in content["/vehicle"]]
print("all checks passed")
print(json.dumps({
    "counts": Counter({topic: len(all_of_it) for topic, all_of_it in messages.items()}),
    "metadata": metadata,
    "scenario": attachments["scenario.json"],
    "parameters": len(attachments["parameters.json"]),
    "bearing_rms_deg": math.sqrt(sum(error**2 for error in errors) / len(errors)),
    "path_length_m": sum(map(math.dist, way, way[1:])),
    "min_clearance_m": min(each["clearance_m"] for each in content["/vehicle"]),
    "last_s": times[-1] / 1e9,
}))
