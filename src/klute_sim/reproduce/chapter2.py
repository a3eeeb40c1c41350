"""Chapter 2: biological muscle. Constants are recovered from the curves that our laws draw."""

from collections.abc import Callable
from typing import Any

import numpy as np

from klute_sim.laws import hill
from klute_sim.laws import hill_tables as tables
from klute_sim.laws.hill import Contractile, Hill, Parallel, Series, Span
from klute_sim.reproduce.implied import SLIGHT
from klute_sim.reproduce.item import Found
from klute_sim.reproduce.picture import Array, Chapter, Line, Picture, Surface

MODEL_RANGE = Span(1.0, 1.6)
"""Of Fig. 2.2 [l0]; where a row of Table 2.1 prints none."""
SERIES_RANGE = (0.5, 1.0)
"""Of Fig. 2.3 [F0]."""
LENGTHS = (0.5, 1.5)
"""Of Fig. 2.4 [l0]."""
GREAT_SPEED = 1e6
"""Lengthening velocity [Vmax] at which force has saturated."""
NAMES = {
    "rat": "rat",
    "frog": "frog",
    "cat": "cat",
    "human": "human",
    "woittiez_1984": "Woittiez",
    "bobbert_1986": "Bobbert 1986",
    "bobbert_van_ingen_schenau_1990": "Bobbert & v. I. Schenau",
    "hof_van_den_berg_1981": "Hof & v. d. Berg",
}


def _curve(function: Callable[[Any, float], float], law: Any, x: Array) -> Array:
    return np.array([function(law, float(each)) for each in x])


def _at_speed(law: Hill, velocity: float) -> float:
    """Force over isometric force at ``velocity`` [Vmax], shortening positive."""
    return hill.force_velocity(law, 1.0, velocity)


def parallel_constants(law: Parallel, span: Span) -> tuple[float, float]:
    """k1 and k2 of (2.1), from the logarithms of a curve over ``span`` [l0]."""
    x = np.linspace(span.low, span.high, 50)
    k2, logarithm = np.polyfit(np.log(x), np.log(_curve(hill.parallel_force, law, x)), 1)
    return float(np.exp(logarithm)), float(k2)


def series_constants(law: Series) -> tuple[float, float]:
    """k3 and k4 of (2.2), from a curve over the range of Fig. 2.3."""
    force = np.linspace(*SERIES_RANGE, 50)
    k3, k4 = np.polyfit(np.log(force), _curve(hill.series_elongation, law, force), 1)
    return float(k3), float(k4)


def contractile_constants(law: Contractile, span: Span) -> tuple[float, float, float]:
    """k5, k6 and k7 of (2.3), from a parabola through a curve over ``span`` [l0]."""
    x = np.linspace(span.low, span.high, 50)
    k5, k6, k7 = np.polyfit(x, _curve(hill.isometric_force, law, x), 2)
    return float(k5), float(k6), float(k7)


def hill_constants(law: Hill) -> tuple[float, float]:
    """a/F0 and b/Vmax of (2.4), which is linear in both: ``F V = b (1 - F) - a V`` at l0."""
    velocity = np.linspace(0.0, 1.0, 50)
    force = _curve(_at_speed, law, velocity)
    a, b = np.linalg.lstsq(np.stack([-velocity, 1.0 - force], axis=1), force * velocity)[0]
    return float(a), float(b)


def compute() -> Chapter:
    """Everything of chapter 2."""
    found: dict[str, Found] = {}
    for name, scale in tables.SCALES.items():
        found[f"scales.{name}.l0"] = Found(1e3 * scale.resting_length)
        found[f"scales.{name}.f0"] = Found(scale.isometric_force)
    _parallel(found)
    _series(found)
    _contractile(found)
    _hill(found)
    _eccentric(found)
    _envelope(found)
    return Chapter(found, tuple(_pictures()))


def _parallel(found: dict[str, Found]) -> None:
    at = {}
    for name, row in tables.PARALLEL.items():
        k1, k2 = parallel_constants(row.law, row.valid or MODEL_RANGE)
        found[f"table-2.1.{name}.k1"], found[f"table-2.1.{name}.k2"] = Found(k1), Found(k2)
        found[f"table-2.1.{name}.r2"] = Found()
        if row.valid is not None:
            found[f"table-2.1.{name}.from"], found[f"table-2.1.{name}.to"] = map(Found, row.valid)
        at[name] = hill.parallel_force(row.law, 1.2)
    found["table-2.1.rat"] = Found(note="There are no constants to compute it from.")
    told = ", ".join(f"{NAMES[name]} {100.0 * force:.1f} %" for name, force in at.items())
    found["table-2.1.insignificant"] = Found(
        max(at.values()), max(at.values()) <= SLIGHT, f"At 1.2 l0 (of F0): {told}. Taken for insignificant: 5 %."
    )


