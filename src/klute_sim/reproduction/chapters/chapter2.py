"""Chapter 2: biological muscle. Constants are recovered from curves of the implemented laws."""

from collections.abc import Callable
from typing import Any

import numpy as np

from klute_sim.laws import hill
from klute_sim.laws import hill_tables as tables
from klute_sim.laws.hill import ClosedInterval, ContractileElement, HillCurve, ParallelElement, SeriesElement
from klute_sim.reproduction.curves import ChapterResult, FigureData, PlotLine, PlotSurface
from klute_sim.reproduction.item import Outcome
from klute_sim.types import Array

DEFAULT_PARALLEL_SPAN = ClosedInterval(1.0, 1.6)
"""Length range of Fig. 2.2 [l0], for rows of Table 2.1 that print none."""
SERIES_FORCE_RANGE = (0.5, 1.0)
"""Force range of Fig. 2.3 [F0]."""
LENGTH_RANGE = (0.5, 1.5)
"""Length range of Fig. 2.4 [l0]."""
SATURATION_SPEED = 1e6
"""Lengthening velocity [Vmax] at which the force is saturated."""
MUSCLE_LABELS = {
    "rat": "rat",
    "frog": "frog",
    "cat": "cat",
    "human": "human",
    "woittiez_1984": "Woittiez",
    "bobbert_1986": "Bobbert 1986",
    "bobbert_van_ingen_schenau_1990": "Bobbert & v. I. Schenau",
    "hof_van_den_berg_1981": "Hof & v. d. Berg",
}
"""Labels of the muscles in the figures."""


def _evaluate_curve(function: Callable[[Any, float], float], law: Any, x: Array) -> Array:
    return np.array([function(law, float(value)) for value in x])


def _relative_force(law: HillCurve, velocity: float) -> float:
    """Return the force over the isometric force at ``velocity`` [Vmax], positive while shortening."""
    return hill.force_velocity(law, 1.0, velocity)


def fit_parallel_constants(law: ParallelElement, span: ClosedInterval) -> tuple[float, float]:
    """Return k1 and k2 of (2.1), fitted to the logarithm of a curve over ``span`` [l0]."""
    x = np.linspace(span.lower, span.upper, 50)
    k2, log_k1 = np.polyfit(np.log(x), np.log(_evaluate_curve(hill.parallel_force, law, x)), 1)
    return float(np.exp(log_k1)), float(k2)


def fit_series_constants(law: SeriesElement) -> tuple[float, float]:
    """Return k3 and k4 of (2.2), fitted to a curve over the range of Fig. 2.3."""
    force = np.linspace(*SERIES_FORCE_RANGE, 50)
    k3, k4 = np.polyfit(np.log(force), _evaluate_curve(hill.series_elongation, law, force), 1)
    return float(k3), float(k4)


def fit_contractile_constants(law: ContractileElement, span: ClosedInterval) -> tuple[float, float, float]:
    """Return k5, k6 and k7 of (2.3), fitted to a curve over ``span`` [l0]."""
    x = np.linspace(span.lower, span.upper, 50)
    k5, k6, k7 = np.polyfit(x, _evaluate_curve(hill.isometric_force, law, x), 2)
    return float(k5), float(k6), float(k7)


def fit_hill_constants(law: HillCurve) -> tuple[float, float]:
    """Return a/F0 and b/Vmax of (2.4), which is linear in both: ``F V = b (1 - F) - a V`` at l0."""
    velocity = np.linspace(0.0, 1.0, 50)
    force = _evaluate_curve(_relative_force, law, velocity)
    a, b = np.linalg.lstsq(np.stack([-velocity, 1.0 - force], axis=1), force * velocity)[0]
    return float(a), float(b)


def compute() -> ChapterResult:
    """Return the findings and figures of chapter 2."""
    findings: dict[str, Outcome] = {}
    for name, scale in tables.MUSCLE_SCALES.items():
        findings[f"scales.{name}.l0"] = Outcome(1e3 * scale.resting_length)
        findings[f"scales.{name}.f0"] = Outcome(scale.isometric_force)
    _add_parallel(findings)
    _add_series(findings)
    _add_contractile(findings)
    _add_hill(findings)
    _add_eccentric(findings)
    _add_envelope(findings)
    return ChapterResult(findings, tuple(_build_figures()))


def _add_parallel(findings: dict[str, Outcome]) -> None:
    forces = {}
    for name, row in tables.PARALLEL_ELEMENTS.items():
        k1, k2 = fit_parallel_constants(row.constants, row.valid_range or DEFAULT_PARALLEL_SPAN)
        findings[f"table-2.1.{name}.k1"], findings[f"table-2.1.{name}.k2"] = Outcome(k1), Outcome(k2)
        findings[f"table-2.1.{name}.r2"] = Outcome()
        if row.valid_range is not None:
            findings[f"table-2.1.{name}.from"], findings[f"table-2.1.{name}.to"] = map(Outcome, row.valid_range)
        forces[name] = hill.parallel_force(row.constants, 1.2)
    findings["table-2.1.rat"] = Outcome(note="There are no constants to compute it from.")
    force_text = ", ".join(f"{MUSCLE_LABELS[name]} {100.0 * force:.1f} %" for name, force in forces.items())
    findings["table-2.1.insignificant"] = Outcome(max(forces.values()), True, f"At 1.2 l0 (of F0): {force_text}.")


