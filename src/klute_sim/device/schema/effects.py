"""Sections ``[effects.NAME]`` of a device file."""

from collections.abc import Mapping

from klute_sim.effects import catalogue
from klute_sim.effects.effect import EffectForm
from klute_sim.errors import InputError
from klute_sim.laws.foot import Foot

EffectContent = Mapping[str, float | str]
"""Content of one section: parameters and, optionally, ``form``."""


def check_effect(name: str, content: EffectContent) -> EffectForm:
    """Return the form that the ``content`` of section ``name`` describes.

    Raises InputError when there is no such effect or form, or a key is unknown, missing or out of range.
    """
    form_name = content.get("form")
    if form_name is not None and not isinstance(form_name, str):
        raise InputError(f"[effects.{name}] form = {form_name!r} is refused; allowed: the name of a form")
    effect, form = catalogue.find_form(name, form_name)
    if effect.kind in ("instrument", "mechanism"):
        owner = "instruments" if effect.kind == "instrument" else "a mechanism"
        raise InputError(
            f"'{name}' is an effect of {owner}; allowed in a device file: effects of the device or the body"
        )
    known = {parameter.key: parameter for parameter in form.parameters}
    for key in content:
        if key != "form" and key not in known:
            raise InputError(f"[effects.{name}] unknown key '{key}'; allowed here: form, {', '.join(known)}")
    for key, parameter in known.items():
        value = content.get(key)
        if value is None and effect.data_driven:
            continue
        if value is None:
            raise InputError(f"[effects.{name}] key '{key}' is missing")
        if isinstance(value, str) or not parameter.lower <= value <= parameter.upper:
            raise InputError(
                f"[effects.{name}] {key} = {value!r} is refused; allowed: {parameter.lower:g} to {parameter.upper:g}"
            )
    return form


def find_parameter_limits(effect: str, key: str) -> tuple[float, float]:
    """Return the smallest and the largest value that ``key`` may have in any form of ``effect``."""
    parameters = [p for form in catalogue.get_effects()[effect].forms for p in form.parameters if p.key == key]
    return min(p.lower for p in parameters), max(p.upper for p in parameters)


def pack_effects(sections: Mapping[str, EffectContent]) -> tuple[float, ...]:
    """Return the effect values of a device (:func:`klute_sim.effects.catalogue.pack_effects`)."""
    return catalogue.pack_effects(select_effects(sections, "device"))


def apply_body_effects(sections: Mapping[str, EffectContent], foot: Foot) -> Foot:
    """Return ``foot`` with the effects that change the body."""
    return catalogue.apply_body_effects(select_effects(sections, "body"), foot)


def select_effects(sections: Mapping[str, EffectContent], kind: str) -> dict[tuple[str, str], dict[str, float]]:
    """Return (effect, form) -> parameters by key, in the units of the keys, for all effects of ``kind``."""
    selected = {}
    for name, content in sections.items():
        form = check_effect(name, content)
        if catalogue.get_effects()[name].kind == kind:
            selected[name, form.name] = {p.key: float(content[p.key]) for p in form.parameters if p.key in content}
    return selected
