"""Errors of numbers in a device file or in the model of a mechanism: the commonest misfit without a missing effect.

A number that the dataset does not declare uncertain may still be wrong: a length read from the wrong end, a nominal
radius, a tube from another batch. Each such number is a candidate beside the effects. Its plausible error bounds it,
and orders what explains the data equally well: both numbers are reported, but one that is wrong by more than is
plausible does not stand first.
"""

from collections.abc import Container, Mapping
from functools import cache
from typing import NamedTuple

from klute_sim.datasets.dataset import Dataset
from klute_sim.datasets.mechanism import DEVICE_SEPARATOR, is_model_number
from klute_sim.device.device import Device
from klute_sim.device.schema.document import DeviceSpec
from klute_sim.diagnosis.fitting.dependent_numbers import (
    C10,
    RADIUS,
    SAME_ANGLE,
    SAME_RADIUS,
    SAME_RATIO,
    TURNS,
    VALUE,
)
from klute_sim.effects.effect import Effect, EffectForm, EffectParameter

EFFECTS = "effects."
"""Beginning of the keys of the numbers of declared effects."""
NUMBER_ERROR_NAME = "number_error"
"""Name of the cause in verdicts, where an effect has its name in the catalogue."""
LENGTH_ZERO = "bench.length_zero_mm"
"""Reading of the prescribed length of a bench where the true length is zero [mm]; 0 where its zero is right."""
FORM_WORDS = {
    SAME_ANGLE: " at the same braid angle",
    SAME_RADIUS: " and braid length at the same radius",
    SAME_RATIO: " and c01 in the same ratio",
}
"""Form -> words after those of the number."""
BOUND_SIGMAS = 6.0
"""Bounds of a number that is tested for an error, in plausible errors from the device's value (assumed). Numbers with
errors as large as that were not read wrongly, they are those of another device."""


class PlausibleError(NamedTuple):
    """Standard deviation of the error that a laboratory may make; both parts add."""

    absolute: float = 0.0
    """Part that does not depend on the value, in the unit of the key."""
    relative: float = 0.0
    """Part in proportion to the value."""
    source: str = "assumed"
    """Source of both parts."""