def _add_series(findings: dict[str, Outcome]) -> None:
    for name, law in tables.SERIES_ELEMENTS.items():
        findings[f"table-2.2.{name}.k3"], findings[f"table-2.2.{name}.k4"] = map(Outcome, fit_series_constants(law))
        findings[f"table-2.2.{name}.r2"] = Outcome()
    max_elongation = max(hill.series_elongation(law, 1.0) for law in tables.SERIES_ELEMENTS.values())
    findings["table-2.2.max-elongation"] = Outcome(100.0 * max_elongation)
    findings["table-2.2.with-tendon"] = Outcome(
        100.0 * max_elongation / 11.0, note="Muscle and a tendon ten times as long together."
    )


def _add_contractile(findings: dict[str, Outcome]) -> None:
    widths, slopes = {}, {}
    for name, row in tables.CONTRACTILE_ELEMENTS.items():
        law, span = row.constants, row.valid_range or ClosedInterval(*LENGTH_RANGE)
        constants = fit_contractile_constants(law, span)
        for key, value in zip(("k5", "k6", "k7"), constants, strict=True):
            findings[f"table-2.3.{name}.{key}"] = Outcome(value)
        findings[f"table-2.3.{name}.at-rest"] = Outcome(hill.isometric_force(law, 1.0))
        if row.valid_range is not None:
            findings[f"table-2.3.{name}.from"], findings[f"table-2.3.{name}.to"] = map(Outcome, row.valid_range)
            findings[f"table-2.3.{name}.fit"] = Outcome()
            root = np.sqrt(law.k6**2 - 4.0 * law.k5 * law.k7) / -law.k5
            widths[name] = float(root)
            slopes[name] = max(abs(2.0 * law.k5 * x + law.k6) for x in row.valid_range)
    shape_text = ", ".join(
        f"{MUSCLE_LABELS[name]} {widths[name]:.2f} l0 and {slopes[name]:.1f} F0/l0" for name in widths
    )
    is_human_narrowest = min(widths, key=widths.__getitem__) == "human" == max(slopes, key=slopes.__getitem__)
    findings["table-2.3.human"] = Outcome(
        widths["human"], is_human_narrowest, f"Width between the roots, greatest slope: {shape_text}."
    )
    findings["table-2.3.digitised"] = Outcome(note="The curves were digitised in the source and have no equation.")


def _add_hill(findings: dict[str, Outcome]) -> None:
    for name, row in tables.HILL_CURVES.items():
        findings[f"table-2.4.{name}.a"], findings[f"table-2.4.{name}.b"] = map(
            Outcome, fit_hill_constants(row.constants)
        )
        if row.isometric_force is not None and row.max_velocity is not None:
            findings[f"table-2.4.{name}.f0"] = Outcome(row.isometric_force)
            findings[f"table-2.4.{name}.vmax"] = Outcome(1e3 * row.max_velocity)
        findings[f"table-2.4.{name}.at-vmax"] = Outcome(hill.concentric_force(row.constants, 1.0, 1.0))
    velocity = np.linspace(0.05, 0.95, 19)
    curves = {
        name: _evaluate_curve(_relative_force, tables.HILL_CURVES[name].constants, velocity)
        for name in ("human", "rat", "frog", "cat")
    }
    inversions = [
        f"{MUSCLE_LABELS[below]} above {MUSCLE_LABELS[above]} "
        f"at {int((curves[above] <= curves[below]).sum())} of 19 speeds"
        for above, below in (("human", "rat"), ("rat", "frog"), ("frog", "cat"))
        if (curves[above] <= curves[below]).any()
    ]
    findings["table-2.4.order"] = Outcome(None, not inversions, f"{'; '.join(inversions)}." if inversions else "")


def _add_eccentric(findings: dict[str, Outcome]) -> None:
    velocity = np.linspace(-0.5, 0.0, 51)
    for name, saturation in tables.ECCENTRIC_SATURATIONS.items():
        law = tables.GENERIC_HILL_CURVE._replace(saturation=saturation)
        findings[f"fig-2.6.{name}"] = Outcome(hill.force_velocity(law, 1.0, -SATURATION_SPEED))
    force = _evaluate_curve(_relative_force, tables.GENERIC_HILL_CURVE, velocity)
    findings["fig-2.6.rises"] = Outcome(float(force[0]), bool((np.diff(force) < 0.0).all()), "At half of Vmax.")
    findings["fig-2.6.cat"] = Outcome(note="The measured points of the cat are on a figure without a table.")
    findings["fig-2.7.protocol"] = Outcome(note="An animal experiment, which cannot be computed.")
    findings["fig-2.7.outside"] = Outcome(note="The curves are not printed as numbers.")


