"""What the device does at one instant: which element pulls how hard, what is stored, how much air it holds."""

from typing import NamedTuple

from klute_sim.device.step import NO_EFFECTS, Parameters, State, muscle_side, supplied, tendon_side, tension
from klute_sim.device.step import gas as gas_of
from klute_sim.effects import catalogue
from klute_sim.laws import charging, mckibben
from klute_sim.laws import damper as _damper
from klute_sim.laws import tendon as _tendon


class Instant(NamedTuple):
    """Tensions [N] as the dissertation's laws have them, energies and air; effects are :func:`added`."""

    tension: float
    """What the unit delivers [N]."""
    gas: float
    """From the compressed air [N]."""
    friction: float
    """From the printed friction offset [N]."""
    bladder: float
    """[N]"""
    damper: float
    """[N]"""
    tendon: float
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


def instant(parameters: Parameters, state: State, unit_length: float, rate: float) -> Instant:
    """The device in ``state`` at ``unit_length`` [m], with its muscle moving at ``rate`` [m/s]."""
    muscle, pressure, length = parameters.muscle, state.pressure, state.length
    pull = tension(parameters, state, unit_length, rate)
    carried, stored = pull, 0.0
    if not parameters.tendon.rigid:
        stretch = unit_length - length - parameters.tendon.slack_length
        carried, stored = _tendon.force(parameters.tendon, stretch), _tendon.energy(parameters.tendon, stretch)
    supply, gas = supplied(parameters, state.memory), gas_of(state)
    volume, most = mckibben.volume(muscle, length), mckibben.volume(muscle, muscle.resting_length)
    return Instant(
        tension=pull,
        gas=mckibben.gas_force(muscle, pressure, length),
        friction=mckibben.friction_force(muscle, pressure),
        bladder=mckibben.bladder_force(muscle, length),
        damper=_damper.force(parameters.damper, rate),
        tendon=carried,
        bladder_energy=mckibben.bladder_energy(muscle, length),
        tendon_energy=stored,
        air_mass=charging.held(supply, gas, pressure, volume, most),
        air_drawn=gas.drawn,
        air_leaked=gas.leaked,
        supply_pressure=charging.upstream(supply, gas.drawn),
    )


def added(
    parameters: Parameters, fewer: Parameters, state: State, unit_length: float, rate: float
) -> tuple[float, float]:
    """By how much muscle side and tendon side [N] pull more in ``parameters`` than with the ``fewer`` effects of
    another one of :func:`stages`."""
    memory, pressure, length = state.memory, state.pressure, state.length
    muscle = muscle_side(parameters, memory, pressure, length, rate)
    muscle -= muscle_side(fewer, memory, pressure, length, rate)
    if parameters.tendon.rigid:
        return muscle, 0.0
    tendon = tendon_side(parameters, memory, length, unit_length) - tendon_side(fewer, memory, length, unit_length)
    return muscle, tendon


def stages(parameters: Parameters) -> tuple[tuple[str, ...], tuple[Parameters, ...]]:
    """The device's effects, and the device with none, one, two ... and all of them, in the catalogue's order.

    What one effect does may depend on those before it; between two stages stands the share of one, and the shares
    make up the whole.
    """
    names, with_more = [], [parameters._replace(effects=NO_EFFECTS)]
    effects = list(NO_EFFECTS)
    for slot in catalogue.device_slots():
        if parameters.effects[slot.at] != 0.0:
            end = slot.at + 1 + len(slot.form.parameters)
            effects[slot.at : end] = parameters.effects[slot.at : end]
            effects[0] += 1.0
            names.append(slot.effect)
            with_more.append(parameters._replace(effects=tuple(effects)))
    return tuple(names), tuple(with_more)
