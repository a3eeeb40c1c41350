"""Energy balance of a device between consecutive samples.

A power is positive where energy flows *out of* an element into the rest of the device. It belongs to the time step that
ends at a sample. Every term follows from the law of its own element, so nothing closes by construction:

- gas: mean pressure of the step times the change of the volume inside the braid;
- bladder and tendon: difference of the stored energy, since both are potentials;
- damper and effects on it: the force at the speed of the step times the displacement;
- friction offset, stops and other effects: mean of the force at both ends times the displacement;
- delivered: mean tension at both ends times the displacement of the unit.

Two residuals check the balance. ``force_residual`` is the tension minus the sum of the forces at the junction; only
the tolerance of :data:`klute_sim.device.dynamics.FORCE_TOLERANCE` and rounding remain. ``residual_power`` is the
delivered power minus the sum of the terms. The implicit time step pairs the damper's force in the middle of a step with
the other forces at its end, so the residual is proportional to the time step; a wrong force or a wrong stored energy
shows in it, too.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from klute_sim.device.dynamics import ZERO_INTERNAL_STATE, DeviceParameters, DeviceState, apply_supply_effects
from klute_sim.device.energy.outputs import (
    DeviceOutputs,
    accumulate_effects,
    compute_effect_forces,
    compute_outputs,
)
from klute_sim.effects import catalogue
from klute_sim.laws import pneumatic_step
from klute_sim.types import Array
from klute_sim.units import BAR


class EnergyBalance(NamedTuple):
    """Energy balance with one entry per sample; at the first sample all powers are 0."""

    gas_power: Array
    """Power ``P dV/dt`` of the compressed air [W], with the volume inside the braid."""
    friction_power: Array
    """Power of the printed friction offset [W]; of either sign, because the offset is not a dissipative friction."""
    damper_power: Array
    """Power of the damper [W]."""
    stop_power: Array
    """Power of the length stops [W]; the stops are rigid, so they absorb energy only at an impact."""
    bladder_power: Array
    """Power released from the energy stored in the bladders [W]."""
    tendon_power: Array
    """Power released from the energy stored in the tendon [W]."""
    effects_power: Array
    """Power of all effects on muscle, damper and tendon [W]; 0 without effects."""
    delivered_power: Array
    """Power delivered to the load of the unit [W]."""
    residual_power: Array
    """Delivered power that the terms do not account for [W]."""
    force_residual: Array
    """Tension that the forces at the junction do not account for [N]."""
    bladder_energy: Array
    """Energy stored in the bladders [J]."""
    tendon_energy: Array
    """Energy stored in the tendon [J]."""
    air_mass: Array
    """Mass of the air in muscles and dead volume [kg]; isothermal for an ideal regulator (assumed)."""
    air_drawn: Array
    """Mass of the air drawn from the supply since the first sample [kg]."""
    air_leaked: Array
    """Mass of the air lost through a leak since the first sample [kg]; the rest of the drawn air was exhausted."""
    supply_pressure: Array
    """Gauge pressure left in the supply or its tank [bar]."""
    effect_powers: Mapping[str, Array]
    """Contribution of each effect to ``effects_power`` [W], by name of the effect."""

    def to_columns(self) -> list[tuple[str, Array]]:
        """Return recording columns ``name [unit]``, each with its samples."""
        effect_columns = [(format_effect_channel(name) + " [W]", power) for name, power in self.effect_powers.items()]
        return [*zip(COLUMN_HEADINGS, self[:-1], strict=True), *effect_columns]


_UNIT_OF_QUANTITY = {
    "power": "W",
    "energy": "J",
    "mass": "kg",
    "drawn": "kg",
    "leaked": "kg",
    "pressure": "bar",
    "residual": "N",
}
COLUMN_HEADINGS = tuple(f"{name} [{_UNIT_OF_QUANTITY[name.rsplit('_')[-1]]}]" for name in EnergyBalance._fields[:-1])
"""Columns of every recording; each effect has one more, :func:`format_effect_channel`."""
POWER_TERMS = tuple(
    name
    for name in EnergyBalance._fields
    if name.endswith("_power") and name not in ("delivered_power", "residual_power")
)
"""Powers of the elements; with ``residual_power`` they sum to ``delivered_power``."""


def format_effect_channel(name: str) -> str:
    """Return the channel name for the power of effect ``name``; the prefix distinguishes it from the power terms."""
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
    """Return the energy balance of samples that are ``dt`` [s] apart.

    ``outputs`` (samples, fields of :class:`DeviceOutputs`) and ``effect_forces`` (samples, effects, 2), the forces [N]
    that each of ``effect_names`` adds to muscle and tendon, belong to muscle ``length`` and ``unit_length`` [m]. Where
    the supply does not meter its air (``supply_meters_air``), the drawn air is the gain of air in the muscle.
    """
    series: Any = DeviceOutputs(*np.ascontiguousarray(outputs.T))  # arrays in place of numbers
    muscle_step, unit_step = np.diff(length, prepend=length[0]), np.diff(unit_length, prepend=unit_length[0])
    tendon_step = unit_step - muscle_step

    def mean(values: Array) -> Array:
        return np.asarray(0.5 * (np.concatenate([values[:1], values[:-1]]) + values))

    def rate(values: Array) -> Array:
        return np.asarray(np.diff(values, prepend=values[0]) / dt)

    def work_rate(force: Array, displacement: Array) -> Array:
        return np.asarray(-mean(force) * displacement / dt)

    gained_air = np.cumsum(np.maximum(np.diff(series.air_mass, prepend=series.air_mass[0]), 0.0))
    muscle_side = (
        series.gas_force
        + series.friction_force
        + series.bladder_force
        + series.damper_force
        + series.stop_force
        + effect_forces[:, :, 0].sum(axis=1)
    )
    effects = catalogue.get_effects()
    effect_powers = {
        name: (
            -effect_forces[:, k, 0] * muscle_step / dt
            if effects[name].acts_on_damper
            else work_rate(effect_forces[:, k, 0], muscle_step) + work_rate(effect_forces[:, k, 1], tendon_step)
        )
        for k, name in enumerate(effect_names)
    }
    terms = {
        "gas_power": mean(series.contact_pressure) * rate(series.braid_volume),
        "friction_power": work_rate(series.friction_force, muscle_step),
        "damper_power": -series.damper_force * muscle_step / dt,
        "stop_power": work_rate(series.stop_force, muscle_step),
        "bladder_power": -rate(series.bladder_energy),
        "tendon_power": -rate(series.tendon_energy),
        "effects_power": np.sum(list(effect_powers.values()), axis=0) if effect_powers else np.zeros(len(length)),
    }
    delivered_power = work_rate(series.tension, unit_step)
    return EnergyBalance(
        **terms,
        delivered_power=delivered_power,
        residual_power=delivered_power - np.sum(list(terms.values()), axis=0),
        force_residual=series.tension - muscle_side,
        bladder_energy=series.bladder_energy,
        tendon_energy=series.tendon_energy,
        air_mass=series.air_mass,
        air_drawn=series.air_drawn - series.air_drawn[0] if supply_meters_air else gained_air,
        air_leaked=series.air_leaked - series.air_leaked[0],
        supply_pressure=series.supply_pressure / BAR,
        effect_powers=effect_powers,
    )


class EnergyRecorder:
    """Record sample by sample what an energy balance needs."""

    def __init__(self, parameters: DeviceParameters, n_samples: int) -> None:
        """Allocate memory for ``n_samples`` samples of a device."""
        self._effect_names, self._cumulative_parameters = accumulate_effects(parameters)
        self._outputs = np.empty((n_samples, len(DeviceOutputs._fields)))
        self._effect_forces = np.empty((n_samples, len(self._effect_names), 2))
        self._lengths = np.empty((2, n_samples))
        self._supply_meters_air = not pneumatic_step.is_ideal(apply_supply_effects(parameters, ZERO_INTERNAL_STATE))

    def record_sample(self, index: int, state: DeviceState, unit_length: float, velocity: float) -> None:
        """Record the device in ``state`` at ``unit_length`` [m] and muscle ``velocity`` [m/s] as sample ``index``."""
        self._outputs[index] = compute_outputs(self._cumulative_parameters[-1], state, unit_length, velocity)
        for k, reduced_parameters in enumerate(self._cumulative_parameters[:-1]):
            self._effect_forces[index, k] = compute_effect_forces(
                self._cumulative_parameters[k + 1], reduced_parameters, state, unit_length, velocity
            )
        self._lengths[:, index] = state.length, unit_length

    def to_energy_balance(self, dt: float) -> EnergyBalance:
        """Return the energy balance of all samples, which are ``dt`` [s] apart."""
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
