"""The package against the command line, `$FOXHOUND`: both are the same Rust, so they must agree in every number."""

import ast
import csv
import inspect
import io
import json
import os
import signal
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import foxhound
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "examples"))
import snr_sweep  # noqa: E402

SQUARE = {"wavelength_m": 0.345, "side_m": 0.138, "sample_rate_hz": 102_400}
RING_M = 0.06 * np.array([[1, 0], [-0.5, 0.866], [-0.5, -0.866]])
RING = {"wavelength_m": 0.1229, "antennas_m": RING_M, "sample_rate_hz": 2e6}
SUITE = {
    "max_time_s": 30,
    "maps": [
        {"row": 2, "instance": 0, "obstacles": [[3, 4, 0.5], [6, 5, 0.7]], "pairs": [[0.5, 0.5, 9, 9, 12.1], [1, 0.5, 3, 4, 4]]},
        {"row": 1, "instance": 3, "obstacles": [], "pairs": [[1, 1, 9, 9, 11.4]]},
    ],
}


def command(*arguments, binary=os.environ.get("FOXHOUND", "foxhound")):
    """What the command line prints. 1 says that a beacon was not reached, which is a result."""
    ended = subprocess.run([binary, *map(str, arguments)], capture_output=True, text=True)
    if ended.returncode not in (0, 1):
        raise RuntimeError(ended.stderr)
    return ended.stdout


def ring_samples(azimuths_rad, samples, random):
    """Complex samples of a carrier in the middle of the band, with noise at 20 dB: (frames, antennas, samples)."""
    towards = np.stack([np.cos(azimuths_rad), np.sin(azimuths_rad)])
    wave = np.exp(2j * np.pi / RING["wavelength_m"] * (RING_M @ towards).T)[..., None] * np.ones(samples)
    noise = 0.1 / np.sqrt(2) * random.standard_normal((2, *wave.shape))
    return (wave + noise[0] + 1j * noise[1]).astype(np.complex64)


