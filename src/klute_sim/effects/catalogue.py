"""Catalogue of all effects in this process: the built-in ones and those that a user registers.

A user registers an effect with :func:`register_effect` or the decorator :func:`effect`, before the first device is
loaded::

    @effect(
        name="muscle_warming",
        description="The muscle pulls more when it is warm.",
        equation="F (1 + gain)",
        hook="muscle_force",
        parameters=(EffectParameter(key="gain", neutral=0.0, lower=0.0, upper=0.5, typical=0.02, source="assumed"),),
    )
    def warm_force(p, state, force, muscle, pressure, length, velocity):
        return force * (1.0 + p.gain)

A Python file with such calls can be named with ``--catalogue`` or in the environment variable
``KLUTE_SIM_CATALOGUE``; it is run at the first use of the catalogue, also in worker processes.
"""

import importlib.util
import marshal
import os
import sys
import types
import zlib
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Literal, TypeVar

from klute_sim.effects import chain
from klute_sim.effects.effect import Effect, EffectForm, EffectParameter
from klute_sim.effects.families import (
    air,
    body,
    damper,
    discrepancy_terms,
    hose,
    instrument,
    joint,
    joint_terms,
    seal,
    supply,
    tendon,
)
from klute_sim.effects.families.muscle import (
    bladder_relaxation,
    bladder_wall,
    braid_extensibility,
    braid_hysteresis,
    dissertation_terms,
    end_taper,
    muscle_damping,
    passive_tension,
    threshold_pressure,
)
from klute_sim.effects.validation import check_effect
from klute_sim.errors import InputError, suggest
from klute_sim.files.limits import CATALOGUE
from klute_sim.files.reading import MissingFileError, read_bytes
from klute_sim.laws.foot import Foot

CATALOGUE_VARIABLE = "KLUTE_SIM_CATALOGUE"
"""Environment variable with the path of the user's catalogue."""
USER_MODULE = "klute_sim_users_effects"
"""Name under which the user's catalogue is imported."""

BUILT_IN_EFFECTS = (
    # Where two effects act at one hook, the earlier one acts first.
    threshold_pressure.THRESHOLD_PRESSURE,
    end_taper.END_TAPER,
    braid_extensibility.BRAID_EXTENSIBILITY,
    dissertation_terms.BLADDER_RUBBER,
    bladder_wall.THICK_WALL_BLADDER,
    bladder_wall.BLADDER_SOFTENING,
    dissertation_terms.FRICTION_OFFSET,
    passive_tension.PASSIVE_TENSION,
    braid_hysteresis.BRAID_HYSTERESIS,
    muscle_damping.MUSCLE_DAMPING,
    bladder_relaxation.BLADDER_RELAXATION,
    air.SUPPLY_DROOP,
    air.CHOKED_VALVE,
    hose.HOSE,
    air.VOLUME_COUPLING,
    air.LEAK,
    supply.REGULATOR_ERROR,
    supply.PRESSURE_LAG,
    supply.PRESSURE_DELAY,
    damper.DISCHARGE_LOSS,
    damper.LAMINAR_ORIFICE,
    damper.TRAPPED_AIR,
    damper.ROD_SIDE_AREA,
    damper.CAVITATION,
    damper.OIL_TEMPERATURE,
    seal.SEAL_FRICTION,
    tendon.TENDON_SLACK,
    tendon.TENDON_STIFFENING,
    tendon.TENDON_HYSTERESIS,
    # Data-driven terms act last, because they complete the equations of all others.
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
    body.SOCKET_TILT,
    discrepancy_terms.UNKNOWN_ANKLE_MOMENT,
    joint.JOINT_FRICTION,
    joint.GUIDE_FRICTION,
    joint.JOINT_INERTIA,
    joint.PULLEY_ERROR,
    joint.GRAVITY_TILT,
    joint.SENSOR_BACKLASH,
    joint_terms.UNKNOWN_JOINT_MOMENT,
    joint_terms.UNKNOWN_GUIDE_FORCE,
    instrument.SENSOR_GAIN,
    instrument.SENSOR_OFFSET,
    instrument.SENSOR_DRIFT,
    instrument.SENSOR_LAG,
    instrument.CLOCK_SKEW,
    instrument.QUANTIZATION,
)
"""Effects of the package."""

_registered_effects: list[Effect] = []
"""Effects of the user, in the order of their registration."""
_Law = TypeVar("_Law", bound=Callable[..., Any])


def register_effect(effect: Effect) -> Effect:
    """Add ``effect`` to the catalogue of this process and return it.

    Raises InputError when the effect is invalid, when its name is taken, or when a device has already been loaded: the
    laws of a loaded device do not change.
    """
    if get_effects.cache_info().currsize:
        raise InputError("cannot register an effect after the first device is loaded; register it earlier")
    check_effect(effect, {known.name for known in (*BUILT_IN_EFFECTS, *_registered_effects)})
    _registered_effects.append(effect)
    return effect


