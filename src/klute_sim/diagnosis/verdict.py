"""Content of ``verdict.json``."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from klute_sim.diagnosis.discrepancy.sparse_regression import format_formula
from klute_sim.diagnosis.evidence import collect_evidence
from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.planning.identifiability import INDISTINGUISHABLE_COSINE
from klute_sim.diagnosis.probability import Probabilities, estimate_probabilities
from klute_sim.diagnosis.rejections import list_rejections
from klute_sim.diagnosis.result import Diagnosis
from klute_sim.diagnosis.selection.predictive_model import PredictiveResult, compare_errors
from klute_sim.diagnosis.transfer_prediction import TransferPrediction, summarize_predictions
from klute_sim.effects.families import instrument

VERDICT_SCHEMA = "klute-sim-verdict/3"
DEVICE_FILE_NAME = "device.toml"


def list_alternatives(diagnosis: Diagnosis) -> list[list[str]]:
    """Return the names of the effects of each equivalent model."""
    models = [
        [term.qualified_name for term in diagnosis.list_added_terms(model.fit)] for model in diagnosis.equivalent_models
    ]
    return [list(names) for names in dict.fromkeys(tuple(sorted(names)) for names in models)]


def list_indistinguishable_pairs(diagnosis: Diagnosis) -> list[list[str]]:
    """Return the pairs of effects that the fitted trials hardly distinguish.

    The sensitivities of some form of each, orthogonal to those of the uncertain numbers of the device, have a cosine
    above :data:`klute_sim.diagnosis.planning.identifiability.INDISTINGUISHABLE_COSINE`.
    """
    if not diagnosis.selection_history:
        return []
    candidates = diagnosis.selection_history[0].candidates
    directions = np.array([candidate.direction for candidate in candidates])
    cosines = np.abs(directions @ directions.T)
    names = [candidate.term.qualified_name for candidate in candidates]
    pairs = {
        tuple(sorted((names[i], names[k])))
        for i, k in np.argwhere(cosines > INDISTINGUISHABLE_COSINE)
        if names[i] != names[k]
    }
    return [list(pair) for pair in sorted(pairs)]


def verdict_to_dict(diagnosis: Diagnosis, predictions: Sequence[TransferPrediction] = ()) -> dict[str, Any]:
    """Return the content of ``verdict.json``: values in the units of their keys, residuals in those of the channels.

    ``predictions`` are those of other datasets.
    """
    split, probabilities = diagnosis.split, estimate_probabilities(diagnosis)
    content = {
        "schema": VERDICT_SCHEMA,
        "verdict": diagnosis.verdict,
        "reasons": list(diagnosis.reasons),
        "accepted": [{"name": finding.name, "sentence": finding.sentence} for finding in diagnosis.dataset.accepted],
        "effects": _list_effect_entries(diagnosis, diagnosis.final_fit, probabilities) if diagnosis.final_fit else [],
        "numbers": _list_fitted_numbers(diagnosis),
        "initial_friction": {e.name: round(e.initial_friction, 3) for e in diagnosis.experiments if e.initial_friction},
        "alternatives": list_alternatives(diagnosis),
        "held_out": diagnosis.held_out,
        "cross_validation": _describe_cross_validation(diagnosis.prediction) if diagnosis.prediction else None,
        "rejected": [
            {
                "name": r.term.effect,
                "form": r.term.form,
                "channel": r.term.channel,
                "number": r.term.number,
                **_list_owners(r.term),
                "reason": r.reason,
            }
            for r in list_rejections(diagnosis)
        ],
        "p_value": diagnosis.p_value,
        "probability_nothing_missing": None if probabilities is None else round(probabilities.nothing_missing, 3),
        "misfit_map": [
            {
                "channel": cell.channel,
                "region": cell.region,
                "misfit_over_noise": round(cell.misfit.rms / cell.misfit.noise_rms, 3),
                "significance": round(cell.misfit.significance, 2),
            }
            for cell in diagnosis.misfit_map
        ],
        "indistinguishable": list_indistinguishable_pairs(diagnosis),
        "split": {"fit": list(split.fit), "validation": list(split.validation), "test": list(split.test)},
        "where": [
            {"channel": region.channel, "share": round(region.fraction, 3), "region": region.region}
            for region in diagnosis.misfit_regions
        ],
        "gap": {
            channel: {
                "unit": CHANNEL_UNITS[channel][0],
                "nominal": rms.nominal / CHANNEL_UNITS[channel][1],
                "refitted": rms.refitted / CHANNEL_UNITS[channel][1],
                "with_effects": rms.with_effects / CHANNEL_UNITS[channel][1],
                "noise_floor": None if rms.noise_floor is None else rms.noise_floor / CHANNEL_UNITS[channel][1],
            }
            for channel, rms in diagnosis.channel_rms.items()
        },
        "next_experiment": diagnosis.next_experiment,
        "direct_measurements": [measurement.to_dict() for measurement in diagnosis.direct_measurements],
        "device_file": DEVICE_FILE_NAME if diagnosis.fitted_device is not None else None,
        "recommended": None if diagnosis.fitted_device is None else diagnosis.recommended_device,
        "predictions": summarize_predictions(predictions),
    }
    finite: dict[str, Any] = _replace_infinite(content)
    return finite


def _replace_infinite(content: Any) -> Any:
    """Return ``content`` with None in place of numbers that JSON does not have."""
    if isinstance(content, dict):
        return {key: _replace_infinite(value) for key, value in content.items()}
    if isinstance(content, list):
        return [_replace_infinite(value) for value in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content


def _list_fitted_numbers(diagnosis: Diagnosis) -> dict[str, dict[str, float]]:
    """Return the fitted numbers of the device that were declared uncertain: key -> declared, fitted, interval."""
    if diagnosis.final_fit is None:
        return {}
    hypothesis = diagnosis.final_fit.hypothesis
    rows = zip(hypothesis.parameters, diagnosis.final_fit.values, diagnosis.confidence_intervals, strict=True)
    return {
        parameter.name: {"declared": parameter.initial, "value": value, "low": low, "high": high}
        for parameter, value, (low, high) in rows
        if parameter.term_index is None
    }


def _list_owners(term: EffectTerm) -> dict[str, str]:
    """Return tendon, part or specimen with the effect of ``term``; empty where all tendons and specimens have it."""
    owners = {"tendon": term.tendon, "part": term.part, "specimen": term.specimen}
    return {key: owner for key, owner in owners.items() if owner is not None}


def _describe_cross_validation(prediction: PredictiveResult) -> dict[str, Any]:
    """Return how well models predict what was left out; errors are relative to the model without added effects."""
    return {
        "left_out": prediction.fold_kind,
        "folds": prediction.n_folds,
        "share": round(prediction.share, 4),
        "stability": {term.qualified_name: round(value, 3) for term, value in prediction.stability.items()},
        "models": [
            {
                "effects": [term.qualified_name for term in model.terms],
                "squared_error": None if ratio is None else round(ratio, 4),
                "reason": model.obstacle or None,
            }
            for model in prediction.models
            for ratio in [compare_errors(model, prediction.base)]
        ],
    }


def _list_effect_entries(
    diagnosis: Diagnosis, final_fit: Fit, probabilities: Probabilities | None
) -> list[dict[str, Any]]:
    entries = []
    evidence = collect_evidence(diagnosis)
    for index, term in enumerate(final_fit.hypothesis.terms):
        rows = zip(final_fit.hypothesis.parameters, final_fit.values, diagnosis.confidence_intervals, strict=True)
        entry: dict[str, Any] = {
            "name": term.effect,
            "form": term.form,
            "kind": term.effect_definition.kind,
            "channel": term.channel,
            "number": term.number,
            "parameters": {
                parameter.name: {"value": value, "low": low, "high": high}
                for parameter, value, (low, high) in rows
                if parameter.term_index == index
            },
        }
        if term.number is not None:
            entry["declared"] = next(p.initial for p in final_fit.hypothesis.parameters if p.term_index == index)
        if term in evidence:
            entry["evidence"] = evidence[term]._asdict()
        if probabilities and term in probabilities.names:
            entry["probability"] = round(probabilities.names[term], 3)
        entry |= _list_owners(term)
        if term.effect_definition.data_driven:
            entry |= {"data_driven": True, "formula": format_formula(final_fit)}
        elif diagnosis.has_proxies:
            entry["proxy"] = True
        entries.append(entry)
    effect = instrument.QUANTIZATION
    form = effect.forms[0]
    for channel, quantizer in diagnosis.quantizers.items():
        si = CHANNEL_UNITS[channel][1]
        resolution, error = quantizer.resolution / si, quantizer.resolution_error / si
        entries.append(
            {
                "name": effect.name,
                "form": form.name,
                "kind": effect.kind,
                "channel": channel,
                "parameters": {
                    form.parameters[0].key: {"value": resolution, "low": resolution - error, "high": resolution + error}
                },
            }
        )
    return entries
