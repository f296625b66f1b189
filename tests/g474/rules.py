"""The rules that the part has and a forgiving emulator would not enforce: one list.

A rule that is broken ends the run with one sentence. The sections are those of RM0440 Rev 8 unless another source is named.
"""

RULES = {
    "unknown-register": ("an address where the model has no register is accessed", "2.2"),
    "access-size": ("a register is accessed with a width that it does not take", "1.2"),
    "reserved-bit": ("a reserved bit is written with another value than its reset value", "1.2"),
    "read-only-bit": ("a read-only bit is written with another value than it reads", "1.2"),
    "clock-off": ("a peripheral is used while its clock is off", "7.2.17"),
    "unmapped": ("memory is accessed where there is none", "2.2"),
    "program-written": ("flash is written outside its programming sequence", "3.3.7"),
    # Clocks and power
    "sysclk-step": ("SYSCLK goes above 80 MHz with AHB prescaler 1; it must be 2 for at least 1 us", "7.2.7"),
    "boost": ("HCLK is above 150 MHz in range 1 without boost: PWR_CR5.R1MODE (bit 8) is set", "6.1.5"),
    "wait-states": ("HCLK is too fast for the flash wait states", "3.3.3"),
    "clock-not-ready": ("a clock is selected that is not ready", "7.2.7"),
    "hse-wait": ("a crystal that does not start is waited for, with no watchdog to end it", "7.2.1"),
    "pll-locked": ("the PLL's source or factors are changed while it runs", "7.4.4"),
    "pll-range": ("the PLL's input or output is outside its range", "DS12288 5.3.9"),
    "clock-in-use": ("a clock is switched off that SYSCLK is made from", "7.4.1"),
    # DMA
    "dma-length": ("a DMA channel is enabled for a transfer of length 0", "12.4.5"),
    "dma-resumed": ("a DMA channel is enabled again without its CNDTR being written", "12.4.5"),
    "dma-locked": ("a DMA channel's registers are written while it is enabled", "12.6.3"),
    "dma-alignment": ("a DMA address is not a multiple of its size", "12.6.5"),
    "dma-memory": ("DMA is pointed at memory that it cannot reach", "2.1"),
    "dma-peripheral": ("DMA is pointed at a register that does not belong to its request", "13.3.2"),
    "dmamux-locked": ("a DMAMUX channel is rerouted while its DMA channel is enabled", "13.4.3"),
    # ADC
    "adc-order": ("an ADC is not switched on in the order of the manual", "21.4.6"),
    "adc-locked": ("an ADC's configuration is written while it converts", "21.7.4"),
    "adc-clock": ("the ADC common clock mode is changed while a converter is on", "21.8.2"),
    "adc-calibration": ("an ADC is calibrated while it is enabled or its regulator has not started", "21.4.8"),
    "adc-rate": ("an ADC is triggered before the conversion before has ended", "21.4.12"),
    "adc-phase": ("ADCs are triggered by a timer whose prescaler is no multiple of theirs, and disturb each other", "ES0430 2.7.11"),
    # USART
    "uart-locked": ("a UART register is written that only a disabled UART takes", "37.8"),
    "uart-dma": ("a UART is disabled while its DMA channel is enabled", "37.8.1"),
    "uart-baud": ("a UART's bit rate is more than 2 % off its line's", "37.5.8"),
    "uart-pins": ("a UART is used whose pins are not its own, or whose input floats", "9.3.10"),
    # Timers, watchdog, DAC
    "iwdg-locked": ("an IWDG register is written without its key", "42.3.5"),
    "iwdg-busy": ("an IWDG register is written while its last value is under way", "42.4.4"),
    "dac-locked": ("a DAC channel's trigger or mode is changed while it is enabled", "22.7.1"),
    # Flash
    "flash-locked": ("FLASH_CR is written while it is locked", "3.3.5"),
    "flash-busy": ("flash is programmed or erased while it is busy", "3.3.7"),
    "flash-alignment": ("flash is programmed in other units than aligned double words", "3.3.7"),
    "flash-overwritten": ("a flash double word is programmed over that is neither erased nor cleared to zero", "3.3.7"),
    "flash-key": ("a flash key is wrong, which locks the flash until the next reset", "3.3.5"),
    # Core
    "vector": ("an exception is taken whose vector is no Thumb code in flash", "ARM DDI 0403E B1.5.3"),
    "lockup": ("a fault comes while HardFault or NMI is handled: the core locks up", "ARM DDI 0403E B1.5.15"),
}


class Broken(Exception):
    """A rule that was broken."""

    def __init__(self, rule, detail):
        sentence, section = RULES[rule]
        source = section if " " in section else f"RM0440 {section}"
        super().__init__(f"{sentence} ({source}): {detail}")
        self.rule = rule


def require(holds, rule, detail):
    """Ends the run where a rule does not hold; `detail` is text, or a function that makes it."""
    if not holds:
        raise Broken(rule, detail() if callable(detail) else detail)
