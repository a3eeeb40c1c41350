"""Energy and air of many simulations over one control interval.

Forces are known only at the ends of an interval. The work is their mean times the travel, which is coarser than the
energy balance of a recording at every step: over a stride, each term differs by less than 2 % of the work that the gas
does and absorbs (0.4 % with the default profile). What the terms do not account for, including the work of length
stops, is ``work_unresolved_j``.

The drawn air is that of a recording. A valve, a leak or a tank meters it; with an ideal regulator, it is the gain of
air in the muscle, which has to be summed at every step: where the command falls while the muscle shortens, the
regulator exhausts and refills within one interval.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from klute_sim.device.batch_outputs import N_OUTPUTS, BatchOutputs
from klute_sim.device.dynamics import (
    N_INTERNAL_STATES,
    ZERO_INTERNAL_STATE,
    DeviceParameters,
    apply_supply_effects,
    has_internal_state,
)
from klute_sim.device.energy.outputs import DeviceOutputs
from klute_sim.laws import mckibben, pneumatic_step
from klute_sim.laws.mckibben import MuscleParameters
from klute_sim.laws.pneumatics import air_mass
from klute_sim.types import Array, Mask


@dataclass(frozen=True)
class DeviceStates:
    """States of ``n`` devices in SI units."""

    pressure: Array
    """Gauge pressure [Pa]."""
    muscle_length: Array
    """Muscle length [m]."""
    muscle_velocity: Array
    """Rate of the muscle length [m/s]."""
    unit_length: Array
    """Length of muscle and tendon together [m]."""
    internal_state: Array
    """Internal states of the effects, shape (n, N_INTERNAL_STATES), or (n, 0) for devices without internal state."""


class EnergyAccounting:
    """Energy accounting of ``n_simulations`` simulations of one device whose parameters may differ."""

    def __init__(self, parameters: DeviceParameters, n_simulations: int, backend: str) -> None:
        """Set up the accounting with the ``backend`` in use, ``compiled`` or ``python``."""
        self._batch_outputs = BatchOutputs(parameters, backend)
        self.samples_air = pneumatic_step.is_ideal(apply_supply_effects(parameters, ZERO_INTERNAL_STATE))
        """Whether the drawn air has to be summed at every step, :meth:`add_steps`."""
        self._has_internal_state = has_internal_state(parameters)
        self._previous_outputs = np.zeros((n_simulations, self._batch_outputs.n_columns))
        self._previous_lengths = np.zeros((n_simulations, 2))
        self._muscles = np.repeat([parameters.muscle], n_simulations, axis=0)
        self._rooms = np.repeat([_describe_room(parameters)], n_simulations, axis=0)
        self._step_air, self._drawn_air = np.zeros(n_simulations), np.zeros(n_simulations)

    def set_parameters(self, index: int, parameters: DeviceParameters) -> None:
        """Set the device of simulation ``index`` from its next reset on; all devices have the same effects."""
        self._batch_outputs.set_parameters(index, parameters, len(self._previous_outputs))
        self._muscles[index], self._rooms[index] = parameters.muscle, _describe_room(parameters)

    def reset(self, mask: Mask, device_states: DeviceStates) -> None:
        """Restart the accounting of the simulations in ``mask``."""
        outputs, lengths = self._evaluate(device_states)
        self._previous_outputs[mask], self._previous_lengths[mask] = outputs[mask], lengths[mask]
        self._step_air[mask], self._drawn_air[mask] = DeviceOutputs(*outputs[mask].T[:N_OUTPUTS]).air_mass, 0.0

    def add_steps(self, mask: Mask, pressure: Array, muscle_length: Array) -> None:
        """Add the air drawn in consecutive steps of the simulations in ``mask``, for :attr:`samples_air`.

        ``pressure`` [Pa] and ``muscle_length`` [m], shape (simulations in ``mask``, steps), are those after each step.
        """
        # Arrays in place of numbers.
        states: Any = pressure, muscle_length
        muscles = MuscleParameters(*self._muscles[mask].T[:, :, None])
        constant_volume, temperature = self._rooms[mask].T[:, :, None]
        volume = mckibben.braid_volume(muscles, states[1]) + constant_volume
        air = np.column_stack([self._step_air[mask], air_mass(states[0], volume, temperature)])
        self._drawn_air[mask] += np.fmax(air[:, 1:] - air[:, :-1], 0.0).sum(axis=1)
        self._step_air[mask] = air[:, -1]

    def update(self, mask: Mask, device_states: DeviceStates) -> dict[str, Array]:
        """Return the energies [J] and air masses [g] of the interval that ends now.

        Work is positive where a part delivers it. Only the simulations in ``mask`` advance.
        """
        outputs, lengths = self._evaluate(device_states)
        mean_columns = 0.5 * (outputs + self._previous_outputs)
        muscle_travel, unit_travel = (lengths - self._previous_lengths).T
        mean_outputs, after, before = (
            DeviceOutputs(*columns.T[:N_OUTPUTS]) for columns in (mean_columns, outputs, self._previous_outputs)
        )
        work = {
            "work_gas_j": -mean_outputs.gas_force * muscle_travel,
            "work_friction_j": -mean_outputs.friction_force * muscle_travel,
            "work_damper_j": -mean_outputs.damper_force * muscle_travel,
            "work_bladder_j": before.bladder_energy - after.bladder_energy,
            "work_tendon_j": before.tendon_energy - after.tendon_energy,
        }
        for k, name in enumerate(self._batch_outputs.effect_names):
            muscle_side, tendon_side = mean_columns[:, N_OUTPUTS + 2 * k], mean_columns[:, N_OUTPUTS + 2 * k + 1]
            work[f"work_effect_{name}_j"] = -muscle_side * muscle_travel - tendon_side * (unit_travel - muscle_travel)
        delivered_work = -mean_outputs.tension * unit_travel
        # Summed in a fixed order: the order of np.sum differs between one simulation and many.
        work["work_unresolved_j"] = delivered_work - sum(work.values())
        air_drawn = self._drawn_air.copy() if self.samples_air else after.air_drawn - before.air_drawn
        self._drawn_air[mask] = 0.0
        result = {
            **work,
            "work_delivered_j": delivered_work,
            "air_g": 1e3 * np.fmax(air_drawn, 0.0),
            "air_leaked_g": 1e3 * (after.air_leaked - before.air_leaked),
            "air_mass_g": 1e3 * after.air_mass,
        }
        self._previous_outputs[mask], self._previous_lengths[mask] = outputs[mask], lengths[mask]
        return {name: np.asarray(value) for name, value in result.items()}

    def _evaluate(self, device_states: DeviceStates) -> tuple[Array, Array]:
        states = np.column_stack(
            [
                device_states.pressure,
                device_states.muscle_length,
                device_states.muscle_velocity,
                device_states.unit_length,
            ]
        )
        internal_state = (
            device_states.internal_state if self._has_internal_state else np.zeros((len(states), N_INTERNAL_STATES))
        )
        return self._batch_outputs.evaluate(states, internal_state), states[:, [1, 3]]


def _describe_room(parameters: DeviceParameters) -> tuple[float, float]:
    """Return the volume of the air beyond that inside the braid [m3], which is constant, and its temperature [K]."""
    muscle, supply = parameters.muscle, parameters.supply
    return supply.dead_volume - muscle.n_actuators * mckibben.bladder_volume(muscle), supply.temperature
