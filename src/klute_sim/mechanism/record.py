"""The recording of a simulated mechanism: joints, devices with their energy and air, and prescribed inputs."""

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from klute_sim.datasets.mechanism_channels import DISPLAY_UNITS, Channel, normalize_name, parse_channel
from klute_sim.datasets.unit_conversion import get_si_factor
from klute_sim.device.batch_outputs import N_OUTPUTS, BatchOutputs
from klute_sim.device.device import Device
from klute_sim.device.dynamics import ZERO_INTERNAL_STATE, apply_supply_effects
from klute_sim.device.energy.ledger import EnergyBalance, compute_energy_balance
from klute_sim.laws import pneumatic_step
from klute_sim.mechanism.simulate import MechanismRollout
from klute_sim.provenance import collect_versions
from klute_sim.recording.recording import Recording, split_heading
from klute_sim.types import Array

DEVICE_QUANTITIES = ("pressure", "force", "unit_length", "muscle_length")
"""Quantities that are recorded of every device."""
JOINT_QUANTITIES = {
    int(mujoco.mjtJoint.mjJNT_HINGE): ("angle", "moment"),
    int(mujoco.mjtJoint.mjJNT_SLIDE): ("position",),
}
"""Type of joint -> quantities that are recorded of it."""


def compute_device_energy(rollout: MechanismRollout, name: str) -> EnergyBalance:
    """Return the energy balance and the air of device ``name``, one entry per step."""
    trace = rollout.trace_device(name)
    outputs = BatchOutputs(trace.parameters, rollout.backend)
    states = np.column_stack([trace.pressure, trace.length, trace.velocity, trace.unit_length])
    table = outputs.evaluate(states, trace.internal_states)
    supply = apply_supply_effects(trace.parameters, ZERO_INTERNAL_STATE)
    return compute_energy_balance(
        table[:, :N_OUTPUTS],
        table[:, N_OUTPUTS:].reshape(len(table), len(outputs.effect_names), 2),
        outputs.effect_names,
        trace.length,
        trace.unit_length,
        rollout.dt,
        supply_meters_air=not pneumatic_step.is_ideal(supply),
    )


def record_mechanism(rollout: MechanismRollout, devices: Mapping[str, Device], options: Mapping[str, Any]) -> Recording:
    """Return the recording of ``rollout`` with ``devices`` by name; names of channels end with that of their object."""
    columns: dict[str, Array] = {"time [s]": rollout.time}
    channels = {name: binding.channel for name, binding in rollout.mechanism.bindings.items()}
    channels |= {channel.name: channel for channel in _list_output_channels(rollout)}
    for channel in channels.values():
        factor = get_si_factor(DISPLAY_UNITS[channel.si_unit], channel.si_unit) or 1.0
        columns[channel.display_heading] = rollout.read_channel(rollout.mechanism.bind(channel)) / factor
    for name in devices:
        for heading, values in compute_device_energy(rollout, name).to_columns():
            quantity, unit = split_heading(heading)
            columns[f"{quantity}_{normalize_name(name)} [{unit}]"] = values
    provenance = {
        "rig": "mjcf",
        "model": {"name": rollout.mechanism.file.name, "sha256": rollout.mechanism.file.digest},
        "devices": {name: {"name": device.name, "sha256": device.digest} for name, device in devices.items()},
        "options": {"step_s": rollout.dt, "backend": rollout.backend, **options},
        "versions": collect_versions(),
    }
    return Recording.from_columns(columns.items(), provenance)


def _list_output_channels(rollout: MechanismRollout) -> list[Channel]:
    """Return the channels of all named joints and all devices."""
    model = rollout.model
    names = [
        f"{quantity}_{normalize_name(model.joint(index).name)}"
        for index in range(model.njnt)
        if model.joint(index).name
        for quantity in JOINT_QUANTITIES.get(int(model.jnt_type[index]), ())
    ]
    names += [
        f"{quantity}_{normalize_name(device)}"
        for device in rollout.mechanism.device_names
        for quantity in DEVICE_QUANTITIES
    ]
    return [parse_channel(name) for name in names]
