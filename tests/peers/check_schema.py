"""Holds documents, one in a line of standard input, against a JSON schema, which is checked first. Prints a line for each: what is
wrong with it, or nothing.

Usage: check_schema.py SCHEMA
"""

import json
import sys

from jsonschema import Draft202012Validator

with open(sys.argv[1], encoding="utf-8") as file:
    schema = json.load(file)
Draft202012Validator.check_schema(schema)
validator = Draft202012Validator(schema)
for line in sys.stdin:
    error = next(validator.iter_errors(json.loads(line)), None)
    print("" if error is None else " ".join(error.message.split()))
