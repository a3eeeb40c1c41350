"""Where the energy of the device goes on its way from one sample to the next.

Powers flow *out of* an element into the rest of the device and are those of the step that ends at a sample: the mean
of the element's force at both ends times the way. The lines sum to what is delivered, to the last bits::

    delivered = gas + friction + damper + stop + bladder + tendon + effects + solver

Bladder and tendon are potentials: their lines are differences of stored energy, whatever happened in between. What a
straight line between two samples makes of their forces differs from that by the *solver's* line. It is no physics but
the error of a finite step, shrinks with the square of the step, and says how far the other lines can be trusted.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from klute_sim.device.dynamics import ZERO_INTERNAL_STATE, DeviceParameters, DeviceState, apply_supply_effects
from klute_sim.device.energy.outputs import DeviceOutputs, accumulate_effects, compute_effect_forces, compute_outputs
from klute_sim.laws import pneumatic_step
from klute_sim.units import BAR

Array = NDArray[np.float64]


class EnergyBalance(NamedTuple):
    """One entry per sample; the first knows of no step and is 0 in all powers."""

    gas_power: Array
    """``P dV/dt``, from the compressed air [W]."""
    friction_power: Array
    """From the printed friction offset [W]; either sign, because it is an offset and not a friction."""
    damper_power: Array
    """From the damper [W]."""
    stop_power: Array
    """From the length stops [W]; they are rigid, so they only take at the instant of impact."""
    bladder_power: Array
    """From the bladders' store [W]."""
    tendon_power: Array
    """From the tendon's store [W]."""
    effects_power: Array
    """From all effects on muscle, damper and tendon [W]; 0 without effects."""
    solver_power: Array
    """What the finite step seems to give [W]."""
    delivered_power: Array
    """To what the unit pulls on [W]."""
    bladder_energy: Array
    """Stored in the bladders [J]."""
    tendon_energy: Array
    """Stored in the tendon [J]."""
    air_mass: Array
    """Air in muscles and dead volume [kg]; of an ideal regulator's isothermal and without dead volume (assumed)."""
    air_drawn: Array
    """Air taken from the supply since the first sample [kg]."""
    air_leaked: Array
    """Air lost through a leak since the first sample [kg]; the rest of what came and is not there was let out."""
    supply_pressure: Array
    """What the supply, or the tank behind it, still has [bar], gauge."""
    effect_powers: Mapping[str, Array]
    """The share of each effect in ``effects_power`` [W], by name."""

    def to_columns(self) -> list[tuple[str, Array]]:
        """Recording columns ``name [unit]``, each with its samples."""
        own = [(format_effect_channel(name) + " [W]", power) for name, power in self.effect_powers.items()]
        return [*zip(COLUMN_HEADINGS, self[:-1], strict=True), *own]


_UNIT_OF_QUANTITY = {"power": "W", "energy": "J", "mass": "kg", "drawn": "kg", "leaked": "kg", "pressure": "bar"}
COLUMN_HEADINGS = tuple(f"{name} [{_UNIT_OF_QUANTITY[name.rsplit('_')[-1]]}]" for name in EnergyBalance._fields[:-1])
"""Columns of every recording; each effect has one of its own besides, :func:`of_effect`."""
POWER_TERMS = tuple(name for name in EnergyBalance._fields if name.endswith("_power") and name != "delivered_power")
"""Powers that sum to ``delivered_power``."""
SOLVER_TERM = "solver_power"
"""The one of them that is no physics."""


def format_effect_channel(name: str) -> str:
    """The channel with the share of an effect, which may be called like one of the lines."""
    return f"effect_{name}_power"


