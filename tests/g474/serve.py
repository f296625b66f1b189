"""The board as a child process: a line of JSON in, a line of JSON out, bytes in hexadecimal.

`python serve.py ELF [--seed N] [--crystal missing|fails] [--new]` boots the image up to its first frame and answers with a report, as it does to

| line | does |
|---|---|
| `{"do": "step", "rx": .., "codes": .., "port": .., "lidar": ..}` | runs to shortly before the next frame is handed over |
| `{"do": "run", "us": ..}` | runs for so long |
| `{"do": "fault", "kind": ..}` | lets something go wrong: `FAULTS` |
| `{"do": "timing"}` | says what time was spent on |

`rx` are bytes for USART1, `port` for LPUART1, `lidar` for USART3, from now on at the line's rate; `codes` are 4 x 256 samples of 16 bits that the
converters bring until the next step, in each of their blocks. A rule that is broken ends the run: `{"broken": ..}`.
"""

import argparse
import json
import struct
import sys

import core as processor
from core import IRQ, SLEEP, THREAD, UNITS_PER_S, Statistic
from machine import SAMPLES, Machine
from rules import Broken
from serial import BREAK, NOISE

US = UNITS_PER_S // 1_000_000
BOARD = b"nucleo_g474re"
# What the firmware hands over: every eighth block.
BLOCKS_PER_FRAME = 8
# So long before a frame is handed over the simulator speaks.
AHEAD_BLOCKS = 2
# Without samples.
PERIOD_UNITS = UNITS_PER_S // 50
# The interrupts that the executors run in.
GUIDANCE, LINK = IRQ + 100, IRQ + 101
LEVELS = {GUIDANCE: "guidance", LINK: "link", THREAD: "planner", SLEEP: "sleep"}


def read_elf(path):
    """The segments of an image, and the board that it is for."""
    with open(path, "rb") as file:
        data = file.read()
    if data[:5] != b"\x7fELF\x01":
        raise SystemExit(f"{path}: it is no 32-bit ELF file")
    programs, sections = struct.unpack_from("<2I", data, 28)
    count, = struct.unpack_from("<H", data, 44)
    segments = []
    for at in range(programs, programs + 32 * count, 32):
        kind, offset, _, address, size = struct.unpack_from("<5I", data, at)
        if kind == 1 and size:
            segments.append((address, data[offset:offset + size]))
    section_count, names = struct.unpack_from("<2H", data, 48)
    headers = [struct.unpack_from("<6I", data, sections + 40 * at) for at in range(section_count)]
    strings = headers[names][4]
    for name, _, _, _, offset, size in headers:
        if data[strings + name:].startswith(b".foxhound_board\0"):
            return segments, data[offset:offset + size]
    return segments, None


