"""Plausible values of the numbers in a device file, with the reason of each range."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple

from klute_sim.plausibility.finding import Finding
from klute_sim.plausibility.units import round_digits
from klute_sim.units import split_unit

MIN_SLENDERNESS = 2.5
"""Smallest ratio of a muscle's length to its diameter (assumed; shorter muscles are only ends)."""


class NumberRange(NamedTuple):
    """Plausible magnitudes of one number, in the unit of its key."""

    low: float
    """Smallest plausible magnitude other than 0."""
    high: float
    """Largest plausible magnitude."""
    reason: str
    """What the range follows from."""


RUBBER = "soft silicone has 5 kPa, hard rubber and woven hoses a few thousand (assumed)"
SPRING = "a soft spring to a steel cable (assumed)"
CONDUCTANCE = "a pinhole to a half-inch valve (assumed)"
MUSCLE = "a hair to an industrial hose (assumed)"
RANGES: Mapping[str, NumberRange] = MappingProxyType(
    {
        "muscle.resting_length_mm": NumberRange(20.0, 2000.0, MUSCLE),
        "muscle.turns_per_m": NumberRange(0.2, 3000.0, MUSCLE),
        "muscle.bladder_radius_mm": NumberRange(0.03, 100.0, MUSCLE),
        "muscle.bladder_thickness_mm": NumberRange(0.005, 20.0, MUSCLE),
        "muscle.c10_kpa": NumberRange(5.0, 5000.0, RUBBER),
        "muscle.c01_kpa": NumberRange(1.5, 5000.0, RUBBER),
        "muscle.friction_slope_n_per_bar": NumberRange(0.01, 400.0, "the dissertation's muscles have 18 to 57"),
        "muscle.friction_offset_n": NumberRange(0.01, 1500.0, "the dissertation's muscles have 3 to 110"),
        "cylinder.extended_length_mm": NumberRange(10.0, 3000.0, "a syringe to an excavator (assumed)"),
        "cylinder.stroke_mm": NumberRange(2.0, 1500.0, "a syringe to an excavator (assumed)"),
        "damper.bore_mm": NumberRange(3.0, 200.0, "a needle to a press (assumed)"),
        "damper.orifice_concentric_mm": NumberRange(0.1, 50.0, "a watch drill to a hose (assumed)"),
        "damper.orifice_eccentric_mm": NumberRange(0.1, 50.0, "a watch drill to a hose (assumed)"),
        "damper.oil_density_kg_m3": NumberRange(500.0, 2000.0, "oils have 800 to 1000, heavy silicones up to 1900"),
        "tendon.slack_length_mm": NumberRange(1.0, 2000.0, "a clamp to a leg (assumed)"),
        "tendon.stiffness_1_n_per_mm": NumberRange(0.5, 8000.0, SPRING),
        "tendon.stiffness_2_n_per_mm": NumberRange(0.001, 8000.0, "a fit finds any small second spring; a steel cable"),
        "tendon.engagement_mm": NumberRange(0.03, 100.0, "a tenth of a millimetre to a hand (assumed)"),
        "supply.pressure_bar": NumberRange(0.75, 16.0, "a muscle needs a part of a bar; hoses burst (assumed)"),
        "supply.rate_bar_per_s": NumberRange(0.05, 3000.0, "a hand pump to an ideal valve (assumed)"),
        "supply.gas_temperature_c": NumberRange(0.0, 60.0, "rooms, tanks in winter and behind a compressor (assumed)"),
        "supply.dead_volume_cm3": NumberRange(0.05, 2000.0, "a fitting to two bottles (assumed)"),
        "valve.fill_dm3_per_s_bar": NumberRange(0.005, 60.0, CONDUCTANCE),
        "valve.exhaust_dm3_per_s_bar": NumberRange(0.005, 60.0, CONDUCTANCE),
        "valve.fill_critical_ratio": NumberRange(0.01, 0.8, "ISO 6358 finds 0.1 to 0.6"),
        "valve.exhaust_critical_ratio": NumberRange(0.01, 0.8, "ISO 6358 finds 0.1 to 0.6"),
        "valve.gain_per_bar": NumberRange(0.05, 500.0, "fully open at 20 bar to at 2 mbar of error (assumed)"),
        "valve.pwm_period_s": NumberRange(0.001, 0.5, "fast to slow switching valves (assumed)"),
        "valve.min_pulse_s": NumberRange(1e-4, 0.1, "fast to slow switching valves (assumed)"),
        "line.length_m": NumberRange(0.01, 40.0, "a fitting to a laboratory (assumed)"),
        "line.inner_diameter_mm": NumberRange(0.8, 25.0, "tubes of 0.8 to 25 mm (assumed)"),
        "chamber.thermal_time_constant_s": NumberRange(0.005, 100.0, "thin to thick gas layers (assumed)"),
        "tank.volume_l": NumberRange(0.02, 500.0, "a cartridge to a workshop (assumed)"),
        "tank.pressure_bar": NumberRange(2.5, 400.0, "a pump to a diver's bottle"),
        "leak.conductance_dm3_per_s_bar": NumberRange(1e-6, 1.0, "a pore to an open tube (assumed)"),
    }
)
"""``section.key`` -> plausible magnitudes. Numbers of effects have limits of their own in the catalogue."""

