"""Values that the printed numbers of the source imply for other items.

They show whether the source contradicts itself. Every number comes from the published items, none from the laws or
devices of this package.
"""

import math
from collections.abc import Mapping

from klute_sim.reproduction import printed

ImpliedValues = Mapping[str, float | bool]
"""Implied number, or truth of a statement without a number, by item identifier."""


def compute_implied_values() -> ImpliedValues:
    """Return all values that printed numbers imply for other items."""
    numbers = printed.get_published_numbers()
    values: dict[str, float | bool] = {}
    for name in _list_names(numbers, "table-2.3.", ".k5"):
        values[f"table-2.3.{name}.at-rest"] = sum(numbers[f"table-2.3.{name}.{k}"] for k in ("k5", "k6", "k7"))
    for name in _list_names(numbers, "table-2.4.", ".a"):
        a, b = numbers[f"table-2.4.{name}.a"], numbers[f"table-2.4.{name}.b"]
        values[f"table-2.4.{name}.at-vmax"] = (1.0 + a) * b / (1.0 + b) - a
    for size in _list_names(numbers, "table-3.1.", ".turns"):
        braid, resting_length, turns = (numbers[f"table-3.1.{size}.{k}"] for k in ("braid", "l0", "turns"))
        values[f"table-3.1.{size}.radius"] = math.sqrt(braid * braid - resting_length * resting_length) / (
            2.0 * math.pi * turns
        )
    passive_forces = [
        numbers[f"table-2.1.{n}.k1"] * 1.2 ** numbers[f"table-2.1.{n}.k2"]
        for n in _list_names(numbers, "table-2.1.", ".k1")
    ]
    values["table-2.1.insignificant"] = max(passive_forces)
    values["table-2.4.order"] = _is_ordered(numbers)
    values["eq-2.5.around"] = all(
        numbers[f"eq-2.5.{k}.low"] <= numbers[f"table-2.3.{n}.{k}"] <= numbers[f"eq-2.5.{k}.high"]
        for n in _list_names(numbers, "table-2.3.", ".k5")
        for k in ("k5", "k6", "k7")
    )
    friction = {bar: numbers["table-3.1.1-1-4.m"] * bar + numbers["table-3.1.1-1-4.b"] for bar in (2.0, 3.0, 4.0, 5.0)}
    values["fig-3.4.bladder"] = friction[5.0]
    values["fig-3.4.geometric"] = friction[5.0] + numbers["fig-3.4.difference"]
    values["fig-3.4.proportional"] = max(friction[x] / friction[5.0] / (x / 5.0) for x in friction)
    values["fig-3.7.rest"] = numbers["table-3.1.3-4.l0"]
    values["fig-3.7.velocity"] = 100.0 * abs(numbers["fig-3.9.fast"] / numbers["fig-3.9.slow"] - 1.0)
    return values


def _list_names(numbers: Mapping[str, float], prefix: str, suffix: str) -> list[str]:
    """Return the middle parts of the identifiers with ``prefix`` and ``suffix``."""
    return [name[len(prefix) : -len(suffix)] for name in numbers if name.startswith(prefix) and name.endswith(suffix)]


def _is_ordered(numbers: Mapping[str, float]) -> bool:
    """Return whether the four measured curves of Fig. 2.5 are ordered as in the text, from 5 to 95 % of Vmax."""

    def force(name: str, velocity: float) -> float:
        a, b = numbers[f"table-2.4.{name}.a"], numbers[f"table-2.4.{name}.b"]
        return (1.0 + a) * b / (velocity + b) - a

    pairs = (("human", "rat"), ("rat", "frog"), ("frog", "cat"))
    return all(force(above, 0.05 * k) > force(below, 0.05 * k) for above, below in pairs for k in range(1, 20))
