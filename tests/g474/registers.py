"""The registers that the image uses: names, places, bits, values after reset (RM0440 Rev 8).

A register is a line: offset, reset value, fields. A field is `NAME[:width][@bit][/access]`; without `@` it follows the one
before. Access: `rw` (default), `r` read-only, `w` write-only, `s` set by software and cleared by hardware, `c1` cleared by
writing 1, `c0` cleared by writing 0. Whatever no field names is reserved.

`python registers.py` prints all of it as JSON; `tests/twin/g474.rs` compares that with a second source.
"""

import json
import re
import sys

FIELD = re.compile(r"(?P<name>\w+)(:(?P<width>\d+))?(@(?P<bit>\d+))?(/(?P<access>\w+))?$")


class Register:
    """One register: masks by access, made from its line."""

    def __init__(self, name, offset, reset, fields):
        self.name, self.offset, self.reset = name, offset, reset
        self.fields = {}
        masks = dict.fromkeys(("rw", "r", "w", "s", "c1", "c0"), 0)
        following = 0
        for text in fields.split():
            match = FIELD.match(text)
            width = int(match["width"] or 1)
            bit = int(match["bit"]) if match["bit"] else following
            access = match["access"] or "rw"
            mask = ((1 << width) - 1) << bit
            if any(mask & other for other in masks.values()) or bit + width > 32:
                raise ValueError(f"{name}.{match['name']} overlaps")
            masks[access] |= mask
            self.fields[match["name"]] = (bit, width, access)
            following = bit + width
        self.rw, self.r, self.w, self.s = masks["rw"], masks["r"], masks["w"], masks["s"]
        self.c1, self.c0 = masks["c1"], masks["c0"]
        self.known = sum(masks.values())
        self.readable = self.known & ~self.w


def block(lines):
    registers = {}
    for line in lines.strip().splitlines():
        name, offset, reset, *fields = line.split(None, 3)
        registers[int(offset, 16)] = Register(name, int(offset, 16), int(reset, 16), fields[0] if fields else "")
    return registers


def each(pattern, numbers, first=0, step=1):
    """`each("A{}", 3)` is A1@0 A2@1 A3@2."""
    return " ".join(f"{pattern.format(n)}@{first + step * at}" for at, n in enumerate(numbers))


AHB1 = "DMA1{0} DMA2{0} DMAMUX1{0} CORDIC{0} FMAC{0} FLASH{0}@8 CRC{0}@12"
AHB2 = each("GPIO{}{{0}}", "ABCDEFG") + (
    " ADC12{0}@13 ADC345{0} DAC1{0}@16 DAC2{0} DAC3{0} DAC4{0} AES{0}@24 RNG{0}@26")
APB1_1 = each("TIM{}{{0}}", "234567") + (
    " CRS{0}@8 SPI2{0}@14 SPI3{0} USART2{0}@17 USART3{0} UART4{0} UART5{0} I2C1{0} I2C2{0} USB{0} FDCAN{0}@25 PWR{0}@28"
    " I2C3{0}@30 LPTIM1{0}")
APB1_2 = "LPUART1{0} I2C4{0} UCPD1{0}@8"
APB2 = ("SYSCFG{0} TIM1{0}@11 SPI1{0} TIM8{0} USART1{0} SPI4{0} TIM15{0} TIM16{0} TIM17{0} TIM20{0}@20 SAI1{0}"
        " HRTIM1{0}@26")
WATCHED = " RTCAPBEN@10 WWDGEN/s"

