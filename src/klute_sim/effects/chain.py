"""Chains of all effect forms at their hooks, so that one compiled device covers every combination of effects.

The sequence ``values`` starts with the number of active forms, in total and at each of :data:`CHAINED_HOOKS`. Then
follow, for each form, its switch (1 active, 0 inactive) and its parameters. A hook without active forms costs one
comparison, at other hooks each inactive form costs one; a device without effects costs one comparison in total. The
sequence ``states`` holds the internal states of all forms.
"""

import types
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from klute_sim.effects.effect import HOOKS, SEPARATE_HOOKS, EffectForm

CHAINED_HOOKS = (*(hook for hook in HOOKS if hook not in SEPARATE_HOOKS), "next_state")
"""Hooks of the device step, in the order of the numbers of forms that are active at them."""
N_COUNTS = 1 + len(CHAINED_HOOKS)
"""Number of counts at the start of ``values``."""


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
    slots, switch_index, state_start = [], N_COUNTS, 0
    for effect, form in forms:
        slots.append(EffectSlot(effect, form, switch_index, state_start))
        switch_index += 1 + len(form.parameters)
        state_start += form.n_states
    return slots


def count_active_forms(values: Sequence[float], slots: Sequence[EffectSlot]) -> list[float]:
    """Return the counts with which ``values`` of ``slots`` start: active forms in total, and at each hook."""
    active = [slot for slot in slots if values[slot.switch_index] != 0.0]
    at_hooks = [sum(hook in slot.form.laws for slot in active) for hook in CHAINED_HOOKS]
    return [float(len(active)), *map(float, at_hooks)]


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
    for index, hook in enumerate(CHAINED_HOOKS):
        setattr(module, hook, _write_hook(index, slots, compile_law, compile_function))
    return module


# Measured: with nested links that unpack the numbers themselves, a device with one effect takes more than twice as
# long. So a hook without active forms returns from a function without variables, the links of a hook are one function,
# and a law has its numbers unpacked in a function of its own, which is called if it is active. The indices are written
# out because a compiler cannot build a named tuple from a slice of an array.
_LAW_SKIP = """
def hook(values, states, value, *context):
    if values[{count}] == 0.0:
        return value
    return chain(values, states, value, *context)
"""
_LAW_CHAIN = """
def chain(values, states, value, *context):
{links}
    return value
"""
_LAW_LINK = """
    if values[{switch}] != 0.0:
        value = apply_{switch}(values, states, value, *context)
"""
_STATE_SKIP = """
def hook(values, states, *context):
    if values[{count}] == 0.0:
        return states[:{n_states}]
    return chain(values, states, *context)
"""
_STATE_CHAIN = """
def chain(values, states, *context):
{links}
    return ({names})
"""
_STATE_LINK = """
    {names} = {state}
    if values[{switch}] != 0.0:
        {names} = apply_{switch}(values, states, *context)
"""
_APPLICATION = """
def apply(values, states, *context):
    return law(Parameters({parameters}), State({state}), *context)
"""


def _write_hook(
    index: int,
    slots: Sequence[EffectSlot],
    compile_law: Callable[[Any], Any],
    compile_function: Callable[[Any], Any],
) -> Any:
    """Return the function of hook ``index``, which applies the laws of all active forms in the order of ``slots``."""
    hook = CHAINED_HOOKS[index]
    acting = [slot for slot in slots if hook in slot.form.laws]
    numbers = range(slots[-1].state_start + slots[-1].form.n_states)
    is_state = hook == "next_state"
    skip, chain, link = (_STATE_SKIP, _STATE_CHAIN, _STATE_LINK) if is_state else (_LAW_SKIP, _LAW_CHAIN, _LAW_LINK)
    applications = {
        f"apply_{slot.switch_index}": compile_function(
            _define(
                "apply",
                _APPLICATION.format(**_format_slot(slot)),
                law=compile_law(slot.form.laws[hook]),
                Parameters=slot.form.parameter_type,
                State=slot.form.state_type,
            )
        )
        for slot in acting
    }
    links = "".join(link.format(**_format_slot(slot)) for slot in acting)
    code = chain.format(links=links, names="".join(f"s{k}, " for k in numbers))
    chained = compile_function(_define("chain", code, **applications))
    return compile_function(_define("hook", skip.format(count=1 + index, n_states=len(numbers)), chain=chained))


def _format_slot(slot: EffectSlot) -> dict[str, Any]:
    """Return the indices and names of the numbers of ``slot`` for the templates."""
    first = slot.switch_index + 1
    numbers = range(slot.state_start, slot.state_start + slot.form.n_states)
    return {
        "switch": slot.switch_index,
        "parameters": ", ".join(f"values[{first + k}]" for k in range(len(slot.form.parameters))),
        "state": "".join(f"states[{k}], " for k in numbers),
        "names": "".join(f"s{k}, " for k in numbers),
    }


def _define(name: str, code: str, **names: Any) -> Any:
    """Return the function ``name`` that ``code`` defines with ``names``."""
    names["__name__"] = __name__
    exec(code, names)
    return names[name]
