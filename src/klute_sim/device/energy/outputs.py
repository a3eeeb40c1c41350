"""What the device does at one instant: which element pulls how hard, what is stored, how much air it holds."""

from typing import NamedTuple

from klute_sim.device.dynamics import (
    NO_EFFECTS,
    DeviceParameters,
    DeviceState,
    apply_supply_effects,
    compute_muscle_damper_force,
    compute_tendon_force,
    compute_tension,
)
from klute_sim.device.dynamics import get_gas_state as gas_of
from klute_sim.effects import catalogue
from klute_sim.laws import damper as _damper
from klute_sim.laws import mckibben, pneumatic_step
from klute_sim.laws import tendon as _tendon


class DeviceOutputs(NamedTuple):
    """Tensions [N] as the dissertation's laws have them, energies and air; effects are :func:`added`."""

    tension: float
    """What the unit delivers [N]."""
    gas_force: float
    """From the compressed air [N]."""
    friction_force: float
    """From the printed friction offset [N]."""
    bladder_force: float
    """[N]"""
    damper_force: float
    """[N]"""
    tendon_force: float
    """What the tendon carries [N]; a rigid tie carries all there is."""
    bladder_energy: float
    """Stored in the bladders [J]."""
    tendon_energy: float
    """Stored in the tendon [J]."""
    air_mass: float
    """Air in muscles and dead volume [kg]; of an ideal regulator's isothermal and without dead volume (assumed)."""
    air_drawn: float
    """Air taken since the start [kg], if the supply counts it; 0 if it remembers nothing."""
    air_leaked: float
    """Air lost through a leak since the start [kg]."""
    supply_pressure: float
    """What the supply has [Pa]: its own pressure, or what a tank still has, if that is less."""


def compute_outputs(
    parameters: DeviceParameters, state: DeviceState, unit_length: float, velocity: float
) -> DeviceOutputs:
    """The device in ``state`` at ``unit_length`` [m], with its muscle moving at ``rate`` [m/s]."""
    muscle, pressure, length = parameters.muscle, state.pressure, state.length
    pull = compute_tension(parameters, state, unit_length, velocity)
    carried, stored = pull, 0.0
    if not parameters.tendon.is_rigid:
        stretch = unit_length - length - parameters.tendon.slack_length
        carried, stored = _tendon.force(parameters.tendon, stretch), _tendon.stored_energy(parameters.tendon, stretch)
    supply, gas = apply_supply_effects(parameters, state.internal_state), gas_of(state)
    volume, most = mckibben.volume(muscle, length), mckibben.volume(muscle, muscle.resting_length)
    return DeviceOutputs(
        tension=pull,
        gas_force=mckibben.gas_force(muscle, pressure, length),
        friction_force=mckibben.friction_force(muscle, pressure),
        bladder_force=mckibben.bladder_force(muscle, length),
        damper_force=_damper.force(parameters.damper, velocity),
        tendon_force=carried,
        bladder_energy=mckibben.bladder_energy(muscle, length),
        tendon_energy=stored,
        air_mass=pneumatic_step.enclosed_air_mass(supply, gas, pressure, volume, most),
        air_drawn=gas.drawn_mass,
        air_leaked=gas.leaked_mass,
        supply_pressure=pneumatic_step.supply_pressure(supply, gas.drawn_mass),
    )


def compute_effect_forces(
    parameters: DeviceParameters,
    reduced_parameters: DeviceParameters,
    state: DeviceState,
    unit_length: float,
    velocity: float,
) -> tuple[float, float]:
    """By how much muscle side and tendon side [N] pull more in ``parameters`` than with the ``fewer`` effects of
    another one of :func:`stages`."""
    memory, pressure, length = state.internal_state, state.pressure, state.length
    muscle = compute_muscle_damper_force(parameters, memory, pressure, length, velocity)
    muscle -= compute_muscle_damper_force(reduced_parameters, memory, pressure, length, velocity)
    if parameters.tendon.is_rigid:
        return muscle, 0.0
    tendon = compute_tendon_force(parameters, memory, length, unit_length) - compute_tendon_force(
        reduced_parameters, memory, length, unit_length
    )
    return muscle, tendon


def accumulate_effects(parameters: DeviceParameters) -> tuple[tuple[str, ...], tuple[DeviceParameters, ...]]:
    """The device's effects, and the device with none, one, two ... and all of them, in the catalogue's order.

    What one effect does may depend on those before it; between two stages stands the share of one, and the shares
    make up the whole.
    """
    names, with_more = [], [parameters._replace(effects=NO_EFFECTS)]
    effects = list(NO_EFFECTS)
    for slot in catalogue.get_device_slots():
        if parameters.effects[slot.switch_index] != 0.0:
            end = slot.switch_index + 1 + len(slot.form.parameters)
            effects[slot.switch_index : end] = parameters.effects[slot.switch_index : end]
            effects[0] += 1.0
            names.append(slot.effect)
            with_more.append(parameters._replace(effects=tuple(effects)))
    return tuple(names), tuple(with_more)
