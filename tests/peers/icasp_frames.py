"""Frames of the recordings of C2A2-at-Florida-Atlantic-University/icasp, as NumPy files.

    icasp_frames.py DATA FOLDER

DATA is that repository's folder `data`. Writes for each of the emitter's eight places PLACE.npy, complex64 (frames, 4, 128):
the six rows of four antennas in turn, which hear the same at once; and PLACE.json with the antennas in wavelengths and
the angle from a row's broadside that the published azimuth and elevation make. What the authors could not cut out is left out.
"""

import json
import pathlib
import sys

import numpy as np
from scipy.io import loadmat

WAVELENGTH_M, APART_M, ROWS = 0.0844486, 0.07935, 6
data, folder = map(pathlib.Path, sys.argv[1:])
for place in range(1, 9):
    recorded = loadmat(data / f"client_x{place}_for_az.mat")
    azimuth = np.deg2rad(recorded["output_az"].item())
    # From straight down.
    elevation = np.deg2rad(loadmat(data / f"client_x{place}_for_elev.mat")["output_elev"].item())
    off_broadside = np.rad2deg(np.arcsin(np.sin(azimuth) * np.sin(abs(elevation))))
    frames = np.stack([recorded[f"output_samples_frame_{frame}"] for frame in range(1, 21)])
    frames = frames[~np.isnan(frames).any(axis=(1, 2, 3))]
    np.save(folder / f"{place}.npy", frames.reshape(-1, *frames.shape[2:]).astype(np.complex64))
    # A wave from the first antenna's side leads there.
    antennas = [[0.0, -APART_M / WAVELENGTH_M * antenna] for antenna in range(4)]
    described = {"antennas": antennas, "bins": None, "looks": [1, ROWS], "off_broadside_deg": off_broadside}
    (folder / f"{place}.json").write_text(json.dumps(described))