RCC = block(f"""
CR       0x00 0x00000500 HSION@8 HSIKERON HSIRDY/r HSEON@16 HSERDY/r HSEBYP CSSON/s PLLON@24 PLLRDY/r
ICSCR    0x04 0x40000000 HSICAL:8@16/r HSITRIM:7
CFGR     0x08 0x00000005 SW:2 SWS:2/r HPRE:4 PPRE1:3 PPRE2:3 MCOSEL:4@24 MCOPRE:3
PLLCFGR  0x0C 0x00001000 PLLSRC:2 PLLM:4@4 PLLN:7 PLLPEN@16 PLLP PLLQEN@20 PLLQ:2 PLLREN@24 PLLR:2 PLLPDIV:5
CIER     0x18 0x00000000 LSIRDYIE LSERDYIE HSIRDYIE@3 HSERDYIE PLLRDYIE LSECSSIE@9 HSI48RDYIE
CIFR     0x1C 0x00000000 LSIRDYF/r LSERDYF/r HSIRDYF@3/r HSERDYF/r PLLRDYF/r CSSF@8/r LSECSSF/r HSI48RDYF/r
CICR     0x20 0x00000000 LSIRDYC/w LSERDYC/w HSIRDYC@3/w HSERDYC/w PLLRDYC/w CSSC@8/w LSECSSC/w HSI48RDYC/w
AHB1RSTR 0x28 0x00000000 {AHB1.format("RST")}
AHB2RSTR 0x2C 0x00000000 {AHB2.format("RST")}
AHB3RSTR 0x30 0x00000000 FMCRST QSPIRST@8
APB1RSTR1 0x38 0x00000000 {APB1_1.format("RST")}
APB1RSTR2 0x3C 0x00000000 {APB1_2.format("RST")}
APB2RSTR 0x40 0x00000000 {APB2.format("RST")}
AHB1ENR  0x48 0x00000100 {AHB1.format("EN")}
AHB2ENR  0x4C 0x00000000 {AHB2.format("EN")}
AHB3ENR  0x50 0x00000000 FMCEN QSPIEN@8
APB1ENR1 0x58 0x00000400 {APB1_1.format("EN")} {WATCHED}
APB1ENR2 0x5C 0x00000000 {APB1_2.format("EN")}
APB2ENR  0x60 0x00000000 {APB2.format("EN")}
CCIPR    0x88 0x00000000 USART1SEL:2 USART2SEL:2 USART3SEL:2 UART4SEL:2 UART5SEL:2 LPUART1SEL:2 I2C1SEL:2 I2C2SEL:2 I2C3SEL:2 LPTIM1SEL:2 SAI1SEL:2 I2S23SEL:2 FDCANSEL:2 CLK48SEL:2 ADC12SEL:2 ADC345SEL:2
BDCR     0x90 0x00000000 LSEON LSERDY/r LSEBYP LSEDRV:2 LSECSSON LSECSSD/r RTCSEL:2@8 RTCEN@15 BDRST LSCOEN@24 LSCOSEL
CSR      0x94 0x0C000000 LSION LSIRDY/r RMVF@23 OBLRSTF@25/r PINRSTF/r BORRSTF/r SFTRSTF/r IWDGRSTF/r WWDGRSTF/r LPWRRSTF/r
CRRCR    0x98 0x00000000 HSI48ON HSI48RDY/r HSI48CAL:9@7/r
CCIPR2   0x9C 0x00000000 I2C4SEL:2 QSPISEL:2@20
""")

PWR = block("""
CR1 0x00 0x00000200 LPMS:3 DBP@8 VOS:2 LPR@14
CR3 0x08 0x00008000 EWUP1 EWUP2 EWUP3 EWUP4 EWUP5 RRS@8 APC@10 UCPD1_STDBY@13 UCPD1_DBDIS EIWUL
CR5 0x80 0x00000100 R1MODE@8
""")

