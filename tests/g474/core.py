"""The processor: Unicorn executes Thumb code; exceptions, priorities, sleep and time are here (ARM DDI 0403E, Armv7-M).

Time is counted in units of 1/4.08 GHz, of which the cycles of 16, 24, 85 and 170 MHz are whole numbers. An instruction takes
`CYCLES_PER_INSTRUCTION + FLASH_STALL_PER_INSTRUCTION` cycles, whatever it is: an assumption, in one place.

Code runs in slices that end where the next event is due; between slices events are served and exceptions taken. A slice
ends early where the program writes a register that makes an exception pending or moves the next event.
"""

import ctypes
import heapq
import struct

import unicorn
from unicorn import arm_const as arm

from rules import Broken, require

UNITS_PER_S = 4_080_000_000
# What `docs/contributing.md` reckons with, and what the flash adds at 4 wait states with prefetch and caches on.
CYCLES_PER_INSTRUCTION = 1.5
FLASH_STALL_PER_INSTRUCTION = 0.25
# Cortex-M4 Technical Reference Manual, 3.9.2: 12 cycles to stack and fetch the vector, as many to return.
EXCEPTION_CYCLES = 12

# A wake of the thread that takes no more than this finds nothing to do.
IDLE_WAKE_CYCLES = 10_000

FLASH_AT, FLASH_BYTES = 0x0800_0000, 512 << 10
# While it is written or erased, what fetches from there waits; the store is in it.
BANK_2_AT = 0x0804_0000
STORE_BYTES = 16 << 10
STORE_AT = FLASH_AT + FLASH_BYTES - STORE_BYTES
RAM_AT, RAM_BYTES = 0x2000_0000, 128 << 10
CCM_AT, CCM_FROM, CCM_BYTES = 0x1000_0000, 0x1_8000, 32 << 10
# What the firmware guards its stack with.
GUARD = range(RAM_AT - (32 << 10), RAM_AT)

NMI, HARD_FAULT, SVCALL, PENDSV, SYSTICK = 2, 3, 11, 14, 15
IRQ = 16
THREAD, SLEEP = 0, -1

# Unicorn's numbers of exceptions.
UNDEFINED, SUPERVISOR, BREAKPOINT = 1, 2, 7

FRAME = (arm.UC_ARM_REG_R0, arm.UC_ARM_REG_R1, arm.UC_ARM_REG_R2, arm.UC_ARM_REG_R3, arm.UC_ARM_REG_R12,
         arm.UC_ARM_REG_LR, arm.UC_ARM_REG_PC, arm.UC_ARM_REG_XPSR)
FLOATS = tuple(arm.UC_ARM_REG_D0 + at for at in range(8))
IT_BITS = 0x0600_FC00
# CONTROL: FPCA and, as Unicorn's M4 has it, SFPA; without both it begins a new context, with other flags.
HAS_FLOATS = 12


class Reset(Exception):
    """The core is reset: by what, and how the flags of RCC_CSR show it."""

    def __init__(self, cause):
        super().__init__(cause)
        self.cause = cause


class Statistic:
    """Number, least, sum and most of some durations in cycles."""

    def __init__(self):
        self.count, self.least, self.total, self.most = 0, None, 0, 0

    def add(self, cycles):
        self.count += 1
        self.total += cycles
        self.most = max(self.most, cycles)
        self.least = cycles if self.least is None else min(self.least, cycles)


