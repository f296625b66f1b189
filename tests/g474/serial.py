"""USART1, LPUART1 and USART3: bytes with their times on the lines."""

from collections import deque

from blocks import Block
from core import UNITS_PER_S
from rules import require

# Of a lidar, and of two kinds of radios, at USART3.
LINE_BAUD = {"USART1": (921_600,), "LPUART1": (921_600,), "USART3": (230_400, 115_200, 1_000_000)}
BITS = 10
HSI_HZ = 16_000_000
PE, FE, NE, ORE, IDLE, RXNE, TC, TXE = (1 << bit for bit in range(8))
ENABLES = {"IDLE": 4, "RXNE": 5, "TC": 6, "TXE": 7}
NOISE, BREAK = "noise", "break"
# Port, pins and their alternate function (DS12288, pin definitions): those of the NUCLEO's connectors, the receiver's last.
PINS = {"USART1": ("A", (9, 10), 7), "LPUART1": ("A", (2, 3), 12), "USART3": ("C", (11,), 7)}
PULL_UP = 1


class Uart(Block):
    RX = {"USART1": 24, "LPUART1": 34, "USART3": 28}
    TX = {"USART1": 25, "LPUART1": 35, "USART3": 29}

    def __init__(self, machine, name):
        super().__init__(machine, name)
        self.rx_request, self.tx_request = self.RX[name], self.TX[name]
        self.byte = UNITS_PER_S * BITS // LINE_BAUD[name][0]
        # What comes in: runs of bytes without a pause, each with the time of its first bit.
        self.runs = deque()
        self.rx_free = 0
        self.idle_at = None
        self.event = None
        self.tx_free = 0
        self.tx_event = None
        self.tc_event = None
        self.sending = None
        self.sent = []
        self.checked = False
        self.received = 0

    # The line

    def feed(self, data, error=None, after=0):
        """Bytes that arrive from now on, or after the ones before; with an error each of them has it."""
        start = max(self.core.time + after, self.rx_free)
        self.rx_free = start + len(data) * self.byte
        self.runs.append([start, bytes(data), 0, error])
        self.schedule()

    def take_sent(self):
        """What has left since the last call, byte by byte as it was complete."""
        out, rest = bytearray(), []
        for start, data in self.sent:
            done = max(0, min(len(data), (self.core.time - start) // self.byte))
            out += data[:done]
            if done < len(data):
                rest.append([start + done * self.byte, data[done:]])
        self.sent = rest
        return bytes(out)

    # Registers

    def kernel_hz(self):
        rcc = self.machine.rcc
        select = rcc.field("CCIPR", f"{self.name}SEL")
        bus = "PPRE2" if self.name == "USART1" else "PPRE1"
        return {0: rcc.pclk_hz(bus), 1: rcc.sysclk_hz(rcc.field("CFGR", "SWS")), 2: HSI_HZ}.get(select)

    def check_baud(self):
        """The rate that the registers give, against the line's."""
        if self.checked:
            return
        self.checked = True
        divider = (1, 2, 4, 6, 8, 10, 12, 16, 32, 64, 128, 256)[self.value["PRESC"]]
        kernel_hz, brr = self.kernel_hz() / divider, self.value["BRR"]
        if self.name == "LPUART1":
            baud = 256 * kernel_hz / max(brr, 1)
        elif self.value["CR1"] >> 15 & 1:
            baud = 2 * kernel_hz / max(brr & 0xFFF0 | (brr & 7) << 1, 1)
        else:
            baud = kernel_hz / max(brr, 1)
        fits = [line for line in LINE_BAUD[self.name] if abs(baud / line - 1) < 0.02]
        require(fits, "uart-baud", f"{self.name}: {baud:.0f} baud")
        self.byte = UNITS_PER_S * BITS // fits[0]
        letter, pins, function = PINS[self.name]
        port = self.machine.blocks[f"GPIO{letter}"]
        for pin in pins:
            mode, of = port.field("MODER", f"MODER{pin}"), port.field("AFRL" if pin < 8 else "AFRH", f"AFR{pin}")
            require(mode == 2 and of == function, "uart-pins", f"{self.name}, P{letter}{pin}: mode {mode}, function {of}")
        require(port.field("PUPDR", f"PUPDR{pins[-1]}") == PULL_UP, "uart-pins",
                f"{self.name}, P{letter}{pins[-1]} has no pull-up")

    def is_on(self, bit):
        return self.value["CR1"] & 1 and self.value["CR1"] >> bit & 1

    def read_ISR(self):
        self.sync()
        now = self.core.now()
        flags = self.value["ISR"] & ~(TC | 1 << 16 | 1 << 21 | 1 << 22)
        if now >= self.tx_free and self.sending is None:
            flags |= TC
        if self.is_on(3):
            flags |= 1 << 21
        if self.is_on(2):
            flags |= 1 << 22
        if self.runs and self.runs[0][0] <= now:
            flags |= 1 << 16
        return flags

    def write_ICR(self, value, old):
        self.value["ISR"] &= ~(value & (PE | FE | NE | ORE | IDLE))
        if value >> 6 & 1:
            self.core.cancel(self.tc_event)
        self.update()

    def read_RDR(self):
        self.sync()
        self.value["ISR"] &= ~RXNE
        self.update()
        return self.value["RDR"]

    def write_TDR(self, value, old):
        self.send(bytes([value & 0xFF]))

    def write_CR1(self, value, old):
        self.sync()
        # All but UE, TE, RE, UESM and the interrupt enables.
        locked = self.table["CR1"].rw & ~(0x1FF | 1 << 14 | 1 << 26 | 1 << 27 | 0xC000_0000)
        if old & 1 and value & 1:
            require((value ^ old) & locked & self.table["CR1"].rw == 0, "uart-locked",
                    f"{self.name}.CR1 {old:#010x} -> {value:#010x}, {self.core.where()}")
        if old & 1 and not value & 1:
            require(self.channel(self.rx_request, 6) is None, "uart-dma", f"{self.name}, {self.core.where()}")
        require(not value & (1 << 29), "unknown-register", f"the FIFO of {self.name}, which the model does not have")
        self.value["CR1"] = value
        self.update()
        self.schedule()
        self.try_send()

    def write_CR2(self, value, old):
        require(value == old or not self.value["CR1"] & 1, "uart-locked", f"{self.name}.CR2, {self.core.where()}")
        self.value["CR2"] = value

    def write_BRR(self, value, old):
        require(value == old or not self.value["CR1"] & 1, "uart-locked", f"{self.name}.BRR, {self.core.where()}")
        self.value["BRR"] = value
        self.checked = False

    def write_CR3(self, value, old):
        self.sync()
        # What may change while the UART is enabled: EIE, DMAR, DMAT, CTSIE and the interrupt enables of the FIFO.
        free = 1 | 3 << 6 | 1 << 10 | 1 << 22 | 1 << 23 | 1 << 24 | 1 << 28
        if self.value["CR1"] & 1:
            require((value ^ old) & ~free == 0, "uart-locked", f"{self.name}.CR3 {old:#010x} -> {value:#010x}, {self.core.where()}")
        self.value["CR3"] = value
        self.update()
        self.schedule()
        self.try_send()

    def update(self):
        """The level of the interrupt line."""
        flags, enables = self.read_flags(), self.value["CR1"]
        level = any(flags >> bit & enables >> bit & 1 for bit in (4, 5, 6, 7))
        if self.value["CR3"] & 1:
            level = level or flags & (FE | NE | ORE) != 0
        level = level or bool(enables >> 8 & 1 and flags & PE)
        self.core.line(self.irq, bool(level and enables & 1))

    def read_flags(self):
        flags = self.value["ISR"] & ~TC
        return flags | (TC if self.core.now() >= self.tx_free and self.sending is None else 0)

    # Receiving

    def channel(self, request, enable):
        return self.machine.channels.get(request) if self.value["CR3"] >> enable & 1 else None

    def schedule(self):
        """The next byte that anybody takes note of: one with an error, one that fills a half of the ring, the end of a run."""
        self.core.cancel(self.event)
        self.event = None
        if self.runs:
            start, data, done, error = self.runs[0]
            channel = self.channel(self.rx_request, 6)
            left = len(data) - done
            count = 1 if error or channel is None else min(left, channel.until_flag())
            due = start + (done + count) * self.byte
            if self.idle_at is not None and self.idle_at < start + done * self.byte + self.byte // BITS:
                due = min(due, self.idle_at)
        elif self.idle_at is not None:
            due = self.idle_at
        else:
            return
        self.event = self.core.at(due, self.due)

    def due(self):
        self.sync()
        self.schedule()

    def sync(self):
        """Takes in what has arrived until now."""
        now = self.core.now()
        while True:
            begins = self.runs[0][0] + self.runs[0][2] * self.byte if self.runs else None
            if self.idle_at is not None and self.idle_at <= now and (begins is None or begins >= self.idle_at):
                self.idle_at = None
                if self.is_on(2):
                    self.value["ISR"] |= IDLE
                    self.update()
                continue
            if begins is None or begins + self.byte > now:
                return
            self.arrive(now)

    def arrive(self, now):
        run = self.runs[0]
        start, data, done, error = run
        count = min(len(data) - done, (now - start) // self.byte - done)
        channel = self.channel(self.rx_request, 6)
        if error or channel is None:
            count = 1
        else:
            count = min(count, channel.until_flag())
        piece = data[done:done + count]
        run[2] += count
        if run[2] == len(data):
            self.runs.popleft()
        self.idle_at = start + (done + count + 1) * self.byte
        if not self.is_on(2):
            return
        self.check_baud()
        self.received += count
        if error:
            self.value["ISR"] |= {NOISE: NE, BREAK: FE}[error]
            if not self.value["CR3"] >> 13 & 1 and channel is not None:
                # DDRE = 0: no request for a byte with an error (RM0440 37.8.4).
                self.update()
                return
        if channel is not None:
            channel.push(piece)
        elif self.value["ISR"] & RXNE:
            self.value["ISR"] |= ORE
        else:
            self.value["ISR"] |= RXNE
            self.value["RDR"] = piece[-1]
        self.update()

    # Sending

    def dma_is_ready(self):
        self.schedule()
        self.try_send()

    def try_send(self):
        channel = self.channel(self.tx_request, 7)
        if channel is None or self.sending is not None or not self.is_on(3):
            return
        self.check_baud()
        data = channel.pending_data()
        start = max(self.core.now(), self.tx_free)
        self.tx_free = start + len(data) * self.byte
        self.sent.append([start, data])
        self.sending = [channel, start, len(data)]
        # The last byte waits in TDR while the one before leaves.
        self.tx_event = self.core.at(max(self.core.now(), self.tx_free - 2 * self.byte) + 1, self.handed_over)
        self.core.cancel(self.tc_event)
        self.tc_event = self.core.at(self.tx_free, self.update)

    def handed_over(self):
        channel, _, count = self.sending
        self.sending = None
        channel.advance(count)
        self.update()

    def send(self, data):
        self.check_baud()
        start = max(self.core.now(), self.tx_free)
        self.tx_free = start + len(data) * self.byte
        self.sent.append([start, data])

    def in_flight(self, channel):
        """Transfers of a channel that have been made and not been counted yet."""
        if self.sending is None or self.sending[0] is not channel:
            return 0
        _, start, count = self.sending
        return max(0, min(count - 1, (self.core.now() - start) // self.byte + 1))

    def dma_stops(self, channel):
        self.schedule()
        if self.sending is None or self.sending[0] is not channel:
            return
        _, start, count = self.sending
        done = self.in_flight(channel)
        self.core.cancel(self.tx_event)
        self.core.cancel(self.tc_event)
        self.sending = None
        self.sent[-1][1] = self.sent[-1][1][:done]
        self.tx_free = start + done * self.byte
