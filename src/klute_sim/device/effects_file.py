"""The ``[effects.NAME]`` sections of a device file."""

from collections.abc import Mapping

from klute_sim.effects import catalogue
from klute_sim.effects.effect import Form
from klute_sim.errors import InputError
from klute_sim.laws.foot import Foot

Content = Mapping[str, float | str]


def check(name: str, content: Content) -> Form:
    """The form that ``content`` of section ``name`` describes; raises InputError for what no such effect has."""
    named = content.get("form")
    if named is not None and not isinstance(named, str):
        raise InputError(f"[effects.{name}] form = {named!r} is refused; allowed: the name of a form")
    effect, form = catalogue.form_of(name, named)
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
        if isinstance(value, str) or not parameter.low <= value <= parameter.high:
            raise InputError(
                f"[effects.{name}] {key} = {value!r} is refused; allowed: {parameter.low:g} to {parameter.high:g}"
            )
    return form


def values(sections: Mapping[str, Content]) -> tuple[float, ...]:
    """The law's values for all sections of a file that are of the device itself."""
    return catalogue.values(active(sections, "device"))


def edited(sections: Mapping[str, Content], foot: Foot) -> Foot:
    """``foot`` with all sections of a file that are of the body it is built into."""
    return catalogue.edited(active(sections, "body"), foot)


def active(sections: Mapping[str, Content], kind: str) -> dict[tuple[str, str], dict[str, float]]:
    """(effect, form) -> numbers by key, of all sections of a file that are of ``kind``."""
    found = {}
    for name, content in sections.items():
        form = check(name, content)
        if catalogue.effects()[name].kind == kind:
            found[name, form.name] = {p.key: float(content[p.key]) for p in form.parameters if p.key in content}
    return found
