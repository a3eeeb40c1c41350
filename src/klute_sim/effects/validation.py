"""Checks of an effect before it is registered: declarations are complete, and every law runs with realistic numbers."""

from collections.abc import Callable
from typing import Any

import numpy as np

from klute_sim.effects.effect import HOOKS, Effect, EffectForm
from klute_sim.errors import InputError
from klute_sim.laws import mckibben
from klute_sim.laws.damper import DamperParameters
from klute_sim.laws.foot import Foot
from klute_sim.laws.joint import NO_BRISTLE, Joint
from klute_sim.laws.pneumatics import SupplyParameters
from klute_sim.laws.tendon import TendonParameters


def check_effect(effect: Any, known_names: set[str]) -> None:
    """Raise InputError when ``effect`` is invalid or its name is among ``known_names``."""
    if not isinstance(effect, Effect):
        raise InputError(f"cannot register {effect!r}; allowed: klute_sim.Effect")
    if effect.name in known_names:
        raise InputError(f"cannot register effect '{effect.name}': an effect of that name exists; choose another name")
    if (effect.kind == "mechanism") != bool(effect.part):
        raise InputError(f"effect '{effect.name}': kind = 'mechanism' needs a part, and other kinds have none")
    for form in effect.forms:
        location = f"effect '{effect.name}', form '{form.name}'"
        for hook in form.laws:
            if hook not in HOOKS:
                raise InputError(f"{location}: unknown hook '{hook}'; allowed: {', '.join(HOOKS)}")
        if bool(form.states) != ("next_state" in form.laws):
            raise InputError(f"{location}: internal states need a law at 'next_state', and such a law needs states")
        if not form.parameters or form.parameters[0].neutral is None:
            raise InputError(f"{location}: the first parameter must have a neutral value")
        for hook, law in form.laws.items():
            _check_law(law, hook, form, f"{location}: the law at '{hook}'")


def _check_law(law: Callable[..., Any], hook: str, form: EffectForm, location: str) -> None:
    """Call ``law`` once with realistic numbers, so that an error in it is reported before it is compiled."""
    state = form.make_zero_state()
    p = form.pack({parameter.key: parameter.typical for parameter in form.parameters})
    muscle = mckibben.MuscleParameters(1.0, 0.2, 0.21, 1.3, 0.01, 0.002, 1e5, 1e4, 1e-4, 0.0)
    pressure, length, velocity, force, stretch, dt = 2e5, 0.19, 0.01, 300.0, 1e-3, 1e-3
    series = np.linspace(0.0, 1.0, 20)
    foot = Foot(*(0.1 for _ in Foot._fields))
    arguments: dict[str, tuple[Any, ...]] = {
        "acting_pressure": (p, state, pressure, muscle, length),
        "muscle_force": (p, state, force, muscle, pressure, length, velocity),
        "damper": (p, state, DamperParameters(1e4, 2e4, 5e-4)),
        "damper_force": (p, state, force, velocity),
        "tendon_stretch": (p, state, stretch),
        "tendon_force": (p, state, force, stretch, TendonParameters(0.1, 6e4, 1.4e5, 4e-3, False)),
        "supply": (p, state, SupplyParameters(5e5, 1e7, 293.15)),
        "pressure_target": (p, state, pressure),
        "pressure_reached": (p, state, pressure, pressure, dt),
        "next_state": (p, state, muscle, pressure, 0.0, length, stretch, dt),
        "reading": (p, series, series),
        "foot": (p, foot),
        "joint": (p, Joint(0.1, 0.1, 0.0, NO_BRISTLE)),
        "pulley": (p, 0.03),
        "gravity": (p, (0.0, 0.0, -9.81)),
    }
    try:
        result = law(*arguments[hook])
    except Exception as error:
        raise InputError(f"{location} fails: {type(error).__name__}: {error}") from None
    if hook == "next_state":
        is_valid = isinstance(result, tuple) and len(result) == form.n_states
        expected = f"a tuple of {form.n_states} (one number for each internal state)"
    elif hook == "supply":
        is_valid, expected = isinstance(result, SupplyParameters), "a klute_sim.laws.pneumatics.SupplyParameters"
    elif hook == "damper":
        is_valid, expected = isinstance(result, DamperParameters), "a klute_sim.laws.damper.DamperParameters"
    elif hook == "foot":
        is_valid, expected = isinstance(result, Foot), "a klute_sim.laws.foot.Foot"
    elif hook == "joint":
        is_valid, expected = isinstance(result, Joint), "a klute_sim.laws.joint.Joint"
    elif hook == "gravity":
        is_valid, expected = isinstance(result, tuple) and len(result) == 3, "a tuple of three numbers"
    elif hook == "reading":
        is_valid, expected = np.shape(result) == series.shape, "an array of the same shape as value"
    else:
        is_valid, expected = isinstance(result, float), "a float"
    if not is_valid:
        raise InputError(f"{location} returns {result!r}; allowed: {expected}")
