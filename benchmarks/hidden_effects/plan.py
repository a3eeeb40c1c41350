"""Which datasets a block holds."""

from typing import Any

import numpy as np
from catalogue import BODY, CHANNELS, EFFECTS, KNOWN_VALVE, NEEDS_VALVE, OTHER_FORMS, Forms, Parameter, instrument_forms
from strangers import STRANGERS

BLOCKS = {
    "clean": 120,
    "single": 3 * len(EFFECTS),
    "instrument": 24,
    "pair": 30,
    "triple": 10,
    "wrong_form": 20,
    "outside": 36,
    "twin": 10,
    "repeats": 24,
    "defective": 10,
    "walk": 54,
    "walk_clean": 40,
}
"""Name -> how many datasets of it tell enough."""
HALVES = {"development": 101, "test": 303}
"""Seeds: thresholds are set on the one half, and frozen before the other is looked at."""
SIZES = (2.0, 8.0, 0.7)
"""Of single effects, over the noise."""
REPEATS = (1, 2, 3, 4)
"""Of every trial, in block ``repeats``."""
FAINT = (
    ("braid_hysteresis", "coulomb"),
    ("muscle_damping", "viscous"),
    ("end_taper", "strain"),
    ("pressure_lag", "first_order"),
    ("tendon_hysteresis", "slip"),
    ("volume_coupling", "polytropic"),
)
"""Effects that are hidden at half the noise in block ``repeats``."""
WALKS = ("walk", "walk_clean")
"""Blocks of the gait rig; the others are of the bench."""
IN_WALKS: tuple[tuple[str, str, str | None], ...] = (
    *((name, form, None) for name, form in BODY),
    ("seal_friction", "coulomb", None),
    ("pressure_lag", "first_order", None),
    ("braid_hysteresis", "coulomb", None),
    ("tendon_slack", "dead_length", None),
    ("sensor_offset", "offset", "ankle_angle"),
    ("sensor_gain", "gain", "force"),
    ("sensor_lag", "first_order", "ankle_angle"),
)
"""What is hidden in walks: all of the body, some of the device and of instruments."""
DEFECTS = ("dead_channel", "no_repeats", "no_excitation", "clock_backwards", "saturated_force")
APART = ({"volume_coupling", "choked_valve"}, {"volume_coupling", "leak"})
"""Not hidden together: behind a valve no regulator makes up for what the motion does."""
TWINS = (
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
"""Effects that have a near twin on this rig."""
Spec = dict[str, Any]


def draw(parameter: Parameter, scale: float, sign: float = 1.0) -> float:
    """The value whose distance from neutral is ``scale`` times the typical one, kept within the range."""
    if parameter.neutral == np.inf:  # a frequency: slower is more
        value = parameter.typical / scale
    else:
        neutral = parameter.neutral or 0.0
        value = neutral + (sign if parameter.signed else 1.0) * scale * (parameter.typical - neutral)
    return float(f"{min(max(value, parameter.low), parameter.high):.6g}")


def effect(
    forms: Forms, key: tuple[str, str], rng: np.random.Generator | None, wanted: float | None = None
) -> dict[str, Any]:
    """One effect at its typical size, or at 0.7 to 3 times that where ``rng`` is given.

    ``wanted`` is the size, over the noise, that it is to have in the end; what only shapes it stays as drawn.
    """

    def scale() -> float:
        return 1.0 if rng is None else float(np.exp(rng.uniform(np.log(0.7), np.log(3.0))))

    sign = 1.0 if rng is None else float(rng.choice([-1.0, 1.0]))
    parameters = {name: draw(parameter, scale(), sign) for name, parameter in forms[key].items()}
    found = {"name": key[0], "form": key[1], "parameters": parameters}
    return found if wanted is None or rng is None else found | {"wanted": wanted}


def hidden(*effects: dict[str, Any]) -> Spec:
    """A dataset with ``effects``, in a device with a known valve where one of them needs it."""
    names = {each["name"] for each in effects}
    spec: Spec = {"effects": list(effects)}
    return spec | {"known": [KNOWN_VALVE]} if names & NEEDS_VALVE and "choked_valve" not in names else spec


def plan(block: str, count: int, seed: int, *, typical: bool = False) -> list[Spec]:
    """Specifications of ``count`` datasets: arguments of ``generate.make``, and a name.

    Dataset ``i`` depends on the block, the seed and ``i`` only, so a longer plan begins with the shorter one.
    ``typical`` puts every parameter at its typical value.
    """
    if block not in BLOCKS:
        raise ValueError(f"block {block!r} is none of {', '.join(BLOCKS)}")
    specs, number = [], list(BLOCKS).index(block)
    contents = (
        _content(block, i, None if typical else np.random.default_rng([seed, number, i, 1])) for i in range(count)
    )
    for i, content in enumerate(contents):
        own = int(np.random.SeedSequence([seed, number, i]).generate_state(1)[0])
        specs.append({"name": f"{block}_{seed}_{i:03d}", "seed": own, "block": block, **content})
    return specs


def _content(block: str, i: int, rng: np.random.Generator | None) -> Spec:
    singles, others = list(EFFECTS), list(OTHER_FORMS)
    match block:
        case "clean" | "walk_clean":
            return {}
        case "walk":
            turn, which = divmod(i, len(IN_WALKS))
            name, form, channel = IN_WALKS[which]
            wanted = SIZES[turn % len(SIZES)]
            if channel:
                return _fault((name, form), channel, rng, wanted)
            return {"effects": [effect(EFFECTS | BODY, (name, form), rng, wanted)]}
        case "defective":
            return {"defect": DEFECTS[i % len(DEFECTS)]}
        case "single":
            turn, which = divmod(i, len(singles))
            return hidden(effect(EFFECTS, singles[which], rng, SIZES[turn % len(SIZES)]))
        case "wrong_form":
            turn, which = divmod(i, len(others))
            return hidden(effect(OTHER_FORMS, others[which], rng, (8.0, 2.0)[turn % 2]))
        case "instrument":
            # Neighbours in the order differ in both fault and channel, so that a short plan sees some of each.
            names, channels = list(instrument_forms("force")), list(CHANNELS)
            turn, which = divmod(i, len(names))
            return _fault(names[which], channels[(i + turn) % len(channels)], rng, (8.0, 2.0)[(i + turn // 3) % 2])
        case "twin":
            name, form, channel = TWINS[i % len(TWINS)]
            if channel:
                return _fault((name, form), channel, rng, 2.0)
            return hidden(effect(EFFECTS, (name, form), rng, 2.0))
        case "repeats":
            turn, which = divmod(i, len(FAINT))
            found = hidden(effect(EFFECTS, FAINT[which], rng, 0.5))
            return found | {"repeats": REPEATS[turn % len(REPEATS)], "muscle_length": False}
        case "outside":
            turn, which = divmod(i, 6)
            if which == 0:
                key = list(STRANGERS)[turn % len(STRANGERS)]
                return {"strangers": [effect(STRANGERS, key, rng, 8.0)]}
            known = singles[(5 * turn + which - 1) % len(singles)]
            return hidden(effect(EFFECTS, known, rng, 8.0)) | {"deleted": True}
        case _:
            return _several(2 if block == "pair" else 3, i, rng)


def _fault(key: tuple[str, str], channel: str, rng: np.random.Generator | None, wanted: float) -> Spec:
    return {"instruments": [{**effect(instrument_forms(channel), key, rng, wanted), "channel": channel}]}


def _several(count: int, i: int, rng: np.random.Generator | None) -> Spec:
    """Effects of different names that can be in one device, each 2 to 8 times the noise when alone."""
    generator, keys = rng or np.random.default_rng(i), list(EFFECTS)
    chosen: list[tuple[str, str]] = []
    while len(chosen) < count:
        key = keys[generator.integers(len(keys))]
        names = {name for name, _ in chosen}
        if key[0] not in names and not any({key[0], name} in APART for name in names):
            chosen.append(key)
    sizes = np.exp(generator.uniform(np.log(2.0), np.log(8.0), count))
    return hidden(*(effect(EFFECTS, key, rng, float(size)) for key, size in zip(chosen, sizes, strict=True)))