FLASH = block("""
ACR     0x00 0x00040600 LATENCY:4 PRFTEN@8 ICEN DCEN ICRST DCRST RUN_PD SLEEP_PD DBG_SWEN@18
PDKEYR  0x04 0x00000000 PDKEY:32/w
KEYR    0x08 0x00000000 KEY:32/w
OPTKEYR 0x0C 0x00000000 OPTKEY:32/w
SR      0x10 0x00000000 EOP/c1 OPERR/c1 PROGERR@3/c1 WRPERR/c1 PGAERR/c1 SIZERR/c1 PGSERR/c1 MISERR/c1 FASTERR/c1 RDERR@14/c1 OPTVERR/c1 BSY/r
CR      0x14 0xC0000000 PG PER MER1 PNB:7 BKER@11 MER2@15 STRT/s OPTSTRT/s FSTPG EOPIE@24 ERRIE RDERRIE OBL_LAUNCH SEC_PROT1 SEC_PROT2 OPTLOCK/s LOCK/s
ECCR    0x18 0x00000000 ADDR_ECC:19/r BK_ECC@21/r SYSF_ECC/r ECCIE@24 ECCC2@28/c1 ECCD2/c1 ECCC/c1 ECCD/c1
OPTR    0x20 0xFFEFF8AA RDP:8 BOR_LEV:3 NRST_STOP@12 NRST_STDBY NRST_SHDW IDWG_SW@16 IWDG_STOP IWDG_STDBY WWDG_SW BFB2 DBANK@22 NBOOT1 SRAM_PE CCMSRAM_RST NSWBOOT0 NBOOT0 NRST_MODE:2 IRHEN
""")

DMA_CHANNELS = 8
DMA = block("\n".join([
    "ISR  0x00 0 " + " ".join(f"GIF{n}/r TCIF{n}/r HTIF{n}/r TEIF{n}/r" for n in range(1, 9)),
    "IFCR 0x04 0 " + " ".join(f"CGIF{n}/w CTCIF{n}/w CHTIF{n}/w CTEIF{n}/w" for n in range(1, 9)),
] + [line for n in range(DMA_CHANNELS) for line in (
    f"CCR{n + 1}   {0x08 + 20 * n:#x} 0 EN TCIE HTIE TEIE DIR CIRC PINC MINC PSIZE:2 MSIZE:2 PL:2 MEM2MEM",
    f"CNDTR{n + 1} {0x0C + 20 * n:#x} 0 NDT:16",
    f"CPAR{n + 1}  {0x10 + 20 * n:#x} 0 PA:32",
    f"CMAR{n + 1}  {0x14 + 20 * n:#x} 0 MA:32",
)]))

DMAMUX = block("\n".join(
    f"C{n}CR {4 * n:#x} 0 DMAREQ_ID:7 SOIE@8 EGE SE@16 SPOL:2 NBREQ:5 SYNC_ID:5" for n in range(16)))

GPIO = block("\n".join([
    "MODER   0x00 0xFFFFFFFF " + " ".join(f"MODER{n}:2" for n in range(16)),
    "OTYPER  0x04 0 " + " ".join(f"OT{n}" for n in range(16)),
    "OSPEEDR 0x08 0 " + " ".join(f"OSPEEDR{n}:2" for n in range(16)),
    "PUPDR   0x0C 0 " + " ".join(f"PUPDR{n}:2" for n in range(16)),
    "IDR     0x10 0 " + " ".join(f"IDR{n}/r" for n in range(16)),
    "ODR     0x14 0 " + " ".join(f"ODR{n}" for n in range(16)),
    "BSRR    0x18 0 " + " ".join(f"BS{n}/w" for n in range(16)) + " " + " ".join(f"BR{n}/w" for n in range(16)),
    "AFRL    0x20 0 " + " ".join(f"AFR{n}:4" for n in range(8)),
    "AFRH    0x24 0 " + " ".join(f"AFR{n}:4" for n in range(8, 16)),
]))

