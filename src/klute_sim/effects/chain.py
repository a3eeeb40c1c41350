"""Chains of all effect forms at their hooks, so that one compiled device covers every combination of effects.

The sequence ``values`` starts with the number of active forms. Then follow, for each form, its switch (1 active, 0
inactive) and its parameters. An inactive form costs one comparison; a device without effects costs one comparison in
total. The sequence ``states`` holds the internal states of all forms.
"""

import types
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from klute_sim.effects.effect import HOOKS, SEPARATE_HOOKS, EffectForm


class EffectSlot(NamedTuple):
    """Position of a form's numbers in ``values`` and ``states``."""

    effect: str
    """Name of the effect."""
    form: EffectForm
    """Form of the effect."""
    switch_index: int
    """Index of the switch in ``values``; the parameters follow it."""
    state_start: int
    """Index of the first internal state in ``states``."""


def allocate_slots(forms: Sequence[tuple[str, EffectForm]]) -> list[EffectSlot]:
    """Return consecutive slots for ``forms``, given as pairs (name of the effect, form)."""
    slots, switch_index, state_start = [], 1, 0
    for effect, form in forms:
        slots.append(EffectSlot(effect, form, switch_index, state_start))
        switch_index += 1 + len(form.parameters)
        state_start += form.n_states
    return slots


def chain_hooks(
    slots: Sequence[EffectSlot],
    compile_law: Callable[[Any], Any] = lambda law: law,
    compile_function: Callable[[Any], Any] = lambda function: function,
) -> types.ModuleType:
    """Return a module with one function per hook: ``hook(values, states, value, *context)``.

    The defaults give plain Python. For the compiled backend, ``compile_law`` returns the compiled version of a form's
    law, and ``compile_function`` compiles each link of the chain.
    """
    module = types.ModuleType(f"{__name__} (assembled)")
    for hook in HOOKS:
        if hook in SEPARATE_HOOKS:
            continue
        function = compile_function(_identity)
        for slot in slots:
            if hook in slot.form.laws:
                function = compile_function(_chain_law(function, compile_law(slot.form.laws[hook]), slot))
        setattr(module, hook, function)
    function = compile_function(_empty_state)
    for slot in slots:
        if slot.form.states:
            function = compile_function(_chain_state(function, compile_law(slot.form.laws["next_state"]), slot))
    module.next_state = function  # type: ignore[attr-defined]
    return module


def _identity(values: Any, states: Any, value: float, *context: Any) -> float:
    return value


def _empty_state(values: Any, states: Any, *context: Any) -> Any:
    return ()


_LAW_LINK = """
def link(values, states, value, *context):
    value = previous(values, states, value, *context)
    if values[{switch}] != 0.0:
        return law(Parameters({parameters}), State({state}), value, *context)
    return value
"""
_STATE_LINK = """
def link(values, states, *context):
    preceding = previous(values, states, *context)
    if values[{switch}] != 0.0:
        after = law(Parameters({parameters}), State({state}), *context)
        return preceding + ({after},)
    return preceding + ({state},)
"""


def _chain_law(previous: Any, law: Any, slot: EffectSlot) -> Any:
    return _write_link(_LAW_LINK, previous, law, slot)


def _chain_state(previous: Any, law: Any, slot: EffectSlot) -> Any:
    return _write_link(_STATE_LINK, previous, law, slot)


def _write_link(template: str, previous: Any, law: Any, slot: EffectSlot) -> Any:
    """Return the function of ``template`` for ``slot``.

    The indices are written out because a compiler cannot build a named tuple from a slice of an array.
    """
    form, names = slot.form, {"previous": previous, "law": law}
    first_parameter = slot.switch_index + 1
    code = template.format(
        switch=slot.switch_index,
        parameters=", ".join(f"values[{first_parameter + k}]" for k in range(len(form.parameters))),
        state=", ".join(f"states[{slot.state_start + k}]" for k in range(form.n_states)),
        after=", ".join(f"after[{k}]" for k in range(form.n_states)),
    )
    names |= {"Parameters": form.parameter_type, "State": form.state_type, "__name__": __name__}
    exec(code, names)
    return names["link"]
