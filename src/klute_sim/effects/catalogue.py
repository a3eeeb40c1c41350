"""Every effect that is known in this process: those that come with the package, and the user's own.

The user's are in a Python file that the environment variable ``KLUTE_SIM_CATALOGUE`` names when the package is first
used: it defines ``EFFECTS``, a list of :class:`klute_sim.effects.effect.Effect`. *The file is run.*
"""

import importlib.util
import os
import sys
import types
import zlib
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from klute_sim.effects import (
    air,
    bladder_relaxation,
    bladder_wall,
    body,
    braid_extensibility,
    braid_hysteresis,
    damper,
    end_taper,
    instrument,
    ladder,
    muscle_damping,
    supply,
    tendon,
    threshold_pressure,
    unknown,
)
from klute_sim.effects import hooks as _hooks
from klute_sim.effects.effect import HOOKS, Effect, Form
from klute_sim.errors import InputError, meant
from klute_sim.laws import mckibben
from klute_sim.laws.foot import Foot
from klute_sim.laws.pneumatics import Supply

VARIABLE = "KLUTE_SIM_CATALOGUE"

BUILT_IN = (
    # Where two act at one hook, the earlier acts first.
    threshold_pressure.EFFECT,
    end_taper.EFFECT,
    braid_extensibility.EFFECT,
    ladder.BLADDER,
    bladder_wall.THICK,
    bladder_wall.SOFTENING,
    ladder.FRICTION,
    braid_hysteresis.EFFECT,
    muscle_damping.EFFECT,
    bladder_relaxation.EFFECT,
    air.DROOP,
    air.CHOKED,
    air.COUPLING,
    air.LEAK,
    supply.ERROR,
    supply.LAG,
    supply.DELAY,
    damper.DISCHARGE,
    damper.LAMINAR,
    damper.AIR,
    damper.SEAL,
    tendon.SLACK,
    tendon.STIFFENING,
    tendon.HYSTERESIS,
    # Last, and outside of the equations they are terms of.
    unknown.FORCE,
    unknown.TENDON,
    unknown.PRESSURE,
    body.FRICTION,
    body.SPRING,
    body.STOP,
    body.ARM,
    body.INERTIA,
    body.KEEL,
    body.LOSS,
    body.SOCKET,
    instrument.GAIN,
    instrument.OFFSET,
    instrument.DRIFT,
    instrument.LAG,
    instrument.SKEW,
    instrument.QUANTISATION,
)


@cache
def effects() -> dict[str, Effect]:
    """Name -> effect; raises InputError if the user's file is not one."""
    found = {effect.name: effect for effect in BUILT_IN}
    for effect in getattr(users(), "EFFECTS", []):
        _check(effect, found)
        found[effect.name] = effect
    return found


def named() -> dict[str, Effect]:
    """Those of :func:`effects` that are names: not the data-driven ones."""
    return {name: effect for name, effect in effects().items() if not effect.data_driven}


def use(file: str | Path) -> None:
    """Add the effects of ``file`` from here on, in this process and those it starts.

    Raises InputError when the package has been used already: a law that runs is not changed.
    """
    wanted = str(Path(file).resolve())
    if effects.cache_info().currsize and os.environ.get(VARIABLE) != wanted:
        raise InputError("the catalogue is in use already: name your effects before anything is simulated")
    os.environ[VARIABLE] = wanted
    effects()