ADC = block("""
ISR   0x00 0x00000000 ADRDY/c1 EOSMP/c1 EOC/c1 EOS/c1 OVR/c1 JEOC/c1 JEOS/c1 AWD1/c1 AWD2/c1 AWD3/c1 JQOVF/c1
IER   0x04 0x00000000 ADRDYIE EOSMPIE EOCIE EOSIE OVRIE JEOCIE JEOSIE AWD1IE AWD2IE AWD3IE JQOVFIE
CR    0x08 0x20000000 ADEN/s ADDIS/s ADSTART/s JADSTART/s ADSTP/s JADSTP/s ADVREGEN@28 DEEPPWD ADCALDIF ADCAL/s
CFGR  0x0C 0x80000000 DMAEN DMACFG RES:2@3 EXTSEL:5 EXTEN:2 OVRMOD CONT AUTDLY ALIGN DISCEN DISCNUM:3 JDISCEN JQM AWD1SGL AWD1EN JAWD1EN JAUTO AWD1CH:5 JQDIS
CFGR2 0x10 0x00000000 ROVSE JOVSE OVSR:3 OVSS:4 TROVS ROVSM GCOMP@16 SWTRIG@25 BULB SMPTRIG
SMPR1 0x14 0x00000000 SMP0:3 SMP1:3 SMP2:3 SMP3:3 SMP4:3 SMP5:3 SMP6:3 SMP7:3 SMP8:3 SMP9:3 SMPPLUS@31
SMPR2 0x18 0x00000000 SMP10:3 SMP11:3 SMP12:3 SMP13:3 SMP14:3 SMP15:3 SMP16:3 SMP17:3 SMP18:3
SQR1  0x30 0x00000000 L:4 SQ1:5@6 SQ2:5@12 SQ3:5@18 SQ4:5@24
DR    0x40 0x00000000 RDATA:16/r
""")

ADC_COMMON = block("""
CCR 0x08 0x00000000 DUAL:5 DELAY:4@8 DMACFG@13 MDMA:2 CKMODE:2 PRESC:4 VREFEN VSENSESEL VBATSEL
""")

DAC = block("""
CR      0x00 0x00000000 EN1 TEN1 TSEL1:4 WAVE1:2 MAMP1:4 DMAEN1 DMAUDRIE1 CEN1 EN2@16 TEN2 TSEL2:4 WAVE2:2 MAMP2:4 DMAEN2 DMAUDRIE2 CEN2
DHR12R1 0x08 0x00000000 DACC1DHR:12 DACC1DHRB:12@16
DOR1    0x2C 0x00000000 DACC1DOR:12/r DACC1DORB:12@16/r
SR      0x34 0x00000000 DAC1RDY@11/r DORSTAT1/r DMAUDR1/c1 CAL_FLAG1/r BWST1/r DAC2RDY@27/r DORSTAT2/r DMAUDR2/c1 CAL_FLAG2/r BWST2/r
MCR     0x3C 0x00000000 MODE1:3 DMADOUBLE1@8 SINFORMAT1 HFSEL:2@14 MODE2:3@16 DMADOUBLE2@24 SINFORMAT2
""")

USART = block("""
CR1   0x00 0x00000000 UE UESM RE TE IDLEIE RXNEIE TCIE TXEIE PEIE PS PCE WAKE M0 MME CMIE OVER8 DEDT:5 DEAT:5 RTOIE EOBIE M1 FIFOEN TXFEIE RXFFIE
CR2   0x04 0x00000000 SLVEN DIS_NSS@3 ADDM7 LBDL LBDIE LBCL@8 CPHA CPOL CLKEN STOP:2 LINEN SWAP RXINV TXINV DATAINV MSBFIRST ABREN ABRMOD:2 RTOEN ADD:8
CR3   0x08 0x00000000 EIE IREN IRLP HDSEL NACK SCEN DMAR DMAT RTSE CTSE CTSIE ONEBIT OVRDIS DDRE DEM DEP SCARCNT:3@17 WUS:2 WUFIE TXFTIE TCBGTIE RXFTCFG:3 RXFTIE TXFTCFG:3
BRR   0x0C 0x00000000 BRR:16
ISR   0x1C 0x000000C0 PE/r FE/r NE/r ORE/r IDLE/r RXNE/r TC/r TXE/r LBDF/r CTSIF/r CTS/r RTOF/r EOBF/r UDR/r ABRE/r ABRF/r BUSY/r CMF/r SBKF/r RWU/r WUF/r TEACK/r REACK/r TXFE/r RXFF/r TCBGT/r RXFT/r TXFT/r
ICR   0x20 0x00000000 PECF/w FECF/w NECF/w ORECF/w IDLECF/w TXFECF/w TCCF/w TCBGTCF/w LBDCF/w CTSCF/w RTOCF@11/w EOBCF/w UDRCF/w CMCF@17/w WUCF@20/w
RDR   0x24 0x00000000 RDR:9/r
TDR   0x28 0x00000000 TDR:9
PRESC 0x2C 0x00000000 PRESCALER:4
""")

