"""The device with what was found in it, as a device file."""

import tomllib
from typing import Any

from klute_sim.dataset.override import put, to_toml
from klute_sim.device.files import Device, read
from klute_sim.diagnose.fit import Fit


def augmented(fit: Fit, where: str) -> Device:
    """The device of ``fit`` with its fitted numbers and its effects; ``where`` names the data they are from.

    Effects of instruments are no part of a device and are left out.
    """
    hypothesis, values = fit.hypothesis, fit.values
    keys: dict[str, Any] = tomllib.loads(hypothesis.device.content.decode("utf-8-sig"))
    fitted = f"fitted by klute-sim diagnose to {where}"
    for (key, _), value in zip(hypothesis.uncertain, values, strict=False):
        put(keys, key, value, fitted)
    for number, term in enumerate(hypothesis.terms):
        if term.channel is not None:
            continue
        own = {u.key: value for u, value in zip(hypothesis.unknowns, values, strict=True) if u.term == number}
        keys.setdefault("effects", {})[term.effect] = {"form": term.form, **own}
        keys.setdefault("sources", {}).update({f"effects.{term.effect}.{key}": fitted for key in own})
    return read(to_toml(keys).encode(), f"{hypothesis.device.name} with effects")