@cache
def users() -> types.ModuleType | None:
    """The user's file, run; None if there is none."""
    named = os.environ.get(VARIABLE, "")
    if not named:
        return None
    file = Path(named)
    if not file.is_file():
        raise InputError(f"catalogue {named} does not exist (from --catalogue or {VARIABLE})")
    spec = importlib.util.spec_from_file_location("klute_sim_users_effects", file)
    if spec is None or spec.loader is None:
        raise InputError(f"catalogue {named} is no Python file; allowed: one that ends with .py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise InputError(f"catalogue {named} cannot be run: {type(error).__name__}: {error}") from None
    if not isinstance(getattr(module, "EFFECTS", None), list):
        raise InputError(f"catalogue {named} has no EFFECTS; allowed: EFFECTS = [Effect(...), ...]")
    return module


def _check(effect: Any, known: Mapping[str, Effect]) -> None:
    where = f"catalogue {os.environ.get(VARIABLE)}"
    if not isinstance(effect, Effect):
        raise InputError(f"{where}: EFFECTS holds {effect!r}; allowed: klute_sim.effects.effect.Effect")
    if effect.name in known:
        raise InputError(f"{where}: there is an effect '{effect.name}' already")
    for form in effect.forms:
        here = f"{where}: effect '{effect.name}', form '{form.name}'"
        for hook in form.laws:
            if hook not in HOOKS:
                raise InputError(f"{here}: there is no hook '{hook}'; allowed: {', '.join(HOOKS)}")
        if bool(form.memory) != ("remember" in form.laws):
            raise InputError(f"{here}: memory and a law at 'remember' go together")
        if not form.parameters or form.parameters[0].neutral is None:
            raise InputError(f"{here}: its first parameter must have a neutral value")
        for hook, law in form.laws.items():
            _try(law, hook, form, f"{here}: its law at '{hook}'")


def _try(law: Callable[..., Any], hook: str, form: Form, where: str) -> None:
    """Call ``law`` once with numbers as they occur, so that a slip in it is told before anything is compiled."""
    own = tuple(parameter.si(parameter.typical) for parameter in form.parameters)
    memory = (0.0,) * form.memory
    muscle = mckibben.Muscle(1.0, 0.2, 0.21, 1.3, 0.01, 0.002, 1e5, 1e4, 1e-4, 0.0)
    pressure, length, rate, force, stretch, step = 2e5, 0.19, 0.01, 300.0, 1e-3, 1e-3
    series = np.linspace(0.0, 1.0, 20)
    foot = Foot(*(0.1 for _ in Foot._fields))
    arguments: dict[str, tuple[Any, ...]] = {
        "acting_pressure": (own, memory, pressure, muscle, length),
        "muscle_force": (own, memory, force, muscle, pressure, length, rate),
        "damper_force": (own, memory, force, rate),
        "tendon_stretch": (own, memory, stretch),
        "tendon_force": (own, memory, force, stretch),
        "supply": (own, memory, Supply(5e5, 1e7, 293.15)),
        "pressure_target": (own, memory, pressure),
        "pressure_reached": (own, memory, pressure, pressure, step),
        "remember": (own, memory, muscle, pressure, length, stretch, step),
        "reading": (own, series, series),
        "foot": (own, foot),
    }
    try:
        found = law(*arguments[hook])
    except Exception as error:
        raise InputError(f"{where} fails: {type(error).__name__}: {error}") from None
    if hook == "remember":
        good = isinstance(found, tuple) and len(found) == form.memory
        wanted = f"a tuple of {form.memory} (as many as it remembers)"
    elif hook == "supply":
        good, wanted = isinstance(found, Supply), "a klute_sim.laws.pneumatics.Supply"
    elif hook == "foot":
        good, wanted = isinstance(found, Foot), "a klute_sim.laws.foot.Foot"
    elif hook == "reading":
        good, wanted = np.shape(found) == series.shape, "an array like the one it was given"
    else:
        good, wanted = isinstance(found, float), "a float"
    if not good:
        raise InputError(f"{where} gives {found!r}; allowed: {wanted}")


@cache
def device_slots() -> tuple[_hooks.Slot, ...]:
    """Places of all forms of effects on the device."""
    forms = [(e.name, form) for e in effects().values() if e.kind == "device" for form in e.forms]
    return tuple(_hooks.slots(forms))


@cache
def sizes() -> tuple[int, int]:
    """How many values a device has, and how many numbers it remembers."""
    last = device_slots()[-1]
    return last.at + 1 + len(last.form.parameters), last.memory + last.form.memory


@cache
def layout() -> int:
    """A number that another order of effects, forms or parameters would not have."""
    text = ";".join(
        f"{slot.effect} {slot.form.name} {[p.key for p in slot.form.parameters]}" for slot in device_slots()
    )
    return zlib.crc32(text.encode()) % 1_000_000


def source() -> bytes:
    """The user's file as it is on the disk; empty if there is none."""
    module = users()
    return Path(str(module.__file__)).read_bytes() if module is not None else b""


def slot(effect: str, form: str) -> _hooks.Slot:
    """The place of a device effect's form; raises InputError if there is none."""
    for each in device_slots():
        if (each.effect, each.form.name) == (effect, form):
            return each
    raise InputError(f"there is no effect '{effect}' on the device with form '{form}'")


def edited(active: Mapping[tuple[str, str], Mapping[str, float]], foot: Foot) -> Foot:
    """``foot`` with these forms of effects of the body, in the order of the catalogue; the others are passed over.

    (effect, form) -> parameters by key, in the keys' units.
    """
    for effect in effects().values():
        for form in effect.forms if effect.kind == "body" else ():
            numbers = active.get((effect.name, form.name))
            if numbers is not None:
                foot = form.laws["foot"](tuple(p.si(numbers[p.key]) for p in form.parameters), foot)
    return foot


def values(active: Mapping[tuple[str, str], Mapping[str, float]]) -> tuple[float, ...]:
    """The values for these forms, (effect, form) -> parameters by key, in the keys' units; none: all neutral.

    A parameter that is left out is neutral, too.
    """
    found = [0.0] * sizes()[0]
    for (effect, form), parameters in active.items():
        place = slot(effect, form)
        found[0] += 1.0
        found[place.at] = 1.0
        for k, parameter in enumerate(place.form.parameters):
            value = parameters.get(parameter.key, parameter.neutral)
            assert value is not None, f"{effect} needs {parameter.key}"
            found[place.at + 1 + k] = parameter.si(value)
    return tuple(found)


def assembled(
    law_of: Callable[[Any], Any] = lambda law: law, made: Callable[[Any], Any] = lambda function: function
) -> types.ModuleType:
    """The hooks of all device effects (:func:`klute_sim.effects.hooks.assemble`)."""
    return _hooks.assemble(device_slots(), law_of, made)


def form_of(effect: str, form: str | None) -> tuple[Effect, Form]:
    """An effect and its form (None: its usual one); raises InputError that lists what there is."""
    known = effects().get(effect)
    if known is None:
        every = (
            f"there are: {', '.join(effects())} (of your own: name their file with --catalogue, or in the environment "
            f"variable {VARIABLE})"
        )
        raise InputError(f"there is no effect '{effect}'; {meant(effect, effects(), every)}")
    found = known.forms[0] if form is None else known.form(form)
    if found is None:
        raise InputError(f"effect '{effect}' has no form '{form}'; it has: {', '.join(f.name for f in known.forms)}")
    return known, found