def _series(found: dict[str, Found]) -> None:
    for name, row in tables.SERIES.items():
        found[f"table-2.2.{name}.k3"], found[f"table-2.2.{name}.k4"] = map(Found, series_constants(row.law))
        found[f"table-2.2.{name}.r2"] = Found()
    most = max(hill.series_elongation(row.law, 1.0) for row in tables.SERIES.values())
    found["table-2.2.most"] = Found(100.0 * most)
    found["table-2.2.with-tendon"] = Found(100.0 * most / 11.0, note="Muscle and a tendon ten times as long together.")


def _contractile(found: dict[str, Found]) -> None:
    widths, slopes = {}, {}
    for name, row in tables.CONTRACTILE.items():
        law, span = row.law, row.valid or Span(*LENGTHS)
        constants = contractile_constants(law, span)
        for key, value in zip(("k5", "k6", "k7"), constants, strict=True):
            found[f"table-2.3.{name}.{key}"] = Found(value)
        found[f"table-2.3.{name}.at-rest"] = Found(hill.isometric_force(law, 1.0))
        if row.valid is not None:
            found[f"table-2.3.{name}.from"], found[f"table-2.3.{name}.to"] = map(Found, row.valid)
            root = np.sqrt(law.k6**2 - 4.0 * law.k5 * law.k7) / -law.k5
            widths[name] = float(root)
            slopes[name] = max(abs(2.0 * law.k5 * x + law.k6) for x in row.valid)
    told = ", ".join(f"{NAMES[name]} {widths[name]:.2f} l0 and {slopes[name]:.1f} F0/l0" for name in widths)
    human = min(widths, key=widths.__getitem__) == "human" == max(slopes, key=slopes.__getitem__)
    found["table-2.3.human"] = Found(widths["human"], human, f"Width between the roots, greatest slope: {told}.")
    found["table-2.3.digitised"] = Found(note="The curves were digitised in the source and have no equation.")


def _hill(found: dict[str, Found]) -> None:
    for name, row in tables.HILL.items():
        found[f"table-2.4.{name}.a"], found[f"table-2.4.{name}.b"] = map(Found, hill_constants(row.law))
        if row.isometric_force is not None and row.peak_velocity is not None:
            found[f"table-2.4.{name}.f0"] = Found(row.isometric_force)
            found[f"table-2.4.{name}.vmax"] = Found(1e3 * row.peak_velocity)
        found[f"table-2.4.{name}.at-vmax"] = Found(hill.concentric_force(row.law, 1.0, 1.0))
    velocity = np.linspace(0.05, 0.95, 19)
    curves = {name: _curve(_at_speed, tables.HILL[name].law, velocity) for name in ("human", "rat", "frog", "cat")}
    inverted = [
        f"{NAMES[below]} above {NAMES[above]} at {int((curves[above] <= curves[below]).sum())} of 19 speeds"
        for above, below in (("human", "rat"), ("rat", "frog"), ("frog", "cat"))
        if (curves[above] <= curves[below]).any()
    ]
    found["table-2.4.order"] = Found(None, not inverted, f"{'; '.join(inverted)}." if inverted else "")


def _eccentric(found: dict[str, Found]) -> None:
    slow = np.linspace(-0.5, 0.0, 51)
    for name, saturation in tables.SATURATIONS.items():
        law = tables.GENERIC_HILL._replace(saturation=saturation)
        found[f"fig-2.6.{name}"] = Found(hill.force_velocity(law, 1.0, -GREAT_SPEED))
    force = _curve(_at_speed, tables.GENERIC_HILL, slow)
    found["fig-2.6.rises"] = Found(float(force[0]), bool((np.diff(force) < 0.0).all()), "At half of Vmax.")
    found["fig-2.6.cat"] = Found(note="The measured points of the cat are on a figure without a table.")
    found["fig-2.7.protocol"] = Found(note="An experiment on animals: nothing of it can be computed.")
    found["fig-2.7.outside"] = Found(note="The curves are not printed as numbers.")