def effect(
    *,
    name: str,
    description: str,
    equation: str,
    hook: str,
    parameters: tuple[EffectParameter, ...],
    form: str = "default",
    kind: Literal["device", "body", "instrument", "mechanism"] = "device",
    part: Literal["", "hinge joint", "slide joint", "pulley", "rig", "position channel"] = "",
    states: tuple[str, ...] = (),
    next_state: Callable[..., Any] | None = None,
    acts_in_supply: bool = False,
) -> Callable[[_Law], _Law]:
    """Return a decorator that registers an effect with one form, whose law at ``hook`` is the decorated function.

    ``states`` names the internal states and ``next_state`` is the law that advances them; the arguments of both laws
    are in :mod:`klute_sim.effects.effect`. The decorated function is returned unchanged.
    """

    def register(law: _Law) -> _Law:
        laws: dict[str, Callable[..., Any]] = {hook: law}
        if next_state is not None:
            laws["next_state"] = next_state
        effect_form = EffectForm(name=form, equation=equation, parameters=parameters, laws=laws, states=states)
        register_effect(
            Effect(
                name=name,
                description=description,
                kind=kind,
                forms=(effect_form,),
                part=part,
                acts_in_supply=acts_in_supply,
            )
        )
        return law

    return register


@cache
def get_effects() -> dict[str, Effect]:
    """Return all effects by name; from the first call on no effect can be registered.

    Raises InputError when the user's catalogue is invalid.
    """
    load_user_module()
    return {effect.name: effect for effect in (*BUILT_IN_EFFECTS, *_registered_effects)}


def get_named_effects() -> dict[str, Effect]:
    """Return the effects that name a cause: all except the data-driven ones."""
    return {name: effect for name, effect in get_effects().items() if not effect.data_driven}


def use_catalogue(path: str | Path) -> None:
    """Register the effects of the Python file ``path`` in this process and in those that it starts.

    Raises InputError when the file is invalid or when a device has already been loaded.
    """
    resolved = str(Path(path).resolve())
    if get_effects.cache_info().currsize and os.environ.get(CATALOGUE_VARIABLE) != resolved:
        raise InputError("cannot change the catalogue after the first device is loaded; name its file earlier")
    os.environ[CATALOGUE_VARIABLE] = resolved
    get_effects()


