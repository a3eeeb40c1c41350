"""Specification of the datasets of each block."""

import random
from typing import Any

import numpy as np
from benchmarks.hidden_effects.adversary.cases import draw_case
from benchmarks.hidden_effects.catalogue import (
    BENCH_CHANNELS,
    BODY_EFFECTS,
    EFFECTS,
    JOINT_EFFECTS,
    KNOWN_VALVE,
    OTHER_FORMS,
    OUT_OF_CATALOGUE_JOINT_FORMS,
    VALVE_EFFECTS,
    Forms,
    HiddenParameter,
    instrument_forms,
    limit_to_range,
)
from benchmarks.hidden_effects.device import load_device
from benchmarks.hidden_effects.imperfect import draw_law_error
from benchmarks.hidden_effects.out_of_catalogue import OUT_OF_CATALOGUE_FORMS
from benchmarks.hidden_effects.set_up import LATER_LOGGINGS, LOGGINGS, draw_number_error, draw_registration

BLOCK_SIZES = {
    "clean": 120,
    "single": 3 * len(EFFECTS),
    "instrument": 24,
    "pair": 30,
    "triple": 10,
    "wrong_form": 33,
    "outside": 36,
    "twin": 10,
    "repeats": 24,
    "defective": 10,
    "walk": 63,
    "walk_clean": 40,
    "imperfect": 60,
    "faint_outside": 24,
    "wrong_number": 48,
    "logging": 40,
    "walk_registration": 20,
    "joint": 48,
    "joint_clean": 40,
    "joint_pair": 12,
    "joint_outside": 24,
    "joint_imperfect": 12,
    "adversary": 24,
    "known_valve": 24,
}
"""Number of datasets of each block that gives sufficient statistics."""
SPLIT_SEEDS = {"development": 101, "calibration": 707, "test": 909}
"""Seeds: thresholds are set on the development split and probabilities on the calibration split. Both are frozen before
the test split is evaluated."""
TARGET_SIZES = (2.0, 8.0, 0.7)
"""Sizes of single effects over the noise."""
REPEAT_COUNTS = (1, 2, 3, 4)
"""Numbers of repeats of every trial in block ``repeats``."""
FAINT_EFFECTS = (
    ("braid_hysteresis", "coulomb"),
    ("muscle_damping", "viscous"),
    ("end_taper", "strain"),
    ("pressure_lag", "first_order"),
    ("tendon_hysteresis", "slip"),
    ("volume_coupling", "polytropic"),
)
"""Effects that block ``repeats`` hides at half the noise."""
STRONG_EFFECTS = (
    ("braid_hysteresis", "coulomb"),
    ("seal_friction", "coulomb"),
    ("muscle_damping", "viscous"),
    ("end_taper", "strain"),
    ("tendon_slack", "dead_length"),
    ("threshold_pressure", "constant"),
    ("pressure_lag", "first_order"),
)
"""Effects that block ``imperfect`` hides: they can be several times as large as the error of a law."""
GAIT_BLOCKS = ("walk", "walk_clean", "walk_registration")
"""Blocks of the gait rig."""
JOINT_BLOCKS = ("joint", "joint_clean", "joint_pair", "joint_outside", "joint_imperfect")
"""Blocks of the antagonist joint; those of neither rig are of the bench."""
ADVERSARY_BLOCK = "adversary"
"""Block of the bench whose datasets have the physics of :mod:`adversary`."""
JOINT_CASES: tuple[tuple[str, str, str | None], ...] = (
    *((name, form, None) for name, form in JOINT_EFFECTS),
    ("sensor_backlash", "play", "angle_joint"),
    ("pressure_lag", "first_order", None),
    ("sensor_gain", "gain", "angle_joint"),
    ("braid_hysteresis", "coulomb", None),
    ("sensor_offset", "offset", "pressure_flexor"),
    ("pressure_delay", "dead_time", None),
    ("muscle_damping", "viscous", None),
    ("sensor_lag", "first_order", "angle_joint"),
    ("regulator_error", "offset", None),
    ("pressure_lag", "first_order", "flexor"),
)
"""Hidden cases of a joint: name, form, and the channel of an instrument or the tendon of the only device that has it.
"""
LATER_GAIT_CASES: tuple[tuple[str, str, str | None], ...] = (
    ("socket_tilt", "elastic", None),
    ("socket_pistoning", "damped", None),
    ("socket_tilt", "damped", None),
)
"""Hidden cases of the walks after the first :data:`FIRST_GAIT_DATASETS`."""
GAIT_CASES: tuple[tuple[str, str, str | None], ...] = (
    *((name, form, None) for name, form in BODY_EFFECTS if (name, form, None) not in LATER_GAIT_CASES),
    ("seal_friction", "coulomb", None),
    ("pressure_lag", "first_order", None),
    ("braid_hysteresis", "coulomb", None),
    ("tendon_slack", "dead_length", None),
    ("sensor_offset", "offset", "ankle_angle"),
    ("sensor_gain", "gain", "force"),
    ("sensor_lag", "first_order", "ankle_angle"),
)
"""Hidden cases in gait: effects of the body, some of the device and of instruments."""
FIRST_GAIT_DATASETS = 3 * len(GAIT_CASES)
"""Number of walks with :data:`GAIT_CASES`, each at every size. Cases that came later follow: no dataset changes."""
FIRST_LOGGING_DATASETS = 20
"""Number of logs as in :data:`~benchmarks.hidden_effects.set_up.LOGGINGS`. Others follow: no dataset changes."""
SOCKET_HEIGHTS_MM = (250.0, 400.0)
"""Range of the height of the centre about which a socket tilts, above the ankle [mm]: from one end of a socket to the
other."""
DEFECTS = ("dead_channel", "no_repeats", "no_excitation", "clock_backwards", "saturated_force")
EXCLUSIVE_PAIRS = (
    {"volume_coupling", "choked_valve"},
    {"volume_coupling", "leak"},
    {"volume_coupling", "hose"},
    {"hose", "choked_valve"},
    {"hose", "leak"},
)
"""Effects that are not hidden together: behind a valve, no regulator compensates the motion, and a hose is one."""
TWIN_CASES = (
    ("regulator_error", "offset", None),
    ("sensor_offset", "offset", "pressure"),
    ("regulator_error", "gain", None),
    ("sensor_gain", "gain", "pressure"),
    ("sensor_lag", "first_order", "force"),
    ("clock_skew", "shift", "force"),
    ("laminar_orifice", "smooth", None),
    ("seal_friction", "coulomb", None),
    ("end_taper", "strain", None),
    ("sensor_gain", "gain", "force"),
)
"""Effects with a near twin on this rig."""
KNOWN_VALVE_FORMS = tuple(
    key
    for key in EFFECTS
    if key[0] not in VALVE_EFFECTS | {"choked_valve"} and {key[0], "choked_valve"} not in EXCLUSIVE_PAIRS
)
"""Effects that block ``known_valve`` hides: those of a device with a valve, but no leak. Without this block a declared
valve would tell that a leak is hidden."""
DatasetSpec = dict[str, Any]


