"""Clocks, power, flash, reset and the core's own registers: RCC, PWR, FLASH, SCB, NVIC, MPU, DWT, IWDG, DBGMCU."""

import core as processor
from blocks import Block
from core import IRQ, UNITS_PER_S, Reset
from rules import Broken, require

US = UNITS_PER_S // 1_000_000
LSI_HZ = 32_000
# Nobody waits longer for a crystal.
HSE_WAIT_MAX_US = 500_000
# DS12288: start-up of HSI16 and HSI48, typical start-up of a crystal, the PLL's lock time.
HSI_US, HSE_US, PLL_US, LSI_US = 4, 2000, 40, 130
HSI_HZ = 16_000_000
# DS12288, flash memory characteristics: a double word, a page.
PROGRAM_US, ERASE_US = 84, 22_000


class Rcc(Block):
    def __init__(self, machine, crystal, hse_hz, flags):
        super().__init__(machine, "RCC")
        self.crystal = crystal
        self.hse_hz = hse_hz if crystal != "missing" else None
        self.ready_at = {}
        self.halved_at = None
        self.hse_from = None
        self.value["CSR"] |= flags

    def has_clock(self, clock):
        register, field = clock.split(".")
        return self.value[register] >> self.table[register].fields[field][0] & 1

    def is_ready(self, what):
        return self.ready_at.get(what, float("inf")) <= self.core.now()

    def follow(self, register, on, ready, what, after_us, works=True):
        """An oscillator that is switched on is ready after a while; one that is off is not."""
        if self.field(register, on):
            self.ready_at.setdefault(what, self.core.now() + after_us * US if works else float("inf"))
        else:
            self.ready_at.pop(what, None)
        self.change(register, ready, int(self.is_ready(what)))

    def read_CR(self):
        self.ready_at.setdefault("HSI", 0) if self.field("CR", "HSION") else None
        self.follow("CR", "HSION", "HSIRDY", "HSI", HSI_US)
        self.follow("CR", "HSEON", "HSERDY", "HSE", HSE_US, works=self.hse_hz is not None)
        if not self.field("CR", "HSEON"):
            self.hse_from = None
        elif self.hse_hz is None:
            self.hse_from = self.core.now() if self.hse_from is None else self.hse_from
            require(self.core.now() - self.hse_from < HSE_WAIT_MAX_US * US or self.machine.iwdg.event is not None, "hse-wait",
                    self.core.where)
        self.follow("CR", "PLLON", "PLLRDY", "PLL", PLL_US)
        return self.value["CR"]

    def write_CR(self, value, old):
        source = self.field("CFGR", "SWS")
        used = {1: {"HSION"}, 2: {"HSEON"}, 3: {"PLLON"} | ({"HSEON"} if self.field("PLLCFGR", "PLLSRC") == 3 else {"HSION"})}
        for name in used[source]:
            require(value & self.mask("CR", name), "clock-in-use", f"RCC.CR.{name} = 0, {self.core.where()}")
        if value & ~old & self.mask("CR", "HSION"):
            self.ready_at["HSI"] = self.core.now() + HSI_US * US
        self.value["CR"] = value
        if value & ~old & self.mask("CR", "PLLON"):
            on, what = ("HSEON", "HSE") if self.field("PLLCFGR", "PLLSRC") == 3 else ("HSION", "HSI")
            self.value["CR"] = old | value
            self.read_CR()
            require(self.is_ready(what), "clock-not-ready", f"the PLL is switched on before {on[:3]} is ready, {self.core.where()}")
            self.pll_hz()
            if self.crystal == "fails" and what == "HSE":
                self.crystal_fails()
                return
        self.read_CR()

    def crystal_fails(self):
        """It stops: where the clock security system is on, SYSCLK comes from the HSI at once, and the NMI is raised."""
        self.read_CR()
        if not self.field("CR", "HSERDY"):
            return
        if not self.field("CR", "CSSON"):
            self.ready_at["PLL"] = float("inf")
            return
        self.value["CR"] = self.value["CR"] & ~self.mask("CR", "HSEON", "CSSON", "PLLON") | self.mask("CR", "HSION")
        self.value["CFGR"] = self.value["CFGR"] & ~15 | 1 << 2 | 1
        self.value["CIFR"] |= self.mask("CIFR", "CSSF")
        self.core.set_clock(HSI_HZ // self.divider(self.value["CFGR"] >> 4 & 15))
        self.core.pending.add(processor.NMI)
        self.core.end_slice()

    def write_PLLCFGR(self, value, old):
        locked = self.mask("PLLCFGR", "PLLSRC", "PLLM", "PLLN")
        if self.field("CR", "PLLON"):
            require((value ^ old) & locked == 0, "pll-locked", f"PLLCFGR = {value:#010x}, {self.core.where()}")
        self.value["PLLCFGR"] = value

    def pll_hz(self):
        """What the PLL gives as SYSCLK."""
        source = self.field("PLLCFGR", "PLLSRC")
        require(source in (2, 3), "pll-range", "the PLL has no source")
        into = (HSI_HZ if source == 2 else self.hse_hz) / (self.field("PLLCFGR", "PLLM") + 1)
        factor = self.field("PLLCFGR", "PLLN")
        vco = into * factor
        out = vco / (2 * (self.field("PLLCFGR", "PLLR") + 1))
        out_max = 170e6 if self.machine.boosts() else 150e6
        require(2.66e6 <= into <= 16e6 and 8 <= factor <= 127 and 96e6 <= vco <= 344e6 and out <= out_max, "pll-range",
                f"{into / 1e6} MHz, VCO {vco / 1e6} MHz, {out / 1e6} of {out_max / 1e6} MHz")
        return round(out)

    def sysclk_hz(self, source):
        if source == 1:
            return HSI_HZ
        return self.hse_hz if source == 2 else self.pll_hz()

    @staticmethod
    def divider(code):
        return 1 if code < 8 else (2, 4, 8, 16, 64, 128, 256, 512)[code - 8]

    def write_CFGR(self, value, old):
        source, code = value & 3, value >> 4 & 15
        self.read_CR()
        name = {1: "HSI", 2: "HSE", 3: "PLL"}.get(source)
        require(name and self.is_ready(name), "clock-not-ready", f"SW = {source}, {self.core.where()}")
        sysclk_hz, divider = self.sysclk_hz(source), self.divider(code)
        before = self.sysclk_hz(self.field("CFGR", "SWS"))
        if sysclk_hz > 80_000_000:
            if before <= 80_000_000:
                require(divider >= 2, "sysclk-step", f"{before / 1e6} -> {sysclk_hz / 1e6} MHz, {self.core.where()}")
                self.halved_at = self.core.now()
            elif divider == 1 and self.divider(old >> 4 & 15) > 1:
                require(self.halved_at is not None and self.core.now() - self.halved_at >= US, "sysclk-step",
                        f"AHB prescaler 1 after {(self.core.now() - self.halved_at) / US:.2f} us, {self.core.where()}")
        self.value["CFGR"] = value & ~(3 << 2) | source << 2
        hclk_hz = sysclk_hz // divider
        self.machine.check_speed(hclk_hz)
        self.core.set_clock(hclk_hz)

    def write_CICR(self, value, old):
        pass

    def pclk_hz(self, which):
        code = self.field("CFGR", which)
        return self.core.hclk_hz // (1 if code < 4 else (2, 4, 8, 16)[code - 4])

    def timer_hz(self, which):
        pclk_hz = self.pclk_hz(which)
        return pclk_hz if pclk_hz == self.core.hclk_hz else 2 * pclk_hz

    def read_CSR(self):
        self.follow("CSR", "LSION", "LSIRDY", "LSI", LSI_US)
        return self.value["CSR"]

    def write_CSR(self, value, old):
        if value & self.mask("CSR", "RMVF"):
            value &= 0x00FF_FFFF
        self.value["CSR"] = value

    def read_CRRCR(self):
        self.follow("CRRCR", "HSI48ON", "HSI48RDY", "HSI48", HSI_US)
        return self.value["CRRCR"]


class Pwr(Block):
    def write_CR5(self, value, old):
        self.value["CR5"] = value
        self.machine.check_speed(self.core.hclk_hz)


class Flash(Block):
    """The controller; the last 16 KB, where the program keeps its store, are read and written through it as well."""

    ERRORS = ("OPERR", "PROGERR", "WRPERR", "PGAERR", "SIZERR", "PGSERR", "MISERR", "FASTERR")

    def __init__(self, machine):
        super().__init__(machine, "FLASH")
        core, store = self.core, processor.STORE_AT
        if not machine.is_new:
            # What docs/hardware/bench.md has one do before anything else.
            self.change("OPTR", "BOR_LEV", 4)
        self.keys = 0
        self.is_key_wrong = False
        self.first_word = None
        self.busy_until = 0
        self.cut_after = None
        for at in range(store, store + processor.STORE_BYTES, 4):
            core.readers[at] = lambda at=at: self.load(at, 4)
            core.writers[at] = lambda value, at=at: self.store(at, value)
        for at in range(store, store + processor.STORE_BYTES):
            core.readers[at, 1] = lambda at=at: self.load(at, 1)
            if at % 2 == 0:
                core.readers[at, 2] = lambda at=at: self.load(at, 2)

    @property
    def damaged(self):
        return self.machine.damaged

    def load(self, at, size):
        """A read of the store: a damaged word raises the NMI and, in every other word, ECCD: the register is not to be relied on."""
        offset = at - processor.FLASH_AT
        if offset & ~7 in self.damaged:
            self.value["ECCR"] |= (offset >> 3 & 1) << 31
            self.core.pending.add(processor.NMI)
            self.core.end_slice()
        return int.from_bytes(self.core.flash[offset:offset + size], "little")

    def is_locked(self):
        return self.value["CR"] >> 31 & 1

    def write_KEYR(self, value, old):
        require(not self.is_key_wrong and value == (0x45670123, 0xCDEF89AB)[self.keys], "flash-key",
                f"{value:#010x}, {self.core.where()}")
        self.keys += 1
        if self.keys == 2:
            self.keys = 0
            self.change("CR", "LOCK", 0)

    def write_ACR(self, value, old):
        self.value["ACR"] = value
        self.machine.check_speed(self.core.hclk_hz)

    def read_SR(self):
        self.change("SR", "BSY", int(self.core.now() < self.busy_until))
        return self.value["SR"]

    def write_CR(self, value, old):
        locked = self.is_locked()
        if locked:
            require(value | 1 << 31 == old, "flash-locked", f"CR = {value:#010x}, {self.core.where()}")
            return
        require(self.core.now() >= self.busy_until, "flash-busy", f"CR = {value:#010x}, {self.core.where()}")
        start = value >> 16 & 1
        self.value["CR"] = value & ~(1 << 16)
        if start and not old >> 16 & 1:
            require(value & 2, "flash-busy", f"STRT without PER, {self.core.where()}")
            page, bank = value >> 3 & 0x7F, value >> 11 & 1
            self.erase(bank * 128 + page)

    def erase(self, page):
        at = page * 2048
        require(at >= processor.FLASH_BYTES - processor.STORE_BYTES, "program-written", f"page {page} is erased")
        data = self.core.flash
        if self.is_cut():
            for word in range(at, at + 2048, 8):
                self.damaged.add(word)
            raise Reset("cut")
        data[at:at + 2048] = b"\xFF" * 2048
        self.damaged.difference_update(range(at, at + 2048, 8))
        self.stall(ERASE_US)

    def store(self, at, value):
        """A write into flash: two words make a double word."""
        core, offset = self.core, at - processor.FLASH_AT
        require(not self.is_locked() and self.value["CR"] & 1, "program-written", f"{at:#010x}, {core.where()}")
        require(core.now() >= self.busy_until, "flash-busy", f"{at:#010x}, {core.where()}")
        if self.first_word is None:
            require(offset % 8 == 0, "flash-alignment", f"{at:#010x}, {core.where()}")
            self.first_word = (offset, value)
            return
        first, low = self.first_word
        self.first_word = None
        require(offset == first + 4, "flash-alignment", f"{at:#010x} after {first + processor.FLASH_AT:#010x}, {core.where()}")
        word = low | value << 32
        old = int.from_bytes(core.flash[first:first + 8], "little")
        if word != 0 and (old != 0xFFFF_FFFF_FFFF_FFFF or first in self.damaged):
            # The part sets PROGERR and programs nothing (RM0440 3.3.7), which the driver may meet on damaged words only.
            require(first in self.damaged, "flash-overwritten", f"{at - 4:#010x}, {core.where()}")
            self.change("SR", "PROGERR", 1)
            return
        if self.is_cut():
            core.flash[first:first + 8] = (old & ~(~word & 0x0F0F_0F0F_0F0F_0F0F)).to_bytes(8, "little")
            self.damaged.add(first)
            raise Reset("cut")
        core.flash[first:first + 8] = word.to_bytes(8, "little")
        if first in self.damaged:
            # The part looks at the word first, and the manual does not say that this look raises nothing.
            self.damaged.discard(first)
            core.pending.add(processor.NMI)
        self.stall(PROGRAM_US)

    def is_cut(self):
        """Whether the power goes away in this operation."""
        if self.machine.cut_in is None:
            return False
        if self.machine.cut_in == 0:
            self.machine.cut_in = None
            return True
        self.machine.cut_in -= 1
        return False

    def stall(self, us):
        """The operation runs; whoever reads or fetches from this bank waits, and whoever asks for BSY sees it."""
        self.busy_until = self.core.bank_2_busy_until = self.core.now() + us * US
        self.core.end_slice()
        if self.value["CR"] & self.mask("CR", "EOPIE"):
            self.change("SR", "EOP", 1)


class Iwdg(Block):
    def __init__(self, machine):
        super().__init__(machine, "IWDG")
        self.event = None
        self.may_write = False
        self.updates = {}
        self.fed_at, self.longest = None, 0

    def reload(self):
        self.core.cancel(self.event)
        divider = 4 << min(self.value["PR"], 6)
        ticks = (self.value["RLR"] + 1) * divider
        self.event = self.core.at(self.core.now() + ticks * (UNITS_PER_S // LSI_HZ), self.expire)

    def expire(self):
        raise Reset("watchdog")

    def write_KR(self, value, old):
        self.may_write = value == 0x5555
        if value == 0xCCCC or value == 0xAAAA and self.event is not None:
            now = self.core.now()
            if self.fed_at is not None:
                self.longest = max(self.longest, now - self.fed_at)
            self.fed_at = now
            self.reload()

    def is_updating(self, name):
        return self.core.now() < self.updates.get(name, 0)

    def read_SR(self):
        names = ("PR", "RLR", "WINR")
        return sum(int(self.is_updating(name)) << bit for bit, name in enumerate(names))

    def update(self, name, value):
        require(self.may_write, "iwdg-locked", f"{name}, {self.core.where()}")
        require(not self.is_updating(name), "iwdg-busy", f"{name}, {self.core.where()}")
        self.value[name] = value
        # Up to five cycles of its own oscillator, once that runs.
        if self.event is not None:
            self.updates[name] = self.core.now() + 5 * UNITS_PER_S // LSI_HZ
            self.reload()

    def write_PR(self, value, old):
        self.update("PR", value)

    def write_RLR(self, value, old):
        self.update("RLR", value)

    def write_WINR(self, value, old):
        self.update("WINR", value)


class System:
    """The core's own registers, of which the model knows those that the image uses (ARM DDI 0403E, B3 and C1)."""

    def __init__(self, machine):
        self.machine, core = machine, machine.core
        self.core = core
        self.plain = {}
        self.cycles_from = None
        self.mpu = {"number": 0, "base": [0] * 8, "size": [0] * 8}
        self.trace = 0

        def register(at, read=None, write=None):
            if read is not None:
                core.readers[at] = read
            if write is not None:
                core.writers[at] = write

        def plain(at, reset=0, writable=0xFFFF_FFFF):
            self.plain[at] = reset

            def write(value):
                require((value ^ self.plain[at]) & ~writable == 0, "reserved-bit", f"{at:#010x} = {value:#010x}, {core.where()}")
                self.plain[at] = value
            register(at, lambda: self.plain[at], write)

        # NVIC: 102 interrupts of the part, 16 priorities.
        for word in range(4):
            register(0xE000E100 + 4 * word, lambda word=word: self.bits(core.enabled, word),
                     lambda value, word=word: self.each(word, value, core.enabled.add))
            register(0xE000E180 + 4 * word, lambda word=word: self.bits(core.enabled, word),
                     lambda value, word=word: self.each(word, value, core.enabled.discard))
            register(0xE000E200 + 4 * word, lambda word=word: self.bits(core.pending, word),
                     lambda value, word=word: self.each(word, value, core.pending.add))
            register(0xE000E280 + 4 * word, lambda word=word: self.bits(core.pending, word),
                     lambda value, word=word: self.each(word, value, self.unpend))
        for irq in range(102):
            at = 0xE000E400 + irq
            core.readers[at, 1] = lambda irq=irq: core.priorities[IRQ + irq]
            core.writers[at, 1] = lambda value, irq=irq: self.set_priority(IRQ + irq, value)
        for at in range(12):
            # SHPR1 to SHPR3: exceptions 4 to 15.
            core.readers[0xE000ED18 + at, 1] = lambda at=at: core.priorities[4 + at]
            core.writers[0xE000ED18 + at, 1] = lambda value, at=at: self.set_priority(4 + at, value)
        register(0xE000EF00, None, lambda value: core.pending.add(IRQ + (value & 0x1FF)))
        # SCB
        register(0xE000ED00, lambda: 0x410FC241)
        register(0xE000ED04, self.read_icsr, self.write_icsr)
        register(0xE000ED08, lambda: core.vector_table, self.write_vtor)
        register(0xE000ED0C, lambda: 0xFA05_0000, self.write_aircr)
        plain(0xE000ED10, writable=0x16)
        plain(0xE000ED14, 0x200, writable=0x31B)
        plain(0xE000ED24, writable=0x7_0000)
        for number, at in enumerate((0xE000ED28, 0xE000ED2C, 0xE000ED34, 0xE000ED38)):
            register(at, lambda number=number: core.fault_status[number],
                     lambda value, number=number: self.clear_fault(number, value))
        plain(0xE000ED88, writable=0x00F0_0000)
        plain(0xE000EF34, 0xC000_0000, writable=0xC000_0000)
        plain(0xE000EF38)
        plain(0xE000EF3C, writable=0x07C0_0000)
        # Debug: nobody is attached.
        register(0xE000EDF0, lambda: 0)
        register(0xE000EDFC, lambda: self.trace, self.write_demcr)
        # MPU of eight regions.
        register(0xE000ED90, lambda: 0x0800)
        plain(0xE000ED94, writable=7)
        register(0xE000ED98, lambda: self.mpu["number"], self.write_mpu_number)
        register(0xE000ED9C, lambda: self.mpu["base"][self.mpu["number"]], lambda value: self.write_mpu("base", value))
        register(0xE000EDA0, lambda: self.mpu["size"][self.mpu["number"]], lambda value: self.write_mpu("size", value))
        # DWT
        register(0xE0001000, lambda: 0x4000_0000 | int(self.cycles_from is not None), self.write_dwt_control)
        register(0xE0001004, self.read_cycles, self.write_cycles)

    @staticmethod
    def bits(numbers, word):
        return sum(1 << number - IRQ - 32 * word for number in numbers if 0 <= number - IRQ - 32 * word < 32)

    @staticmethod
    def each(word, value, action):
        for bit in range(32):
            if value >> bit & 1:
                require(32 * word + bit < 102, "reserved-bit", f"interrupt {32 * word + bit}")
                action(IRQ + 32 * word + bit)

    def unpend(self, number):
        self.core.pending.discard(number)
        if number in self.core.levels:
            self.core.pending.add(number)

    def set_priority(self, number, value):
        require(value & 0x0F == 0, "reserved-bit", f"priority {value:#04x} of exception {number}, {self.core.where()}")
        self.core.priorities[number] = value

    def read_icsr(self):
        core = self.core
        active = core.active[-1][0] if core.active else 0
        best = core.candidate()
        return active | (best[1] << 12 if best else 0)

    def write_icsr(self, value):
        for bit, number, action in ((28, processor.PENDSV, "add"), (27, processor.PENDSV, "discard"),
                                    (26, processor.SYSTICK, "add"), (25, processor.SYSTICK, "discard"),
                                    (31, processor.NMI, "add")):
            if value >> bit & 1:
                getattr(self.core.pending, action)(number)

    def write_vtor(self, value):
        require(value & 0x7F == 0, "reserved-bit", f"VTOR = {value:#010x}")
        self.core.vector_table = value

    def write_aircr(self, value):
        require(value >> 16 == 0x05FA, "reserved-bit", f"AIRCR = {value:#010x}, {self.core.where()}")
        if value & 4:
            raise Reset("software")
        require(value & 0x700 == 0, "reserved-bit", "priority groups, which the model does not have")

    def clear_fault(self, number, value):
        self.core.fault_status[number] &= ~value

    def write_demcr(self, value):
        require(value & ~0x0100_0000 == 0, "reserved-bit", f"DEMCR = {value:#010x}")
        self.trace = value

    def write_mpu_number(self, value):
        require(value < 8, "reserved-bit", f"MPU region {value}")
        self.mpu["number"] = value

    def write_mpu(self, what, value):
        self.mpu[what][self.mpu["number"]] = value

    def write_dwt_control(self, value):
        require(value & 0x3FFF_FFFE & ~0x4000_0000 == 0, "reserved-bit", f"DWT_CTRL = {value:#010x}")
        require(value & 1 == 0 or self.trace >> 24 & 1, "clock-off", "DWT without DEMCR.TRCENA")
        if value & 1 and self.cycles_from is None:
            self.cycles_from = self.core.now()
        elif not value & 1:
            self.cycles_from = None

    def read_cycles(self):
        if self.cycles_from is None:
            return 0
        return (self.core.now() - self.cycles_from) // self.core.cycle & 0xFFFF_FFFF

    def write_cycles(self, value):
        self.cycles_from = self.core.now() - value * self.core.cycle
