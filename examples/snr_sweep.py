"""Sweeps the signal-to-noise ratio through `foxhound bearing` and holds the rms error against the Cramer-Rao bound.

    python3 examples/snr_sweep.py                    # out/snr_sweep.csv, and .png where there is Matplotlib
    python3 examples/snr_sweep.py --frames 5000 --snr-db 0 5 10 15 20 25 30

The frames are made here with NumPy, not by the simulator: a plane wave from random azimuths on the default square array,
white noise, 12-bit codes. They go in as `.npy`, the bearings come out as JSON lines: all that another program needs.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path

import numpy as np

WAVELENGTH_M, SIDE_M = 0.345, 0.138
SAMPLE_RATE_HZ, TONE_HZ = 102_400.0, 14_800.0
SAMPLES = 256
AMPLITUDE_CODES = 500.0
# A1 to A4: front-right, front-left, back-left, back-right; forward and right of the middle.
ANTENNAS_M = SIDE_M / 2 * np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]])
ARRAY = f"""wavelength_m = {WAVELENGTH_M}
side_m = {SIDE_M}
sample_rate_hz = {SAMPLE_RATE_HZ}
"""


def frames(azimuths_rad, snr_db, random):
    """Codes of frames of one source each: (frames, channels, samples)."""
    towards = np.stack([np.cos(azimuths_rad), np.sin(azimuths_rad)])
    # The antenna nearer the source leads in phase.
    lead_rad = 2 * np.pi / WAVELENGTH_M * (ANTENNAS_M @ towards).T
    common_rad = random.uniform(0, 2 * np.pi, len(azimuths_rad))
    time_s = np.arange(SAMPLES) / SAMPLE_RATE_HZ
    phase_rad = 2 * np.pi * TONE_HZ * time_s + (lead_rad + common_rad[:, None])[..., None]
    noise_codes = AMPLITUDE_CODES / np.sqrt(2 * 10 ** (snr_db / 10))
    values = AMPLITUDE_CODES * np.cos(phase_rad) + noise_codes * random.standard_normal(phase_rad.shape)
    return np.clip(np.rint(values), -2048, 2047).astype(np.int16)


def bearings(program, adc, array):
    """What `foxhound bearing` says of each frame."""
    command = [program, "bearing", "--adc", adc, "--array", array, "--independent", "--json"]
    found = subprocess.run(command, stdout=subprocess.PIPE, check=True, text=True)
    return [json.loads(line) for line in found.stdout.splitlines()]


def row(args, snr_db, random):
    """One line of the table."""
    azimuths_rad = random.uniform(-np.pi, np.pi, args.frames)
    adc, array = args.out / "snr_sweep.npy", args.out / "snr_sweep.toml"
    np.save(adc, frames(azimuths_rad, snr_db, random))
    array.write_text(ARRAY)
    lines = bearings(args.foxhound, adc, array)
    valid = np.array([line["valid"] for line in lines])
    found_rad = np.radians([line["azimuth_deg"] if line["valid"] else np.nan for line in lines])[valid]
    error_rad = np.angle(np.exp(1j * (found_rad - azimuths_rad[valid])))
    rms_rad = np.sqrt(np.mean(error_rad**2)) if valid.any() else np.nan
    bound_rad = WAVELENGTH_M / (2 * np.pi * SIDE_M * np.sqrt(SAMPLES * 10 ** (snr_db / 10)))
    return snr_db, args.frames, int(valid.sum()), np.degrees(rms_rad), np.degrees(bound_rad)


def draw(rows, path):
    """Both over the signal-to-noise ratio, where there is something to draw with."""
    try:
        import matplotlib

        matplotlib.use("Agg")
        from matplotlib import pyplot
    except ImportError:
        print("no matplotlib: no plot", file=sys.stderr)
        return
    snr_db, _, _, rms_deg, bound_deg = np.array(rows).T
    figure, axes = pyplot.subplots(figsize=(6, 4), layout="constrained")
    axes.semilogy(snr_db, rms_deg, "o-", color="#0072b2", label="foxhound bearing")
    axes.semilogy(snr_db, bound_deg, "--", color="#d55e00", label="Cramer-Rao bound")
    axes.set(xlabel="signal-to-noise ratio per sample, dB", ylabel="rms error of the azimuth, deg")
    axes.grid(which="both", alpha=0.3)
    axes.legend()
    figure.savefig(path, dpi=150)
    print(f"plot: {path}", file=sys.stderr)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--snr-db", type=float, nargs="+", default=[0, 5, 10, 15, 20, 25, 30, 35, 40])
    parser.add_argument("--frames", type=int, default=1000, help="frames of each [default: 1000]")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--foxhound", type=Path, default=Path("target/release/foxhound"), help="the program")
    parser.add_argument("--out", type=Path, default=Path("out"), help="folder of what is written")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    random = np.random.default_rng(args.seed)
    rows = [row(args, snr_db, random) for snr_db in args.snr_db]
    lines = ["snr_db,frames,valid,rms_deg,bound_deg"]
    lines += [f"{snr:g},{count},{valid},{rms:.4f},{bound:.4f}" for snr, count, valid, rms, bound in rows]
    (args.out / "snr_sweep.csv").write_text("\n".join(lines) + "\n")
    print("\n".join(lines))
    draw(rows, args.out / "snr_sweep.png")


if __name__ == "__main__":
    main()