def draw_value(parameter: HiddenParameter, scale: float, sign: float = 1.0) -> float:
    """Return the value at ``scale`` times the typical distance from neutral, off the ends of the range."""
    if parameter.neutral == np.inf:  # a frequency: slower is more
        value = parameter.typical / scale
    else:
        neutral = parameter.neutral or 0.0
        value = neutral + (sign if parameter.is_signed else 1.0) * scale * (parameter.typical - neutral)
    return limit_to_range(parameter, value)


def draw_effect(
    forms: Forms, key: tuple[str, str], rng: np.random.Generator | None, target_size: float | None = None
) -> dict[str, Any]:
    """Return one effect at its typical size, or at 0.7 to 3 times that with ``rng``.

    ``target_size`` is its required size over the noise; parameters that only shape it stay as drawn.
    """

    def draw_scale() -> float:
        return 1.0 if rng is None else float(np.exp(rng.uniform(np.log(0.7), np.log(3.0))))

    sign = 1.0 if rng is None else float(rng.choice([-1.0, 1.0]))
    parameters = {name: draw_value(parameter, draw_scale(), sign) for name, parameter in forms[key].items()}
    effect = {"name": key[0], "form": key[1], "parameters": parameters}
    return effect if target_size is None or rng is None else effect | {"wanted": target_size}


def make_spec(*effects: dict[str, Any]) -> DatasetSpec:
    """Return a dataset with ``effects``, in a device with a known valve where an effect requires it."""
    names = {effect["name"] for effect in effects}
    spec: DatasetSpec = {"effects": list(effects)}
    return spec | {"known": [KNOWN_VALVE]} if names & VALVE_EFFECTS and "choked_valve" not in names else spec


def sample_datasets(block: str, count: int | None, seed: int) -> list[DatasetSpec]:
    """Return the specifications of ``count`` datasets of ``block`` (None: all of it) in a random order.

    The order depends on ``seed``. The datasets of a block are ordered by effect and size, so only a random beginning
    is a sample of it.
    """
    plan = plan_datasets(block, max(BLOCK_SIZES[block], count or 0), seed)
    random.Random(f"{seed} {block}").shuffle(plan)
    return plan[:count]


