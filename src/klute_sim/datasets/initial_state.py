"""Initial state that a dataset states for a trial of a mechanism, where measurements do not show it."""

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import mujoco

from klute_sim.datasets.declarations import parse_quantity
from klute_sim.datasets.mechanism import DatasetMechanism
from klute_sim.datasets.mechanism_channels import normalize_name, parse_channel
from klute_sim.datasets.trial import InitialState
from klute_sim.errors import InputError, suggest

_POSITION_QUANTITIES = {mujoco.mjtJoint.mjJNT_HINGE: ("angle", "rad"), mujoco.mjtJoint.mjJNT_SLIDE: ("position", "m")}
"""Kind of a joint -> quantity of its position, and SI unit."""


class _Entry(NamedTuple):
    """Where the value of a key belongs."""

    field: str
    owner: str
    si_unit: str


def parse_initial_state(texts: Mapping[str, str], mechanism: DatasetMechanism, place: str) -> InitialState:
    """Return the initial state in ``texts`` (key -> number with a unit); ``place`` names the table.

    Raises InputError for a key that ``mechanism`` does not have, a number without a unit of its kind, or a negative
    pressure.
    """
    if not texts:
        return InitialState()
    entries = _list_entries(mechanism)
    fields: dict[str, dict[str, float]] = {"positions": {}, "velocities": {}, "pressures": {}}
    for key, text in texts.items():
        if key not in entries:
            listing = f"allowed: {', '.join(entries)} (joints that are not driven, devices under pressure commands)"
            raise InputError(f"{place} names '{key}'; {suggest(key, entries, listing)}")
        field, owner, si_unit = entries[key]
        value = parse_quantity(text, si_unit, f"{place} {key}")
        if field == "pressures" and value < 0.0:
            raise InputError(f"{place} {key} = '{text}' is refused; allowed: a gauge pressure of 0 or more")
        fields[field][owner] = value
    return InitialState(**fields)


def _list_entries(mechanism: DatasetMechanism) -> dict[str, _Entry]:
    """Return key -> what it states, for everything that a dataset of ``mechanism`` may state."""
    prescribed = {
        (channel.quantity, channel.object_name) for channel in map(parse_channel, mechanism.channels.prescribed)
    }
    entries = {}
    for joint in mechanism.file.make_spec().joints:
        name = normalize_name(joint.name)
        quantity, unit = _POSITION_QUANTITIES.get(joint.type, ("", ""))
        if name and quantity and (quantity, name) not in prescribed:
            entries[f"{quantity}_{name}"] = _Entry("positions", joint.name, unit)
            entries[f"velocity_{name}"] = _Entry("velocities", joint.name, f"{unit}/s")
    for tendon in mechanism.devices:
        name = normalize_name(tendon)
        if ("pressure_command", name) in prescribed:
            entries[f"pressure_{name}"] = _Entry("pressures", tendon, "Pa")
    return entries


def check_initial_state(state: InitialState, measured: Iterable[str], place: str) -> None:
    """Raise InputError for the velocity of a joint whose position is neither stated nor ``measured``."""
    for joint in state.velocities:
        names = [f"{quantity}_{normalize_name(joint)}" for quantity, _ in _POSITION_QUANTITIES.values()]
        if joint not in state.positions and not set(names) & set(measured):
            raise InputError(
                f"{place}: [trial.initial] states the velocity of joint '{joint}', whose position is not known; state "
                f"{' or '.join(names)} as well, or measure it"
            )
