"""What the bench records, the same with MuJoCo and without."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from klute_sim.device.device import Device
from klute_sim.device.energy.ledger import COLUMN_HEADINGS, EnergyBalance
from klute_sim.laws import damper as damper_law
from klute_sim.laws import mckibben
from klute_sim.provenance import collect_versions
from klute_sim.recording.recording import Array, Recording
from klute_sim.units import BAR

CHANNELS = (
    "length_command [mm]",
    "force [N]",
    "load_cell [N]",
    "pressure [bar]",
    "muscle_length [mm]",
    "muscle_force [N]",
    "damper_force [N]",
    *COLUMN_HEADINGS,
)
"""Beside ``time``, ``length`` (reached) and ``pressure_command`` (or ``valve_command``)."""


def create_recording(
    device: Device,
    *,
    dt: float,
    length: Array,
    length_command: Array,
    command: Array,
    tension: Array,
    load_cell: Array,
    pressure: Array,
    muscle_length: Array,
    muscle_rate: Array,
    ledger: EnergyBalance,
    options: Mapping[str, Any],
) -> Recording:
    """A recording of series [SI], one entry per ``step`` [s]."""
    muscle, damper = device.parameters.muscle, device.parameters.damper
    states = zip(pressure.tolist(), muscle_length.tolist(), strict=True)
    pull = np.array([mckibben.force(muscle, p, x) for p, x in states])
    damping = np.array([damper_law.force(damper, rate) for rate in muscle_rate.tolist()])
    # What was asked for is an opening, if that is what the supply takes.
    opens = device.parameters.supply.command_is_opening != 0.0
    asked = ("valve_command [1]", command) if opens else ("pressure_command [bar]", command / BAR)
    columns = [
        ("time [s]", np.arange(len(length)) * dt),
        ("length [mm]", 1e3 * length),
        ("length_command [mm]", 1e3 * length_command),
        asked,
        ("force [N]", tension),
        ("load_cell [N]", load_cell),
        ("pressure [bar]", pressure / BAR),
        ("muscle_length [mm]", 1e3 * muscle_length),
        ("muscle_force [N]", pull),
        ("damper_force [N]", damping),
        *ledger.to_columns(),
    ]
    provenance = {
        "rig": "bench",
        "device": {"name": device.name, "sha256": device.digest},
        "options": {"step_s": dt, **options},
        "versions": collect_versions(),
    }
    return Recording.from_columns([(heading, np.asarray(series)) for heading, series in columns], provenance)
