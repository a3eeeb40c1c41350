"""The direct measurements that a verdict proposes, made on the plant: which names they refute."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from benchmarks.hidden_effects.score import Truth, Verdict, list_effect_sets, remove_joint

STREAM = 5
"""Number of the random stream of these measurements, beside those of the dataset."""


def list_refuted_names(truth: Truth, verdict: Verdict) -> tuple[str, ...]:
    """Return the names that the direct measurements of ``verdict`` refute, as ``--exclude`` takes them.

    A measurement has its stated accuracy. It refutes a name whose interval is further from the measured value than the
    value without it is. Otherwise it confirms the name, and refutes what only the sets without it contain.
    """
    rng = np.random.default_rng([truth["seed"], STREAM])
    sets = [set(effect_set) for effect_set in list_effect_sets(verdict)]
    refuted: set[str] = set()
    for measurement in verdict.get("direct_measurements", ()):
        measured = find_true_value(truth, measurement) + measurement["accuracy"] * rng.standard_normal()
        name = remove_joint(measurement["name"])
        outside = max(measurement["low"] - measured, measured - measurement["high"], 0.0)
        if outside > abs(measured - measurement["otherwise"]):
            refuted.add(name)
        else:
            remaining = set().union(*(names for names in sets if name in names))
            refuted |= set().union(*sets) - remaining
    return tuple(sorted(refuted))


def find_true_value(truth: Truth, measurement: Mapping[str, Any]) -> float:
    """Return the value of the measured quantity in the plant: what is hidden, or else the value without the name."""
    effect, _, owner = remove_joint(measurement["name"]).partition("@")
    hidden = [entry for kind in ("effects", "instruments", "numbers") for entry in truth.get(kind, ())]
    for entry in hidden:
        place = entry.get("channel") or entry.get("number") or entry.get("tendon") or ""
        if (entry["name"], place) == (effect, owner):
            values: Mapping[str, float] = entry["parameters"]
            return float(values.get(measurement["quantity"], measurement["otherwise"]))
    return float(measurement["otherwise"])
