"""Outputs of a device at one instant: forces of its elements, stored energies and air."""

from typing import NamedTuple

from klute_sim.device.dynamics import (
    NO_EFFECTS,
    DeviceParameters,
    DeviceState,
    apply_supply_effects,
    compute_muscle_force,
    compute_tendon_force,
    compute_tension,
    get_gas_state,
)
from klute_sim.effects import catalogue
from klute_sim.laws import damper as _damper
from klute_sim.laws import mckibben, pneumatic_step
from klute_sim.laws import tendon as _tendon
from klute_sim.laws.mckibben import MuscleParameters


class DeviceOutputs(NamedTuple):
    """Forces of the dissertation's laws, energies and air; :func:`compute_effect_forces` gives those of effects."""

    tension: float
    """Tension of the muscle-tendon unit [N]."""
    gas_force: float
    """Tension of the compressed air [N]."""
    friction_force: float
    """Tension of the printed friction offset [N]."""
    bladder_force: float
    """Tension of the bladders [N]."""
    damper_force: float
    """Tension of the damper [N]."""
    tendon_force: float
    """Tension of the tendon [N]; a rigid tie carries the whole tension of the unit."""
    bladder_energy: float
    """Energy stored in the bladders [J]."""
    tendon_energy: float
    """Energy stored in the tendon [J]."""
    air_mass: float
    """Mass of the air in muscles and dead volume [kg]; isothermal for an ideal regulator (assumed)."""
    air_drawn: float
    """Mass of the air drawn from the supply since the start [kg]; 0 for an ideal regulator, which does not count it."""
    air_leaked: float
    """Mass of the air lost through a leak since the start [kg]."""
    supply_pressure: float
    """Gauge pressure of the supply [Pa]: its maximum pressure, or the pressure left in the tank if that is lower."""
    stop_force: float
    """Tension of the length stops [N], :func:`compute_stop_force`."""
    contact_pressure: float
    """Gauge pressure of the bladder on the braid [Pa], :func:`klute_sim.laws.mckibben.contact_pressure`."""
    braid_volume: float
    """Volume inside the braid [m3]; the work of the gas is the pressure times its change."""


STOP_CONTACT_TOLERANCE = 1e-12
"""Distance [m] from an end of the muscle's range that counts as contact: MuJoCo's states round the length."""


def compute_stop_force(muscle: MuscleParameters, length: float, imbalance: float) -> float:
    """Return the tension [N] of the muscle's length stops at ``length`` [m].

    ``imbalance`` is the tension of the tendon minus the force of muscle, damper and effects [N]. The stops are rigid
    and unilateral (Signorini's condition): in contact they carry the imbalance, at resting length only one that
    stretches the muscle and at lock length only one that shortens it. Away from them they carry nothing.
    """
    if length >= muscle.resting_length - STOP_CONTACT_TOLERANCE:
        return max(imbalance, 0.0)
    if length <= mckibben.lock_length(muscle) + STOP_CONTACT_TOLERANCE:
        return min(imbalance, 0.0)
    return 0.0


def compute_outputs(
    parameters: DeviceParameters, state: DeviceState, unit_length: float, velocity: float
) -> DeviceOutputs:
    """Return the outputs of the device in ``state`` at ``unit_length`` [m] and muscle ``velocity`` [m/s]."""
    muscle, pressure, length = parameters.muscle, state.pressure, state.length
    unit_tension = compute_tension(parameters, state, unit_length, velocity)
    tendon_force, tendon_energy, stop_force = unit_tension, 0.0, 0.0
    if not parameters.tendon.is_rigid:
        muscle_force = compute_muscle_force(parameters, state.internal_state, pressure, length, velocity)
        stop_force = compute_stop_force(muscle, length, unit_tension - muscle_force)
        stretch = unit_length - length - parameters.tendon.slack_length
        tendon_force, tendon_energy = (
            _tendon.force(parameters.tendon, stretch),
            _tendon.stored_energy(parameters.tendon, stretch),
        )
    supply, gas = apply_supply_effects(parameters, state.internal_state), get_gas_state(state)
    volume, resting_volume = mckibben.gas_volume(muscle, length), mckibben.gas_volume(muscle, muscle.resting_length)
    return DeviceOutputs(
        tension=unit_tension,
        gas_force=mckibben.gas_force(muscle, pressure, length),
        friction_force=mckibben.friction_force(muscle, pressure),
        bladder_force=mckibben.bladder_force(muscle, length),
        damper_force=_damper.force(parameters.damper, velocity),
        tendon_force=tendon_force,
        bladder_energy=mckibben.bladder_energy(muscle, length),
        tendon_energy=tendon_energy,
        air_mass=pneumatic_step.enclosed_air_mass(supply, gas, pressure, volume, resting_volume),
        air_drawn=gas.drawn_mass,
        air_leaked=gas.leaked_mass,
        supply_pressure=pneumatic_step.supply_pressure(supply, gas.drawn_mass),
        stop_force=stop_force,
        contact_pressure=mckibben.contact_pressure(pressure),
        braid_volume=mckibben.braid_volume(muscle, length),
    )


def compute_effect_forces(
    parameters: DeviceParameters,
    reduced_parameters: DeviceParameters,
    state: DeviceState,
    unit_length: float,
    velocity: float,
) -> tuple[float, float]:
    """Return the forces [N] that the effects in ``parameters`` add to muscle and tendon beyond ``reduced_parameters``.

    Both devices are entries of :func:`accumulate_effects`.
    """
    internal_state, pressure, length = state.internal_state, state.pressure, state.length
    muscle = compute_muscle_force(parameters, internal_state, pressure, length, velocity)
    muscle -= compute_muscle_force(reduced_parameters, internal_state, pressure, length, velocity)
    if parameters.tendon.is_rigid:
        return muscle, 0.0
    tendon = compute_tendon_force(parameters, internal_state, length, unit_length) - compute_tendon_force(
        reduced_parameters, internal_state, length, unit_length
    )
    return muscle, tendon


def accumulate_effects(parameters: DeviceParameters) -> tuple[tuple[str, ...], tuple[DeviceParameters, ...]]:
    """Return the names of the device's effects, and the device with none, one, two ... and all of them.

    The order is that of the catalogue. The action of an effect may depend on the effects before it. The difference of
    two consecutive devices is the contribution of one effect, and the contributions sum to the total.
    """
    active = [slot for slot in catalogue.get_device_slots() if parameters.effects[slot.switch_index] != 0.0]
    cumulative = [parameters._replace(effects=NO_EFFECTS)]
    for count in range(1, len(active) + 1):
        effects = catalogue.select_effects(parameters.effects, active[:count].__contains__)
        cumulative.append(parameters._replace(effects=effects))
    return tuple(slot.effect for slot in active), tuple(cumulative)
