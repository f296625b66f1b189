"""Reads the tables of a suite with pyarrow and compares them with each other and with the lines of JSON.

Usage: check_table.py FLIGHTS.parquet FLIGHTS.csv FLIGHTS.jsonl
"""

import json
import sys

import pyarrow
import pyarrow.csv
import pyarrow.parquet

parquet = pyarrow.parquet.read_table(sys.argv[1])
text = ["result", "reason", "trace_hash"]
whole = ["row", "instance", "pair", "seed", "replans"]
# A column of nothing but empty fields has no type of its own.
types = {name: pyarrow.string() for name in text} | {name: pyarrow.int64() for name in whole}
types |= {name: pyarrow.float64() for name in parquet.column_names if name not in types}
options = pyarrow.csv.ConvertOptions(column_types=types)
csv = pyarrow.csv.read_csv(sys.argv[2], convert_options=options)
lines = [json.loads(line) for line in open(sys.argv[3], encoding="utf-8")]

assert parquet.column_names == csv.column_names, (parquet.column_names, csv.column_names)
for name in parquet.column_names:
    assert parquet.schema.field(name).type == types[name], parquet.schema
    assert parquet.schema.field(name).nullable == (types[name] == pyarrow.float64()), name
    expected = [line[name] for line in lines]
    assert parquet[name].to_pylist() == expected, (name, parquet[name].to_pylist(), expected)
    assert csv[name].to_pylist() == expected, (name, csv[name].to_pylist(), expected)
print(json.dumps({"rows": parquet.num_rows, "columns": parquet.column_names, "nulls": sum(c.null_count for c in parquet.columns)}))
