"""All forms of a catalogue chained at their hooks, so that one compiled law can be every combination of them.

``values`` holds, for each form in turn, 1 if it is active and 0 if not, then its parameters; before all of them the
number of active forms. A form that is not active costs one comparison, a device without effects one for all.
"""

import types
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from klute_sim.effects.effect import HOOKS, EffectForm


class EffectSlot(NamedTuple):
    """Where a form keeps its numbers."""

    effect: str
    form: EffectForm
    switch_index: int
    """Of its switch among the values; its parameters follow."""
    state_start: int
    """Where its memory begins."""


def allocate_slots(forms: Sequence[tuple[str, EffectForm]]) -> list[EffectSlot]:
    """Places for ``forms`` (effect's name, form), one behind the other."""
    found, at, memory = [], 1, 0
    for effect, form in forms:
        found.append(EffectSlot(effect, form, at, memory))
        at += 1 + len(form.parameters)
        memory += form.n_states
    return found


def chain_hooks(
    slots: Sequence[EffectSlot],
    compile_law: Callable[[Any], Any] = lambda law: law,
    compile_function: Callable[[Any], Any] = lambda function: function,
) -> types.ModuleType:
    """A module with one function per hook: ``hook(values, memory, value, ...)``.

    ``law_of`` turns a form's law into what is called, ``made`` a finished function into what calls it: compiled ones,
    for the compiled law.
    """
    module = types.ModuleType(f"{__name__} (assembled)")
    for hook in HOOKS:
        if hook in ("remember", "reading", "foot"):
            continue
        function = compile_function(_identity)
        for place in slots:
            if hook in place.form.laws:
                function = compile_function(_chain_law(function, compile_law(place.form.laws[hook]), place))
        setattr(module, hook, function)
    function = compile_function(_empty_state)
    for place in slots:
        if place.form.n_states:
            function = compile_function(_chain_state(function, compile_law(place.form.laws["remember"]), place))
    module.remember = function  # type: ignore[attr-defined]
    return module


def _identity(values: Any, state: Any, value: float, *context: Any) -> float:
    return value


def _chain_law(previous: Any, law: Any, slot: EffectSlot) -> Any:
    # Plain numbers, so that a compiler takes them for constants.
    at, begin, end = slot.switch_index, slot.switch_index + 1, slot.switch_index + 1 + len(slot.form.parameters)
    first, last = slot.state_start, slot.state_start + slot.form.n_states

    def chained(values: Any, memory: Any, value: float, *context: Any) -> Any:
        value = previous(values, memory, value, *context)
        if values[at] != 0.0:
            return law(values[begin:end], memory[first:last], value, *context)
        return value

    return chained


def _empty_state(values: Any, state: Any, *context: Any) -> Any:
    return ()


def _chain_state(previous: Any, law: Any, slot: EffectSlot) -> Any:
    at, begin, end = slot.switch_index, slot.switch_index + 1, slot.switch_index + 1 + len(slot.form.parameters)
    first, last = slot.state_start, slot.state_start + slot.form.n_states

    def remembered(values: Any, memory: Any, *context: Any) -> Any:
        others = previous(values, memory, *context)
        if values[at] != 0.0:
            return others + law(values[begin:end], memory[first:last], *context)
        return others + memory[first:last]

    return remembered
