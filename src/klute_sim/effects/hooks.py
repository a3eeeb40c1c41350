"""All forms of a catalogue chained at their hooks, so that one compiled law can be every combination of them.

``values`` holds, for each form in turn, 1 if it is active and 0 if not, then its parameters; before all of them the
number of active forms. A form that is not active costs one comparison, a device without effects one for all.
"""

import types
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from klute_sim.effects.effect import HOOKS, Form


class Slot(NamedTuple):
    """Where a form keeps its numbers."""

    effect: str
    form: Form
    at: int
    """Of its switch among the values; its parameters follow."""
    memory: int
    """Where its memory begins."""


def slots(forms: Sequence[tuple[str, Form]]) -> list[Slot]:
    """Places for ``forms`` (effect's name, form), one behind the other."""
    found, at, memory = [], 1, 0
    for effect, form in forms:
        found.append(Slot(effect, form, at, memory))
        at += 1 + len(form.parameters)
        memory += form.memory
    return found


def assemble(
    places: Sequence[Slot],
    law_of: Callable[[Any], Any] = lambda law: law,
    made: Callable[[Any], Any] = lambda function: function,
) -> types.ModuleType:
    """A module with one function per hook: ``hook(values, memory, value, ...)``.

    ``law_of`` turns a form's law into what is called, ``made`` a finished function into what calls it: compiled ones,
    for the compiled law.
    """
    module = types.ModuleType(f"{__name__} (assembled)")
    for hook in HOOKS:
        if hook in ("remember", "reading", "foot"):
            continue
        function = made(_untouched)
        for place in places:
            if hook in place.form.laws:
                function = made(_then(function, law_of(place.form.laws[hook]), place))
        setattr(module, hook, function)
    function = made(_nothing)
    for place in places:
        if place.form.memory:
            function = made(_and(function, law_of(place.form.laws["remember"]), place))
    module.remember = function  # type: ignore[attr-defined]
    return module


def _untouched(values: Any, memory: Any, value: float, *context: Any) -> float:
    return value


def _then(before: Any, law: Any, place: Slot) -> Any:
    # Plain numbers, so that a compiler takes them for constants.
    at, begin, end = place.at, place.at + 1, place.at + 1 + len(place.form.parameters)
    first, last = place.memory, place.memory + place.form.memory

    def chained(values: Any, memory: Any, value: float, *context: Any) -> Any:
        value = before(values, memory, value, *context)
        if values[at] != 0.0:
            return law(values[begin:end], memory[first:last], value, *context)
        return value

    return chained


def _nothing(values: Any, memory: Any, *context: Any) -> Any:
    return ()


def _and(before: Any, law: Any, place: Slot) -> Any:
    at, begin, end = place.at, place.at + 1, place.at + 1 + len(place.form.parameters)
    first, last = place.memory, place.memory + place.form.memory

    def remembered(values: Any, memory: Any, *context: Any) -> Any:
        others = before(values, memory, *context)
        if values[at] != 0.0:
            return others + law(values[begin:end], memory[first:last], *context)
        return others + memory[first:last]

    return remembered