class Session:
    """A board that is being stepped."""

    def __init__(self, machine):
        self.machine = machine
        self.told = 0
        self.per_frame = {name: Statistic() for name in [*LEVELS.values(), "interrupts"]}
        self.before = {}

    @property
    def core(self):
        return self.machine.core

    def next_frame(self):
        """When the next frame is handed over that can still be spoken for; `None` while nothing is sampled."""
        machine = self.machine
        if machine.sampling_at is None:
            return None
        period = machine.sampler.period()
        frame = BLOCKS_PER_FRAME * SAMPLES * period
        first = machine.sampling_at + frame
        # A run ends within an instruction or an exception of where it should.
        due = self.core.time + AHEAD_BLOCKS * SAMPLES * period - period
        return first + max(0, -(-(due - first) // frame)) * frame

    def pause(self):
        """Runs to where the next frame can be spoken for."""
        end = self.core.time + PERIOD_UNITS
        frame = self.next_frame()
        if frame is not None:
            ahead = AHEAD_BLOCKS * SAMPLES * self.machine.sampler.period()
            following = frame + BLOCKS_PER_FRAME * SAMPLES * self.machine.sampler.period()
            # This one, where it has not been spoken for; else the one behind it.
            is_spoken_for = frame - ahead <= self.core.time + self.machine.sampler.period()
            end = (following if is_spoken_for else frame) - ahead
        self.machine.run(end)

    def boot(self):
        while self.next_frame() is None and self.core.time < UNITS_PER_S:
            self.machine.run(self.core.time + US * 1000)
        frame = self.next_frame()
        if frame is not None:
            self.machine.run(frame - AHEAD_BLOCKS * SAMPLES * self.machine.sampler.period())
        # What the start takes is not what a frame takes.
        self.machine.busy.clear()
        self.core.own_units = 0
        self.before = dict(self.machine.units)

    def step(self, line):
        codes = bytes.fromhex(line.get("codes", ""))
        if codes:
            length = 2 * SAMPLES
            self.machine.codes = [codes[at * length:(at + 1) * length] for at in range(4)]
        self.speak(line)
        self.pause()
        self.count()

    def speak(self, line):
        for name, uart in (("rx", self.machine.usart), ("port", self.machine.lpuart), ("lidar", self.machine.lidar)):
            data = bytes.fromhex(line.get(name, ""))
            if data:
                uart.feed(data)

    def run(self, line):
        self.speak(line)
        self.machine.run(self.core.time + line["us"] * US)

    def fault(self, line):
        """What can go wrong."""
        machine, kind, us = self.machine, line["kind"], line.get("after_us", 0)
        if kind == "adc-overrun":
            machine.blocks[f"ADC{line['channel'] + 1}"].overruns_at = self.core.time + us * US
        elif kind == "adc-miss":
            machine.blocks[f"ADC{line['channel'] + 1}"].misses_at = self.core.time + us * US
        elif kind in (NOISE, BREAK):
            machine.usart.feed(bytes(line.get("bytes", 1)), error=kind, after=us * US)
        elif kind == "flash-cut":
            machine.cut_in = line["operation"]
        elif kind in ("brown-out", "power", "pin"):
            machine.reset_in(us, kind)
        elif kind == "crystal":
            self.core.at(self.core.time + us * US, lambda: machine.rcc.crystal_fails())
        elif kind == "stuck":
            machine.hang_in(us)
        else:
            raise SystemExit(f"there is no fault {kind}")

    def count(self):
        """What this frame's time was spent on."""
        units = dict(self.machine.units)
        spent = dict.fromkeys(self.per_frame, 0)
        for level, total in units.items():
            spent[LEVELS.get(level, "interrupts")] += total - self.before.get(level, 0)
        self.before = units
        for name, total in spent.items():
            self.per_frame[name].add(total // self.core.cycle)

    def report(self):
        core, machine = self.core, self.machine
        frame = self.next_frame()
        resets, self.told = machine.resets[self.told:], len(machine.resets)
        return {
            "now_us": core.time / US,
            "frame_us": (frame if frame is not None else core.time + PERIOD_UNITS) / US,
            "is_sampling": frame is not None,
            "is_in_step": machine.sampler.is_in_step(),
            "origin_us": machine.blocks["TIM15"].from_time / US,
            "tx": machine.usart.take_sent().hex(),
            "log": machine.lpuart.take_sent().hex(),
            "resets": [{"us": time / US, "cause": cause} for time, cause in resets],
        }

    def timing(self):
        def as_json(statistic):
            mean = statistic.total / statistic.count if statistic.count else 0
            return {"count": statistic.count, "least": statistic.least or 0, "mean": mean, "most": statistic.most}
        names = {GUIDANCE: "guidance", LINK: "link", THREAD: "planner"}
        return {
            "hclk_hz": self.core.hclk_hz,
            "cycles_per_instruction": processor.CYCLES_PER_INSTRUCTION,
            "flash_stall_per_instruction": processor.FLASH_STALL_PER_INSTRUCTION,
            "exception_cycles": processor.EXCEPTION_CYCLES,
            "per_frame": {name: as_json(statistic) for name, statistic in self.per_frame.items()},
            "per_activation": {name: as_json(self.machine.busy[level]) for level, name in names.items()
                               if level in self.machine.busy},
            "watchdog_longest_us": self.machine.iwdg.longest / US,
        }


def say(answer):
    sys.stdout.write(json.dumps(answer) + "\n")
    sys.stdout.flush()


def main():
    parser = argparse.ArgumentParser(description="the NUCLEO-G474RE under Unicorn")
    parser.add_argument("elf")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--crystal", choices=("works", "missing", "fails"), default="works")
    parser.add_argument("--new", action="store_true", help="with the option bytes as delivered")
    options = parser.parse_args()
    segments, board = read_elf(options.elf)
    if board != BOARD:
        raise SystemExit(f"{options.elf}: it is for another board, or not of Foxhound")
    session = None
    try:
        session = Session(Machine(segments, options.seed, options.crystal, options.new))
        session.boot()
        say(session.report())
        for text in sys.stdin:
            line = json.loads(text)
            if line["do"] == "timing":
                say(session.timing())
                continue
            {"step": session.step, "run": session.run, "fault": session.fault}[line["do"]](line)
            say(session.report())
    except Broken as broken:
        answer = session.report() if session is not None else {}
        say(answer | {"broken": str(broken), "rule": broken.rule})


if __name__ == "__main__":
    main()
