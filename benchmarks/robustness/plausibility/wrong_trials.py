"""Bench datasets with one mistake: wrong units, signs, zeros, columns, codes and time axes."""

from collections.abc import Callable, Iterator

import numpy as np
from benchmarks.robustness.plausibility.recordings import SI_UNITS, Base, Column, Table, Variant

from klute_sim.datasets.unit_conversion import get_si_factor
from klute_sim.types import Array

Change = Callable[[Table], Table]

PAIR = Base()
VALVE = Base("klute-1-1-4-pair-valve", ("ramps", "steps"), 0.004)
BARE = Base("klute-3-4", ("sines", "rest"), 0.002)
SMALL = Base("klute-1-2", ("rest", "isometric"))
NO_MUSCLE_LENGTH = Base(
    "klute-1-1-4-pair",
    ("mixed", "hold"),
    0.01,
    (("length", "m"), ("pressure_command", "kPa"), ("force", "N"), ("pressure", "kPa")),
)
FORCE_ONLY = Base(
    "klute-3-4-pair", ("steps", "slack"), 0.005, (("length", "mm"), ("pressure_command", "kPa"), ("force", "N"))
)
BASES = {
    "pair": PAIR,
    "valve": VALVE,
    "bare": BARE,
    "small": SMALL,
    "kPa": NO_MUSCLE_LENGTH,
    "force only": FORCE_ONLY,
}


def write_as(channel: str, unit: str, heading: str) -> Change:
    """Return a change: numbers in ``unit`` under ``heading``."""

    def change(table: Table) -> Table:
        si = SI_UNITS[channel]
        ratio = (get_si_factor(table[channel].unit, si) or 1.0) / (get_si_factor(unit, si) or 1.0)
        return {**table, channel: Column(heading, table[channel].value * ratio)}

    return change


def map_values(channel: str, function: Callable[[Array], Array]) -> Change:
    """Return a change of the numbers of ``channel``."""

    def change(table: Table) -> Table:
        return {**table, channel: table[channel]._replace(value=function(table[channel].value))}

    return change


def exchange(*channels: str) -> Change:
    """Return a change: each channel has the numbers of the next one, the headings stay."""

    def change(table: Table) -> Table:
        sources = (*channels[1:], channels[0])
        return table | {a: table[a]._replace(value=table[b].value) for a, b in zip(channels, sources, strict=True)}

    return change


def combine(*changes: Change) -> Change:
    """Return the changes one after the other."""

    def change(table: Table) -> Table:
        for each in changes:
            table = each(table)
        return table

    return change


def put_code(code: float, length: int, period: int) -> Callable[[Array], Array]:
    """Return a function that puts ``code`` into ``length`` samples of every ``period``."""
    return lambda values: np.where(np.arange(len(values)) % period < length, code, values)


def list_variants() -> Iterator[Variant]:
    """Yield all wrong variants."""
    yield from _list_units()
    yield from _list_signs_and_zeros()
    yield from _list_columns()
    yield from _list_codes()
    yield from _list_time_axes()


UNIT_MISTAKES = (
    *(("force", "kN", "N"), ("force", "N", "kN"), ("force", "lbf", "N"), ("force", "kgf", "N"), ("force", "N", "lbf")),
    *(("force", "N", "kgf"), ("force", "N", "mN"), ("force", "mN", "N")),
    *(("length", "mm", "m"), ("length", "m", "mm"), ("length", "cm", "mm"), ("length", "in", "mm")),
    *(("length", "mm", "cm"), ("length", "mm", "in")),
)
PRESSURE_MISTAKES = (
    *(("kPa", "bar"), ("bar", "kPa"), ("psi", "bar"), ("psi", "kPa"), ("MPa", "bar"), ("mbar", "bar"), ("Pa", "kPa")),
    *(("bar", "psi"), ("kPa", "psi"), ("bar", "MPa"), ("Pa", "bar")),
)


def _list_units() -> Iterator[Variant]:
    bases = list(BASES.items())
    for index, (channel, unit, heading) in enumerate(UNIT_MISTAKES):
        for label, base in (bases[index % 6], bases[(index + 3) % 6]):
            change = write_as(channel, unit, heading)
            yield Variant(f"{channel}: {unit} under [{heading}], {label}", f"{channel}-unit", change, base)
    for index, (unit, heading) in enumerate(PRESSURE_MISTAKES):
        label, base = bases[index % 5]
        change = write_as("pressure", unit, heading)
        yield Variant(f"pressure: {unit} under [{heading}], {label}", "pressure-unit", change, base)
        label, base = bases[(index + 1) % 6]
        change = write_as("pressure_command", unit, heading)
        yield Variant(f"command: {unit} under [{heading}], {label}", "pressure_command-unit", change, base)
        label, base = bases[(index + 2) % 5]
        change = combine(change, write_as("pressure", unit, heading))
        yield Variant(f"both pressures: {unit} under [{heading}], {label}", "pressure_command-unit", change, base)
    for unit, heading, label in (
        ("mm", "m", "pair"),
        ("m", "mm", "valve"),
        ("cm", "mm", "small"),
        ("in", "mm", "bare"),
    ):
        change = write_as("muscle_length", unit, heading)
        name = f"muscle_length: {unit} under [{heading}], {label}"
        yield Variant(name, "muscle_length-unit", change, BASES[label])
    for channel, unit, heading in (("force", "kN", "N"), ("pressure", "psi", "bar"), ("length", "in", "mm")):
        change = write_as(channel, unit, heading)
        name = f"{channel} of one trial: {unit} under [{heading}]"
        yield Variant(name, f"{channel}-unit", change, PAIR, first_trial_only=True)
    yield Variant("force times 1e30", "force-unit", map_values("force", lambda v: 1e30 * v), PAIR)


