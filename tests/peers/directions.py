"""Directions of frames by MUSIC for one source and by a plain beam, in NumPy.

    directions.py FOLDER

For each NAME.json in the folder, {"antennas": [[x, y], ...] in wavelengths, "bins": [first, last] of the band or null,
"looks": how many frames in a row are joined, one or several numbers}, reads NAME.npy, complex64 (frames, channels, N), and
prints a line {"name", "looks", "music_deg", "beam_deg", "music_us"} for each number of looks. Both methods look at every tenth of a
degree; the time is the least that MUSIC took, with its spectrum and its covariance.
"""

import json
import os
import pathlib
import sys
import time

# One core, as the program that it is compared with.
os.environ["OPENBLAS_NUM_THREADS"] = "1"
import numpy as np

GRID = np.deg2rad(np.arange(3600) / 10)


def covariance(frames, bins):
    if bins is not None:
        frames = np.fft.fft(frames)[..., bins]
    return sum(frame @ frame.conj().T for frame in frames)


def music(r, steering):
    _, vectors = np.linalg.eigh(r)
    left = np.sum(np.abs(vectors[:, :-1].conj().T @ steering) ** 2, axis=0)
    return np.argmin(left) / 10


def beam(r, steering):
    return np.argmax(np.sum(steering.conj() * (r @ steering), axis=0).real) / 10


for file in sorted(pathlib.Path(sys.argv[1]).glob("*.json")):
    described = json.loads(file.read_text())
    frames = np.load(file.with_suffix(".npy"))
    x, y = np.array(described["antennas"]).T
    steering = np.exp(2j * np.pi * (np.outer(x, np.cos(GRID)) + np.outer(y, np.sin(GRID))))
    bins = described["bins"] and np.arange(described["bins"][0], described["bins"][1] + 1)
    for looks in described["looks"]:
        found, beams, times = [], [], []
        for first in range(0, len(frames) - looks + 1, looks):
            began = time.perf_counter()
            r = covariance(frames[first : first + looks], bins)
            found.append(music(r, steering))
            times.append(time.perf_counter() - began)
            beams.append(beam(r, steering))
        line = {"name": file.stem, "looks": looks, "music_deg": found, "beam_deg": beams}
        print(json.dumps(line | {"music_us": min(times) * 1e6}))
