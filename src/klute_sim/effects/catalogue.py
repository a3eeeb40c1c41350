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

from klute_sim.effects import chain as _hooks
from klute_sim.effects.effect import HOOKS, Effect, EffectForm
from klute_sim.effects.families import air, body, damper, discrepancy_terms, instrument, supply, tendon
from klute_sim.effects.families.muscle import (
    bladder_relaxation,
    bladder_wall,
    braid_extensibility,
    braid_hysteresis,
    dissertation_terms,
    end_taper,
    muscle_damping,
    threshold_pressure,
)
from klute_sim.errors import InputError, suggest
from klute_sim.laws import mckibben
from klute_sim.laws.foot import Foot
from klute_sim.laws.pneumatics import Supply

CATALOGUE_VARIABLE = "KLUTE_SIM_CATALOGUE"

BUILT_IN_EFFECTS = (
    # Where two act at one hook, the earlier acts first.
    threshold_pressure.THRESHOLD_PRESSURE,
    end_taper.END_TAPER,
    braid_extensibility.BRAID_EXTENSIBILITY,
    dissertation_terms.BLADDER_RUBBER,
    bladder_wall.THICK_WALL_BLADDER,
    bladder_wall.BLADDER_SOFTENING,
    dissertation_terms.FRICTION_OFFSET,
    braid_hysteresis.BRAID_HYSTERESIS,
    muscle_damping.MUSCLE_DAMPING,
    bladder_relaxation.BLADDER_RELAXATION,
    air.SUPPLY_DROOP,
    air.CHOKED_VALVE,
    air.VOLUME_COUPLING,
    air.LEAK,
    supply.REGULATOR_ERROR,
    supply.PRESSURE_LAG,
    supply.PRESSURE_DELAY,
    damper.DISCHARGE_LOSS,
    damper.LAMINAR_ORIFICE,
    damper.TRAPPED_AIR,
    damper.SEAL_FRICTION,
    tendon.TENDON_SLACK,
    tendon.TENDON_STIFFENING,
    tendon.TENDON_HYSTERESIS,
    # Last, and outside of the equations they are terms of.
    discrepancy_terms.UNKNOWN_FORCE,
    discrepancy_terms.UNKNOWN_TENDON_FORCE,
    discrepancy_terms.UNKNOWN_PRESSURE,
    body.ANKLE_FRICTION,
    body.RETURN_SPRING_ERROR,
    body.END_STOP,
    body.MOMENT_ARM_ERROR,
    body.INERTIA_ERROR,
    body.FOOT_STIFFNESS,
    body.FOOT_HYSTERESIS,
    body.SOCKET_PISTONING,
    instrument.SENSOR_GAIN,
    instrument.SENSOR_OFFSET,
    instrument.SENSOR_DRIFT,
    instrument.SENSOR_LAG,
    instrument.CLOCK_SKEW,
    instrument.QUANTISATION,
)


@cache
def get_effects() -> dict[str, Effect]:
    """Name -> effect; raises InputError if the user's file is not one."""
    found = {effect.name: effect for effect in BUILT_IN_EFFECTS}
    for effect in getattr(load_user_module(), "EFFECTS", []):
        _check_effect(effect, found)
        found[effect.name] = effect
    return found


def get_named_effects() -> dict[str, Effect]:
    """Those of :func:`effects` that are names: not the data-driven ones."""
    return {name: effect for name, effect in get_effects().items() if not effect.data_driven}


def use_catalogue(path: str | Path) -> None:
    """Add the effects of ``file`` from here on, in this process and those it starts.

    Raises InputError when the package has been used already: a law that runs is not changed.
    """
    wanted = str(Path(path).resolve())
    if get_effects.cache_info().currsize and os.environ.get(CATALOGUE_VARIABLE) != wanted:
        raise InputError("the catalogue is in use already: name your effects before anything is simulated")
    os.environ[CATALOGUE_VARIABLE] = wanted
    get_effects()


@cache
def load_user_module() -> types.ModuleType | None:
    """The user's file, run; None if there is none."""
    named = os.environ.get(CATALOGUE_VARIABLE, "")
    if not named:
        return None
    file = Path(named)
    if not file.is_file():
        raise InputError(f"catalogue {named} does not exist (from --catalogue or {CATALOGUE_VARIABLE})")
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


