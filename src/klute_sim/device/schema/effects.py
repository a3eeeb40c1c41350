"""The ``[effects.NAME]`` sections of a device file."""

from collections.abc import Mapping

from klute_sim.effects import catalogue
from klute_sim.effects.effect import EffectForm
from klute_sim.errors import InputError
from klute_sim.laws.foot import Foot

EffectContent = Mapping[str, float | str]


def check_effect(name: str, content: EffectContent) -> EffectForm:
    """The form that ``content`` of section ``name`` describes; raises InputError for what no such effect has."""
    named = content.get("form")
    if named is not None and not isinstance(named, str):
        raise InputError(f"[effects.{name}] form = {named!r} is refused; allowed: the name of a form")
    effect, form = catalogue.find_form(name, named)
    if effect.kind == "instrument":
        raise InputError(f"'{name}' is an effect of instruments, not of a device")
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


def pack_effects(sections: Mapping[str, EffectContent]) -> tuple[float, ...]:
    """The law's values for all sections of a file that are of the device itself."""
    return catalogue.pack_effects(select_effects(sections, "device"))


def apply_body_effects(sections: Mapping[str, EffectContent], foot: Foot) -> Foot:
    """``foot`` with all sections of a file that are of the body it is built into."""
    return catalogue.apply_body_effects(select_effects(sections, "body"), foot)


def select_effects(sections: Mapping[str, EffectContent], kind: str) -> dict[tuple[str, str], dict[str, float]]:
    """(effect, form) -> numbers by key, of all sections of a file that are of ``kind``."""
    found = {}
    for name, content in sections.items():
        form = check_effect(name, content)
        if catalogue.get_effects()[name].kind == kind:
            found[name, form.name] = {p.key: float(content[p.key]) for p in form.parameters if p.key in content}
    return found
