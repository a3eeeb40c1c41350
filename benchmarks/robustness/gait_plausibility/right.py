"""Gait files that are right, ordinary and unusual: none may be refused."""

import numpy as np
from benchmarks.robustness.gait_plausibility.files import Columns, Edit, Variant
from benchmarks.robustness.gait_plausibility.walker import UNUSUAL_WALKERS, Walker

KINDS_BY_WALKER = ("reference", "dataset", "opensim", "trc", "table", "c3d")
"""Kinds of files in which every walker is written."""
SKIPPED = {("runner", kind) for kind in ("opensim", "trc", "table", "c3d")}
"""The import takes strides of walking only, and says so."""


def _edit_all(factor: float = 1.0, offset: float = 0.0, *parts: str) -> Edit:
    def edit(columns: Columns) -> Columns:
        return {
            name: factor * values + offset if any(part in name for part in parts) else values
            for name, values in columns.items()
        }

    return edit


def _add_noise(columns: Columns) -> Columns:
    random = np.random.default_rng(1)
    return {
        name: values if "time" in name else values + 0.01 * np.nanstd(values) * random.normal(size=values.shape)
        for name, values in columns.items()
    }


def list_variants() -> list[Variant]:
    """Return all right variants."""
    variants = [
        Variant(kind, name, walker=walker)
        for name, walker in UNUSUAL_WALKERS.items()
        for kind in KINDS_BY_WALKER
        if (name, kind) not in SKIPPED
    ]
    overground = Walker(seconds=6.0)
    variants += [
        Variant("dataset", "ankle 4 cm too high", edit=_edit_all(1.0, 0.04, "ankle_z")),
        Variant("dataset", "centre of pressure 5 cm off", edit=_edit_all(1.0, 0.05, "cop_x")),
        Variant("dataset", "encoder zero 12 degrees off", edit=_edit_all(1.0, 12.0, "ankle_angle")),
        Variant("dataset", "plate offset of 15 N", edit=_edit_all(1.0, 15.0, "grf_vertical")),
        Variant("dataset", "noise", edit=_add_noise),
        Variant("dataset", "time starts at 5000 s", edit=_edit_all(1.0, 5000.0, "time")),
        Variant("dataset", "one stride and a half", walker=Walker(seconds=2.4)),
        Variant("dataset", "far from the origin", edit=_edit_all(1.0, 40.0, "ankle_x", "cop_x")),
        Variant("dataset", "walks from negative positions", edit=_edit_all(1.0, -6.0, "ankle_x", "cop_x")),
        Variant("reference", "mean of a slow group", walker=Walker(stride_time=1.4, speed=0.8)),
        Variant("reference", "zero of the ankle 8 degrees off", edit=_edit_all(1.0, 8.0, "ankle_dors")),
        Variant("opensim", "given mass 4 % too large", walker=overground, mass=75.0),
        Variant("trc", "given stature", stature=1.75, mass=72.0),
        Variant("table", "noise", edit=_add_noise),
    ]
    return variants
