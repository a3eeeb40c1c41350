"""Channels of a bench recording, identical with and without MuJoCo."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from klute_sim.device.device import Device
from klute_sim.device.energy.ledger import COLUMN_HEADINGS, EnergyBalance
from klute_sim.laws import damper as damper_law
from klute_sim.laws import mckibben
from klute_sim.provenance import collect_versions
from klute_sim.recording.recording import Recording
from klute_sim.types import Array
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
"""Headings of the channels besides ``time``, ``length`` (reached) and ``pressure_command`` (or ``valve_command``)."""


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
    """Return the recording of a bench run from series in SI units with one sample per time step ``dt`` [s]."""
    muscle, damper = device.parameters.muscle, device.parameters.damper
    states = zip(pressure.tolist(), muscle_length.tolist(), strict=True)
    muscle_force = np.array([mckibben.force(muscle, p, x) for p, x in states])
    damper_force = np.array([damper_law.force(damper, rate) for rate in muscle_rate.tolist()])
    command_is_opening = device.parameters.supply.command_is_opening != 0.0
    command_column = ("valve_command [1]", command) if command_is_opening else ("pressure_command [bar]", command / BAR)
    columns = [
        ("time [s]", np.arange(len(length)) * dt),
        ("length [mm]", 1e3 * length),
        ("length_command [mm]", 1e3 * length_command),
        command_column,
        ("force [N]", tension),
        ("load_cell [N]", load_cell),
        ("pressure [bar]", pressure / BAR),
        ("muscle_length [mm]", 1e3 * muscle_length),
        ("muscle_force [N]", muscle_force),
        ("damper_force [N]", damper_force),
        *ledger.to_columns(),
    ]
    provenance = {
        "rig": "bench",
        "device": {"name": device.name, "sha256": device.digest},
        "options": {"step_s": dt, **options},
        "versions": collect_versions(),
    }
    return Recording.from_columns([(heading, np.asarray(series)) for heading, series in columns], provenance)