_CALIPER = PlausibleError(absolute=0.1, source="assumed: calipers on rubber or braid")
_MATERIAL = PlausibleError(relative=0.1, source="assumed: batches of one material")
_SPRING = PlausibleError(relative=0.1, source="assumed: springs as sold")
_CONDUCTANCE = PlausibleError(relative=0.3, source="assumed: fittings, filters and silencers narrow a valve")
_CRITICAL_RATIO = PlausibleError(0.1, 0.0, "assumed: ISO 6358 finds 0.2 to 0.5 for valves")
DEFAULT_PLAUSIBLE_ERROR = PlausibleError(relative=0.05, source="assumed: data sheets")
SPECIMEN_NUMBERS = (
    "muscle.resting_length_mm",
    "muscle.turns_per_m",
    "muscle.bladder_radius_mm",
    "muscle.c10_kpa",
    "tendon.slack_length_mm",
)
"""Numbers that may be wrong for one specimen only, or for the device on one of several tendons (assumed: those that are
made or measured one by one)."""
PLAUSIBLE_ERRORS = {
    "muscle.resting_length_mm": PlausibleError(1.0, 0.005, "assumed: tape between crimped ends"),
    "muscle.braid_length_ratio": PlausibleError(relative=0.005, source="assumed: counted threads"),
    "muscle.turns_per_m": PlausibleError(relative=0.02, source="assumed: counted threads"),
    "muscle.bladder_radius_mm": _CALIPER,
    "muscle.bladder_thickness_mm": _CALIPER,
    "muscle.c10_kpa": _MATERIAL,
    "muscle.c01_kpa": _MATERIAL,
    "muscle.friction_slope_n_per_bar": _MATERIAL,
    "muscle.friction_offset_n": _MATERIAL,
    "damper.bore_mm": PlausibleError(relative=0.005, source="assumed: machined"),
    "damper.orifice_concentric_mm": PlausibleError(relative=0.02, source="assumed: drilled"),
    "damper.orifice_eccentric_mm": PlausibleError(relative=0.02, source="assumed: drilled"),
    "damper.oil_density_kg_m3": PlausibleError(relative=0.02, source="assumed: data sheet and temperature"),
    "tendon.stiffness_1_n_per_mm": _SPRING,
    "tendon.stiffness_2_n_per_mm": _SPRING,
    "tendon.slack_length_mm": PlausibleError(2.0, 0.0, "assumed: assembly, knots and crosshead zero"),
    "tendon.engagement_mm": PlausibleError(0.5, 0.0, "assumed: assembly"),
    "mounting.neutral_muscle_ratio": PlausibleError(0.01, 0.0, "assumed: assembly, a few millimetres"),
    LENGTH_ZERO: PlausibleError(1.0, 0.0, "assumed: clamps and crosshead zero"),
    "supply.rate_bar_per_s": PlausibleError(relative=2.0, source="assumed: regulators differ by several times"),
    "supply.gas_temperature_c": PlausibleError(3.0, 0.0, "assumed: a room over a day"),
    "valve.fill_dm3_per_s_bar": _CONDUCTANCE,
    "valve.exhaust_dm3_per_s_bar": _CONDUCTANCE,
    "valve.fill_critical_ratio": _CRITICAL_RATIO,
    "valve.exhaust_critical_ratio": _CRITICAL_RATIO,
    "valve.gain_per_bar": PlausibleError(relative=0.5, source="assumed: set in the electronics, rarely stated"),
    "supply.dead_volume_cm3": PlausibleError(relative=0.5, source="assumed: tubes and fittings, rarely measured"),
}
"""``section.key``, of all devices or of one -> plausible error; :data:`DEFAULT_PLAUSIBLE_ERROR` for other keys."""
_EFFECT_SIZE = PlausibleError(relative=0.5, source="assumed: from another device, or from the literature")
"""Plausible error of the numbers of effects that a device file declares."""
KEYS_WITHOUT_UPPER_LIMIT = frozenset({"supply.rate_bar_per_s"})
"""Numbers that may be named at their upper bound: beyond it, a faster supply changes nothing in the data."""
_DRY_FRICTION = PlausibleError(relative=0.5, source="assumed: depends on load and wear")
MODEL_PLAUSIBLE_ERRORS = {
    ("joint", "damping"): PlausibleError(relative=0.5, source="assumed: depends on grease and temperature"),
    ("joint", "frictionloss"): _DRY_FRICTION,
    ("joint", "stiffness"): _SPRING,
    ("tendon", "frictionloss"): _DRY_FRICTION,
    ("geom", "mass"): PlausibleError(relative=0.05, source="assumed: weighed with its fittings"),
    ("body", "mass"): PlausibleError(relative=0.05, source="assumed: weighed with its fittings"),
    **{("site", f"pos_{axis}"): PlausibleError(2e-3, 0.0, "assumed: ruler") for axis in "xyz"},
}
"""(element, number) of a model -> plausible error; other numbers of models are not tested."""


def list_error_candidates(spec: DeviceSpec) -> dict[str, float]:
    """Return ``section.key`` -> plausible error [unit of the key] of each number that may be wrong.

    Counts cannot be a little wrong, zeros mean that a part is absent, the numbers of the foot have effects of their
    own, those of a cylinder are its stops, and a data-driven term is fitted to data.
    """
    excluded = ("foot.", "cylinder.", f"{EFFECTS}unknown_")
    return {
        key: compute_plausible_error(key, value)
        for key, value in spec.collect_values().items()
        if isinstance(value, float) and value != 0.0 and not key.startswith(excluded)
    }


def list_tendon_error_candidates(devices: Mapping[str, Device], uncertain_keys: Container[str]) -> dict[str, float]:
    """Return ``tendon/section.key`` -> each number of :data:`SPECIMEN_NUMBERS` that one of ``devices`` may have wrong.

    ``devices`` are those of a mechanism by tendon; a single one has the numbers of all. ``uncertain_keys`` are fitted
    anyway.
    """
    if len(devices) < 2:
        return {}
    return {
        name: device.spec.collect_values()[key]
        for tendon, device in devices.items()
        for key in list_error_candidates(device.spec)
        if key in SPECIMEN_NUMBERS and (name := f"{tendon}{DEVICE_SEPARATOR}{key}") not in uncertain_keys
    }


