"""DMA1, DMA2 and their request multiplexer."""

import core as processor
from blocks import Block
from registers import REQUESTS
from rules import Broken, require

CHANNELS = 8
IRQS = {"DMA1": (11, 12, 13, 14, 15, 16, 17, 96), "DMA2": (56, 57, 58, 59, 60, 97, 98, 99)}
EN, TCIE, HTIE, TEIE, DIR, CIRC = 1, 2, 4, 8, 16, 32
# What is read-only while a channel is enabled.
LOCKED = 0x7FF0


class Channel:
    """One channel; `index` counts from 0."""

    def __init__(self, dma, index):
        self.dma, self.index = dma, index
        self.name = f"{dma.name} channel {index + 1}"
        self.control = self.length = self.remaining = self.peripheral = self.memory = 0
        self.is_fresh = False
        self.flags = 0
        self.request = None

    @property
    def is_enabled(self):
        return self.control & EN != 0

    @property
    def size(self):
        return 1 << (self.control >> 10 & 3)

    def enable(self):
        where = lambda: f"{self.name}, {self.dma.core.where()}"
        require(self.remaining > 0, "dma-length", where)
        require(self.is_fresh, "dma-resumed", where)
        self.is_fresh = False
        require(self.memory % self.size == 0 and self.peripheral % (1 << (self.control >> 8 & 3)) == 0, "dma-alignment", where)
        try:
            self.dma.core.memory(self.memory, self.length * self.size)
        except Broken as broken:
            raise Broken("dma-memory", f"{self.name}: {self.length} x {self.size} bytes at {self.memory:#010x}") from broken
        require(self.memory >= processor.RAM_AT or self.control & DIR, "dma-memory", where)
        self.request = self.dma.machine.dmamux.request_of(self)
        name, register, writes = REQUESTS.get(self.request, (None, None, None))
        owner = self.dma.machine.blocks.get(name)
        require(owner is not None and self.peripheral == owner.base + owner.table[register].offset
                and writes == bool(self.control & DIR), "dma-peripheral",
                lambda: f"{self.name}: request {self.request}, {self.peripheral:#010x}")
        self.dma.machine.channels[self.request] = self
        owner.dma_is_ready()

    def disable(self):
        owner = self.dma.machine.blocks[REQUESTS[self.request][0]]
        owner.dma_stops(self)
        self.dma.machine.channels.pop(self.request, None)

    def until_flag(self):
        """Transfers until the next half or the end."""
        half = self.length // 2
        return self.remaining - (self.length - half) if self.remaining > self.length - half else self.remaining

    def push(self, data):
        """Data from the peripheral, at most up to the next flag."""
        memory, at = self.dma.core.memory(self.memory + (self.length - self.remaining) * self.size, len(data))
        memory[at:at + len(data)] = data
        self.advance(len(data) // self.size)

    def pending_data(self):
        """What is left to be handed to the peripheral."""
        length = self.remaining * self.size
        memory, at = self.dma.core.memory(self.memory + (self.length - self.remaining) * self.size, length)
        return bytes(memory[at:at + length])

    def advance(self, count):
        until_half = self.remaining - (self.length - self.length // 2)
        self.remaining -= count
        if 0 < until_half <= count:
            self.flags |= 4
        if self.remaining == 0:
            self.flags |= 2
            if self.control & CIRC:
                self.remaining = self.length
        self.update()

    def update(self):
        self.dma.core.line(IRQS[self.dma.name][self.index], self.flags & self.control & 0xE != 0)


class Dma(Block):
    def __init__(self, machine, name):
        super().__init__(machine, name)
        self.channels = [Channel(self, index) for index in range(CHANNELS)]

    def read_ISR(self):
        self.machine.sync()
        return sum((channel.flags | int(channel.flags != 0)) << 4 * channel.index for channel in self.channels)

    def write_IFCR(self, value, old):
        for channel in self.channels:
            bits = value >> 4 * channel.index & 0xF
            if bits & 1:
                bits = 0xE
            channel.flags &= ~bits
            channel.update()


def accessors(index):
    n = index + 1

    def read_ccr(self):
        return self.channels[index].control

    def write_ccr(self, value, old):
        self.machine.sync()
        channel = self.channels[index]
        if old & EN and value & EN:
            require((value ^ old) & LOCKED == 0, "dma-locked", f"{channel.name}, {self.core.where()}")
        channel.control = value
        if value & EN and not old & EN:
            channel.enable()
        elif old & EN and not value & EN:
            channel.control = old & ~EN
            channel.disable()
            channel.control = value
        channel.update()

    def read_cndtr(self):
        self.machine.sync()
        channel = self.channels[index]
        return channel.remaining - self.machine.in_flight(channel)

    def guarded(name, set_value):
        def write(self, value, old):
            channel = self.channels[index]
            require(not channel.is_enabled, "dma-locked", f"{channel.name} {name}, {self.core.where()}")
            set_value(channel, value)
        return write

    def set_cndtr(channel, value):
        channel.length = channel.remaining = value
        channel.is_fresh = True

    def set_cpar(channel, value):
        channel.peripheral = value

    def set_cmar(channel, value):
        channel.memory = value

    setattr(Dma, f"read_CCR{n}", read_ccr)
    setattr(Dma, f"write_CCR{n}", write_ccr)
    setattr(Dma, f"read_CNDTR{n}", read_cndtr)
    setattr(Dma, f"write_CNDTR{n}", guarded("CNDTR", set_cndtr))
    setattr(Dma, f"read_CPAR{n}", lambda self: self.channels[index].peripheral)
    setattr(Dma, f"write_CPAR{n}", guarded("CPAR", set_cpar))
    setattr(Dma, f"read_CMAR{n}", lambda self: self.channels[index].memory)
    setattr(Dma, f"write_CMAR{n}", guarded("CMAR", set_cmar))


for at in range(CHANNELS):
    accessors(at)


class Dmamux(Block):
    def channel_of(self, number):
        return self.machine.dma[number // CHANNELS].channels[number % CHANNELS]

    def request_of(self, channel):
        number = channel.index + (0 if channel.dma.name == "DMA1" else CHANNELS)
        return self.value[f"C{number}CR"] & 0x7F


def mux_writer(number):
    def write(self, value, old):
        name = f"C{number}CR"
        require(value == old or not self.channel_of(number).is_enabled, "dmamux-locked", f"{name}, {self.core.where()}")
        require(value >> 7 == 0, "unknown-register", f"{name} = {value:#010x}: synchronisation, which the model does not have")
        self.value[name] = value
    return write


for at in range(16):
    setattr(Dmamux, f"write_C{at}CR", mux_writer(at))
