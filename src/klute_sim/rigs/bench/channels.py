"""What the bench records, the same with MuJoCo and without."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from klute_sim.device.files import Device
from klute_sim.device.ledger import HEADINGS, Ledger
from klute_sim.laws import damper as damper_law
from klute_sim.laws import mckibben
from klute_sim.provenance import versions
from klute_sim.recording.recording import Recording, Samples
from klute_sim.units import BAR

CHANNELS = (
    "length_command [mm]",
    "force [N]",
    "load_cell [N]",
    "pressure [bar]",
    "muscle_length [mm]",
    "muscle_force [N]",
    "damper_force [N]",
    *HEADINGS,
)
"""Beside ``time``, ``length`` (reached) and ``pressure_command``."""


def recorded(
    device: Device,
    *,
    step: float,
    length: Samples,
    length_command: Samples,
    command: Samples,
    tension: Samples,
    load_cell: Samples,
    pressure: Samples,
    muscle_length: Samples,
    muscle_rate: Samples,
    ledger: Ledger,
    options: Mapping[str, Any],
) -> Recording:
    """A recording of series [SI], one entry per ``step`` [s]."""
    muscle, damper = device.parameters.muscle, device.parameters.damper
    states = zip(pressure.tolist(), muscle_length.tolist(), strict=True)
    pull = np.array([mckibben.force(muscle, p, x) for p, x in states])
    damping = np.array([damper_law.force(damper, rate) for rate in muscle_rate.tolist()])
    columns = [
        ("time [s]", np.arange(len(length)) * step),
        ("length [mm]", 1e3 * length),
        ("length_command [mm]", 1e3 * length_command),
        ("pressure_command [bar]", command / BAR),
        ("force [N]", tension),
        ("load_cell [N]", load_cell),
        ("pressure [bar]", pressure / BAR),
        ("muscle_length [mm]", 1e3 * muscle_length),
        ("muscle_force [N]", pull),
        ("damper_force [N]", damping),
        *ledger.columns(),
    ]
    provenance = {
        "rig": "bench",
        "device": {"name": device.name, "sha256": device.digest},
        "options": {"step_s": step, **options},
        "versions": versions(),
    }
    return Recording.from_columns([(heading, np.asarray(series)) for heading, series in columns], provenance)
