"""Device file of a fitted device."""

from typing import Any

from klute_sim.device.device import Device, parse_device, set_number
from klute_sim.diagnosis.fitting.dependent_numbers import complete_numbers
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.files.toml import format_toml, parse_toml


def augment_device(fit: Fit, source: str) -> Device:
    """Return the device of ``fit`` with its fitted numbers and effects; ``source`` names the data.

    Effects of instruments are not part of a device and are omitted.
    """
    hypothesis, values = fit.hypothesis, fit.values
    content: dict[str, Any] = parse_toml(hypothesis.device.content, f"device {hypothesis.device.name}")
    note = f"fitted by klute-sim diagnose to {source}"
    nominal = hypothesis.device.spec.collect_values()
    numbers = hypothesis.collect_numbers(values)
    for key, value in complete_numbers(nominal, numbers).items():
        set_number(
            content, key, value, note if key in numbers else f"{note}: follows from the numbers that were fitted"
        )
    for index, term in enumerate(hypothesis.terms):
        if term.effect_definition.kind not in ("device", "body"):
            continue
        parameters = {
            parameter.name: value
            for parameter, value in zip(hypothesis.parameters, values, strict=True)
            if parameter.term_index == index
        }
        content.setdefault("effects", {})[term.effect] = {"form": term.form, **parameters}
        content.setdefault("sources", {}).update({f"effects.{term.effect}.{key}": note for key in parameters})
    return parse_device(format_toml(content).encode(), f"{hypothesis.device.name} with effects")
