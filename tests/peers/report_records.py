"""Reads the records of a flight's report: lines of JSON as gzip, as Base64.

Usage: report_records.py FLIGHT.html    (prints them)
"""

import base64
import gzip
import json
import pathlib
import re
import sys


def lines_of(page):
    packed = re.search(r'id="records">(.*?)</script>', page, re.S).group(1)
    return gzip.decompress(base64.b64decode(packed)).decode()


def records_of(page):
    return [json.loads(line) for line in lines_of(page).splitlines()]


if __name__ == "__main__":
    sys.stdout.write(lines_of(pathlib.Path(sys.argv[1]).read_text()))
