"""The board: the part with its peripherals, its memories, its resets, and what is connected to it."""

import struct

import core as processor
from analog import Adc, AdcCommon, Dac, Sampler
from blocks import Block
from core import UNITS_PER_S, Core, Reset
from dma import Dma, Dmamux
from rules import require
from serial import Uart
from system import Flash, Iwdg, Pwr, Rcc, System
from timers import Timer

US = UNITS_PER_S // 1_000_000
HSE_HZ = 24_000_000
SAMPLES = 256
MIDDLE = 2048
# Where a reset shows in RCC_CSR; a reset from inside drives the pin, too (RM0440 7.1.2).
PIN, BROWN_OUT, SOFTWARE, WATCHDOG = 1 << 26, 1 << 27, 1 << 28, 1 << 29
FLAGS = {"power": BROWN_OUT | PIN, "brown-out": BROWN_OUT | PIN, "cut": BROWN_OUT | PIN, "pin": PIN,
         "software": SOFTWARE | PIN, "watchdog": WATCHDOG | PIN}


def noise(seed):
    """Words that look like memory after power-on: a linear congruential generator (Knuth, MMIX)."""
    state = seed * 2 + 1
    while True:
        state = (state * 6364136223846793005 + 1442695040888963407) & 0xFFFF_FFFF_FFFF_FFFF
        yield state >> 32


class Machine:
    """The board, with an image in its flash."""

    def __init__(self, segments, seed=1, crystal="works", is_new=False):
        self.flash = bytearray(b"\xFF" * processor.FLASH_BYTES)
        for at, data in segments:
            require(processor.FLASH_AT <= at and at + len(data) <= processor.STORE_AT, "unmapped", f"a segment at {at:#010x}")
            self.flash[at - processor.FLASH_AT:at - processor.FLASH_AT + len(data)] = data
        self.ram = bytearray(processor.RAM_BYTES)
        self.seed = seed
        self.crystal = crystal
        self.is_new = is_new
        self.damaged = set()
        self.cut_in = None
        self.resets = []
        self.codes = None
        self.frames = 0
        self.touched = set()
        # Units of time by who runs, and cycles of each activation.
        self.units, self.busy = {}, {}
        self.core = None
        self.power_on("power")

    def power_on(self, cause):
        words = noise(self.seed)
        self.ram[:] = struct.pack(f"<{len(self.ram) // 4}I", *(next(words) for _ in range(len(self.ram) // 4)))
        self.seed += 1
        self.boot(cause)

    def boot(self, cause):
        """Everything but the memories begins anew."""
        self.core = core = Core(self.flash, self.ram, self.core.time if self.core is not None else 0)
        core.units, core.busy = self.units, self.busy
        self.blocks, self.channels = {}, {}
        flags = FLAGS[cause] | (self.rcc.value["CSR"] & 0xFF00_0000 if cause in ("software", "watchdog", "pin") else 0)
        self.rcc = Rcc(self, self.crystal, HSE_HZ, flags)
        self.iwdg = Iwdg(self)
        self.dmamux = Dmamux(self, "DMAMUX1")
        self.dma = [Dma(self, "DMA1"), Dma(self, "DMA2")]
        self.sampler = Sampler(self)
        self.usart, self.lpuart, self.lidar = (Uart(self, name) for name in ("USART1", "LPUART1", "USART3"))
        self.flash_block = Flash(self)
        made = [self.rcc, self.iwdg, self.dmamux, *self.dma, self.sampler, self.usart, self.lpuart, self.lidar, self.flash_block,
                Pwr(self, "PWR"), Dac(self, "DAC1"), AdcCommon(self, "ADC12_COMMON"), AdcCommon(self, "ADC345_COMMON")]
        made += [Adc(self, f"ADC{n}") for n in (1, 2, 3, 4)]
        made += [Timer(self, "TIM15")]
        made += [Block(self, name) for name in ("GPIOA", "GPIOB", "GPIOC", "DBGMCU")]
        self.blocks = {block.name: block for block in made}
        self.system = System(self)
        self.sampling_at = None
        core.start()

    # What the peripherals ask the board

    def boosts(self):
        """Whether the regulator is in range 1 boost."""
        return not self.blocks["PWR"].value["CR5"] >> 8 & 1

    def check_speed(self, hclk_hz):
        """HCLK against wait states and boost."""
        if "PWR" not in self.blocks:
            return
        boosts = self.boosts()
        require(boosts or hclk_hz <= 150_000_000, "boost", f"HCLK {hclk_hz / 1e6} MHz, {self.core.where()}")
        steps = (34e6, 68e6, 102e6, 136e6, 170e6) if boosts else (30e6, 60e6, 90e6, 120e6, 150e6)
        waits = self.flash_block.value["ACR"] & 15
        require(hclk_hz <= steps[min(waits, 4)], "wait-states", f"HCLK {hclk_hz / 1e6} MHz with {waits}, {self.core.where()}")

    def sync(self):
        """Lets everything that runs by itself catch up with the time."""
        self.sampler.sync()
        self.usart.sync()
        self.lpuart.sync()
        self.lidar.sync()

    def in_flight(self, channel):
        return self.usart.in_flight(channel) + self.lpuart.in_flight(channel)

    def codes_of(self, channel, first, count):
        """What a converter gives: the simulator's codes of this frame, in each of its blocks; half scale before there are any."""
        at = first % SAMPLES
        if self.codes is None:
            return struct.pack("<H", MIDDLE) * count
        return (self.codes[channel] * 2)[2 * at:2 * (at + count)]

    def sampling_begins(self):
        self.sampling_at = self.core.now()

    def sampling_ends(self):
        self.sampling_at = None

    # Running

    def run(self, until):
        """Runs until then; a reset on the way begins anew and is noted."""
        while self.core.time < until:
            try:
                self.core.run(until)
            except Reset as reset:
                self.resets.append((self.core.time, reset.cause))
                if reset.cause in ("power", "cut"):
                    self.power_on(reset.cause)
                else:
                    self.boot(reset.cause)

    # What goes wrong

    def reset_in(self, us, cause):
        def happen():
            raise Reset(cause)
        self.core.at(self.core.time + us * US, happen)

    def hang_in(self, us):
        """The core executes nothing any more."""
        def happen():
            self.core.is_stuck = True
        self.core.at(self.core.time + us * US, happen)