# Without the parts that a low-power UART lacks.
LPUART = dict(USART) | block("""
CR1   0x00 0x00000000 UE UESM RE TE IDLEIE RXNEIE TCIE TXEIE PEIE PS PCE WAKE M0 MME CMIE DEDT:5@16 DEAT:5 M1@28 FIFOEN TXFEIE RXFFIE
CR2   0x04 0x00000000 ADDM7@4 STOP:2@12 SWAP@15 RXINV TXINV DATAINV MSBFIRST ADD:8@24
CR3   0x08 0x00000000 EIE HDSEL@3 DMAR@6 DMAT RTSE CTSE CTSIE OVRDIS@12 DDRE DEM DEP WUS:2@20 WUFIE TXFTIE RXFTCFG:3@25 RXFTIE TXFTCFG:3
BRR   0x0C 0x00000000 BRR:20
ISR   0x1C 0x000000C0 PE/r FE/r NE/r ORE/r IDLE/r RXNE/r TC/r TXE/r CTSIF@9/r CTS/r BUSY@16/r CMF/r SBKF/r RWU/r WUF/r TEACK/r REACK/r TXFE/r RXFF/r RXFT@26/r TXFT/r
ICR   0x20 0x00000000 PECF/w FECF/w NECF/w ORECF/w IDLECF/w TCCF@6/w CTSCF@9/w CMCF@17/w WUCF@20/w
""")

TIM15 = block("""
CR1   0x00 0x00000000 CEN UDIS URS OPM ARPE@7 CKD:2 UIFREMAP@11 DITHEN
DIER  0x0C 0x00000000 UIE CC1IE CC2IE COMIE@5 TIE BIE UDE CC1DE CC2DE COMDE@13 TDE
SR    0x10 0x00000000 UIF/c0 CC1IF/c0 CC2IF/c0 COMIF@5/c0 TIF/c0 BIF/c0 CC1OF@9/c0 CC2OF/c0
EGR   0x14 0x00000000 UG/w CC1G/w CC2G/w COMG@5/w TG/w BG/w
CNT   0x24 0x00000000 CNT:16 UIFCPY@31/r
PSC   0x28 0x00000000 PSC:16
ARR   0x2C 0x0000FFFF ARR:20
CCR1  0x34 0x00000000 CCR1:20
CCR2  0x38 0x00000000 CCR2:20
""")

TIM_BASIC = block("""
CR1   0x00 0x00000000 CEN UDIS URS OPM ARPE@7 UIFREMAP@11 DITHEN
CR2   0x04 0x00000000 MMS:3@4
DIER  0x0C 0x00000000 UIE UDE@8
SR    0x10 0x00000000 UIF/c0
EGR   0x14 0x00000000 UG/w
CNT   0x24 0x00000000 CNT:16 UIFCPY@31/r
PSC   0x28 0x00000000 PSC:16
ARR   0x2C 0x0000FFFF ARR:20
""")

IWDG = block("""
KR   0x00 0x00000000 KEY:16/w
PR   0x04 0x00000000 PR:3
RLR  0x08 0x00000FFF RL:12
SR   0x0C 0x00000000 PVU/r RVU/r WVU/r
WINR 0x10 0x00000FFF WIN:12
""")

DBGMCU = block("""
CR       0x04 0x00000000 DBG_SLEEP DBG_STOP DBG_STANDBY TRACE_IOEN@5 TRACE_MODE:2
APB1FZR1 0x08 0x00000000 DBG_TIM2_STOP DBG_TIM3_STOP DBG_TIM4_STOP DBG_TIM5_STOP DBG_TIM6_STOP DBG_TIM7_STOP DBG_RTC_STOP@10 DBG_WWDG_STOP DBG_IWDG_STOP DBG_I2C1_STOP@21 DBG_I2C2_STOP DBG_I2C3_STOP@30 DBG_LPTIM_STOP
""")

# Which take half words, too.
HALF_WORDS = {"TIM6", "TIM15"}

