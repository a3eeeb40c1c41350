"""Definition of an effect: a name, a description, forms with parameters, and the laws of each form.

A law is a pure function of numbers, like those in :mod:`klute_sim.laws`; the same source runs as plain Python and
compiled. A law receives the value without the effect and returns the value with it, so that effects can be chained. It
is attached to one of these hooks:

==================  ===========================================================  ==================================
hook                arguments                                                    result
==================  ===========================================================  ==================================
acting_pressure     p, state, pressure, muscle, length                           gauge pressure acting on the braid
                                                                                 [Pa]
muscle_force        p, state, force, muscle, pressure, length, velocity          muscle tension [N]
damper              p, state, damper                                             parameters of the damper
damper_force        p, state, force, velocity                                    damper tension [N]
tendon_stretch      p, state, stretch                                            stretch beyond slack length [m]
tendon_force        p, state, force, stretch, tendon                             tendon tension [N], clipped at 0
supply              p, state, supply                                             parameters of the supply
pressure_target     p, state, command                                            target of the regulator [Pa]
pressure_reached    p, state, target, pressure, dt                               pressure after the step, before the
                                                                                 supply limits its rate [Pa]
next_state          p, state, muscle, pressure, pressure_change, length,         internal state after the step
                    stretch, dt
reading             p, time, value (arrays)                                      reading of the instrument
foot                p, foot                                                      parameters of the foot
joint               p, joint                                                     parameters of the joint
pulley              p, radius                                                    radius of the pulley [m]
gravity             p, gravity (three numbers)                                   gravity [m/s2]
==================  ===========================================================  ==================================

``p`` holds the form's parameters in SI units, named as in their keys without the unit: ``stiffness_n_per_mm`` is
``p.stiffness`` [N/m]. ``state`` holds the form's internal states by name. ``muscle`` is a
:class:`~klute_sim.laws.mckibben.MuscleParameters`, ``length`` [m] and ``velocity`` = d(length)/dt [m/s] are those of
the muscle, ``pressure`` [Pa] is the acting one, ``pressure_change`` [Pa] is that which the supply causes in the step
(the motion of the muscle adds to it; no force may depend on it), and ``dt`` [s] is the time step.

A law at ``next_state`` returns a tuple, one number for each internal state. The other laws of the form receive the
state *after* the step. ``next_state`` must hold for a step of any length, because a device in equilibrium has rested
for :data:`klute_sim.effects.smoothing.EQUILIBRIUM_TIME_STEP`. All internal states are zero for a muscle at its resting
length with a tendon that is just taut.
"""

from collections import namedtuple
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

from klute_sim.units import split_unit, to_si

HOOKS = (
    "acting_pressure",
    "muscle_force",
    "damper",
    "damper_force",
    "tendon_stretch",
    "tendon_force",
    "supply",
    "pressure_target",
    "pressure_reached",
    "next_state",
    "reading",
    "foot",
    "joint",
    "pulley",
    "gravity",
)
"""Names of all hooks."""
SEPARATE_HOOKS = ("next_state", "reading", "foot", "joint", "pulley", "gravity")
"""Hooks whose laws do not change a value of the device step."""


@dataclass(frozen=True, kw_only=True)
class EffectParameter:
    """One parameter of a form; its values have the unit at the end of its key."""

    key: str
    """Name in files, with the unit: ``stiffness_n_per_mm``."""
    neutral: float | None
    """Value without effect; None for a shape parameter, which has no neutral value."""
    lower: float
    """Smallest allowed value."""
    upper: float
    """Largest allowed value."""
    typical: float
    """Value of a magnitude that occurs in practice."""
    source: str
    """Source of range and typical value; begins with 'assumed' if neither is published."""
    physical_limits: tuple[float, ...] = ()
    """Ends of the range where physics ends, too, as those of isothermal and adiabatic change, or where a part of the
    effect is absent: a fit may end there."""
    diameter_exponent: float = 0.0
    """Power of the muscle's diameter with which the value changes in an otherwise equal muscle of another diameter; 0
    for ratios and where the law itself contains the diameter."""

    @property
    def name(self) -> str:
        """Name without the unit."""
        return split_unit(self.key)[0].removesuffix("_per")

    def to_si(self, value: float) -> float:
        """Convert ``value`` from the unit of the key to SI."""
        return to_si(self.key, value)


