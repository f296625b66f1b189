"""The four converters, the timer that triggers them, and the converter that makes the test tone."""

from blocks import Block
from core import UNITS_PER_S
from rules import require

US = UNITS_PER_S // 1_000_000
TIM6_TRGO = 13
# RM0440, ADC timing: sampling times in half cycles; 12.5 cycles of conversion at 12 bits.
SAMPLING_HALVES = (5, 13, 25, 49, 95, 185, 495, 1281)
CONVERSION_HALVES = 25
REGULATOR_US = 20


class Adc(Block):
    REQUEST = {"ADC1": 5, "ADC2": 36, "ADC3": 37, "ADC4": 38}

    def __init__(self, machine, name):
        super().__init__(machine, name)
        self.channel_index = int(name[-1]) - 1
        self.regulated_at = None
        self.calibrated_at = None
        self.ready_at = None
        self.stops_at = None
        self.converted = 0
        # Faults that a test asks for.
        self.overruns_at = None
        self.misses_at = None
        self.calibrates = True

    @property
    def common(self):
        return self.machine.blocks["ADC12_COMMON" if self.channel_index < 2 else "ADC345_COMMON"]

    def clock_units(self):
        mode = self.common.field("CCR", "CKMODE")
        require(mode != 0, "unknown-register", "an asynchronous ADC clock, which the model does not have")
        return self.core.cycle * (1, 1, 2, 4)[mode]

    def read_CR(self):
        now = self.core.now()
        if self.calibrated_at is not None and now >= self.calibrated_at and self.calibrates:
            self.change("CR", "ADCAL", 0)
        if self.stops_at is not None and now >= self.stops_at:
            self.value["CR"] &= ~self.mask("CR", "ADSTP", "ADSTART")
            self.stops_at = None
        return self.value["CR"]

    def write_CR(self, value, old):
        core, now = self.core, self.core.now()
        bit = lambda name: self.mask("CR", name)
        rises = value & ~old
        where = lambda: f"{self.name}.CR {old:#010x} -> {value:#010x}, {core.where()}"
        if rises & bit("ADVREGEN"):
            require(not value & bit("DEEPPWD"), "adc-order", where)
            self.regulated_at = now + REGULATOR_US * US
        if (value ^ old) & bit("ADCALDIF"):
            require(not old & bit("ADEN"), "adc-calibration", where)
        if rises & bit("ADCAL"):
            require(not old & bit("ADEN") and self.regulated_at is not None and now >= self.regulated_at, "adc-calibration", where)
            self.calibrated_at = now + 116 * self.clock_units()
        if rises & bit("ADEN"):
            require(not old & (bit("ADCAL") | bit("ADSTP") | bit("ADDIS")) and value & bit("ADVREGEN"), "adc-order", where)
            require(self.calibrated_at is not None and now >= self.calibrated_at + 4 * self.clock_units(), "adc-order", where)
            self.ready_at = now + 1 * US
        if rises & bit("ADSTART"):
            require(old & bit("ADEN") and self.is_ready() and not old & bit("ADDIS"), "adc-order", where)
        if rises & bit("ADSTP"):
            require(old & bit("ADSTART"), "adc-order", where)
            self.stops_at = now + 4 * self.clock_units()
        require(not rises & (bit("ADDIS") | bit("JADSTART") | bit("JADSTP")), "unknown-register", where)
        self.value["CR"] = value

    def is_ready(self):
        return self.ready_at is not None and self.core.now() >= self.ready_at

    def read_ISR(self):
        self.machine.sync()
        if self.ready_at is not None and self.is_ready():
            self.value["ISR"] |= 1
            self.ready_at = 0
        return self.value["ISR"]

    def write_ISR(self, value, old):
        self.value["ISR"] = value

    def idle(self, name):
        def write(value, old):
            require(not self.read_CR() & self.mask("CR", "ADSTART"), "adc-locked", f"{self.name}.{name}, {self.core.where()}")
            self.value[name] = value
        return write

    def __getattr__(self, name):
        # Registers that only an idle converter takes.
        if name in ("write_CFGR", "write_CFGR2", "write_SMPR1", "write_SMPR2", "write_SQR1"):
            return self.idle(name[6:])
        raise AttributeError(name)

    def conversion_units(self):
        """From the trigger to the result, by the input that is sampled."""
        require(self.field("SQR1", "L") == 0, "unknown-register", "a sequence, which the model does not have")
        source = self.field("SQR1", "SQ1")
        register, first = ("SMPR1", 0) if source < 10 else ("SMPR2", 10)
        halves = SAMPLING_HALVES[self.field(register, f"SMP{source}")] + CONVERSION_HALVES
        return (halves * self.clock_units() + 1) // 2 + 3 * self.clock_units()

    def converts(self):
        """Whether a trigger of TIM6 starts a conversion."""
        cfgr = self.value["CFGR"]
        return (self.read_CR() & self.mask("CR", "ADSTART") and self.field("CFGR", "EXTEN") == 1
                and cfgr >> 5 & 31 == TIM6_TRGO)

    def channel(self):
        return self.machine.channels.get(self.REQUEST[self.name])

    def take(self, triggers):
        """So many conversions have been triggered; their results go by DMA."""
        if self.misses_at is not None and self.core.now() >= self.misses_at:
            self.misses_at = None
            triggers -= 1
        if self.overruns_at is not None and self.core.now() >= self.overruns_at:
            self.overruns_at = None
            self.value["ISR"] |= self.mask("ISR", "OVR")
        if self.value["ISR"] & self.mask("ISR", "OVR") and not self.field("CFGR", "OVRMOD"):
            # No more requests until it is cleared.
            return
        self.value["ISR"] |= self.mask("ISR", "EOSMP", "EOC", "EOS")
        channel = self.channel()
        if channel is None or not self.field("CFGR", "DMAEN"):
            if triggers > 1:
                self.value["ISR"] |= self.mask("ISR", "OVR")
            return
        while triggers:
            count = min(triggers, channel.until_flag())
            channel.push(self.machine.codes_of(self.channel_index, self.converted, count))
            self.converted += count
            triggers -= count

    def dma_is_ready(self):
        self.converted = 0
        self.machine.sampler.schedule()

    def dma_stops(self, channel):
        pass