# What a block's registers are called in the part, where it lies, its registers, its clock, its interrupt.
BLOCKS = [
    ("TIM6", 0x40001000, TIM_BASIC, "APB1ENR1.TIM6EN", 54),
    ("IWDG", 0x40003000, IWDG, None, None),
    ("PWR", 0x40007000, PWR, "APB1ENR1.PWREN", None),
    ("USART3", 0x40004800, USART, "APB1ENR1.USART3EN", 39),
    ("LPUART1", 0x40008000, LPUART, "APB1ENR2.LPUART1EN", 91),
    ("USART1", 0x40013800, USART, "APB2ENR.USART1EN", 37),
    ("TIM15", 0x40014000, TIM15, "APB2ENR.TIM15EN", 24),
    ("DMA1", 0x40020000, DMA, "AHB1ENR.DMA1EN", None),
    ("DMA2", 0x40020400, DMA, "AHB1ENR.DMA2EN", None),
    ("DMAMUX1", 0x40020800, DMAMUX, "AHB1ENR.DMAMUX1EN", None),
    ("RCC", 0x40021000, RCC, None, None),
    ("FLASH", 0x40022000, FLASH, "AHB1ENR.FLASHEN", 4),
    ("GPIOA", 0x48000000, GPIO, "AHB2ENR.GPIOAEN", None),
    ("GPIOB", 0x48000400, GPIO, "AHB2ENR.GPIOBEN", None),
    ("GPIOC", 0x48000800, GPIO, "AHB2ENR.GPIOCEN", None),
    ("ADC1", 0x50000000, ADC, "AHB2ENR.ADC12EN", 18),
    ("ADC2", 0x50000100, ADC, "AHB2ENR.ADC12EN", 18),
    ("ADC12_COMMON", 0x50000300, ADC_COMMON, "AHB2ENR.ADC12EN", None),
    ("ADC3", 0x50000400, ADC, "AHB2ENR.ADC345EN", 47),
    ("ADC4", 0x50000500, ADC, "AHB2ENR.ADC345EN", 61),
    ("ADC345_COMMON", 0x50000700, ADC_COMMON, "AHB2ENR.ADC345EN", None),
    ("DAC1", 0x50000800, DAC, "AHB2ENR.DAC1EN", None),
    ("DBGMCU", 0xE0042000, DBGMCU, None, None),
]

# RM0440, table of the DMAMUX inputs: request, the register that its peripheral has for it, whether DMA writes that.
REQUESTS = {
    5: ("ADC1", "DR", False), 36: ("ADC2", "DR", False), 37: ("ADC3", "DR", False), 38: ("ADC4", "DR", False),
    6: ("DAC1", "DHR12R1", True),
    24: ("USART1", "RDR", False), 25: ("USART1", "TDR", True),
    28: ("USART3", "RDR", False), 29: ("USART3", "TDR", True),
    34: ("LPUART1", "RDR", False), 35: ("LPUART1", "TDR", True),
}
# Values after reset that differ from port to port.
RESETS = {
    "GPIOA": {"MODER": 0xABFFFFFF, "OSPEEDR": 0x0C000000, "PUPDR": 0x64000000},
    "GPIOB": {"MODER": 0xFFFFFEBF, "OSPEEDR": 0x000000C0, "PUPDR": 0x00000100},
}


def as_json():
    """Everything that a second source is asked for."""
    table = []
    for name, base, registers, clock, interrupt in BLOCKS:
        table.append({
            "name": name, "address": base, "clock": clock, "interrupt": interrupt,
            "registers": [{
                "name": register.name, "offset": offset,
                "fields": [{"name": field, "bit": bit, "width": width, "access": access}
                           for field, (bit, width, access) in register.fields.items()],
            } for offset, register in sorted(registers.items())],
        })
    requests = [{"number": number, "peripheral": name, "register": register, "writes": writes}
                for number, (name, register, writes) in REQUESTS.items()]
    return {"blocks": table, "requests": requests}


if __name__ == "__main__":
    json.dump(as_json(), sys.stdout)