def list_bench_error_candidates(dataset: Dataset) -> dict[str, float]:
    """Return name -> declared value of each number of a bench that may be wrong beside those of the device.

    With a tendon, the slack length has the error of the zero as well. Muscles of several lengths are clamped and
    measured one by one, so they share no zero.
    """
    if dataset.rig != "bench":
        return {}
    specs = [trial.device.spec for trial in dataset.trials]
    lengths = {spec.muscle.resting_length_mm if spec.muscle and spec.tendon is None else None for spec in specs}
    return {LENGTH_ZERO: 0.0} if len(lengths) == 1 and None not in lengths else {}


def list_rig_error_candidates(dataset: Dataset) -> dict[str, float]:
    """Return name -> declared value of each number that may be wrong beside those of the device and of the model."""
    devices = {} if dataset.mechanism is None else dataset.mechanism.devices
    return {**list_tendon_error_candidates(devices, dataset.uncertainties), **list_bench_error_candidates(dataset)}


def list_model_error_candidates(values: Mapping[str, float], uncertain_keys: frozenset[str]) -> list[str]:
    """Return the names of the numbers of a model that may be wrong, among its ``values`` (name -> value).

    ``uncertain_keys`` are fitted anyway, and zeros mean that a part is absent.
    """
    return [
        name
        for name, value in values.items()
        if name not in uncertain_keys and value != 0.0 and _split_model_name(name) in MODEL_PLAUSIBLE_ERRORS
    ]


def _split_model_name(name: str) -> tuple[str, str]:
    """Return element and number of ``model.<element>.<name of the element>.<number>``."""
    return name.split(".")[1], name.rpartition(".")[2]


def _find_plausible_error(key: str) -> PlausibleError:
    if is_model_number(key):
        return MODEL_PLAUSIBLE_ERRORS.get(_split_model_name(key), DEFAULT_PLAUSIBLE_ERROR)
    device_key = key.rpartition(DEVICE_SEPARATOR)[2]
    if device_key.startswith(EFFECTS):
        return _EFFECT_SIZE
    return PLAUSIBLE_ERRORS.get(device_key, DEFAULT_PLAUSIBLE_ERROR)


def compute_plausible_error(key: str, value: float) -> float:
    """Return the plausible error of number ``key`` with ``value``, both in the unit of the key."""
    error = _find_plausible_error(key)
    return error.absolute + error.relative * abs(value)


@cache
def make_number_effect(key: str) -> Effect:
    """Return the error of number ``key`` in the shape of an effect, whose one parameter is the number itself."""
    parameter = EffectParameter(
        key=key,
        neutral=0.0,
        lower=-BOUND_SIGMAS,
        upper=BOUND_SIGMAS,
        typical=1.0,
        source=_find_plausible_error(key).source,
    )
    file = "MJCF file" if is_model_number(key) else "device file"
    description, equations = f"A number of the {file} is wrong.", {VALUE: f"{key} differs from the {file}"}
    if key == LENGTH_ZERO:
        description = "The prescribed length has a wrong zero."
        equations = {VALUE: f"the length reads {key} too much"}
    if key == RADIUS:
        equations[SAME_ANGLE] = f"{key} differs from the {file}, and so do the turns: the braid has the declared angle"
    if key == TURNS:
        equations[SAME_RADIUS] = f"{key} and the length of the braid differ from the {file}, whose radius is right"
    if key == C10:
        equations[SAME_RATIO] = f"{key} and muscle.c01_kpa differ from the {file}, in proportion: it is another rubber"
    forms = [EffectForm(name=name, equation=text, parameters=(parameter,)) for name, text in equations.items()]
    return Effect(
        name=NUMBER_ERROR_NAME,
        description=description,
        kind="model number" if is_model_number(key) else "instrument" if key == LENGTH_ZERO else "number",
        forms=tuple(forms),
    )
