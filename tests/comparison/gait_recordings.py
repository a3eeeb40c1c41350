"""Recordings and runs of a synthetic gait, for the tests of comparisons."""

from pathlib import Path

import numpy as np

from klute_sim.comparison.comparison import Comparison
from klute_sim.comparison.difference import Difference
from klute_sim.comparison.runs import ComparedRun
from klute_sim.recording.recording import Recording

PER_STRIDE = 50


def make_gait(
    strides: int = 4, *, bump: float = 0.0, scatter: float = 0.2, seed: int = 1, rig: str | None = None, **more: str
) -> Recording:
    """Return strides of a wave with a ``bump`` [deg] from 60 to 70 %, copied into the channels ``more``."""
    rng = np.random.default_rng(seed)
    count = PER_STRIDE * strides
    phase = np.tile(np.arange(PER_STRIDE) * 100.0 / PER_STRIDE, strides)
    angle = np.sin(0.02 * np.pi * phase) + scatter * np.repeat(rng.normal(size=strides), PER_STRIDE)
    angle += np.where((phase >= 60.0) & (phase <= 70.0), bump, 0.0)
    columns = [("time [s]", np.arange(count) / PER_STRIDE), ("gait_phase [%]", phase), ("ankle_angle [deg]", angle)]
    columns += [(f"{name} [{unit}]", angle) for name, unit in more.items()]
    options = {"mass_kg": 75.0, "speed_m_per_s": 1.2}
    return Recording.from_columns(columns, {"rig": rig, "options": options, "device": {"name": "d"}} if rig else None)


def make_run(label: str, *parts: Recording, names: tuple[str, ...] = ("one", "two", "three")) -> ComparedRun:
    return ComparedRun(label, Path(label), dict(zip(names[: len(parts)], parts, strict=True)))


def add_reference(recording: Recording, sd: float | None = 0.5) -> Recording:
    columns = {**recording.channels, "reference_ankle_angle": np.sin(0.02 * np.pi * recording["gait_phase"])}
    units = {**recording.units, "reference_ankle_angle": "deg"}
    if sd is not None:
        columns["reference_ankle_angle_sd"], units["reference_ankle_angle_sd"] = np.full(len(recording), sd), "deg"
    return Recording(columns, units, recording.provenance)


def get_difference(comparison: Comparison, channel: str = "ankle_angle", label: str = "b") -> Difference:
    (part,) = comparison.parts
    return part.differences[channel][label]
