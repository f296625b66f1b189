"""A peripheral as a block of registers: what every access is checked for, before the peripheral sees it."""

import registers
from rules import require


class Block:
    """Registers by name. A subclass may have `read_NAME(self)` and `write_NAME(self, value, old)`; the latter gets the value
    that the register would have, with bits that are set by software and cleared by hardware as they were written."""

    def __init__(self, machine, name):
        self.machine, self.core, self.name = machine, machine.core, name
        _, self.base, table, self.clock, self.irq = next(entry for entry in registers.BLOCKS if entry[0] == name)
        self.table = {register.name: register for register in table.values()}
        resets = registers.RESETS.get(name, {})
        self.value = {register.name: resets.get(register.name, register.reset) for register in table.values()}
        self.seen = {}
        self.touched = machine.touched
        for register in table.values():
            at, read, write = self.base + register.offset, self.reader(register), self.writer(register)
            self.core.readers[at], self.core.writers[at] = read, write
            if name in registers.HALF_WORDS:
                self.core.readers[at, 2], self.core.writers[at, 2] = read, write

    def field(self, register, field):
        bit, width, _ = self.table[register].fields[field]
        return self.value[register] >> bit & (1 << width) - 1

    def mask(self, register, *fields):
        return sum(((1 << width) - 1) << bit for bit, width, _ in (self.table[register].fields[name] for name in fields))

    def change(self, register, field, to):
        bit, width, _ = self.table[register].fields[field]
        mask = ((1 << width) - 1) << bit
        self.value[register] = self.value[register] & ~mask | to << bit & mask

    def check_clock(self, name):
        require(self.clock is None or self.machine.rcc.has_clock(self.clock), "clock-off",
                lambda: f"{self.name}.{name}, {self.core.where()}")

    def reader(self, register):
        name, readable, seen = register.name, register.readable, self.seen
        value = self.value
        custom = getattr(self, f"read_{name}", None)

        def read():
            self.check_clock(name)
            result = (value[name] if custom is None else custom()) & readable
            seen[name] = result
            return result
        return read

    def writer(self, register):
        name = register.name
        custom = getattr(self, f"write_{name}", None)
        get = getattr(self, f"read_{name}", None)
        value, seen = self.value, self.seen
        reset = value[name]
        # Where bits are cleared by writing 0, drivers write 1 to all others, reserved or not.
        known, read_only = register.known if not register.c0 else 0xFFFF_FFFF, register.r
        kept = register.r | register.c1 | register.c0

        def write(written):
            self.check_clock(name)
            self.touched.add((self.name, name))
            require((written ^ reset) & ~known & 0xFFFF_FFFF == 0, "reserved-bit",
                    lambda: f"{self.name}.{name} = {written:#010x}, {self.core.where()}")
            old = value[name] if get is None else get()
            if read_only:
                require((written ^ old) & read_only == 0 or (written ^ seen.get(name, old)) & read_only == 0, "read-only-bit",
                        lambda: f"{self.name}.{name} = {written:#010x}, it reads {old:#010x}, {self.core.where()}")
            new = written & ~kept | old & register.r
            new |= old & register.c1 & ~written | old & register.c0 & written
            new |= old & register.s
            if custom is None:
                value[name] = new & ~register.w
            else:
                custom(new, old)
        return write