FACTORS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "_n_per_mm": {"N/m": 1e-3, "N/cm": 0.1, "kN/mm": 1e3, "lbf/in": 0.1751268},
        "_dm3_per_s_bar": {"l/(min*bar)": 1.0 / 60.0, "m3/(s*Pa)": 1e8, "cm3/(s*bar)": 1e-3},
        "_bar_per_s": {"kPa/s": 0.01, "Pa/s": 1e-5, "MPa/s": 10.0, "psi/s": 0.0689476},
        "_n_per_bar": {"N/kPa": 100.0, "N/Pa": 1e5, "N/MPa": 0.1},
        "_kg_m3": {"g/cm3": 1e3, "lb/ft3": 16.01846},
        "_per_bar": {"1/Pa": 1e5, "1/kPa": 100.0, "1/MPa": 0.1},
        "_per_m": {"turns per mm": 1e3, "turns per cm": 100.0, "turns per inch": 39.37008},
        "_kpa": {"MPa": 1e3, "Pa": 1e-3, "bar": 100.0, "psi": 6.894757, "GPa": 1e6},
        "_bar": {"MPa": 10.0, "kPa": 0.01, "psi": 0.06894757, "Pa": 1e-5},
        "_cm3": {"mm3": 1e-3, "l": 1e3, "m3": 1e6},
        "_mm": {"m": 1e3, "cm": 10.0, "in": 25.4, "um": 1e-3},
        "_l": {"cm3": 1e-3, "m3": 1e3},
        "_n": {"kN": 1e3, "lbf": 4.448222, "mN": 1e-3},
        "_m": {"mm": 1e-3, "cm": 0.01, "in": 0.0254},
        "_s": {"ms": 1e-3, "min": 60.0, "us": 1e-6},
        "_pct": {"a fraction": 100.0},
    }
)
"""End of a key -> other unit -> factor that converts a value from it into the unit of the key."""
OTHER_TEMPERATURES: Mapping[str, Callable[[float], float]] = MappingProxyType(
    {"K": lambda value: value - 273.15, "degrees Fahrenheit": lambda value: (value - 32.0) / 1.8}
)
"""Unit of temperature -> conversion to degrees Celsius."""
COLD_ROOM = -30.0
"""Lowest plausible temperature [degrees Celsius] (assumed: outdoors in winter)."""


def check_device_numbers(values: Mapping[str, float], place: str) -> list[Finding]:
    """Return what is implausible in ``values`` (``section.key`` -> value in the unit of the key) of a device file.

    A finding is named like its key. Zero means that something is absent, and is always plausible where it is allowed.
    """
    findings = []
    for key, limits in RANGES.items():
        value = values.get(key, 0.0)
        if value == 0.0 or limits.low <= abs(value) <= limits.high:
            continue
        if _find_lowest(key, limits) <= value <= limits.high:
            continue
        findings.append(_describe(key, value, limits, place))
    return findings or _check_relations(values, place)


