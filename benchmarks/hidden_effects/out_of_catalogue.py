"""Bench effects that are in no catalogue and are no other form of a catalogued effect."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from benchmarks.hidden_effects.catalogue import Forms, HiddenParameter
from benchmarks.hidden_effects.inputs import InputProgram
from benchmarks.hidden_effects.truth import TRACE_STEP
from scipy.signal import lfilter

Floats = np.ndarray
OutOfCatalogueEffect = Mapping[str, Any]

OUT_OF_CATALOGUE_FORMS: Forms = {
    ("moving_mass", "rigid"): {"mass_kg": HiddenParameter(0, 20, 0.5)},
    ("cross_talk", "pressure"): {"force_n_per_bar": HiddenParameter(0, 100, 6)},
    ("crosshead_play", "dead_band"): {"width_mm": HiddenParameter(0, 10, 0.5)},
    ("sticking_gauge", "dead_band"): {"width_bar": HiddenParameter(0, 2, 0.05)},
    ("load_cell_creep", "first_order"): {
        "share": HiddenParameter(0, 0.5, 0.03),
        "time_constant_s": HiddenParameter(0.2, 10, 1.5, None),
    },
}


def apply_to_motion(program: InputProgram, effects: Sequence[OutOfCatalogueEffect]) -> InputProgram:
    """Return the program with the motion that reaches the device; the log keeps the commanded motion."""
    for effect in effects:
        if effect["name"] == "crosshead_play":
            program = program._replace(length=_apply_play(program.length, effect["parameters"]["width_mm"] * 1e-3))
    return program


def apply_to_channels(
    channels: Mapping[str, Floats], program: InputProgram, effects: Sequence[OutOfCatalogueEffect]
) -> dict[str, Floats]:
    """Return ``channels`` on the trace grid, in the units of the columns, changed by ``effects``."""
    changed = dict(channels)
    for effect in effects:
        p = effect["parameters"]
        match effect["name"]:
            case "moving_mass":  # between load cell and device, moved by the crosshead
                acceleration = np.gradient(np.gradient(program.length, TRACE_STEP), TRACE_STEP)
                changed["force"] = changed["force"] + p["mass_kg"] * acceleration
            case "cross_talk":
                changed["force"] = changed["force"] + p["force_n_per_bar"] * channels["pressure"]
            case "sticking_gauge":
                changed["pressure"] = _apply_play(changed["pressure"], p["width_bar"])
            case "load_cell_creep":
                weight = TRACE_STEP / (p["time_constant_s"] + TRACE_STEP)
                start = [(1.0 - weight) * changed["force"][0]]
                lagged, _ = lfilter([weight], [1.0, weight - 1.0], changed["force"], zi=start)
                changed["force"] = changed["force"] + p["share"] * lagged
    return changed


def _apply_play(values: Floats, width: float) -> Floats:
    """Return the output of a dead band of ``width`` that starts at its middle."""
    out, position = np.empty_like(values), values[0]
    for k, value in enumerate(values):
        position = min(max(position, value - 0.5 * width), value + 0.5 * width)
        out[k] = position
    return out
