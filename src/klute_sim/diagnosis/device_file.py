"""Device file of a fitted device."""

from typing import Any

from klute_sim.device.device import Device, parse_device, set_number
from klute_sim.diagnosis.fitting.dependent_numbers import hold_mounting
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.files.toml import format_toml, parse_toml


def augment_device(fit: Fit, source: str, device: Device | None = None, tendon: str | None = None) -> Device:
    """Return the device of ``fit`` with its fitted numbers and effects; ``source`` names the data.

    On a mechanism, ``device`` is that of ``tendon``; by default it is the device of the dataset. Effects of instruments
    are not part of a device and are omitted.
    """
    hypothesis, values = fit.hypothesis, fit.values
    device = device or hypothesis.device
    content: dict[str, Any] = parse_toml(device.content, f"device {device.name}")
    note = f"fitted by klute-sim diagnose to {source}"
    numbers = hypothesis.list_fitted_keys(tendon)
    corrected = hypothesis.correct_numbers(device, tendon, values)
    for key, value in hold_mounting(device.spec.collect_values(), corrected).items():
        set_number(
            content, key, value, note if key in numbers else f"{note}: follows from the numbers that were fitted"
        )
    for index, term in enumerate(hypothesis.terms):
        if term.effect_definition.kind not in ("device", "body") or term.tendon not in (None, tendon):
            continue
        parameters = {
            parameter.name: value
            for parameter, value in zip(hypothesis.parameters, values, strict=True)
            if parameter.term_index == index
        }
        content.setdefault("effects", {})[term.effect] = {"form": term.form, **parameters}
        content.setdefault("sources", {}).update({f"effects.{term.effect}.{key}": note for key in parameters})
    return parse_device(format_toml(content).encode(), f"{device.name} with effects")
