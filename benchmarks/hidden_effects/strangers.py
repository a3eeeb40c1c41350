"""What is in no catalogue, and is no other form of what is in one: things that happen on benches."""

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
    """The motion as the device gets it; the log has what was asked for."""
    for each in effects:
        if each["name"] == "crosshead_play":
            program = program._replace(length=_apply_play(program.length, each["parameters"]["width_mm"] * 1e-3))
    return program


def apply_to_channels(
    channels: Mapping[str, Floats], program: InputProgram, effects: Sequence[OutOfCatalogueEffect]
) -> dict[str, Floats]:
    """``channels`` on the trace grid, in the units of the columns, with what ``strangers`` do to them."""
    found = dict(channels)
    for each in effects:
        p = each["parameters"]
        match each["name"]:
            case "moving_mass":  # between load cell and device, moved by the crosshead
                acceleration = np.gradient(np.gradient(program.length, TRACE_STEP), TRACE_STEP)
                found["force"] = found["force"] + p["mass_kg"] * acceleration
            case "cross_talk":
                found["force"] = found["force"] + p["force_n_per_bar"] * channels["pressure"]
            case "sticking_gauge":
                found["pressure"] = _apply_play(found["pressure"], p["width_bar"])
            case "load_cell_creep":
                share = TRACE_STEP / (p["time_constant_s"] + TRACE_STEP)
                start = [(1.0 - share) * found["force"][0]]
                late, _ = lfilter([share], [1.0, share - 1.0], found["force"], zi=start)
                found["force"] = found["force"] + p["share"] * late
    return found


def _apply_play(values: Floats, width: float) -> Floats:
    """What follows ``values`` through a dead band ``width`` wide; in its middle at the start."""
    out, here = np.empty_like(values), values[0]
    for k, value in enumerate(values):
        here = min(max(here, value - 0.5 * width), value + 0.5 * width)
        out[k] = here
    return out
