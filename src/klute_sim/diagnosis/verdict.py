"""The verdict as ``verdict.json`` has it."""

from typing import Any

import numpy as np

from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.planning.identifiability import INDISTINGUISHABLE_COSINE
from klute_sim.diagnosis.selection.sparse_regression import format_formula
from klute_sim.diagnosis.workflow import Diagnosis
from klute_sim.effects.families import instrument

VERDICT_SCHEMA = "klute-sim-verdict/1"
DEVICE_FILE_NAME = "device.toml"


def list_alternatives(diagnosis: Diagnosis) -> list[list[str]]:
    """Names of the sets that explain the data as well."""
    own = len(diagnosis.added_terms)
    sets = [[_format_term(term) for term in rival.fit.hypothesis.terms[-own:]] for rival in diagnosis.equivalent_models]
    return [list(each) for each in dict.fromkeys(tuple(sorted(names)) for names in sets)]


def list_indistinguishable_pairs(diagnosis: Diagnosis) -> list[list[str]]:
    """Pairs of effects that these data hardly tell apart: what the device's numbers leave of them looks the same.

    Their traces in the fitted trials, with the device's uncertain numbers projected off, have a cosine beyond
    :data:`klute_sim.diagnosis.planning.identifiability.ALIKE`, in some form of each.
    """
    if not diagnosis.selection_history:
        return []
    every = diagnosis.selection_history[0].candidates
    cosines = np.abs(np.array([one.direction for one in every]) @ np.array([one.direction for one in every]).T)
    names = [_format_term(one.term) for one in every]
    pairs = {
        tuple(sorted((names[i], names[k])))
        for i, k in np.argwhere(cosines > INDISTINGUISHABLE_COSINE)
        if names[i] != names[k]
    }
    return [list(pair) for pair in sorted(pairs)]


def _format_term(term: EffectTerm) -> str:
    return f"{term.effect}@{term.channel}" if term.channel else term.effect


def verdict_to_dict(diagnosis: Diagnosis) -> dict[str, Any]:
    """The object of ``verdict.json``; values in the units of their keys, the gap in the channel's."""
    split = diagnosis.split
    return {
        "schema": VERDICT_SCHEMA,
        "verdict": diagnosis.verdict,
        "reasons": list(diagnosis.reasons),
        "effects": _list_effect_entries(diagnosis, diagnosis.final_fit) if diagnosis.final_fit else [],
        "alternatives": list_alternatives(diagnosis),
        "alike": list_indistinguishable_pairs(diagnosis),
        "split": {"fit": list(split.fit), "select": list(split.validation), "show": list(split.test)},
        "where": [
            {"channel": place.channel, "share": round(place.fraction, 3), "region": place.region}
            for place in diagnosis.misfit_regions
        ],
        "gap": {
            channel: {
                "unit": CHANNEL_UNITS[channel][0],
                "before": gap.refitted / CHANNEL_UNITS[channel][1],
                "after": gap.with_effects / CHANNEL_UNITS[channel][1],
                "floor": None if gap.noise_floor is None else gap.noise_floor / CHANNEL_UNITS[channel][1],
            }
            for channel, gap in diagnosis.channel_rms.items()
        },
        "next_experiment": diagnosis.next_experiment,
        "device_file": DEVICE_FILE_NAME if diagnosis.added_terms and diagnosis.device_is_representable else None,
    }


def _list_effect_entries(diagnosis: Diagnosis, final_fit: Fit) -> list[dict[str, Any]]:
    terms, found = final_fit.hypothesis.terms, []
    for number, term in enumerate(terms):
        rows = zip(final_fit.hypothesis.parameters, final_fit.values, diagnosis.confidence_intervals, strict=True)
        entry: dict[str, Any] = {
            "name": term.effect,
            "form": term.form,
            "kind": term.effect_definition.kind,
            "channel": term.channel,
            "parameters": {
                u.key: {"value": value, "low": low, "high": high}
                for u, value, (low, high) in rows
                if u.term_index == number
            },
        }
        if term.effect_definition.data_driven:
            entry |= {"data_driven": True, "formula": format_formula(final_fit)}
        elif diagnosis.verdict in ("unexplained", "insufficient-data"):
            entry["proxy"] = True
        found.append(entry)
    for channel, display in diagnosis.quantizers.items():
        step, error = (
            display.resolution / CHANNEL_UNITS[channel][1],
            display.resolution_error / CHANNEL_UNITS[channel][1],
        )
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
