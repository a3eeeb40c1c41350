"""Which datasets a block holds."""

from collections.abc import Iterator
from itertools import cycle, islice
from typing import Any

import numpy as np
from catalogue import CHANNELS, EFFECTS, KNOWN_VALVE, NEEDS_VALVE, OTHER_FORMS, Forms, Parameter, instrument_forms

BLOCKS = ("clean", "single", "instrument", "pair", "defective", "wrong_form")
DEFECTS = ("dead_channel", "no_repeats", "no_excitation", "clock_backwards", "saturated_force")
APART = ({"volume_coupling", "choked_valve"}, {"volume_coupling", "leak"})
"""Not hidden together: behind a valve no regulator makes up for what the motion does."""
Spec = dict[str, Any]


def draw(parameter: Parameter, scale: float, sign: float = 1.0) -> float:
    """The value whose distance from neutral is ``scale`` times the typical one, kept within the range."""
    if parameter.neutral == np.inf:  # a frequency: slower is more
        value = parameter.typical / scale
    else:
        neutral = parameter.neutral or 0.0
        value = neutral + (sign if parameter.signed else 1.0) * scale * (parameter.typical - neutral)
    return float(f"{min(max(value, parameter.low), parameter.high):.6g}")


def effect(forms: Forms, key: tuple[str, str], rng: np.random.Generator | None) -> dict[str, Any]:
    """One effect at its typical size, or at 0.7 to 3 times that where ``rng`` is given."""

    def scale() -> float:
        return 1.0 if rng is None else float(np.exp(rng.uniform(np.log(0.7), np.log(3.0))))

    sign = 1.0 if rng is None else float(rng.choice([-1.0, 1.0]))
    parameters = {name: draw(parameter, scale(), sign) for name, parameter in forms[key].items()}
    return {"name": key[0], "form": key[1], "parameters": parameters}


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
    specs = []
    for i, content in enumerate(islice(_contents(block, seed, typical), count)):
        own = int(np.random.SeedSequence([seed, BLOCKS.index(block), i]).generate_state(1)[0])
        specs.append({"name": f"{block}_{seed}_{i:03d}", "seed": own, "block": block, **content})
    return specs


def _contents(block: str, seed: int, typical: bool) -> Iterator[Spec]:
    def rng(i: int) -> np.random.Generator | None:
        return None if typical else np.random.default_rng([seed, BLOCKS.index(block), i, 1])

    if block == "clean":
        yield from cycle([{}])
    elif block == "defective":
        yield from ({"defect": defect} for defect in cycle(DEFECTS))
    elif block in {"single", "wrong_form"}:
        forms = EFFECTS if block == "single" else OTHER_FORMS
        yield from (hidden(effect(forms, key, rng(i))) for i, key in enumerate(cycle(forms)))
    elif block == "instrument":
        # Neighbours in the order differ in both fault and channel, so that a short plan sees some of each.
        names, channels = list(instrument_forms("force")), list(CHANNELS)
        for i in range(10**9):
            channel = channels[(i + i // len(names)) % len(channels)]
            fault = effect(instrument_forms(channel), names[i % len(names)], rng(i))
            yield {"instruments": [{**fault, "channel": channel}]}
    else:
        for i in range(10**9):
            chooser, keys = np.random.default_rng([seed, BLOCKS.index(block), i]), list(EFFECTS)
            first, second = (keys[k] for k in chooser.choice(len(keys), 2, replace=False))
            while second[0] == first[0] or {first[0], second[0]} in APART:
                second = keys[chooser.integers(len(keys))]
            generator = rng(i)
            yield hidden(effect(EFFECTS, first, generator), effect(EFFECTS, second, generator))
