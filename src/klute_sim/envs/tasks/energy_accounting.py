"""Energy and air of many simulations, from one control interval to the next.

Forces are known where an interval ends, so work is their mean at both ends times the way: coarser than the ledger of a
recording, which has every step. What that leaves open is told as ``work_unresolved_j``; what length stops take is in
there, too.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from klute_sim.device.batch_outputs import N_OUTPUTS, BatchOutputs
from klute_sim.device.dynamics import (
    N_INTERNAL_STATES,
    ZERO_INTERNAL_STATE,
    DeviceParameters,
    apply_supply_effects,
    has_internal_state,
)
from klute_sim.device.energy.outputs import DeviceOutputs
from klute_sim.laws import pneumatic_step

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class DeviceStates:
    """Of ``n`` devices, SI."""

    pressure: Array
    """Gauge [Pa]."""
    muscle_length: Array
    """Of the muscle [m]."""
    muscle_velocity: Array
    """Of the muscle's length [m/s]."""
    unit_length: Array
    """[m]"""
    internal_state: Array
    """(n, MEMORY), or (n, 0) of devices that remember nothing."""


class EnergyAccounting:
    """Of ``count`` simulations of one device, whose numbers may differ."""

    def __init__(self, parameters: DeviceParameters, n_simulations: int, backend: str) -> None:
        """``law`` is the one in force, ``compiled`` or ``python``."""
        self._snapshots = BatchOutputs(parameters, backend)
        self._supply_is_metered = not pneumatic_step.is_ideal(apply_supply_effects(parameters, ZERO_INTERNAL_STATE))
        self._has_internal_state = has_internal_state(parameters)
        self._previous_outputs, self._previous_lengths = (
            np.zeros((n_simulations, self._snapshots.n_columns)),
            np.zeros((n_simulations, 2)),
        )

    def set_parameters(self, index: int, parameters: DeviceParameters) -> None:
        """Simulation ``place`` has this device from its next beginning on, with the effects that all have."""
        self._snapshots.set_parameters(index, parameters, len(self._previous_outputs))

    def reset(self, mask: Mask, device_states: DeviceStates) -> None:
        """Start the books of ``which`` anew."""
        told, way = self._evaluate(device_states)
        self._previous_outputs[mask], self._previous_lengths[mask] = told[mask], way[mask]

    def update(self, mask: Mask, device_states: DeviceStates) -> dict[str, Array]:
        """What the interval that ends ``now`` came to in ``which``: work given by each part [J], air drawn [g]."""
        told, way = self._evaluate(device_states)
        mean, muscle_way, unit_way = 0.5 * (told + self._previous_outputs), *(way - self._previous_lengths).T
        at, after, before = (DeviceOutputs(*each.T[:N_OUTPUTS]) for each in (mean, told, self._previous_outputs))
        work = {
            "work_gas_j": -at.gas_force * muscle_way,
            "work_friction_j": -at.friction_force * muscle_way,
            "work_damper_j": -at.damper_force * muscle_way,
            "work_bladder_j": before.bladder_energy - after.bladder_energy,
            "work_tendon_j": before.tendon_energy - after.tendon_energy,
        }
        for k, name in enumerate(self._snapshots.effect_names):
            side, other = mean[:, N_OUTPUTS + 2 * k], mean[:, N_OUTPUTS + 2 * k + 1]
            work[f"work_effect_{name}_j"] = -side * muscle_way - other * (unit_way - muscle_way)
        delivered = -at.tension * unit_way
        # One after the other: NumPy's own sum takes another order for one simulation than for many.
        work["work_unresolved_j"] = delivered - sum(work.values())
        drawn = after.air_drawn - before.air_drawn if self._supply_is_metered else after.air_mass - before.air_mass
        found = {
            **work,
            "work_delivered_j": delivered,
            "air_g": 1e3 * np.fmax(drawn, 0.0),
            "air_leaked_g": 1e3 * (after.air_leaked - before.air_leaked),
            "air_held_g": 1e3 * after.air_mass,
        }
        self._previous_outputs[mask], self._previous_lengths[mask] = told[mask], way[mask]
        return {name: np.asarray(value) for name, value in found.items()}

    def _evaluate(self, device_states: DeviceStates) -> tuple[Array, Array]:
        states = np.column_stack(
            [
                device_states.pressure,
                device_states.muscle_length,
                device_states.muscle_velocity,
                device_states.unit_length,
            ]
        )
        memory = (
            device_states.internal_state if self._has_internal_state else np.zeros((len(states), N_INTERNAL_STATES))
        )
        return self._snapshots.evaluate(states, memory), states[:, [1, 3]]
