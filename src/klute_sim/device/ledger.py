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

from klute_sim.device.instant import Instant, added, instant, stages
from klute_sim.device.step import NO_MEMORY, Parameters, State, supplied
from klute_sim.laws import charging
from klute_sim.units import BAR

Array = NDArray[np.float64]


class Ledger(NamedTuple):
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
    shares: Mapping[str, Array]
    """The share of each effect in ``effects_power`` [W], by name."""

    def columns(self) -> list[tuple[str, Array]]:
        """Recording columns ``name [unit]``, each with its samples."""
        own = [(of_effect(name) + " [W]", power) for name, power in self.shares.items()]
        return [*zip(HEADINGS, self[:-1], strict=True), *own]


_UNITS = {"power": "W", "energy": "J", "mass": "kg", "drawn": "kg", "leaked": "kg", "pressure": "bar"}
HEADINGS = tuple(f"{name} [{_UNITS[name.rsplit('_')[-1]]}]" for name in Ledger._fields[:-1])
"""Columns of every recording; each effect has one of its own besides, :func:`of_effect`."""
LINES = tuple(name for name in Ledger._fields if name.endswith("_power") and name != "delivered_power")
"""Powers that sum to ``delivered_power``."""
SOLVER = "solver_power"
"""The one of them that is no physics."""


def of_effect(name: str) -> str:
    """The channel with the share of an effect, which may be called like one of the lines."""
    return f"effect_{name}_power"


def ledger(
    instants: Array,
    own: Array,
    effects: Sequence[str],
    length: Array,
    unit_length: Array,
    step: float,
    *,
    counts: bool,
) -> Ledger:
    """The ledger of a series of samples, one every ``step`` [s].

    ``instants`` (samples, fields of :class:`Instant`); ``own`` (samples, effects, 2) is what each of ``effects`` adds
    to the muscle side and to the tendon side [N]; muscle ``length`` and ``unit_length`` [m]. Unless the supply
    ``counts`` its air, what is drawn is what the muscle gains.
    """
    at: Any = Instant(*np.ascontiguousarray(instants.T))  # of arrays instead of numbers
    muscle_moved, moved = np.diff(length, prepend=length[0]), np.diff(unit_length, prepend=unit_length[0])
    stretched = moved - muscle_moved

    def given(force: Array, way: Array) -> Array:
        before = np.concatenate([force[:1], force[:-1]])
        return np.asarray(-0.5 * (before + force) * way / step)

    def from_store(energy: Array) -> Array:
        return np.asarray(-np.diff(energy, prepend=energy[0]) / step)

    bladder, tendon = from_store(at.bladder_energy), from_store(at.tendon_energy)
    gained = np.cumsum(np.maximum(np.diff(at.air_mass, prepend=at.air_mass[0]), 0.0))
    stop = at.tension - (at.gas + at.friction + at.bladder + at.damper + own[:, :, 0].sum(axis=1))
    shares = {
        name: given(own[:, k, 0], muscle_moved) + given(own[:, k, 1], stretched) for k, name in enumerate(effects)
    }
    return Ledger(
        gas_power=given(at.gas, muscle_moved),
        friction_power=given(at.friction, muscle_moved),
        damper_power=given(at.damper, muscle_moved),
        stop_power=given(stop, muscle_moved),
        bladder_power=bladder,
        tendon_power=tendon,
        effects_power=np.sum(list(shares.values()), axis=0) if shares else np.zeros(len(length)),
        solver_power=given(at.bladder, muscle_moved) - bladder + given(at.tendon, stretched) - tendon,
        delivered_power=given(at.tension, moved),
        bladder_energy=at.bladder_energy,
        tendon_energy=at.tendon_energy,
        air_mass=at.air_mass,
        air_drawn=at.air_drawn - at.air_drawn[0] if counts else gained,
        air_leaked=at.air_leaked - at.air_leaked[0],
        supply_pressure=at.supply_pressure / BAR,
        shares=shares,
    )


class Book:
    """What a ledger is made from, written down sample by sample."""

    def __init__(self, parameters: Parameters, samples: int) -> None:
        """With room for that many ``samples`` of a device."""
        self._names, self._stages = stages(parameters)
        self._instants = np.empty((samples, len(Instant._fields)))
        self._own = np.empty((samples, len(self._names), 2))
        self._lengths = np.empty((2, samples))
        self._counts = not charging.plain(supplied(parameters, NO_MEMORY))

    def note(self, sample: int, state: State, unit_length: float, rate: float) -> None:
        """The device in ``state`` at ``unit_length`` [m], with its muscle moving at ``rate`` [m/s]."""
        self._instants[sample] = instant(self._stages[-1], state, unit_length, rate)
        for k, fewer in enumerate(self._stages[:-1]):
            self._own[sample, k] = added(self._stages[k + 1], fewer, state, unit_length, rate)
        self._lengths[:, sample] = state.length, unit_length

    def ledger(self, step: float) -> Ledger:
        """The ledger, when every sample is noted; one every ``step`` [s]."""
        length, unit_length = self._lengths
        return ledger(self._instants, self._own, self._names, length, unit_length, step, counts=self._counts)