def plan_datasets(block: str, count: int, seed: int, *, typical: bool = False) -> list[DatasetSpec]:
    """Return the specifications of ``count`` datasets: arguments of ``generate.make_dataset``, and a name.

    Dataset ``i`` depends only on block, seed and ``i``, so a longer plan begins with the shorter one. ``typical`` sets
    every parameter to its typical value.
    """
    if block not in BLOCK_SIZES:
        raise ValueError(f"block {block!r} is none of {', '.join(BLOCK_SIZES)}")
    specs, number = [], list(BLOCK_SIZES).index(block)
    contents = (
        _block_content(block, i, None if typical else np.random.default_rng([seed, number, i, 1])) for i in range(count)
    )
    for i, content in enumerate(contents):
        dataset_seed = int(np.random.SeedSequence([seed, number, i]).generate_state(1)[0])
        specs.append({"name": f"{block}_{seed}_{i:03d}", "seed": dataset_seed, "block": block, **content})
    return specs


def _block_content(block: str, index: int, rng: np.random.Generator | None) -> DatasetSpec:
    singles, others = list(EFFECTS), list(OTHER_FORMS)
    match block:
        case "clean" | "walk_clean" | "joint_clean":
            return {}
        case "joint":
            turn, position = divmod(index, len(JOINT_CASES))
            return _draw_joint_case(JOINT_CASES[position], rng, TARGET_SIZES[turn % len(TARGET_SIZES)])
        case "joint_pair":
            return _draw_joint_pair(index, rng)
        case "joint_outside":
            turn, position = divmod(index, 3)
            if position == 0:
                forms = list(OUT_OF_CATALOGUE_JOINT_FORMS)
                stranger = draw_effect(OUT_OF_CATALOGUE_JOINT_FORMS, forms[turn % len(forms)], rng, 8.0)
                return {"strangers": [stranger]}
            return _draw_joint_case(JOINT_CASES[(2 * turn + position - 1) % 6], rng, 8.0) | {"deleted": True}
        case "joint_imperfect":
            error = draw_law_error(rng)
            if index % 3 == 2:
                return {"law_error": error}
            return {**_draw_joint_case(JOINT_CASES[(2 * (index // 3) + index % 3) % 6], rng, 30.0), "law_error": error}
        case "walk":
            later = index - FIRST_GAIT_DATASETS
            cases = GAIT_CASES if later < 0 else LATER_GAIT_CASES
            turn, position = divmod(index if later < 0 else later, len(cases))
            name, form, channel = cases[position]
            wanted = TARGET_SIZES[turn % len(TARGET_SIZES)]
            if channel:
                return _draw_fault((name, form), channel, rng, wanted)
            effect = draw_effect(EFFECTS | BODY_EFFECTS, (name, form), rng, wanted)
            if rng is not None and "height_mm" in effect["parameters"]:
                effect["parameters"]["height_mm"] = float(f"{rng.uniform(*SOCKET_HEIGHTS_MM):.6g}")
            return {"effects": [effect]}
        case "defective":
            return {"defect": DEFECTS[index % len(DEFECTS)]}
        case "single":
            turn, position = divmod(index, len(singles))
            return make_spec(draw_effect(EFFECTS, singles[position], rng, TARGET_SIZES[turn % len(TARGET_SIZES)]))
        case "wrong_form":
            turn, position = divmod(index, len(others))
            return make_spec(draw_effect(OTHER_FORMS, others[position], rng, (8.0, 2.0, 0.7)[turn % 3]))
        case "instrument":
            # Neighbours in the order differ in both fault and channel, so that a short plan sees some of each.
            names, channels = list(instrument_forms("force")), list(BENCH_CHANNELS)
            turn, position = divmod(index, len(names))
            return _draw_fault(
                names[position], channels[(index + turn) % len(channels)], rng, (8.0, 2.0)[(index + turn // 3) % 2]
            )
        case "twin":
            name, form, channel = TWIN_CASES[index % len(TWIN_CASES)]
            if channel:
                return _draw_fault((name, form), channel, rng, 2.0)
            return make_spec(draw_effect(EFFECTS, (name, form), rng, 2.0))
        case "repeats":
            turn, position = divmod(index, len(FAINT_EFFECTS))
            spec = make_spec(draw_effect(EFFECTS, FAINT_EFFECTS[position], rng, 0.5))
            return spec | {"repeats": REPEAT_COUNTS[turn % len(REPEAT_COUNTS)], "muscle_length": False}
        case "imperfect":
            error = draw_law_error(rng)
            turn, is_clean = divmod(index, 3)[0], index % 3 == 2
            if is_clean:
                return {"law_error": error}
            name = STRONG_EFFECTS[(2 * turn + index % 3) % len(STRONG_EFFECTS)]
            multiple = 4.0 if rng is None else float(np.exp(rng.uniform(np.log(2.0), np.log(8.0))))
            return {**make_spec(draw_effect(EFFECTS, name, rng, multiple)), "law_error": error}
        case "outside":
            return _draw_outside(index, rng, 8.0)
        case "faint_outside":
            return _draw_outside(index, rng, (2.0, 0.7)[(index // 6 + index) % 2])
        case "wrong_number":
            error = draw_number_error(index, rng, load_device())
            # Only behind a valve does the temperature of the gas have an influence.
            known = {"known": [KNOWN_VALVE]} if error["number"] == "supply.gas_temperature_c" else {}
            return {"numbers": [error], **known}
        case "known_valve":
            turn, position = divmod(index, 3)
            if position == 2:
                return {"effects": [], "known": [KNOWN_VALVE]}
            key = KNOWN_VALVE_FORMS[(5 * turn + position) % len(KNOWN_VALVE_FORMS)]
            effect = draw_effect(EFFECTS, key, rng, (2.0, 8.0)[(turn + position) % 2])
            return {"effects": [effect], "known": [KNOWN_VALVE]}
        case "logging":
            later = index - FIRST_LOGGING_DATASETS
            return {
                "logging": LOGGINGS[index % len(LOGGINGS)] if later < 0 else LATER_LOGGINGS[later % len(LATER_LOGGINGS)]
            }
        case "adversary":
            return draw_case(index, rng or np.random.default_rng(index))
        case "walk_registration":
            return {"registration": draw_registration(index, rng)}
        case _:
            return _draw_combination(2 if block == "pair" else 3, index, rng)


def _draw_outside(index: int, rng: np.random.Generator | None, target_size: float) -> DatasetSpec:
    """Return an effect that is in no catalogue, every sixth time, or else one that is removed from it."""
    turn, position = divmod(index, 6)
    if position == 0:
        key = list(OUT_OF_CATALOGUE_FORMS)[turn % len(OUT_OF_CATALOGUE_FORMS)]
        return {"strangers": [draw_effect(OUT_OF_CATALOGUE_FORMS, key, rng, target_size)]}
    singles = list(EFFECTS)
    known = singles[(5 * turn + position - 1) % len(singles)]
    return make_spec(draw_effect(EFFECTS, known, rng, target_size)) | {"deleted": True}


def _draw_fault(key: tuple[str, str], channel: str, rng: np.random.Generator | None, target_size: float) -> DatasetSpec:
    return {"instruments": [{**draw_effect(instrument_forms(channel), key, rng, target_size), "channel": channel}]}


def _draw_joint_case(
    case: tuple[str, str, str | None], rng: np.random.Generator | None, target_size: float
) -> DatasetSpec:
    name, form, owner = case
    if owner is not None and "_" in owner:
        return _draw_fault((name, form), owner, rng, target_size)
    effect = draw_effect(EFFECTS | JOINT_EFFECTS, (name, form), rng, target_size)
    return {"effects": [effect if owner is None else {**effect, "tendon": owner}]}


def _draw_joint_pair(index: int, rng: np.random.Generator | None) -> DatasetSpec:
    """Return an effect of the joint and another cause, each 2 to 8 times the noise when alone."""
    generator = rng or np.random.default_rng(index)
    first, second = JOINT_CASES[index % 6], JOINT_CASES[6 + (5 * index + index // 6) % (len(JOINT_CASES) - 6)]
    sizes = np.exp(generator.uniform(np.log(2.0), np.log(8.0), 2))
    specs = [_draw_joint_case(case, rng, float(size)) for case, size in zip((first, second), sizes, strict=True)]
    return {kind: [*specs[0].get(kind, ()), *specs[1].get(kind, ())] for kind in ("effects", "instruments")}


def _draw_combination(count: int, index: int, rng: np.random.Generator | None) -> DatasetSpec:
    """Return effects of different names that can be in one device, each 2 to 8 times the noise when alone."""
    generator, keys = rng or np.random.default_rng(index), list(EFFECTS)
    chosen: list[tuple[str, str]] = []
    while len(chosen) < count:
        key = keys[generator.integers(len(keys))]
        names = {name for name, _ in chosen}
        if key[0] not in names and not any({key[0], name} in EXCLUSIVE_PAIRS for name in names):
            chosen.append(key)
    sizes = np.exp(generator.uniform(np.log(2.0), np.log(8.0), count))
    return make_spec(*(draw_effect(EFFECTS, key, rng, float(size)) for key, size in zip(chosen, sizes, strict=True)))