def compute_energy_balance(
    outputs: Array,
    effect_forces: Array,
    effect_names: Sequence[str],
    length: Array,
    unit_length: Array,
    dt: float,
    *,
    supply_meters_air: bool,
) -> EnergyBalance:
    """The ledger of a series of samples, one every ``step`` [s].

    ``instants`` (samples, fields of :class:`Instant`); ``own`` (samples, effects, 2) is what each of ``effects`` adds
    to the muscle side and to the tendon side [N]; muscle ``length`` and ``unit_length`` [m]. Unless the supply
    ``counts`` its air, what is drawn is what the muscle gains.
    """
    at: Any = DeviceOutputs(*np.ascontiguousarray(outputs.T))  # of arrays instead of numbers
    muscle_moved, moved = np.diff(length, prepend=length[0]), np.diff(unit_length, prepend=unit_length[0])
    stretched = moved - muscle_moved

    def given(force: Array, way: Array) -> Array:
        before = np.concatenate([force[:1], force[:-1]])
        return np.asarray(-0.5 * (before + force) * way / dt)

    def from_store(energy: Array) -> Array:
        return np.asarray(-np.diff(energy, prepend=energy[0]) / dt)

    bladder, tendon = from_store(at.bladder_energy), from_store(at.tendon_energy)
    gained = np.cumsum(np.maximum(np.diff(at.air_mass, prepend=at.air_mass[0]), 0.0))
    stop = at.tension - (
        at.gas_force + at.friction_force + at.bladder_force + at.damper_force + effect_forces[:, :, 0].sum(axis=1)
    )
    shares = {
        name: given(effect_forces[:, k, 0], muscle_moved) + given(effect_forces[:, k, 1], stretched)
        for k, name in enumerate(effect_names)
    }
    return EnergyBalance(
        gas_power=given(at.gas_force, muscle_moved),
        friction_power=given(at.friction_force, muscle_moved),
        damper_power=given(at.damper_force, muscle_moved),
        stop_power=given(stop, muscle_moved),
        bladder_power=bladder,
        tendon_power=tendon,
        effects_power=np.sum(list(shares.values()), axis=0) if shares else np.zeros(len(length)),
        solver_power=given(at.bladder_force, muscle_moved) - bladder + given(at.tendon_force, stretched) - tendon,
        delivered_power=given(at.tension, moved),
        bladder_energy=at.bladder_energy,
        tendon_energy=at.tendon_energy,
        air_mass=at.air_mass,
        air_drawn=at.air_drawn - at.air_drawn[0] if supply_meters_air else gained,
        air_leaked=at.air_leaked - at.air_leaked[0],
        supply_pressure=at.supply_pressure / BAR,
        effect_powers=shares,
    )


class EnergyRecorder:
    """What a ledger is made from, written down sample by sample."""

    def __init__(self, parameters: DeviceParameters, n_samples: int) -> None:
        """With room for that many ``samples`` of a device."""
        self._effect_names, self._cumulative_parameters = accumulate_effects(parameters)
        self._outputs = np.empty((n_samples, len(DeviceOutputs._fields)))
        self._effect_forces = np.empty((n_samples, len(self._effect_names), 2))
        self._lengths = np.empty((2, n_samples))
        self._supply_meters_air = not pneumatic_step.is_ideal(apply_supply_effects(parameters, ZERO_INTERNAL_STATE))

    def record_sample(self, index: int, state: DeviceState, unit_length: float, velocity: float) -> None:
        """The device in ``state`` at ``unit_length`` [m], with its muscle moving at ``rate`` [m/s]."""
        self._outputs[index] = compute_outputs(self._cumulative_parameters[-1], state, unit_length, velocity)
        for k, fewer in enumerate(self._cumulative_parameters[:-1]):
            self._effect_forces[index, k] = compute_effect_forces(
                self._cumulative_parameters[k + 1], fewer, state, unit_length, velocity
            )
        self._lengths[:, index] = state.length, unit_length

    def to_energy_balance(self, dt: float) -> EnergyBalance:
        """The ledger, when every sample is noted; one every ``step`` [s]."""
        length, unit_length = self._lengths
        return compute_energy_balance(
            self._outputs,
            self._effect_forces,
            self._effect_names,
            length,
            unit_length,
            dt,
            supply_meters_air=self._supply_meters_air,
        )
