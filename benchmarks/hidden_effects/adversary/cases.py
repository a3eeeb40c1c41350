"""What the adversary's datasets contain: departures of every rig from the textbook, and one strong hidden effect."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

Spec = dict[str, Any]


class Departure(NamedTuple):
    """A departure from the textbook, with the names of the catalogue that describe it."""

    names: tuple[str, ...]
    ranges: Mapping[str, tuple[float, float]]
    """Field of the rig -> range from which it is drawn, in SI units."""


DEPARTURES: Mapping[str, Departure] = {
    "cones": Departure(("end_taper",), {"cone_slope": (0.10, 0.3)}),
    "toe": Departure(("tendon_stiffening", "number_error@tendon.engagement_mm"), {"toe_length": (0.3e-3, 0.8e-3)}),
    "creep": Departure(("bladder_relaxation",), {"creep_per_decade": (0.02, 0.05)}),
    "rubber": Departure(("muscle_damping",), {"rubber_damping": (3.0, 8.0)}),
    "braid": Departure(("braid_hysteresis",), {"braid_friction": (0.4e-5, 1.0e-5), "braid_reach": (0.8e-3, 2e-3)}),
    "seal": Departure(("seal_friction",), {"seal_friction": (0.8, 2.5), "seal_reach": (0.05e-3, 0.2e-3)}),
    "clearance": Departure(("laminar_orifice", "muscle_damping"), {"viscous_clearance": (15.0, 50.0)}),
    "regulator": Departure(
        ("pressure_lag", "pressure_delay"), {"regulator_time": (0.3e-3, 0.9e-3), "pilot_time": (0.1e-3, 0.4e-3)}
    ),
    "droop": Departure(("volume_coupling",), {"flow_droop": (0.4e6, 1.5e6)}),
}
"""Mild departures of real rigs (sizes assumed: about a hundredth of the range of the force, or a few millibar)."""
VALVE_NAMES = (
    "choked_valve",
    "number_error@valve.fill_critical_ratio",
    "number_error@valve.exhaust_critical_ratio",
    "number_error@valve.fill_dm3_per_s_bar",
    "number_error@valve.exhaust_dm3_per_s_bar",
)
"""Names that are right where a valve fills the muscle: its flow is that of a nozzle and not of ISO 6358."""
NUMBER_RANGES: Mapping[str, float] = {
    "muscle.bladder_radius_mm": 0.02,
    "muscle.bladder_thickness_mm": 0.02,
    "muscle.c01_kpa": 0.02,
    "muscle.friction_offset_n": 0.02,
    "muscle.turns_per_m": 0.004,
    "muscle.resting_length_mm": 0.003,
    "damper.bore_mm": 0.005,
    "damper.oil_density_kg_m3": 0.02,
    "tendon.engagement_mm": 0.02,
}
"""Key of the device file -> largest relative error of a number that nobody declared uncertain.