class Bearings(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        self.random = np.random.default_rng(1)

    def save(self, name, array):
        np.save(self.folder / name, array)
        return self.folder / name

    def assert_same(self, table, array, *arguments):
        """Each number of the table is that of the line which the command line prints."""
        (self.folder / "array.toml").write_text(array.toml)
        printed = command("bearing", *arguments, "--array", self.folder / "array.toml", "--json")
        lines = [json.loads(line) for line in printed.splitlines()]
        self.assertGreater(len(lines), 0)
        self.assertEqual(set(table), set(lines[0]))
        for name, column in table.items():
            expected = [line[name] for line in lines]
            if name == "flags":
                expected = [" ".join(flags) for flags in expected]
            self.assertEqual((type(column), column.shape), (np.ndarray, (len(lines),)), name)
            found = [None if value != value else value for value in column.tolist()]
            self.assertEqual(found, expected, name)

    def test_codes(self):
        """Good frames, one that is silent, one with a dead channel, and looks of an array that turns."""
        azimuths_rad = self.random.uniform(-np.pi, np.pi, 16)
        frames = snr_sweep.frames(azimuths_rad, 20, self.random)
        frames[3], frames[5, 2] = 0, 0
        array, adc = foxhound.Array(**SQUARE), self.save("adc.npy", frames)
        table = foxhound.bearings(array, frames)
        self.assert_same(table, array, "--adc", adc)
        error_rad = np.radians(table["azimuth_deg"]) - azimuths_rad
        error_deg = np.degrees(np.angle(np.exp(1j * error_rad)))[table["valid"]]
        self.assertTrue(12 <= len(error_deg) <= 15 and np.abs(error_deg).max() < 5, error_deg)
        self.assertTrue(np.isnan(table["azimuth_deg"][3]) and table["flags"][3] == "no_signal", table)
        self.assertIn("dead_3", table["flags"][5])
        self.assert_same(foxhound.bearings(array, str(adc)), array, "--adc", adc)

        yaw_rad = np.linspace(0, 3, 16)
        with self.assertWarnsRegex(UserWarning, "side_m is close to half a wavelength"):
            foxhound.bearings(foxhound.Array(**SQUARE | {"side_m": 0.17}), frames)
        table = foxhound.bearings(array, np.asfortranarray(frames), looks=4, yaw_rad=yaw_rad, independent=True)
        yaw = self.save("yaw.npy", yaw_rad)
        self.assert_same(table, array, "--adc", adc, "--looks", 4, "--yaw", yaw, "--independent")

    def test_complex_samples(self):
        azimuths_rad = np.array([-2.0, 0.5, 3.0, 1.0])
        samples = ring_samples(azimuths_rad, 64, self.random)
        array, iq = foxhound.Array(**RING), self.save("iq.npy", samples)
        table = foxhound.bearings(array, samples)
        self.assert_same(table, array, "--iq", iq)
        np.testing.assert_allclose(np.radians(table["azimuth_deg"]), azimuths_rad, atol=0.1)
        self.assert_same(foxhound.bearings(array, iq, looks=2), array, "--iq", iq, "--looks", 2)
        with self.assertWarnsRegex(UserWarning, "of the power are at 0 Hz"):
            foxhound.bearings(array, samples + np.complex64(10))

    def test_packets_of_an_array_behind_a_switch(self):
        azimuths_rad = np.array([-2.0, 0.5] * 8)
        slots = np.arange(30) % 3
        packets = ring_samples(azimuths_rad, 4, self.random)[:, slots]
        time_s = np.arange(30)[:, None] * 4e-6 + np.arange(4) / 2e6
        packets = (packets * np.exp(2j * np.pi * 250e3 * time_s)).astype(np.complex64)
        array = foxhound.Array(**RING, tone_hz=250e3, switch={"slot_s": 4e-6, "pattern": [1, 2, 3]})
        arguments = "--switched", self.save("packets.npy", packets), "--looks", 4
        emitter = np.array([7, 9] * 8)
        table = foxhound.bearings(array, packets, emitter=emitter, looks=4)
        self.assert_same(table, array, *arguments, "--emitter", self.save("emitter.npy", emitter.astype(np.int32)))
        np.testing.assert_allclose(np.radians(table["azimuth_deg"]), [-2.0, 0.5] * 2, atol=0.1)
        with self.assertWarnsRegex(UserWarning, "1 of 15 packets make no group of 2 of one transmitter"):
            foxhound.bearings(array, packets[:15], emitter=emitter[:15], looks=2)

    def test_what_is_refused_is_named(self):
        array, frames = foxhound.Array(**SQUARE), np.zeros((3, 4, 64), np.int16)
        cases = [
            (lambda: foxhound.Array(**SQUARE | {"wavelength_m": -1}), "wavelength_m = -1 is outside 0.001..=10"),
            (lambda: foxhound.Array(**SQUARE, tone_hertz=9e3), "tone_hertz: unknown key; did you mean `tone_hz`?"),
            (lambda: foxhound.Array(**RING, switch={"slot_s": 9, "pattern": [1]}), "switch.slot_s = 9 is outside"),
            (lambda: foxhound.Array.from_file("none.toml"), "none.toml: No such file"),
            (lambda: foxhound.bearings(array, frames.astype(float)), "dtype float64: expected int16"),
            (lambda: foxhound.bearings(array, frames[:, :3]), "channels = 3: expected 4"),
            (lambda: foxhound.bearings(array, frames + np.int16(3000)), "code 3000 in frame 0, channel 1"),
            (lambda: foxhound.bearings(array, frames, looks=2), "looks = 2: the last 1 of 3 frames"),
            (lambda: foxhound.bearings(array, frames, looks=0), "looks = 0 is outside 1..=1000000"),
            (lambda: foxhound.bearings(array, frames, emitter=[1, 2, 3]), "emitter: only with packets"),
            (lambda: foxhound.bearings(array, frames, yaw_rad=[1.0]), "expected one yaw a frame, (3,)"),
            (lambda: foxhound.bearings(foxhound.Array(**RING), frames), "antennas_m: 3 antennas"),
            (lambda: foxhound.fly({"goal": [1, 1e9]}), "goal[1] = 1000000000 is outside"),
            (lambda: foxhound.fly(snr_db=99), "snr_db = 99 is outside -30..=80"),
            (lambda: foxhound.fly(planner="none"), 'planner = "none": expected one of foxhound, paper'),
            (lambda: foxhound.fly(params={"FH_MARGINS": 1.0}), "FH_MARGINS: unknown parameter"),
            (lambda: foxhound.Suite({"maps": []}).run(), "maps: there is no pair"),
            (lambda: foxhound.Suite(SUITE).run(jobs=0), "jobs = 0 is outside 1..=1024"),
        ]
        for call, text in cases:
            with self.subTest(text):
                with self.assertRaises(ValueError) as caught:
                    call()
                self.assertIn(text, str(caught.exception))


class Flights(unittest.TestCase):
    def assert_same(self, flight, *arguments, radius_m=0.15):
        printed = json.loads(command("fly", "--json", *arguments))
        path, obstacles = flight.pop("path"), flight.pop("obstacles")
        self.assertEqual(flight, printed)
        length_m = np.hypot(np.diff(path["north_m"]), np.diff(path["east_m"])).sum()
        # The end of the last step is in no row.
        self.assertAlmostEqual(length_m, printed["path_length_m"], delta=0.03)
        self.assertEqual({column.shape for column in path.values()}, {(round(printed["time_s"] / 0.02),)})
        apart_m = np.hypot(*(path[axis][:, None] - obstacles[axis] for axis in ("north_m", "east_m")))
        clearance_m = (apart_m - obstacles["radius_m"]).min() - radius_m
        self.assertAlmostEqual(clearance_m, printed["min_clearance_m"], delta=0.01)

    def test_the_built_in_mission(self):
        flight = foxhound.fly()
        readme = (ROOT / "README.md").read_text()
        self.assertIn(f"trace            {flight['trace_hash']} (seed 1)", readme)
        self.assert_same(flight)

    def test_a_scenario_as_dictionary_and_as_file(self):
        scenario = {"obstacles": [{"x": 4, "y": 4.2, "r": 0.5}], "random": {"count": 4}, "limits": {"v_max": np.float32(0.75)}}
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "world.json"
            file.write_text(json.dumps(scenario, default=float))
            params = {"FH_MARGIN_GRD": 0.06, "FH_RADIUS": 0.2, "FH_OBS_FOV": 180.0}
            (file.parent / "params.toml").write_text("".join(f"{name} = {value}\n" for name, value in params.items()))
            options = {"seed": 5, "snr_db": 10.0, "planner": "paper", "params": params}
            arguments = ["--seed", 5, "--snr-db", 10, "--planner", "paper", "--params", file.parent / "params.toml"]
            for given in (scenario, file, str(file)):
                self.assert_same(foxhound.fly(given, **options), "--scenario", file, *arguments, radius_m=0.2)

    def test_a_suite(self):
        with tempfile.TemporaryDirectory() as folder:
            file, table = Path(folder) / "suite.json", Path(folder) / "flights.csv"
            file.write_text(json.dumps(SUITE))
            printed = json.loads(command("suite", file, "--json", "--csv", table, "--seed", 3, "--snr-db", 20))
            rows = list(csv.DictReader(io.StringIO(table.read_text())))
            for given in (SUITE, file):
                result = foxhound.Suite(given).run(seed=3, snr_db=20.0, jobs=2)
                flights = result.pop("flights")
                self.assertEqual(result, printed)
                self.assertEqual((printed["all"]["runs"], printed["all"]["success"]), (3, 2), "one goal is in a pillar")
                self.assertEqual(list(flights), list(rows[0]))
                for name, column in flights.items():
                    expected = [row[name] for row in rows]
                    found = ["" if value != value else value for value in column.tolist()]
                    self.assertEqual([type(value)(text) for value, text in zip(found, expected)], found, name)
        self.assertEqual(foxhound.Suite(SUITE).run(only=[1])["all"]["runs"], 1)

    def test_ctrl_c_ends_a_suite(self):
        """Thousands of flights take minutes."""
        # Where the tests run in the background of a shell, Ctrl-C is ignored unless it is asked for.
        code = """import signal, foxhound
signal.signal(signal.SIGINT, signal.default_int_handler)
pairs = [[0.5, 0.5, 9, 9, 12.1]] * 20_000
suite = foxhound.Suite({"maps": [{"row": 1, "instance": 0, "obstacles": [[3, 4, 0.5]], "pairs": pairs}]})
print("ready", flush=True)
suite.run()"""
        program = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.addCleanup(program.kill)
        self.assertEqual(program.stdout.readline(), "ready\n")
        program.send_signal(signal.SIGINT)
        _, errors = program.communicate(timeout=300)
        self.assertIn("KeyboardInterrupt", errors)


class Stub(unittest.TestCase):
    def test_the_types_are_of_what_is_there(self):
        """The same names, with the same parameters in the same order; the keys of an array are those of its reader."""
        tree = ast.parse((ROOT / "python/foxhound.pyi").read_text())
        functions = [(foxhound, node) for node in tree.body if isinstance(node, ast.FunctionDef)]
        for owner in (node for node in tree.body if isinstance(node, ast.ClassDef)):
            members = [node for node in owner.body if isinstance(node, ast.FunctionDef)]
            functions += [(getattr(foxhound, owner.name), node) for node in members if node.name != "__init__"]
        self.assertEqual(sorted(node.name for _, node in functions), ["bearings", "fly", "from_file", "run", "toml"])
        for owner, node in functions:
            if node.name == "toml":
                continue
            names = [argument.arg for argument in node.args.args + node.args.kwonlyargs if argument.arg not in ("cls", "self")]
            signature = inspect.signature(getattr(owner, node.name))
            self.assertEqual([name for name in signature.parameters if name != "self"], names, node.name)
        public = {name for name in dir(foxhound) if not name.startswith("_")} - {"foxhound"}
        self.assertEqual(public, {"Array", "Suite", "bearings", "fly"})


if __name__ == "__main__":
    unittest.main()