@cache
def load_user_module() -> types.ModuleType | None:
    """Run the user's catalogue and return its module; None if no catalogue is named.

    Raises InputError when the file does not exist, cannot be run, or registers no effect.
    """
    catalogue = os.environ.get(CATALOGUE_VARIABLE, "")
    if not catalogue:
        return None
    path = Path(catalogue)
    try:
        read_bytes(path, CATALOGUE)
    except MissingFileError:
        raise InputError(f"catalogue {catalogue} does not exist (from --catalogue or {CATALOGUE_VARIABLE})") from None
    spec = importlib.util.spec_from_file_location(USER_MODULE, path)
    if spec is None or spec.loader is None:
        raise InputError(f"catalogue {catalogue} is not a Python file; its name must end with .py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    n_before = len(_registered_effects)
    try:
        spec.loader.exec_module(module)
    except InputError as error:
        raise InputError(f"catalogue {catalogue}: {error}") from None
    except Exception as error:
        raise InputError(f"catalogue {catalogue} cannot be run: {type(error).__name__}: {error}") from None
    if len(_registered_effects) == n_before:
        raise InputError(
            f"catalogue {catalogue} registers no effect; call klute_sim.register_effect(...) or decorate a law with "
            "klute_sim.effect(...)"
        )
    return module


@cache
def get_device_slots() -> tuple[chain.EffectSlot, ...]:
    """Return the slots of all forms of device effects."""
    forms = [
        (effect.name, form) for effect in get_effects().values() if effect.kind == "device" for form in effect.forms
    ]
    return tuple(chain.allocate_slots(forms))


@cache
def count_values_and_states() -> tuple[int, int]:
    """Return how many effect values and how many internal states of effects a device has."""
    last = get_device_slots()[-1]
    return last.switch_index + 1 + len(last.form.parameters), last.state_start + last.form.n_states


@cache
def compute_layout_checksum() -> int:
    """Return a number that identifies the order of effects, forms and parameters."""
    text = ";".join(
        f"{slot.effect} {slot.form.name} {[parameter.key for parameter in slot.form.parameters]}"
        for slot in get_device_slots()
    )
    return zlib.crc32(text.encode()) % 1_000_000


def get_user_modules() -> list[types.ModuleType]:
    """Return the modules that define laws of registered effects, each once, in order of registration."""
    laws = [law for effect in _registered_effects for form in effect.forms for law in form.laws.values()]
    names = dict.fromkeys(law.__module__ for law in laws)
    return [sys.modules[name] for name in names if not name.startswith("klute_sim.")]


def read_user_source() -> bytes:
    """Return the source of the modules that define registered effects, for fingerprints; empty without any."""
    get_effects()
    return b"".join(map(_read_source, get_user_modules()))


def _read_source(module: types.ModuleType) -> bytes:
    """Return the source file of ``module``, or the code of its functions if it has none (a notebook)."""
    path = getattr(module, "__file__", None)
    if path is not None:
        return read_bytes(path, CATALOGUE)
    functions = [value for value in vars(module).values() if isinstance(value, types.FunctionType)]
    return b"".join(marshal.dumps(function.__code__) for function in functions)


def find_slot(effect: str, form: str) -> chain.EffectSlot:
    """Return the slot of a form of a device effect; raises InputError if it does not exist."""
    for slot in get_device_slots():
        if (slot.effect, slot.form.name) == (effect, form):
            return slot
    raise InputError(f"no device effect '{effect}' has a form '{form}'")


def find_parameter_index(effect: str, form: str, key: str) -> int:
    """Return the index of the parameter ``key`` of a form among the values of all effects."""
    slot = find_slot(effect, form)
    return slot.switch_index + 1 + [parameter.key for parameter in slot.form.parameters].index(key)


def apply_body_effects(active_forms: Mapping[tuple[str, str], Mapping[str, float]], foot: Foot) -> Foot:
    """Return ``foot`` with the active forms of body effects, in the order of the catalogue; other effects are skipped.

    ``active_forms`` maps (effect, form) to parameters by key, in the units of the keys. A missing parameter has its
    neutral value.
    """
    for effect in get_effects().values():
        for form in effect.forms if effect.kind == "body" else ():
            parameters = active_forms.get((effect.name, form.name))
            if parameters is not None:
                neutral = {p.key: p.neutral for p in form.parameters if p.neutral is not None}
                foot = form.laws["foot"](form.pack(neutral | dict(parameters)), foot)
    return foot


def pack_effects(active_forms: Mapping[tuple[str, str], Mapping[str, float]]) -> tuple[float, ...]:
    """Return the effect values of a device with these active forms; without any, all effects are off.

    ``active_forms`` maps (effect, form) to parameters by key, in the units of the keys. A missing parameter has its
    neutral value.
    """
    values = [0.0] * count_values_and_states()[0]
    for (effect, form), parameters in active_forms.items():
        slot = find_slot(effect, form)
        values[slot.switch_index] = 1.0
        for k, parameter in enumerate(slot.form.parameters):
            value = parameters.get(parameter.key, parameter.neutral)
            assert value is not None, f"{effect} needs {parameter.key}"
            values[slot.switch_index + 1 + k] = parameter.to_si(value)
    return _count_forms(values)


def select_effects(values: Sequence[float], is_selected: Callable[[chain.EffectSlot], bool]) -> tuple[float, ...]:
    """Return effect ``values`` of a device with those of its active forms for which ``is_selected`` is true."""
    selected = [0.0] * len(values)
    for slot in get_device_slots():
        if values[slot.switch_index] != 0.0 and is_selected(slot):
            end = slot.switch_index + 1 + len(slot.form.parameters)
            selected[slot.switch_index : end] = values[slot.switch_index : end]
    return _count_forms(selected)


def _count_forms(values: Sequence[float]) -> tuple[float, ...]:
    return (*chain.count_active_forms(values, get_device_slots()), *values[chain.N_COUNTS :])


def chain_device_effects(
    compile_law: Callable[[Any], Any] = lambda law: law,
    compile_function: Callable[[Any], Any] = lambda function: function,
) -> types.ModuleType:
    """Return the chained hooks of all device effects (:func:`klute_sim.effects.chain.chain_hooks`)."""
    return chain.chain_hooks(get_device_slots(), compile_law, compile_function)


def find_form(effect: str, form: str | None) -> tuple[Effect, EffectForm]:
    """Return an effect and its form (None: the default form).

    Raises InputError that lists the known names if there is no such effect or form.
    """
    known_effect = get_effects().get(effect)
    if known_effect is None:
        listing = (
            f"there are: {', '.join(get_effects())}. To add effects of your own, name their file with --catalogue or "
            f"in the environment variable {CATALOGUE_VARIABLE}"
        )
        raise InputError(f"there is no effect '{effect}'; {suggest(effect, get_effects(), listing)}")
    known_form = known_effect.forms[0] if form is None else known_effect.find_form(form)
    if known_form is None:
        names = ", ".join(effect_form.name for effect_form in known_effect.forms)
        raise InputError(f"effect '{effect}' has no form '{form}'; it has: {names}")
    return known_effect, known_form
