"""Hydraulic damper of the benchmark: orifices, air and voids in the oil, a rod on one side, and warm or cold oil.

SI units. A chamber takes up *travel* of the piston that its orifice does not let pass. The lengthening side carries the
rod; ``law.charge`` is the absolute pressure of the other side, 0 for a reservoir at atmospheric pressure with check
valves to both sides.
"""

import math
from typing import TYPE_CHECKING

from benchmarks.hidden_effects.compiled import cached_njit

if TYPE_CHECKING:
    from benchmarks.hidden_effects.law import Law

ATMOSPHERE = 101325.0  # Pa
OIL_COLUMN = 0.04  # m: height of the oil before the damper's piston (assumed)
OIL_MODULUS = 1.5e9  # Pa: bulk modulus of oil without air


@cached_njit
def orifice_tension(v: float, law: "Law") -> float:
    """Return the tension of the damper's orifices: the pressure that drives the oil out, on the area of its side."""
    area = chamber_area(v, law)
    flow, transition = area * v, law.bore_area * math.sqrt(max(0.0, law.transition**2 + law.transition_rise))
    damping = law.damping_out if v > 0.0 else law.damping_in
    return area * damping * flow * math.sqrt(flow * flow + transition * transition) / law.bore_area**3


@cached_njit
def chamber_area(side: float, law: "Law") -> float:
    """Return the area that meters the oil: that of the side which is compressed, and with a charge that of the rod."""
    return law.bore_area - law.rod_area if side > 0.0 or law.charge > 0.0 else law.bore_area


@cached_njit
def orifice_flow(pressure: float, damping: float, law: "Law") -> float:
    """Return the flow [m3/s] that a pressure >= 0 drives through an orifice: the inverse of :func:`orifice_tension`."""
    if damping == 0.0 or pressure == 0.0:
        return 0.0
    square, load = max(0.0, law.transition**2 + law.transition_rise), pressure * law.bore_area / damping
    return law.bore_area * load * math.sqrt(2.0 / (square + math.hypot(square, 2.0 * load)))


@cached_njit
def compressed_pressure(travel: float, area: float, law: "Law") -> float:
    """Return by how much [Pa] a travel >= 0 of the piston raises the pressure of a chamber with air.

    Boyle's air and Hooke's oil share the travel, which is a quadratic equation for the pressure.
    """
    start = law.charge if law.charge > 0.0 else ATMOSPHERE
    oil, air = OIL_COLUMN / OIL_MODULUS, law.damper_air * ATMOSPHERE / start / area
    rest = air + oil * start - travel
    root = math.sqrt(rest * rest + 4.0 * oil * start * travel)
    return 2.0 * start * travel / (rest + root) if rest > 0.0 else (root - rest) / (2.0 * oil)


@cached_njit
def expanded_travel(suction: float, area: float, law: "Law") -> float:
    """Return the travel that the air and oil of a chamber yield at a pressure ``suction`` below that of the charge."""
    if law.damper_air == 0.0:
        return 0.0
    air = law.damper_air * ATMOSPHERE / law.charge / area
    left = law.charge - suction
    return air * suction / left + OIL_COLUMN / OIL_MODULUS * suction if left > 0.0 else math.inf


@cached_njit
def solve_chamber(v: float, base: float, gh: float, law: "Law") -> tuple[float, float]:
    """Return travel and tension of the chambers after a stage.

    The travel is what the piston displaced and the orifice did not let pass: compressed air and oil, expanded air, or a
    void.
    """
    displaced = base + gh * v
    side, most, area = math.copysign(1.0, displaced), abs(displaced), chamber_area(displaced, law)
    damping = law.damping_out if displaced > 0.0 else law.damping_in
    if displaced < 0.0 and law.charge > 0.0:
        low, high = 0.0, law.charge
        for _ in range(80):
            middle = 0.5 * (low + high)
            if expanded_travel(middle, area, law) + gh * orifice_flow(middle, damping, law) / area > most:
                high = middle
            else:
                low = middle
        return -max(0.0, most - gh * orifice_flow(low, damping, law) / area), -area * low
    if law.damper_air == 0.0:
        return 0.0, orifice_tension(displaced / gh, law)
    low, high = 0.0, most
    for _ in range(80):
        middle = 0.5 * (low + high)
        out = gh * orifice_flow(compressed_pressure(middle, area, law), damping, law) / area
        if middle + out > most:
            high = middle
        else:
            low = middle
    return side * low, side * area * compressed_pressure(low, area, law)


def compare_oil(celsius: float) -> tuple[float, float]:
    """Return kinematic viscosity and density of oil (ISO VG 32) over those at 20 degrees Celsius.

    The chart of ASTM D341 is straight in log T and log log(nu + 0.7): here through 32 mm2/s at 40 degrees Celsius and
    5.4 mm2/s at 100. Oil expands by 0.065 % per kelvin (assumed).
    """

    def viscosity(at: float) -> float:
        ends = [math.log10(math.log10(nu + 0.7)) for nu in (32.0, 5.4)]
        place = math.log((at + 273.15) / 313.15) / math.log(373.15 / 313.15)
        return 10.0 ** (10.0 ** (ends[0] + place * (ends[1] - ends[0]))) - 0.7

    return viscosity(celsius) / viscosity(20.0), 1.0 - 6.5e-4 * (celsius - 20.0)