Two hundredths; what is counted, or measured over a length, is known better.
"""
RIGS: tuple[tuple[str, tuple[str, ...], int], ...] = (
    ("sensors", (), 0),
    ("numbers", (), 4),
    ("geometry", ("cones", "toe"), 0),
    ("rubber", ("creep", "rubber"), 0),
    ("friction", ("braid", "seal", "clearance"), 0),
    ("air", ("regulator", "droop"), 0),
    ("all", tuple(DEPARTURES), 2),
    ("some", (), 3),
)
"""Rigs without a strong effect: name, departures, and how many numbers are wrong."""
N_SOME = 4
"""Number of departures of a rig that has some of them."""


class HiddenCase(NamedTuple):
    """A strong hidden effect."""

    kind: str
    """Key of the ground truth: ``effects``, ``instruments`` or ``numbers``."""
    name: str
    """Name of the catalogue."""
    ranges: Mapping[str, tuple[float, float]]
    """Field of the rig or of the fault, or key of the device file (relative error) -> range."""
    channel: str | None = None
    has_valve: bool = False
    replaces: str | None = None
    """Mild departure that the strong effect takes the place of."""


HIDDEN_CASES: tuple[HiddenCase, ...] = (
    HiddenCase("effects", "bladder_relaxation", {"creep_per_decade": (0.3, 0.5)}, replaces="creep"),
    HiddenCase(
        "effects",
        "braid_hysteresis",
        {"braid_friction": (5e-5, 9e-5), "braid_reach": (0.6e-3, 2e-3)},
        replaces="braid",
    ),
    HiddenCase("instruments", "sensor_gain", {"gain": (0.85, 0.92)}, channel="force"),
    HiddenCase("effects", "hose", {"hose_length": (0.3, 0.8), "hose_diameter": (3.5e-3, 4.5e-3)}, has_valve=True),
    HiddenCase("numbers", "number_error", {"muscle.turns_per_m": (-0.09, -0.06)}),
    HiddenCase(
        "effects", "seal_friction", {"seal_friction": (12.0, 22.0), "seal_reach": (0.05e-3, 0.3e-3)}, replaces="seal"
    ),
    HiddenCase("effects", "leak", {"leak_conductance": (0.15e-8, 0.3e-8)}, has_valve=True),
    HiddenCase("instruments", "sensor_drift", {"warm_up": (30.0, 50.0)}, channel="force"),
    HiddenCase("effects", "supply_droop", {"tank_volume": (0.25e-3, 0.35e-3)}, has_valve=True),
    HiddenCase("effects", "threshold_pressure", {"threshold": (0.5e5, 0.8e5)}),
    HiddenCase(
        "effects",
        "pressure_lag",
        {"regulator_time": (5e-3, 12e-3), "pilot_time": (1e-3, 3e-3)},
        replaces="regulator",
    ),
    HiddenCase("effects", "tendon_hysteresis", {"tendon_loss": (0.12, 0.2)}),
    HiddenCase("numbers", "number_error", {"tendon.engagement_mm": (0.5, 0.9)}),
    HiddenCase("effects", "muscle_damping", {"rubber_damping": (50.0, 90.0)}, replaces="rubber"),
    HiddenCase("effects", "end_taper", {"cone_slope": (1.8, 2.4)}, replaces="cones"),
    HiddenCase("instruments", "sensor_lag", {"slow_time": (6e-3, 12e-3)}, channel="force"),
)


def draw_case(index: int, rng: np.random.Generator) -> Spec:
    """Return what the dataset ``index`` contains: every third has no strong effect, the others one each.

    The result consists of ``departures`` (name -> field -> value), ``number_errors`` (key -> relative error), ``valve``
    and ``hidden``, None or a dict with the entry of the ground truth.
    """
    turn, position = divmod(index, 3)
    if position == 2:
        name, chosen, n_numbers = RIGS[turn % len(RIGS)]
        if name == "some":
            chosen = tuple(rng.choice(list(DEPARTURES), N_SOME, replace=False))
        return {**_draw_rig(chosen, n_numbers, rng), "rig": name, "valve": False, "hidden": None}
    case = HIDDEN_CASES[(2 * turn + position) % len(HIDDEN_CASES)]
    eligible = [key for key in DEPARTURES if not (case.has_valve and key in ("regulator", "droop"))]
    chosen = tuple(key for key in rng.choice(eligible, N_SOME, replace=False) if key != case.replaces)
    values = {field: _draw(rng, *ends) for field, ends in case.ranges.items()}
    entry: Spec = {"name": case.name, "form": "adversary", "parameters": values}
    if case.channel is not None:
        entry["channel"] = case.channel
    if case.kind == "numbers":
        (entry["number"],) = values
    hidden = {"kind": case.kind, "entry": entry}
    rig = _draw_rig(chosen, 3, rng)
    if case.kind == "numbers":
        rig["number_errors"].pop(entry["number"], None)
    return {**rig, "rig": "some", "valve": case.has_valve, "hidden": hidden}


def _draw_rig(chosen: tuple[str, ...], n_numbers: int, rng: np.random.Generator) -> Spec:
    departures = {
        str(key): {field: _draw(rng, *ends) for field, ends in DEPARTURES[key].ranges.items()} for key in chosen
    }
    keys = [str(key) for key in rng.choice(list(NUMBER_RANGES), n_numbers, replace=False)]
    # Half of the largest error or more, so that a number that is wrong is wrong.
    errors = {key: float(rng.choice([-1.0, 1.0])) * _draw(rng, 0.5, 1.0) * NUMBER_RANGES[key] for key in keys}
    return {"departures": departures, "number_errors": errors}


def _draw(rng: np.random.Generator, low: float, high: float) -> float:
    return float(f"{rng.uniform(low, high):.6g}")