class AdcCommon(Block):
    def write_CCR(self, value, old):
        pair = ("ADC1", "ADC2") if self.name == "ADC12_COMMON" else ("ADC3", "ADC4")
        for name in pair:
            require(value == old or not self.machine.blocks[name].value["CR"] & 1, "adc-clock", f"{self.name}, {self.core.where()}")
        require(value & ~(3 << 16) == 0, "unknown-register", f"{self.name}.CCR = {value:#010x}: the model has CKMODE only")
        self.value["CCR"] = value


class Sampler(Block):
    """TIM6: its update event triggers the converters."""

    def __init__(self, machine):
        super().__init__(machine, "TIM6")
        self.first_at = None
        self.done = 0
        self.event = None
        self.armed_at = None

    def converters(self):
        return [self.machine.blocks[f"ADC{n}"] for n in (1, 2, 3, 4)]

    def is_in_step(self):
        """Whether all of them have filled as much of their rings."""
        self.sync()
        channels = [converter.channel() for converter in self.converters()]
        return None not in channels and len({channel.remaining for channel in channels}) == 1

    def period(self):
        return ((self.value["ARR"] & 0xFFFF) + 1) * (self.value["PSC"] + 1) * (UNITS_PER_S // self.machine.rcc.timer_hz("PPRE1"))

    def triggers(self):
        return self.value["CR2"] >> 4 & 7 == 2

    def write_EGR(self, value, old):
        if value & 1:
            if not self.value["CR1"] & 4:
                self.value["SR"] |= 1
            if self.triggers():
                for converter in self.converters():
                    if converter.converts():
                        converter.take(1)

    def write_CR1(self, value, old):
        self.sync()
        self.value["CR1"] = value
        if value & 1 and not old & 1:
            self.first_at, self.done = self.core.now(), 0
            for converter in self.converters():
                if self.triggers() and converter.converts():
                    require(self.period() >= converter.conversion_units(), "adc-rate", f"{converter.name}, {self.core.where()}")
                    require((self.value["PSC"] + 1) * self.core.cycle % converter.clock_units() == 0, "adc-phase",
                            f"{converter.name}, {self.core.where()}")
            self.machine.sampling_begins()
        elif old & 1 and not value & 1:
            self.first_at = None
            self.machine.sampling_ends()
        self.schedule()

    def write_ARR(self, value, old):
        require(not self.value["CR1"] & 1, "unknown-register", "ARR of TIM6 is changed while it runs, which the model does not have")
        self.value["ARR"] = value

    def sync(self):
        """Takes in the triggers until now."""
        if self.first_at is None or not self.triggers():
            return
        delay = 110 * 4 * self.core.cycle
        passed = (self.core.now() - self.first_at - delay) // self.period()
        count = passed - self.done
        if count > 0:
            self.done = passed
            for converter in self.converters():
                if converter.converts():
                    converter.take(count)

    def schedule(self):
        """The next time at which a channel has a half full, or all of it."""
        self.core.cancel(self.event)
        self.event = None
        if self.first_at is None:
            return
        channels = [converter.channel() for converter in self.converters()]
        counts = [channel.until_flag() for channel in channels if channel is not None]
        if counts:
            delay = 110 * 4 * self.core.cycle
            self.event = self.core.at(self.first_at + (self.done + min(counts)) * self.period() + delay, self.due)

    def due(self):
        self.sync()
        self.schedule()


class Dac(Block):
    def write_CR(self, value, old):
        locked = self.mask("CR", "TSEL1", "WAVE1", "MAMP1")
        if old & 1 and value & 1:
            require((value ^ old) & locked == 0, "dac-locked", f"CR = {value:#010x}, {self.core.where()}")
        self.value["CR"] = value

    def write_MCR(self, value, old):
        if (value ^ old) & self.mask("MCR", "MODE1"):
            require(not self.value["CR"] & 1, "dac-locked", f"MCR = {value:#010x}, {self.core.where()}")
        self.value["MCR"] = value

    def dma_is_ready(self):
        pass

    def dma_stops(self, channel):
        pass
