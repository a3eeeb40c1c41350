"""What an effect is: a name, a sentence, parameters, and laws at the hooks where it acts.

A law is a pure function of numbers, like those in :mod:`klute_sim.laws`, and runs as plain Python and compiled. It is
given what there would be without it and returns what there is with it, so effects can be chained. ``own`` are its
form's parameters in their order, SI; ``memory`` is what its form remembers (a tuple, empty unless ``Form.memory``).

==================  =====================================================================  =====
hook                arguments                                                              gives
==================  =====================================================================  =====
acting_pressure     own, memory, pressure, muscle, length                                  gauge pressure that the
                                                                                           muscle feels [Pa]
muscle_force        own, memory, force, muscle, pressure, length, rate                     tension [N]
damper_force        own, memory, force, rate                                               tension [N]
tendon_stretch      own, memory, stretch                                                   beyond slack length [m]
tendon_force        own, memory, force, stretch                                            tension [N], floored at 0
supply              own, memory, supply                                                    what the supply is then
pressure_target     own, memory, command                                                   what is regulated to [Pa]
pressure_reached    own, memory, target, pressure, step                                    a step later, before the
                                                                                           supply's rate limits it [Pa]
remember            own, memory, muscle, pressure, length, stretch, step                   the memory a step later
reading             own, time, value (arrays)                                              what an instrument shows
foot                own, foot                                                              what the foot is then, of
                                                                                           an effect of the body
==================  =====================================================================  =====

``length`` [m] and ``rate`` = d(length)/dt [m/s] are the muscle's, ``pressure`` [Pa] is the acting one. Where a form
remembers, its other laws are given the memory *after* the step: ``remember`` decides, the others follow. It must hold
for a step of any length, because a device at rest has rested long: see :mod:`klute_sim.effects.smoothing`. All memory
is zero for a muscle that rests at its resting length and a tendon that is just taut.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from klute_sim.units import to_si

FloatSequence = Sequence[float]
"""Parameters or memory of a form."""

HOOKS = (
    "acting_pressure",
    "muscle_force",
    "damper_force",
    "tendon_stretch",
    "tendon_force",
    "supply",
    "pressure_target",
    "pressure_reached",
    "remember",
    "reading",
    "foot",
)


@dataclass(frozen=True, kw_only=True)
class EffectParameter:
    """One number of a form, in the unit that its key ends with."""

    key: str
    neutral: float | None
    """The value without effect; None: a shape, which has none of its own."""
    lower: float
    upper: float
    typical: float
    """Of a size one meets in practice."""
    source: str
    """Where range and typical size are from; begins with 'assumed' if nobody printed them."""

    def to_si(self, value: float) -> float:
        """``value`` in SI."""
        return to_si(self.key, value)


@dataclass(frozen=True, kw_only=True)
class EffectForm:
    """One functional form of an effect."""

    name: str
    equation: str
    """The law in a line."""
    parameters: tuple[EffectParameter, ...]
    laws: Mapping[str, Callable[..., Any]] = field(default_factory=dict)
    """Hook -> law; none for what acts on a whole series (a dead time)."""
    n_states: int = 0
    """Numbers it remembers from step to step."""


@dataclass(frozen=True, kw_only=True)
class Effect:
    """A named effect."""

    name: str
    description: str
    kind: Literal["device", "body", "instrument"]
    forms: tuple[EffectForm, ...]
    """The usual one first."""
    replaces_switch: str = ""
    """A switch of the device file's ``[muscle]`` that must be off, because the device has the effect otherwise."""
    acts_in_supply: bool = False
    """Whether it acts in the gas supply, which may do work; the others, at constant pressure, may not.

    The dissertation's own friction offset can create some while the pressure changes, as its source has it.
    """

    data_driven: bool = False
    """Whether it is only a combination of functions fitted to data, which names nothing: no diagnosis proposes it as a
    name, nothing keeps it from giving energy, and a device file may leave out numbers that are neutral."""

    def find_form(self, name: str) -> EffectForm | None:
        """The form of that name."""
        return next((form for form in self.forms if form.name == name), None)
