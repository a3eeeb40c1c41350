"""Where the energy and the air of the device are at one step.

Powers flow *out of* an element into the rest of the device. With energies ``U`` and powers ``P``, over any
time: ``work on the ankle = sum(P) dt - change of (U_bladder + U_tendon)``. The tendon's and the bladders'
lines are energies, not powers, because both are potentials: a wrong sign or a lost step shows as a ledger
that does not close.
"""

from typing import NamedTuple

from klute_sim.device.step import Parameters, State, muscle_side, tension
from klute_sim.laws import damper as _damper
from klute_sim.laws import mckibben, pneumatics
from klute_sim.laws import tendon as _tendon


class Ledger(NamedTuple):
    """One step's entries."""

    gas_power: float
    """``P dV/dt``, from the compressed air [W]."""
    friction_power: float
    """From the printed friction offset [W]; either sign, because it is an offset and not a friction."""
    damper_power: float
    """From the damper [W]; never positive."""
    stop_power: float
    """From the length stops [W]; never positive: they are rigid, so they only take at the instant of impact."""
    effects_power: float
    """From what effects add to muscle, damper and tendon [W]; 0 without effects."""
    bladder_energy: float
    """Stored in the bladders [J]."""
    tendon_energy: float
    """Stored in the tendon [J]."""
    air_mass: float
    """Air in the muscles [kg], at the supply's gas temperature and without dead volume (assumed)."""


def entries(
    parameters: Parameters, before: State, after: State, unit_length: float, unit_rate: float, step: float
) -> Ledger:
    """Entries of the step that led from ``before`` to ``after`` in ``step`` [s].

    It ended at ``unit_length`` [m], which changes at ``unit_rate`` [m/s].
    """
    muscle, pressure, length = parameters.muscle, after.pressure, after.length
    rate = (length - before.length) / step
    gas = mckibben.gas_force(muscle, pressure, length)
    friction = mckibben.friction_force(muscle, pressure)
    damping = _damper.force(parameters.damper, rate)
    pull = tension(parameters, after, unit_length, rate)
    plain = gas + friction + damping + mckibben.bladder_force(muscle, length)
    whole = muscle_side(parameters, after.memory, pressure, length, rate)
    volume = mckibben.volume(muscle, length)
    stored, beyond = 0.0, 0.0
    if not parameters.tendon.rigid:
        stretch = unit_length - length - parameters.tendon.slack_length
        stored = _tendon.energy(parameters.tendon, stretch)
        beyond = pull - _tendon.force(parameters.tendon, stretch)
    return Ledger(
        gas_power=-gas * rate,
        friction_power=-friction * rate,
        damper_power=-damping * rate,
        stop_power=-(pull - whole) * rate,
        effects_power=-(whole - plain) * rate - beyond * (unit_rate - rate),
        bladder_energy=mckibben.bladder_energy(muscle, length),
        tendon_energy=stored,
        air_mass=pneumatics.air_mass(pressure, volume, parameters.supply.temperature),
    )