def _list_signs_and_zeros() -> Iterator[Variant]:
    for label, base in BASES.items():
        yield Variant(f"negative tension, {label}", "force-sign", map_values("force", np.negative), base)
    for label in ("pair", "valve", "small"):
        base = BASES[label]
        yield Variant(f"negative pressure, {label}", "pressure-sign", map_values("pressure", np.negative), base)
        yield Variant(f"negative length, {label}", "length-sign", map_values("length", np.negative), base)
        shorten = map_values("muscle_length", lambda v: v[0] - v)
        yield Variant(f"shortening as muscle length, {label}", "muscle_length-sign", shorten, base)
        displace = map_values("length", lambda v: v - v[0])
        yield Variant(f"displacement as length, {label}", "length-zero", displace, base)
    yield Variant("muscle length as length, valve", "length-zero", map_values("length", lambda v: v - 100.0), VALVE)
    invert = map_values("length", lambda v: v.max() + v.min() - v)
    yield Variant("inverted length, pair", "length-sign", invert, PAIR)
    for label in ("pair", "bare", "valve"):
        absolute = map_values("pressure", lambda v: v + 1.01325)
        yield Variant(f"absolute pressure, {label}", "pressure-absolute", absolute, BASES[label])
        both = combine(absolute, map_values("pressure_command", lambda v: v + 1.01325))
        yield Variant(f"absolute pressures, {label}", "pressure_command-absolute", both, BASES[label])
    absolute = map_values("pressure_command", lambda v: v + 1.0)
    yield Variant("absolute command, pair", "pressure_command-absolute", absolute, PAIR)


def _list_columns() -> Iterator[Variant]:
    for label in ("pair", "valve", "bare"):
        base = BASES[label]
        pair = exchange("force", "length")
        yield Variant(f"force and length exchanged, {label}", "force-length-exchanged", pair, base)
        pair = exchange("pressure", "pressure_command")
        yield Variant(f"pressures exchanged, {label}", "pressure-pressure_command-exchanged", pair, base)
    pair = exchange("force", "pressure")
    for label in ("pair", "kPa", "valve"):
        yield Variant(f"force and pressure exchanged, {label}", "force-pressure-exchanged", pair, BASES[label])
    pair = exchange("force", "pressure_command")
    yield Variant("force and command exchanged", "force-pressure_command-exchanged", pair, NO_MUSCLE_LENGTH)
    pair = exchange("length", "muscle_length")
    yield Variant("lengths exchanged", "length-muscle_length-exchanged", pair, PAIR)
    pair = exchange("length", "pressure_command")
    yield Variant("length and command exchanged", "length-pressure_command-exchanged", pair, BARE)
    cycle = exchange("length", "pressure_command", "force", "pressure")
    name = "force-length-pressure-pressure_command-exchanged"
    yield Variant("columns shifted by one", name, cycle, PAIR)
    flip: Callable[[Array], Array] = lambda v: v[::-1]  # noqa: E731
    yield Variant("force backwards", "force-reversed", map_values("force", flip), PAIR)
    yield Variant("pressure backwards", "pressure-reversed", map_values("pressure", flip), VALVE)
    yield Variant("muscle length backwards", "muscle_length-reversed", map_values("muscle_length", flip), PAIR)
    yield Variant("length backwards", "length-reversed", map_values("length", flip), PAIR)
    yield Variant("command backwards", "pressure_command-reversed", map_values("pressure_command", flip), PAIR)


def _list_codes() -> Iterator[Variant]:
    for channel, code, base in (
        ("force", -9999.0, PAIR),
        ("pressure", -9999.0, VALVE),
        ("pressure", 999.0, PAIR),
        ("force", 1e30, BARE),
        ("length", -9999.0, PAIR),
        ("muscle_length", -999.0, SMALL),
        ("pressure_command", -9999.0, FORCE_ONLY),
        ("force", 99999.0, NO_MUSCLE_LENGTH),
    ):
        change = map_values(channel, put_code(code, 7, 200))
        yield Variant(f"{channel}: missing samples are {code:g}", f"{channel}-missing", change, base)


def _list_time_axes() -> Iterator[Variant]:
    for label in ("pair", "valve", "kPa", "force only"):
        yield Variant(f"time: ms under [s], {label}", "time-unit", write_as("time", "ms", "s"), BASES[label])
    for label in ("pair", "small"):
        yield Variant(f"time: min under [s], {label}", "time-unit", write_as("time", "min", "s"), BASES[label])
        yield Variant(f"time: s under [ms], {label}", "time-unit", write_as("time", "s", "ms"), BASES[label])
    yield Variant("time: s under [min], valve", "time-unit", write_as("time", "s", "min"), VALVE)
    yield Variant("time: us under [s], bare", "time-unit", write_as("time", "us", "s"), BARE)
    yield Variant("time: ms under [s], one trial", "time-unit", write_as("time", "ms", "s"), PAIR, True)
    late = map_values("time", lambda v: np.where(np.arange(len(v)) > len(v) - 3, v + 1e6, v))
    yield Variant("time: last stamps 1e6 s late", "time-gap", late, PAIR)
