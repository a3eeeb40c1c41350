"""The device with what was found in it, as a device file."""

import tomllib
from typing import Any

from klute_sim.device.changes import set_value, to_toml
from klute_sim.device.device import Device, parse_device
from klute_sim.diagnosis.fitting.least_squares import Fit


def augment_device(fit: Fit, source: str) -> Device:
    """The device of ``fit`` with its fitted numbers and its effects; ``where`` names the data they are from.

    Effects of instruments are no part of a device and are left out.
    """
    hypothesis, values = fit.hypothesis, fit.values
    keys: dict[str, Any] = tomllib.loads(hypothesis.device.content.decode("utf-8-sig"))
    fitted = f"fitted by klute-sim diagnose to {source}"
    for (key, _), value in zip(hypothesis.uncertainties, values, strict=False):
        set_value(keys, key, value, fitted)
    for number, term in enumerate(hypothesis.terms):
        if term.channel is not None:
            continue
        own = {u.key: value for u, value in zip(hypothesis.parameters, values, strict=True) if u.term_index == number}
        keys.setdefault("effects", {})[term.effect] = {"form": term.form, **own}
        keys.setdefault("sources", {}).update({f"effects.{term.effect}.{key}": fitted for key in own})
    return parse_device(to_toml(keys).encode(), f"{hypothesis.device.name} with effects")