def _add_envelope(findings: dict[str, Outcome]) -> None:
    for key in ("k5", "k6", "k7", "a", "b"):
        span: ClosedInterval = getattr(hill.DESIGN_ENVELOPE, key)
        findings[f"eq-2.5.{key}.low"], findings[f"eq-2.5.{key}.high"] = (
            Outcome(span.lower),
            Outcome(span.upper),
        )
    findings["eq-2.5.saturation"] = Outcome(hill.DESIGN_ENVELOPE.saturation.lower)
    generic = fit_contractile_constants(tables.GENERIC_CONTRACTILE_ELEMENT, ClosedInterval(*LENGTH_RANGE))
    for key, value in zip(("k5", "k6", "k7"), generic, strict=True):
        findings[f"fig-2.8.{key}"] = Outcome(value)
    findings["fig-2.8.a"], findings["fig-2.8.b"] = map(Outcome, fit_hill_constants(tables.GENERIC_HILL_CURVE))
    is_inside = hill.is_in_envelope(hill.DESIGN_ENVELOPE, tables.GENERIC_CONTRACTILE_ELEMENT, tables.GENERIC_HILL_CURVE)
    findings["fig-2.8.inside"] = Outcome(None, is_inside)
    outside = []
    for name, row in tables.CONTRACTILE_ELEMENTS.items():
        for key in ("k5", "k6", "k7"):
            value = getattr(row.constants, key)
            if not hill.is_in_interval(getattr(hill.DESIGN_ENVELOPE, key), value):
                outside.append(f"{MUSCLE_LABELS[name]}: {key} = {value:g}")
    findings["eq-2.5.around"] = Outcome(None, not outside, f"Outside: {'; '.join(outside)}." if outside else "")


def _build_figures() -> list[FigureData]:
    fine = np.linspace(1.0, 1.6, 121)
    force = np.linspace(*SERIES_FORCE_RANGE, 101)
    length = np.linspace(*LENGTH_RANGE, 201)
    velocity, lengthening = np.linspace(0.0, 1.0, 101), np.linspace(-0.5, 0.0, 101)
    generic = np.array(
        [
            [
                hill.contractile_force(tables.GENERIC_CONTRACTILE_ELEMENT, tables.GENERIC_HILL_CURVE, x, v)
                for x in length[::5]
            ]
            for v in np.linspace(-0.5, 1.0, 31)
        ]
    )
    return [
        FigureData(
            "2.2",
            "Parallel element (2.1)",
            "l/l0",
            "Fpe/F0",
            tuple(
                PlotLine(MUSCLE_LABELS[n], fine, _evaluate_curve(hill.parallel_force, row.constants, fine))
                for n, row in tables.PARALLEL_ELEMENTS.items()
            ),
            (1.0, 1.6),
            (0.0, 0.5),
        ),
        FigureData(
            "2.3",
            "Series element (2.2)",
            "F/F0",
            "elongation/l0",
            tuple(
                PlotLine(MUSCLE_LABELS[n], force, _evaluate_curve(hill.series_elongation, law, force))
                for n, law in tables.SERIES_ELEMENTS.items()
            ),
            (0.5, 1.0),
            (0.0, 0.10),
        ),
        FigureData(
            "2.4",
            "Isometric force against length (2.3)",
            "l/l0",
            "F/F0",
            tuple(
                PlotLine(MUSCLE_LABELS[n], length, _evaluate_curve(hill.isometric_force, row.constants, length))
                for n, row in tables.CONTRACTILE_ELEMENTS.items()
                if n != "bobbert_1986"  # printed as Woittiez's
            ),
            LENGTH_RANGE,
            (0.0, 1.2),
        ),
        FigureData(
            "2.5",
            "Force against shortening velocity (2.4)",
            "V/Vmax",
            "F/F(l)",
            tuple(
                PlotLine(MUSCLE_LABELS[n], velocity, _evaluate_curve(_relative_force, row.constants, velocity))
                for n, row in tables.HILL_CURVES.items()
            ),
            (0.0, 1.0),
            (0.0, 1.0),
        ),
        FigureData(
            "2.6",
            "Force against lengthening velocity",
            "V/Vmax",
            "F/F(l)",
            tuple(
                PlotLine(
                    f"saturating at {s:g} F(l)",
                    lengthening,
                    _evaluate_curve(_relative_force, tables.GENERIC_HILL_CURVE._replace(saturation=s), lengthening),
                    ordered_value=s,
                )
                for s in sorted(tables.ECCENTRIC_SATURATIONS.values())
            ),
            (-0.5, 0.0),
            (0.0, 1.8),
            assumption_note="the shape between rest and saturation: an inverted hyperbola that joins (2.4) smoothly",
        ),
        FigureData(
            "2.8",
            "The generic muscle of the design envelope (2.5)",
            "l/l0",
            "V/Vmax",
            surface=PlotSurface(length[::5], np.linspace(-0.5, 1.0, 31), generic),
            z_label="F/F0",
            assumption_note="the shape of the lengthening side",
        ),
    ]