@dataclass(frozen=True, kw_only=True)
class EffectForm:
    """One functional form of an effect."""

    name: str
    """Name in device files."""
    equation: str
    """Equation in one line, written as :mod:`klute_sim.report.effects.formulas` reads it."""
    parameters: tuple[EffectParameter, ...]
    """Parameters; the first one has a neutral value."""
    laws: Mapping[str, Callable[..., Any]] = field(default_factory=dict)
    """Law of each hook; empty for a form that acts on a whole time series (a dead time)."""
    states: tuple[str, ...] = ()
    """Names of the internal states, which the law at ``next_state`` advances."""
    holds_friction: bool = False
    """Whether the internal states hold a dry friction at rest: a trial may begin with that of an earlier motion."""
    candidate_sections: tuple[str, ...] = ()
    """Sections that a device file must have for a diagnosis to propose this form: without them it has no cause."""
    find_flaw: Callable[[Any], str] | None = None
    """Function of ``p`` that returns why no part has these parameters, words that follow the name, or '' if parts have
    them. A diagnosis does not name such a part. None: parts have all parameters within the bounds."""
    replaces_number: str = ""
    """Number of a joint that describes the same; a diagnosis proposes this form where the model has 0 there."""

    @property
    def n_states(self) -> int:
        """Number of internal states."""
        return len(self.states)

    @cached_property
    def parameter_type(self) -> Callable[..., Any]:
        """Named tuple of the parameters, the ``p`` of the laws."""
        return _make_named_tuple("Parameters", [parameter.name for parameter in self.parameters])

    @cached_property
    def state_type(self) -> Callable[..., Any]:
        """Named tuple of the internal states, the ``state`` of the laws."""
        return _make_named_tuple("State", self.states)

    def pack(self, values: Mapping[str, float]) -> Any:
        """Return the ``p`` of the laws for parameter ``values`` by key, in the units of the keys."""
        return self.parameter_type(*(parameter.to_si(values[parameter.key]) for parameter in self.parameters))

    def make_zero_state(self) -> Any:
        """Return the ``state`` of the laws for a muscle at its resting length."""
        return self.state_type(*(0.0 for _ in self.states))


def _make_named_tuple(name: str, fields: Sequence[str]) -> Callable[..., Any]:
    return namedtuple(name, fields)


@dataclass(frozen=True, kw_only=True)
class Effect:
    """A named effect."""

    name: str
    """Name in device files."""
    description: str
    """One sentence on the effect's cause and consequence."""
    kind: Literal["device", "body", "instrument", "mechanism", "number", "model number"]
    """What has the effect. The catalogue has no 'number' (a wrong number of the device file) and no 'model number' (one
    of the model of a mechanism)."""
    forms: tuple[EffectForm, ...]
    """Functional forms; the default one first."""
    part: Literal["", "hinge joint", "slide joint", "pulley", "rig", "position channel"] = ""
    """Kind of the part of a mechanism that has the effect; empty for effects of other kinds."""
    replaces_switch: str = ""
    """Key of ``[muscle]`` in the device file that must be off, because it switches on the same physics."""
    acts_in_supply: bool = False
    """Whether the effect acts in the gas supply, which may do work.

    All other effects are passive at constant pressure. One exception follows its source: the dissertation's friction
    offset can create energy while the pressure changes.
    """

    data_driven: bool = False
    """Whether the effect is only a combination of functions fitted to data.

    A diagnosis does not propose such an effect as a cause, the effect may create energy, and a device file may omit its
    neutral parameters.
    """

    @property
    def acts_on_damper(self) -> bool:
        """Whether the effect changes the force of the damper, which depends on the velocity."""
        return any(hook in form.laws for form in self.forms for hook in ("damper", "damper_force"))

    def find_form(self, name: str) -> EffectForm | None:
        """Return the form called ``name``; None if there is none."""
        return next((form for form in self.forms if form.name == name), None)