def limit_to_plausible(key: str, declared: float, lower: float, upper: float) -> tuple[float, float]:
    """Return the part of the range from ``lower`` to ``upper`` in which number ``key`` is plausible.

    All are in the unit of the key. A ``declared`` value that is not plausible itself limits nothing.
    """
    limits = RANGES.get(key)
    if limits is None or not _find_lowest(key, limits) <= declared <= limits.high:
        return lower, upper
    return max(lower, _find_lowest(key, limits)), min(upper, limits.high)


def _find_lowest(key: str, limits: NumberRange) -> float:
    return COLD_ROOM if key == "supply.gas_temperature_c" else limits.low


def describe_possible_units(values: Mapping[str, float], message: str) -> str:
    """Return the units that the numbers named in ``message`` seem to have, or ''.

    ``message`` is that of a check of the file's format, which knows the allowed range of a number only.
    """
    guesses = []
    for key, limits in RANGES.items():
        value = values.get(key, 0.0)
        units = _list_possible_units(key, value, limits) if key in message else []
        if units and not limits.low <= abs(value) <= limits.high:
            guesses.append(f"is {key} = {value:g} in {' or '.join(units)}?")
    return " ".join(guesses)


def _describe(key: str, value: float, limits: NumberRange, place: str) -> Finding:
    unit = _get_unit(key)
    guesses = _list_possible_units(key, value, limits)
    fix = f"is it in {' or '.join(guesses)}? Convert it into {unit}" if guesses else "check the number"
    low = _find_lowest(key, limits)
    statement = f"{key} = {value:g}, but {low:g} to {limits.high:g} {unit} is plausible ({limits.reason}): {fix}"
    return Finding(key, place, statement.replace("  ", " "))


def _get_unit(key: str) -> str:
    """Return the unit at the end of ``key``; '' where it has none."""
    return "degrees Celsius" if key == "supply.gas_temperature_c" else split_unit(key)[1]


def _list_possible_units(key: str, value: float, limits: NumberRange) -> list[str]:
    """Return the units that make ``value`` plausible, each with the converted value."""
    if key == "supply.gas_temperature_c":
        converted = {unit: convert(value) for unit, convert in OTHER_TEMPERATURES.items()}
    else:
        suffix = next((suffix for suffix in FACTORS if key.endswith(suffix)), "")
        converted = {unit: value * factor for unit, factor in FACTORS.get(suffix, {}).items()}
    return [
        f"{unit} ({round_digits(number):g} {_get_unit(key)})"
        for unit, number in converted.items()
        if limits.low <= abs(number) <= limits.high
    ]


def _check_relations(values: Mapping[str, float], place: str) -> list[Finding]:
    """Return what is implausible in numbers that are plausible alone, but not together."""
    findings = []
    length, radius = values.get("muscle.resting_length_mm"), values.get("muscle.bladder_radius_mm")
    if length is not None and radius is not None and length < MIN_SLENDERNESS * 2.0 * radius:
        statement = (
            f"muscle.resting_length_mm = {length:g}, but the muscle is {2.0 * radius:g} mm thick, and muscles are at "
            f"least {MIN_SLENDERNESS:g} times as long as thick: is it in cm or in? Convert it into mm"
        )
        findings.append(Finding("muscle.resting_length_mm", place, statement))
    tank, supply = values.get("tank.pressure_bar"), values.get("supply.pressure_bar")
    if tank is not None and supply is not None and tank < supply:
        statement = (
            f"tank.pressure_bar = {tank:g}, but the regulator behind the tank delivers {supply:g} bar: is it in MPa? "
            "Convert it into bar"
        )
        findings.append(Finding("tank.pressure_bar", place, statement))
    return findings