class Core:
    """The processor with its memories. Peripherals register the addresses that they answer, and schedule events."""

    def __init__(self, flash, ram, time=0):
        self.flash, self.ram = flash, ram
        self.time = time
        self.events, self.sequence = [], 0
        self.problem = None
        self.readers, self.writers = {}, {}
        self.pending, self.enabled, self.levels = set(), set(), set()
        self.priorities = bytearray(256)
        self.active = []
        self.own_units = 0
        self.is_asleep = False
        self.is_stuck = False
        self.bank_2_busy_until = 0
        self.vector_table = 0
        self.fault_status = [0, 0, 0, 0]
        # Units of time by who runs, and cycles of each activation.
        self.units, self.busy = {}, {}
        self.set_clock(16_000_000)
        self.is_running = False
        self.interrupted = None
        self.fault_address = None
        self.build()

    # Memory and registers

    def build(self):
        uc = self.uc = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
        uc.ctl_set_cpu_model(arm.UC_CPU_ARM_CORTEX_M4)
        code = unicorn.UC_PROT_READ | unicorn.UC_PROT_EXEC
        program = FLASH_BYTES - STORE_BYTES
        flash, ram = (ctypes.addressof((ctypes.c_ubyte * len(memory)).from_buffer(memory))
                      for memory in (self.flash, self.ram))
        for at in (0, FLASH_AT):
            uc.mem_map_ptr(at, program, code, flash)
        uc.mem_map_ptr(RAM_AT, RAM_BYTES, unicorn.UC_PROT_ALL, ram)
        uc.mem_map_ptr(CCM_AT, CCM_BYTES, unicorn.UC_PROT_ALL, ram + CCM_FROM)
        for base, size in ((STORE_AT, STORE_BYTES), (0x4000_0000, 0x2_4000), (0x4800_0000, 0x2000),
                           (0x5000_0000, 0x1000), (0xE000_0000, 0x1_0000), (0xE004_0000, 0x4000)):
            uc.mmio_map(base, size, self.on_read, base, self.on_write, base)
        uc.hook_add(unicorn.UC_HOOK_INTR, self.on_interrupt)
        uc.hook_add(unicorn.UC_HOOK_MEM_INVALID, self.on_invalid)
        self.counter, self.limit = self.find_counter()

    def find_counter(self):
        """Where Unicorn counts the instructions of a run, and keeps the limit that it was given, which no function of its
        tells: two words side by side. They are searched for, so that another version of Unicorn either has them or is
        refused. The limit is lowered to end a run behind the instruction that accesses a register: `emu_stop` would
        leave that one half done."""
        uc, limit, found = self.uc, 0x5EED_1234, []
        handle = uc._uch.value if hasattr(uc._uch, "value") else uc._uch
        words = (ctypes.c_size_t * 384).from_address(handle)
        probe = RAM_AT
        before = bytes(self.ram[:16])
        # Two `nop`, `ldr r1, [r0]`, and `wfi`.
        self.ram[:8] = b"\x00\xbf\x00\xbf\x01\x68\x30\xbf"
        uc.reg_write(arm.UC_ARM_REG_R0, 0xE000_0000)
        self.readers[0xE000_0000] = lambda: found.extend(at for at in range(383) if words[at + 1] == limit) or 0
        uc.emu_start(probe | 1, 0, count=limit)
        del self.readers[0xE000_0000]
        self.ram[:16] = before
        if len(found) != 1 or words[found[0]] != 4:
            raise SystemExit("this version of Unicorn does not count instructions where 2.1.4 does")
        uc.ctl_remove_cache(probe, probe + 16)
        at = handle + found[0] * ctypes.sizeof(ctypes.c_size_t)
        return ctypes.c_size_t.from_address(at), ctypes.c_size_t.from_address(at + ctypes.sizeof(ctypes.c_size_t))

    def on_read(self, _uc, offset, size, base):
        try:
            at = base + offset
            reader = self.readers.get(at)
            if reader is None or size != 4:
                reader = self.narrow_reader(at, size)
            return reader()
        except (Broken, Reset) as problem:
            self.fail(problem)
            return 0

    def on_write(self, _uc, offset, size, value, base):
        try:
            at = base + offset
            writer = self.writers.get(at)
            if writer is None or size != 4:
                writer = self.narrow_writer(at, size)
            writer(value)
            if self.is_due():
                self.end_slice()
        except (Broken, Reset) as problem:
            self.fail(problem)

    def narrow_reader(self, at, size):
        """Byte access to the priorities of the NVIC and the system handlers, and to the store."""
        reader = self.readers.get((at, size))
        require(reader is not None, "unknown-register" if at & ~3 not in self.readers else "access-size",
                lambda: f"read of {size} bytes at {at:#010x}, {self.where()}")
        return reader

    def narrow_writer(self, at, size):
        writer = self.writers.get((at, size))
        require(writer is not None, "unknown-register" if at & ~3 not in self.writers else "access-size",
                lambda: f"write of {size} bytes at {at:#010x}, {self.where()}")
        return writer

    def where(self):
        return f"PC {self.uc.reg_read(arm.UC_ARM_REG_PC):#010x} at {self.now() / UNITS_PER_S * 1e3:.3f} ms"

    def end_slice(self):
        """Lets the slice end behind the instruction that runs."""
        self.limit.value = self.counter.value

    def fail(self, problem):
        self.problem = self.problem or problem
        self.uc.emu_stop()

    def on_interrupt(self, uc, number, _data):
        self.interrupted = number
        uc.emu_stop()

    def on_invalid(self, uc, access, address, size, _value, _data):
        self.fault_address = address
        return False

    def memory(self, at, size):
        """The memory as DMA or the core sees it: the buffer and the place in it."""
        if RAM_AT <= at and at + size <= RAM_AT + RAM_BYTES:
            return self.ram, at - RAM_AT
        if FLASH_AT <= at and at + size <= FLASH_AT + FLASH_BYTES:
            return self.flash, at - FLASH_AT
        raise Broken("dma-memory", f"{size} bytes at {at:#010x}")

    # Time and events

    def set_clock(self, hclk_hz):
        require(UNITS_PER_S % hclk_hz == 0, "pll-range", lambda: f"HCLK of {hclk_hz} Hz: the model cannot count it")
        self.hclk_hz = hclk_hz
        self.cycle = UNITS_PER_S // hclk_hz
        self.instruction = round(self.cycle * (CYCLES_PER_INSTRUCTION + FLASH_STALL_PER_INSTRUCTION))
        if getattr(self, "is_running", False):
            # The rest of this slice would be counted with the wrong clock.
            self.end_slice()

    def now(self):
        """The time, in units."""
        if self.is_running:
            return self.time + self.counter.value * self.slice_instruction
        return self.time

    def at(self, time, action):
        """Lets something happen then; returns the event, which `cancel` takes."""
        self.sequence += 1
        event = [time, self.sequence, action]
        heapq.heappush(self.events, event)
        return event

    @staticmethod
    def cancel(event):
        if event is not None:
            event[2] = None

    def next_event(self):
        while self.events and self.events[0][2] is None:
            heapq.heappop(self.events)
        return self.events[0][0] if self.events else None

    def is_due(self):
        """Whether the slice that runs has to end now."""
        event = self.next_event()
        return event is not None and event < self.slice_end or self.takeable() is not None

    # Interrupts

    def line(self, irq, level):
        """The level of a peripheral's interrupt line."""
        number = IRQ + irq
        if level:
            if number not in self.levels:
                self.levels.add(number)
                self.pending.add(number)
        else:
            self.levels.discard(number)

    def pulse(self, irq):
        self.pending.add(IRQ + irq)

    def priority_of(self, number):
        return {NMI: -2, HARD_FAULT: -1}.get(number, self.priorities[number])

    def current_priority(self):
        return min((self.priority_of(frame[0]) for frame in self.active), default=256)

    def candidate(self):
        """The most urgent pending exception that is enabled, with its priority."""
        best = None
        for number in self.pending:
            if number >= IRQ and number not in self.enabled:
                continue
            key = (self.priority_of(number), number)
            if best is None or key < best:
                best = key
        return best

    def takeable(self):
        """The exception that would be taken now, but for the masks."""
        best = self.candidate()
        return best[1] if best is not None and best[0] < self.current_priority() else None

    def is_masked(self, number):
        priority = self.priority_of(number)
        if priority < 0:
            return False
        read = self.uc.reg_read
        if read(arm.UC_ARM_REG_PRIMASK) & 1 or read(arm.UC_ARM_REG_FAULTMASK) & 1:
            return True
        base = read(arm.UC_ARM_REG_BASEPRI) & 0xF0
        return base != 0 and priority >= base

    def enter(self, number):
        """Takes an exception."""
        uc = self.uc
        values = [uc.reg_read(register) for register in FRAME]
        stack, control = uc.reg_read(arm.UC_ARM_REG_SP), uc.reg_read(arm.UC_ARM_REG_CONTROL)
        require(control & 2 == 0, "unknown-register", "the process stack, which the model does not have")
        has_floats = control & 4 != 0
        values[6] = self.pc & ~1
        if stack & 4:
            values[7] |= 1 << 9
        size = 104 if has_floats else 32
        frame = (stack - size) & ~7
        if frame < RAM_AT or frame + size > RAM_AT + RAM_BYTES:
            require(number != HARD_FAULT, "lockup", f"the stack pointer is {stack:#010x}, {self.where()}")
            self.fault_status[0] |= 1 << 4
            number = HARD_FAULT
        else:
            struct.pack_into("<8I", self.ram, frame - RAM_AT, *values)
            if has_floats:
                floats = [uc.reg_read(register) for register in FLOATS]
                struct.pack_into("<8Q2I", self.ram, frame - RAM_AT + 32, *floats, uc.reg_read(arm.UC_ARM_REG_FPSCR), 0)
                uc.reg_write(arm.UC_ARM_REG_CONTROL, control & 3)
        link = (0xFFFF_FFF1 if self.active else 0xFFFF_FFF9) & ~(0x10 if has_floats else 0)
        vector, = struct.unpack_from("<I", self.flash, (self.vector_table & 0x00FF_FFFF) + 4 * number)
        require(vector & 1 and FLASH_AT <= vector < STORE_AT, "vector", lambda: f"{number} -> {vector:#010x}")
        uc.reg_write(arm.UC_ARM_REG_SP, frame)
        uc.reg_write(arm.UC_ARM_REG_LR, link)
        uc.reg_write(arm.UC_ARM_REG_XPSR, values[7] & ~(0x3FF | IT_BITS) | 1 << 24 | number)
        uc.reg_write(arm.UC_ARM_REG_IPSR, number)
        uc.reg_write(arm.UC_ARM_REG_PC, vector)
        self.pc = vector
        self.pending.discard(number)
        self.active.append([number, self.own_units])
        self.own_units = 0
        self.spend(EXCEPTION_CYCLES * self.cycle)

    def leave(self, link):
        """Returns from an exception."""
        uc = self.uc
        require(self.active, "vector", f"return from an exception outside one, {self.where()}")
        self.spend(EXCEPTION_CYCLES * self.cycle)
        number, outer = self.active.pop()
        self.busy.setdefault(number, Statistic()).add(self.own_units // self.cycle)
        self.own_units = outer
        stack = uc.reg_read(arm.UC_ARM_REG_SP)
        size = 32 if link & 0x10 else 104
        require(RAM_AT <= stack and stack + size <= RAM_AT + RAM_BYTES, "lockup", f"unstacking from {stack:#010x}")
        values = struct.unpack_from("<8I", self.ram, stack - RAM_AT)
        if not link & 0x10:
            *floats, status, _ = struct.unpack_from("<8Q2I", self.ram, stack - RAM_AT + 32)
            for register, value in zip(FLOATS, floats):
                uc.reg_write(register, value)
        # In this order: the program status says whether this is a handler, which decides what else may be written.
        uc.reg_write(arm.UC_ARM_REG_XPSR, values[7] & ~(1 << 9))
        uc.reg_write(arm.UC_ARM_REG_IPSR, values[7] & 0x1FF)
        uc.reg_write(arm.UC_ARM_REG_CONTROL, uc.reg_read(arm.UC_ARM_REG_CONTROL) & 3 | (0 if link & 0x10 else HAS_FLOATS))
        if not link & 0x10:
            uc.reg_write(arm.UC_ARM_REG_FPSCR, status)
        for register, value in zip(FRAME[:6], values):
            uc.reg_write(register, value)
        uc.reg_write(arm.UC_ARM_REG_SP, stack + size + (4 if values[7] & 1 << 9 else 0))
        self.pc = values[6] | 1
        if number in self.levels:
            self.pending.add(number)

    def fault(self, status, address=None):
        """A fault that is not configurable here: HardFault, forced (B1.5.14)."""
        require(self.current_priority() > -1, "lockup", lambda: f"{status:#x}, {self.where()}")
        self.fault_status[0] |= status
        self.fault_status[1] |= 1 << 30
        if address is not None:
            self.fault_status[2] = self.fault_status[3] = address
        self.pending.add(HARD_FAULT)

    # Running

    def start(self):
        """Begins at the reset vector."""
        stack, entry = struct.unpack_from("<2I", self.flash, 0)
        require(entry & 1 and FLASH_AT <= entry < STORE_AT, "vector", f"reset -> {entry:#010x}")
        uc = self.uc
        uc.reg_write(arm.UC_ARM_REG_SP, stack)
        uc.reg_write(arm.UC_ARM_REG_LR, 0xFFFF_FFFF)
        self.pc = entry

    def spend(self, units):
        """Time that passes for whoever runs."""
        self.time += units
        level = self.active[-1][0] if self.active else THREAD
        self.units[level] = self.units.get(level, 0) + units
        self.own_units += units

    def run(self, until):
        """Runs until then. Ends by `Broken` or `Reset` where that happens."""
        while self.time < until:
            event = self.next_event()
            if event is not None and event <= self.time:
                heapq.heappop(self.events)[2]()
                continue
            if self.is_stuck:
                self.time = until if event is None else min(event, until)
                continue
            number = self.takeable()
            if number is not None and not self.is_masked(number):
                self.is_asleep = False
                self.enter(number)
                continue
            if self.is_asleep:
                if number is None:
                    wake = until if event is None else min(event, until)
                    self.units[SLEEP] = self.units.get(SLEEP, 0) + wake - self.time
                    self.time = wake
                    continue
                # Masked: it goes on behind the `wfi`.
                self.is_asleep = False
            end = until if event is None else min(event, until)
            # What is pending behind a mask is taken as soon as that is lifted, be it for one instruction.
            self.execute(1 if number is not None else max(1, -(-(end - self.time) // self.instruction)))

    def execute(self, count):
        """One slice of at most so many instructions. One that begins in a bank that is busy waits for that."""
        uc = self.uc
        if self.time < self.bank_2_busy_until and BANK_2_AT <= self.pc < STORE_AT:
            self.spend(self.bank_2_busy_until - self.time)
            return
        self.slice_instruction = self.instruction
        self.slice_end = self.time + count * self.instruction
        self.interrupted = self.fault_address = None
        self.is_running = True
        error = None
        try:
            uc.emu_start(self.pc | 1, 0xFFFF_FFFF, count=count)
        except unicorn.UcError as failed:
            error = failed
        # Beyond its limit it has counted the instruction that it did not begin.
        executed = min(self.counter.value, self.limit.value)
        self.is_running = False
        pc = uc.reg_read(arm.UC_ARM_REG_PC)
        self.spend(executed * self.slice_instruction)
        if self.problem is not None:
            raise self.problem
        self.pc = pc | 1
        if pc >= 0xFFFF_FFE0:
            # EXC_RETURN, whether Unicorn has noticed it or the slice has ended there.
            self.leave(pc | 1)
        elif error is not None:
            self.on_error(error, pc)
        elif self.interrupted is not None:
            self.on_trap(self.interrupted, pc)
        elif executed < self.limit.value:
            self.look_for_sleep(pc)

    def look_for_sleep(self, pc):
        """Unicorn ends a run behind a `wfi`."""
        if FLASH_AT + 2 <= pc < STORE_AT and self.flash[pc - FLASH_AT - 2:pc - FLASH_AT] == b"\x30\xbf":
            self.is_asleep = True
            if not self.active:
                cycles = self.own_units // self.cycle
                if cycles > IDLE_WAKE_CYCLES:
                    self.busy.setdefault(THREAD, Statistic()).add(cycles)
                self.own_units = 0

    def on_error(self, error, pc):
        address = self.fault_address
        if address is None:
            raise Broken("unmapped", f"{error}, {self.where()}")
        if address in GUARD:
            # MMFSR: DACCVIOL, MMARVALID.
            self.fault(1 << 1 | 1 << 7, address)
        elif 0x4000_0000 <= address < 0x6000_0000 or address >= 0xE000_0000:
            raise Broken("unknown-register", f"{address:#010x}, {self.where()}")
        elif FLASH_AT <= address < FLASH_AT + FLASH_BYTES or address < FLASH_BYTES:
            raise Broken("program-written", f"{address:#010x}, {self.where()}")
        else:
            # BFSR: PRECISERR, BFARVALID.
            self.fault(1 << 9 | 1 << 15, address)

    def on_trap(self, number, pc):
        if number == SUPERVISOR:
            self.pending.add(SVCALL)
        elif number in (UNDEFINED, BREAKPOINT):
            self.fault(1 << 16)
        else:
            raise Broken("unmapped", f"exception {number} of Unicorn, {self.where()}")