def _check_effect(effect: Any, known: Mapping[str, Effect]) -> None:
    where = f"catalogue {os.environ.get(CATALOGUE_VARIABLE)}"
    if not isinstance(effect, Effect):
        raise InputError(f"{where}: EFFECTS holds {effect!r}; allowed: klute_sim.effects.effect.Effect")
    if effect.name in known:
        raise InputError(f"{where}: there is an effect '{effect.name}' already")
    for form in effect.forms:
        here = f"{where}: effect '{effect.name}', form '{form.name}'"
        for hook in form.laws:
            if hook not in HOOKS:
                raise InputError(f"{here}: there is no hook '{hook}'; allowed: {', '.join(HOOKS)}")
        if bool(form.n_states) != ("remember" in form.laws):
            raise InputError(f"{here}: memory and a law at 'remember' go together")
        if not form.parameters or form.parameters[0].neutral is None:
            raise InputError(f"{here}: its first parameter must have a neutral value")
        for hook, law in form.laws.items():
            _check_law(law, hook, form, f"{here}: its law at '{hook}'")


def _check_law(law: Callable[..., Any], hook: str, form: EffectForm, where: str) -> None:
    """Call ``law`` once with numbers as they occur, so that a slip in it is told before anything is compiled."""
    own = tuple(parameter.to_si(parameter.typical) for parameter in form.parameters)
    memory = (0.0,) * form.n_states
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
        good = isinstance(found, tuple) and len(found) == form.n_states
        wanted = f"a tuple of {form.n_states} (as many as it remembers)"
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
def get_device_slots() -> tuple[_hooks.EffectSlot, ...]:
    """Places of all forms of effects on the device."""
    forms = [(e.name, form) for e in get_effects().values() if e.kind == "device" for form in e.forms]
    return tuple(_hooks.allocate_slots(forms))


@cache
def count_values_and_states() -> tuple[int, int]:
    """How many values a device has, and how many numbers it remembers."""
    last = get_device_slots()[-1]
    return last.switch_index + 1 + len(last.form.parameters), last.state_start + last.form.n_states


@cache
def layout_checksum() -> int:
    """A number that another order of effects, forms or parameters would not have."""
    text = ";".join(
        f"{slot.effect} {slot.form.name} {[p.key for p in slot.form.parameters]}" for slot in get_device_slots()
    )
    return zlib.crc32(text.encode()) % 1_000_000


def read_user_source() -> bytes:
    """The user's file as it is on the disk; empty if there is none."""
    module = load_user_module()
    return Path(str(module.__file__)).read_bytes() if module is not None else b""


def find_slot(effect: str, form: str) -> _hooks.EffectSlot:
    """The place of a device effect's form; raises InputError if there is none."""
    for each in get_device_slots():
        if (each.effect, each.form.name) == (effect, form):
            return each
    raise InputError(f"there is no effect '{effect}' on the device with form '{form}'")


def apply_body_effects(active_forms: Mapping[tuple[str, str], Mapping[str, float]], foot: Foot) -> Foot:
    """``foot`` with these forms of effects of the body, in the order of the catalogue; the others are passed over.

    (effect, form) -> parameters by key, in the keys' units.
    """
    for effect in get_effects().values():
        for form in effect.forms if effect.kind == "body" else ():
            numbers = active_forms.get((effect.name, form.name))
            if numbers is not None:
                foot = form.laws["foot"](tuple(p.to_si(numbers[p.key]) for p in form.parameters), foot)
    return foot


def pack_effects(active_forms: Mapping[tuple[str, str], Mapping[str, float]]) -> tuple[float, ...]:
    """The values for these forms, (effect, form) -> parameters by key, in the keys' units; none: all neutral.

    A parameter that is left out is neutral, too.
    """
    found = [0.0] * count_values_and_states()[0]
    for (effect, form), parameters in active_forms.items():
        place = find_slot(effect, form)
        found[0] += 1.0
        found[place.switch_index] = 1.0
        for k, parameter in enumerate(place.form.parameters):
            value = parameters.get(parameter.key, parameter.neutral)
            assert value is not None, f"{effect} needs {parameter.key}"
            found[place.switch_index + 1 + k] = parameter.to_si(value)
    return tuple(found)


def chain_device_effects(
    compile_law: Callable[[Any], Any] = lambda law: law,
    compile_function: Callable[[Any], Any] = lambda function: function,
) -> types.ModuleType:
    """The hooks of all device effects (:func:`klute_sim.effects.chain.assemble`)."""
    return _hooks.chain_hooks(get_device_slots(), compile_law, compile_function)


def find_form(effect: str, form: str | None) -> tuple[Effect, EffectForm]:
    """An effect and its form (None: its usual one); raises InputError that lists what there is."""
    known = get_effects().get(effect)
    if known is None:
        every = (
            f"there are: {', '.join(get_effects())} (of your own: name their file with --catalogue, or in the environment "
            f"variable {CATALOGUE_VARIABLE})"
        )
        raise InputError(f"there is no effect '{effect}'; {suggest(effect, get_effects(), every)}")
    found = known.forms[0] if form is None else known.find_form(form)
    if found is None:
        raise InputError(f"effect '{effect}' has no form '{form}'; it has: {', '.join(f.name for f in known.forms)}")
    return known, found
