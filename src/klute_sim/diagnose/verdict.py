"""The verdict as ``verdict.json`` has it."""

from typing import Any

import numpy as np

from klute_sim.diagnose.confusable import ALIKE
from klute_sim.diagnose.diagnosis import Diagnosis
from klute_sim.diagnose.experiment import UNITS
from klute_sim.diagnose.fallback import formula
from klute_sim.diagnose.fit import Fit
from klute_sim.diagnose.hypothesis import Term
from klute_sim.effects import instrument

SCHEMA = "klute-sim-verdict/1"
DEVICE_FILE = "device.toml"


def alternatives(diagnosis: Diagnosis) -> list[list[str]]:
    """Names of the sets that explain the data as well."""
    own = len(diagnosis.found)
    sets = [[_name(term) for term in rival.fit.hypothesis.terms[-own:]] for rival in diagnosis.rivals]
    return [list(each) for each in dict.fromkeys(tuple(sorted(names)) for names in sets)]


def alike(diagnosis: Diagnosis) -> list[list[str]]:
    """Pairs of effects that these data hardly tell apart: what the device's numbers leave of them looks the same.

    Their traces in the fitted trials, with the device's uncertain numbers projected off, have a cosine beyond
    :data:`klute_sim.diagnose.confusable.ALIKE`, in some form of each.
    """
    if not diagnosis.steps:
        return []
    every = diagnosis.steps[0].candidates
    cosines = np.abs(np.array([one.signature for one in every]) @ np.array([one.signature for one in every]).T)
    names = [_name(one.term) for one in every]
    pairs = {tuple(sorted((names[i], names[k]))) for i, k in np.argwhere(cosines > ALIKE) if names[i] != names[k]}
    return [list(pair) for pair in sorted(pairs)]


def _name(term: Term) -> str:
    return f"{term.effect}@{term.channel}" if term.channel else term.effect


def as_json(diagnosis: Diagnosis) -> dict[str, Any]:
    """The object of ``verdict.json``; values in the units of their keys, the gap in the channel's."""
    split = diagnosis.split
    return {
        "schema": SCHEMA,
        "verdict": diagnosis.verdict,
        "reasons": list(diagnosis.reasons),
        "effects": _effects(diagnosis, diagnosis.final) if diagnosis.final else [],
        "alternatives": alternatives(diagnosis),
        "alike": alike(diagnosis),
        "split": {"fit": list(split.fit), "select": list(split.select), "show": list(split.show)},
        "where": [
            {"channel": place.channel, "share": round(place.share, 3), "region": place.region}
            for place in diagnosis.where
        ],
        "gap": {
            channel: {
                "unit": UNITS[channel][0],
                "before": gap.refitted / UNITS[channel][1],
                "after": gap.after / UNITS[channel][1],
                "floor": None if gap.floor is None else gap.floor / UNITS[channel][1],
            }
            for channel, gap in diagnosis.gap.items()
        },
        "next_experiment": diagnosis.next_experiment,
        "device_file": DEVICE_FILE if diagnosis.found and diagnosis.device_written else None,
    }


def _effects(diagnosis: Diagnosis, final: Fit) -> list[dict[str, Any]]:
    terms, found = final.hypothesis.terms, []
    for number, term in enumerate(terms):
        rows = zip(final.hypothesis.unknowns, final.values, diagnosis.intervals, strict=True)
        entry: dict[str, Any] = {
            "name": term.effect,
            "form": term.form,
            "kind": term.entry.kind,
            "channel": term.channel,
            "parameters": {
                u.key: {"value": value, "low": low, "high": high} for u, value, (low, high) in rows if u.term == number
            },
        }
        if term.entry.data_driven:
            entry |= {"data_driven": True, "formula": formula(final)}
        elif diagnosis.verdict in ("unexplained", "insufficient-data"):
            entry["proxy"] = True
        found.append(entry)
    for channel, display in diagnosis.displays.items():
        step, error = display.step / UNITS[channel][1], display.error / UNITS[channel][1]
        own = instrument.QUANTISATION
        found.append(
            {
                "name": own.name,
                "form": own.forms[0].name,
                "kind": own.kind,
                "channel": channel,
                "parameters": {
                    own.forms[0].parameters[0].key: {"value": step, "low": step - error, "high": step + error}
                },
            }
        )
    return found