def _envelope(found: dict[str, Found]) -> None:
    for key in ("k5", "k6", "k7", "a", "b"):
        span: Span = getattr(hill.ENVELOPE, key)
        found[f"eq-2.5.{key}.low"], found[f"eq-2.5.{key}.high"] = Found(span.low), Found(span.high)
    found["eq-2.5.saturation"] = Found(hill.ENVELOPE.saturation.low)
    generic = contractile_constants(tables.GENERIC_CONTRACTILE, Span(*LENGTHS))
    for key, value in zip(("k5", "k6", "k7"), generic, strict=True):
        found[f"fig-2.8.{key}"] = Found(value)
    found["fig-2.8.a"], found["fig-2.8.b"] = map(Found, hill_constants(tables.GENERIC_HILL))
    inside = hill.in_envelope(hill.ENVELOPE, tables.GENERIC_CONTRACTILE, tables.GENERIC_HILL)
    found["fig-2.8.inside"] = Found(None, inside)
    outside = []
    for name, row in tables.CONTRACTILE.items():
        for key in ("k5", "k6", "k7"):
            value = getattr(row.law, key)
            if not hill.in_span(getattr(hill.ENVELOPE, key), value):
                outside.append(f"{NAMES[name]}: {key} = {value:g}")
    found["eq-2.5.around"] = Found(None, not outside, f"Outside: {'; '.join(outside)}." if outside else "")


def _pictures() -> list[Picture]:
    fine = np.linspace(1.0, 1.6, 121)
    force = np.linspace(*SERIES_RANGE, 101)
    length = np.linspace(*LENGTHS, 201)
    velocity, lengthening = np.linspace(0.0, 1.0, 101), np.linspace(-0.5, 0.0, 101)
    generic = np.array(
        [
            [hill.contractile_force(tables.GENERIC_CONTRACTILE, tables.GENERIC_HILL, x, v) for x in length[::5]]
            for v in np.linspace(-0.5, 1.0, 31)
        ]
    )
    return [
        Picture(
            "2.2",
            "Parallel element (2.1)",
            "l/l0",
            "Fpe/F0",
            tuple(
                Line(NAMES[n], fine, _curve(hill.parallel_force, row.law, fine)) for n, row in tables.PARALLEL.items()
            ),
            (1.0, 1.6),
            (0.0, 0.5),
        ),
        Picture(
            "2.3",
            "Series element (2.2)",
            "F/F0",
            "elongation/l0",
            tuple(
                Line(NAMES[n], force, _curve(hill.series_elongation, row.law, force))
                for n, row in tables.SERIES.items()
            ),
            (0.5, 1.0),
            (0.0, 0.10),
        ),
        Picture(
            "2.4",
            "Isometric force against length (2.3)",
            "l/l0",
            "F/F0",
            tuple(
                Line(NAMES[n], length, _curve(hill.isometric_force, row.law, length))
                for n, row in tables.CONTRACTILE.items()
                if n != "bobbert_1986"  # printed as Woittiez's
            ),
            LENGTHS,
            (0.0, 1.2),
        ),
        Picture(
            "2.5",
            "Force against shortening velocity (2.4)",
            "V/Vmax",
            "F/F(l)",
            tuple(Line(NAMES[n], velocity, _curve(_at_speed, row.law, velocity)) for n, row in tables.HILL.items()),
            (0.0, 1.0),
            (0.0, 1.0),
        ),
        Picture(
            "2.6",
            "Force against lengthening velocity",
            "V/Vmax",
            "F/F(l)",
            tuple(
                Line(
                    f"saturating at {s:g} F(l)",
                    lengthening,
                    _curve(_at_speed, tables.GENERIC_HILL._replace(saturation=s), lengthening),
                )
                for s in sorted(tables.SATURATIONS.values())
            ),
            (-0.5, 0.0),
            (0.0, 1.8),
            assumed="the shape between rest and saturation: an inverted hyperbola that joins (2.4) without a kink",
        ),
        Picture(
            "2.8",
            "The generic muscle of the design envelope (2.5)",
            "l/l0",
            "V/Vmax",
            surface=Surface(length[::5], np.linspace(-0.5, 1.0, 31), generic),
            z_label="F/F0",
            assumed="the shape of the lengthening side",
        ),
    ]
