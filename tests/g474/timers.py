"""TIM15, which keeps embassy's time."""

from blocks import Block
from core import UNITS_PER_S
from rules import require

CHANNELS = 2
# Update and compares.
FLAGS = 0b111


class Timer(Block):
    """Counts up; update and compare events."""

    def __init__(self, machine, name):
        super().__init__(machine, name)
        self.from_time, self.from_count = 0, 0
        self.synced = 0
        self.prescaler = 0
        self.event = None

    def tick(self):
        return (self.prescaler + 1) * (UNITS_PER_S // self.machine.rcc.timer_hz("PPRE2"))

    def is_on(self):
        return self.value["CR1"] & 1

    def period(self):
        return (self.value["ARR"] & 0xFFFF) + 1

    def total(self):
        """The count without its wrapping, from `from_time` on."""
        return self.from_count + ((self.core.now() - self.from_time) // self.tick() if self.is_on() else 0)

    def rebase(self, count):
        self.from_time, self.from_count, self.synced = self.core.now(), count, count

    def sync(self):
        """Sets the flags of what has passed."""
        total = self.total()
        if total == self.synced:
            return
        period = self.period()
        if total // period != self.synced // period:
            self.value["SR"] |= 1
        for n in range(CHANNELS):
            compare = self.value[f"CCR{n + 1}"]
            if compare < period and (total - compare) // period != (self.synced - compare) // period:
                self.value["SR"] |= 2 << n
        self.synced = total

    def update(self):
        """The interrupt line, and the next event that changes it."""
        self.core.line(self.irq, bool(self.value["SR"] & self.value["DIER"] & FLAGS))
        self.core.cancel(self.event)
        self.event = None
        if not self.is_on():
            return
        wanted = self.value["DIER"] & ~self.value["SR"] & FLAGS
        total, period = self.synced, self.period()
        due = []
        for bit in range(1 + CHANNELS):
            if not wanted >> bit & 1:
                continue
            compare = 0 if bit == 0 else self.value[f"CCR{bit}"]
            if compare < period:
                due.append(total + ((compare - total - 1) % period) + 1)
        if due:
            self.event = self.core.at(self.from_time + (min(due) - self.from_count) * self.tick(), self.due)

    def due(self):
        self.sync()
        self.update()

    def read_SR(self):
        self.sync()
        return self.value["SR"]

    def write_SR(self, value, old):
        self.value["SR"] = value
        self.update()

    def read_CNT(self):
        return self.total() % self.period()

    def write_CNT(self, value, old):
        self.sync()
        self.rebase(value)
        self.update()

    def write_CR1(self, value, old):
        self.sync()
        require(value & ~0b1000_0101 == 0, "unknown-register", f"{self.name}.CR1 = {value:#010x}: the model has CEN, URS and ARPE")
        count = self.total() % self.period()
        self.value["CR1"] = value
        if (value ^ old) & 1:
            self.rebase(count)
        self.update()

    def write_EGR(self, value, old):
        if value & 1:
            self.prescaler = self.value["PSC"]
            self.rebase(0)
            if not self.value["CR1"] & 4:
                self.value["SR"] |= 1
        self.update()

    def write_DIER(self, value, old):
        self.sync()
        self.value["DIER"] = value
        self.update()

    def write_ARR(self, value, old):
        self.sync()
        self.value["ARR"] = value
        self.update()


def compare_writer(name):
    def write(self, value, old):
        self.sync()
        self.value[name] = value
        self.update()
    return write


for n in range(CHANNELS):
    setattr(Timer, f"write_CCR{n + 1}", compare_writer(f"CCR{n + 1}"))
