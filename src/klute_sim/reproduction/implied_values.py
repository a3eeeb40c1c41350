"""What the source's other printed numbers make of an item: only with them is a contradiction its own and not ours.

Nothing here comes from our laws or devices: every number is read from the list of what is printed.
"""

import math
from collections.abc import Mapping

from klute_sim.reproduction import printed

MAX_INSIGNIFICANT_FORCE = 0.05
"""Force [F0] up to which a muscle's passive force is insignificant (assumed: the text gives no number)."""
MAX_PROPORTIONAL_RATIO = 1.1
"""Ratio up to which something is proportional (assumed)."""
MAX_UNCHANGED_PERCENT = 1.0
"""Change [%] up to which force does not depend on velocity (assumed)."""

ImpliedValues = Mapping[str, float | bool]
"""Identifier -> the number that follows, or whether the statement holds."""


def compute_implied_values() -> ImpliedValues:
    """Everything that the printed numbers imply about each other."""
    p = printed.published_numbers()
    found: dict[str, float | bool] = {}
    for name in _names(p, "table-2.3.", ".k5"):
        found[f"table-2.3.{name}.at-rest"] = sum(p[f"table-2.3.{name}.{k}"] for k in ("k5", "k6", "k7"))
    for name in _names(p, "table-2.4.", ".a"):
        a, b = p[f"table-2.4.{name}.a"], p[f"table-2.4.{name}.b"]
        found[f"table-2.4.{name}.at-vmax"] = (1.0 + a) * b / (1.0 + b) - a
    for size in _names(p, "table-3.1.", ".turns"):
        braid, rest, turns = (p[f"table-3.1.{size}.{k}"] for k in ("braid", "l0", "turns"))
        found[f"table-3.1.{size}.radius"] = math.sqrt(braid * braid - rest * rest) / (2.0 * math.pi * turns)
    passive = [p[f"table-2.1.{n}.k1"] * 1.2 ** p[f"table-2.1.{n}.k2"] for n in _names(p, "table-2.1.", ".k1")]
    found["table-2.1.insignificant"] = max(passive) <= MAX_INSIGNIFICANT_FORCE
    found["table-2.4.order"] = _is_ordered(p)
    found["eq-2.5.around"] = all(
        p[f"eq-2.5.{k}.low"] <= p[f"table-2.3.{n}.{k}"] <= p[f"eq-2.5.{k}.high"]
        for n in _names(p, "table-2.3.", ".k5")
        for k in ("k5", "k6", "k7")
    )
    friction = {bar: p["table-3.1.1-1-4.m"] * bar + p["table-3.1.1-1-4.b"] for bar in (2.0, 3.0, 4.0, 5.0)}
    found["fig-3.4.bladder"] = friction[5.0]
    found["fig-3.4.geometric"] = friction[5.0] + p["fig-3.4.difference"]
    found["fig-3.4.proportional"] = all(
        friction[x] / friction[5.0] <= MAX_PROPORTIONAL_RATIO * x / 5.0 for x in friction
    )
    found["fig-3.7.rest"] = p["table-3.1.3-4.l0"]
    lost = 100.0 * abs(p["fig-3.9.fast"] / p["fig-3.9.slow"] - 1.0)
    found["fig-3.7.velocity"] = lost < MAX_UNCHANGED_PERCENT
    return found


def _names(numbers: Mapping[str, float], prefix: str, suffix: str) -> list[str]:
    return [name[len(prefix) : -len(suffix)] for name in numbers if name.startswith(prefix) and name.endswith(suffix)]


def _is_ordered(numbers: Mapping[str, float]) -> bool:
    """Whether the four measured curves of Fig. 2.5 lie in the order of the text, from 5 to 95 % of Vmax."""

    def force(name: str, velocity: float) -> float:
        a, b = numbers[f"table-2.4.{name}.a"], numbers[f"table-2.4.{name}.b"]
        return (1.0 + a) * b / (velocity + b) - a

    pairs = (("human", "rat"), ("rat", "frog"), ("frog", "cat"))
    return all(force(above, 0.05 * k) > force(below, 0.05 * k) for above, below in pairs for k in range(1, 20))
