"""Parallel simulations of one model, each with its own device if required.

This is a thin layer over :class:`mujoco.batch.Batch`, whose results do not depend on the number of threads. MuJoCo's
batch accepts C functions only, so it needs the compiled backend.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import ArrayLike

from klute_sim.device.backend.packing import ROW_SIZE, pack_parameters
from klute_sim.device.dynamics import DeviceParameters, has_internal_state
from klute_sim.errors import InputError, SimulationError
from klute_sim.plant import callbacks
from klute_sim.plant.actuator import DeviceActuator
from klute_sim.plant.coupling import N_BASE_STATES
from klute_sim.types import Array


def create_batch(model: mujoco.MjModel, n_simulations: int, n_threads: int = 0) -> Batch:
    """Return ``n_simulations`` simulations of ``model`` on ``n_threads`` threads (0: one per core).

    The model comes from :func:`klute_sim.plant.models.attach_devices`; advance the batch with :func:`step_batch`.
    Raises InputError when the compiled backend is unavailable or a number is out of range.
    """
    if n_simulations < 1 or n_threads < 0:
        raise InputError(
            f"{n_simulations} simulations on {n_threads} threads; allowed: 1 or more simulations on 0 (all cores) or "
            "more threads"
        )
    if callbacks.choose_backend("auto") != "compiled":
        raise InputError("a batch needs the compiled backend; step the simulations one by one instead")
    return Batch(model, n_simulations, n_threads)


def set_parameters(batch: Batch, actuator: str, parameters: Sequence[DeviceParameters]) -> None:
    """Give every simulation of ``batch`` its own device on ``actuator``.

    Only the device differs; its attachment points are those of the model. Raises InputError when the number of devices
    is wrong, when a device has a rigid tendon (its damping is part of the model), when a device needs internal states
    that the model lacks, or when the actuator carries no device.
    """
    device_actuator = DeviceActuator(batch.model, actuator)
    index = device_actuator.id
    if len(parameters) != batch.nsim:
        raise InputError(f"{len(parameters)} devices for {batch.nsim} simulations; give one device for each")
    if any(device.tendon.is_rigid for device in (*parameters, device_actuator.parameters)):
        raise InputError("a device with a rigid tendon cannot be in a batch; give it its own model")
    if batch.model.actuator_actnum[index] == N_BASE_STATES and any(map(has_internal_state, parameters)):
        raise InputError(
            "a device with internal states needs a model made with attach_devices(..., reserve_internal_states=True)"
        )
    batch.expand("actuator_user")[:, index, :ROW_SIZE] = np.array([pack_parameters(device) for device in parameters])


def step_batch(
    batch: Batch,
    ids: ArrayLike | None = None,
    n_steps: int = 1,
    controls: ArrayLike | None = None,
    *,
    record: Mapping[str, Array] | None = None,
    is_isolated: bool = False,
) -> None:
    """Advance the simulations ``ids`` (None: all) by ``n_steps`` steps.

    ``controls`` (n, n_steps, nu) are the commands of every step; None keeps those of the simulations. ``record`` holds
    arrays (n, n_steps, ...) by field of MjData, which are filled with its values after each step. ``is_isolated``
    removes the callbacks of other code meanwhile.

    Raises SimulationError when a device has no finite state: the pressure of its simulation is NaN, and all other
    simulations have been stepped. Raises InputError when other code's callbacks are installed in MuJoCo.
    """
    with callbacks.device_callbacks("compiled", is_isolated=is_isolated) as backend:
        if backend != "compiled":
            raise InputError("a batch cannot be stepped while Python callbacks are installed in MuJoCo; remove them")
        if controls is None and not record:
            batch.step(ids=ids, nstep=n_steps)
        else:
            batch.rollout(n_steps, controls, record=tuple(record or ()), ids=ids, out=dict(record or {}))
        faults = callbacks.pop_fault_messages()
    if faults:
        act = batch.bind("act")
        failed = np.flatnonzero(np.isnan(act[:, find_pressure_addresses(batch.model)]).any(axis=1))
        listing = ", ".join(str(index) for index in failed[:5]) + (", ..." if len(failed) > 5 else "")
        raise SimulationError(f"{len(failed)} of {batch.nsim} simulations have failed ({listing}): {faults[0]}")


def get_model_field(model: mujoco.MjModel, name: str) -> Any:
    """Return the field ``name`` of ``model``, such as ``body_mass`` or ``opt.timestep``."""
    value: Any = model
    for part in name.split("."):
        value = getattr(value, part)
    return value


def model_fields_differ(name: str, first: mujoco.MjModel, second: mujoco.MjModel) -> bool:
    """Return whether the field ``name`` differs between two models."""
    return not np.array_equal(get_model_field(first, name), get_model_field(second, name))


def find_pressure_addresses(model: mujoco.MjModel) -> list[int]:
    """Return the indices of the devices' pressures in ``act``."""
    return [int(model.actuator_actadr[i]) for i in range(model.nactuator) if callbacks.get_parameter_row(model, i)]
