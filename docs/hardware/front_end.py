"""Draws front_end.svg: one of the four equal channels, from the mixer to the converter's pin; prints gain and filter.

    pip install schemdraw==0.23
    python docs/hardware/front_end.py
"""

from math import log10, pi
from pathlib import Path

import schemdraw
from schemdraw import elements as elm

SUPPLY = "+3.3 V A"
PINS = """A1: PA0, CN8-1 (A0)
A2: PA1, CN8-2 (A1)
A3: PB0, CN8-4 (A3)
A4: PB12, CN10-16"""

# The filter's sections: resistors and capacitors, and the feedback resistors, with 10 kohm to ground.
FILTER_OHM, FILTER_F = 5_360, 1e-9
SECTIONS = {"U1B": 1_540, "U1C": 12_400}


def ohms(value):
    """A resistor's value as the schematic has it."""
    return f"{value / 1_000:g} k" if value >= 1_000 else f"{value}"


def response(frequency_hz):
    """The amplitude behind U1C over that behind U1A."""
    x = 2j * pi * frequency_hz * FILTER_OHM * FILTER_F
    gains = [1 + feedback / 10_000 for feedback in SECTIONS.values()]
    first, second = (gain / (1 + (3 - gain) * x + x * x) for gain in gains)
    return abs(first * second)


def to_ground(drawing, start, *parts, side="bottom"):
    """Parts in a row, from a point down to ground."""
    for part, value in parts:
        drawing += (last := part().at(start).down(1.9).label(value, loc=side))
        start = last.end
    drawing += elm.Ground(lead=False)


def bias(drawing):
    """Couples the signal and puts it half-way between ground and the supply."""
    drawing += elm.Capacitor().right(2.4).label("100 n", loc="bottom", ofst=(0, -0.5))
    drawing += (node := elm.Dot())
    drawing += elm.Resistor().at(node.center).up(1.9).label("10 k")
    drawing += elm.Vdd().label(SUPPLY)
    to_ground(drawing, node.center, (elm.Resistor, "10 k"))
    drawing.move_from(node.center)


def amplifier(drawing, name, feedback=None, shunt=None, capacitor=None):
    """A non-inverting stage with its gain set by two resistors; with none it follows. At DC the gain is 1."""
    opamp = elm.Opamp(leads=False).flip().anchor("in2").label(name, "center", ofst=(-0.2, 0))
    drawing += opamp
    drawing += elm.Line().at(opamp.in1).left(0.4)
    drawing += elm.Line().down(1.1)
    drawing += (corner := elm.Dot(radius=0.075 if feedback else 0))
    part = elm.Resistor().label(feedback, loc="bottom", ofst=(0, -0.4)) if feedback else elm.Line()
    drawing += part.at(corner.center).right().tox(opamp.out)
    drawing += elm.Line().up().toy(opamp.out)
    drawing += elm.Dot().at(opamp.out)
    if feedback:
        to_ground(drawing, corner.center, (elm.Resistor, shunt), (elm.Capacitor, capacitor), side="top")
    drawing.move_from(opamp.out)
    return opamp


def low_pass(drawing, name):
    """A Sallen-Key section."""
    drawing += elm.Line().right(0.6)
    drawing += elm.Resistor().right(2.2).label(ohms(FILTER_OHM))
    drawing += (middle := elm.Dot())
    drawing += elm.Resistor().right(2.2).label(ohms(FILTER_OHM))
    drawing += (end := elm.Dot())
    to_ground(drawing, end.center, (elm.Capacitor, "1 n"))
    drawing += elm.Line().at(end.center).right(2.2)
    opamp = amplifier(drawing, name, ohms(SECTIONS[name]), "10 k", "1 u")
    drawing += elm.Line().at(middle.center).up(1.5)
    drawing += elm.Capacitor().right().tox(opamp.out).label("1 n")
    drawing += elm.Line().down().toy(opamp.out)
    drawing.move_from(opamp.out)


def main():
    """Draws the channel in two rows: the filter, then what stands before the pin."""
    with schemdraw.Drawing(file=str(Path(__file__).with_suffix(".svg")), show=False) as d:
        d.config(unit=2.4, fontsize=11, lw=1.3, color="#1F2933", bgcolor="white", inches_per_unit=0.33, margin=0.6)

        d += elm.Dot(open=True).label("mixer", "top")
        bias(d)
        d += elm.Line().right(1.6)
        amplifier(d, "U1A", "10 k", "324", "10 u")
        for name in SECTIONS:
            low_pass(d, name)
        d += elm.Line().right(0.6)
        d += elm.Dot(open=True).label("IF", "right")

        d += elm.Dot(open=True).at((0, -9.5)).label("IF", "left")
        d += elm.Switch().right(2.4).label("jumper", ofst=(0, 0.3))
        bias(d)
        d += elm.Line().right(2.0)
        d += (tone := elm.Dot())
        d += elm.Resistor().at(tone.center).down(1.9).label("22 k, 0.1 %", loc="bottom")
        d += elm.Line().right(1.0)
        d += elm.Dot(open=True).label("test point of all four,\nby 10 u and a jumper\nto PA4, CN8-3, or AGND", "right")
        d += elm.Line().at(tone.center).right(8.2)
        follower = amplifier(d, "U1D")
        d += elm.Resistor().at(follower.out).right(2.2).label("100")
        d += (pin := elm.Dot())
        to_ground(d, pin.center, (elm.Capacitor, "1 n"))
        d += elm.Line().at(pin.center).right(1.6)
        d += elm.Dot(open=True).label(PINS, "right")
        d += elm.Vdd().at((26.8, -8.9)).label(f"U1: {SUPPLY}")
        to_ground(d, (26.8, -8.9), (elm.Capacitor, "100 n"))


    print(f"gain {20 * log10((1 + 10_000 / 324) * response(0)):.1f} dB, corner {1e-3 / (2 * pi * FILTER_OHM * FILTER_F):.1f} kHz")
    for frequency_khz in (16.4, 23.6, 78.8, 86.0):
        print(f"{frequency_khz:5.1f} kHz: {20 * log10(response(0) / response(1e3 * frequency_khz)):5.1f} dB")


if __name__ == "__main__":
    main()
