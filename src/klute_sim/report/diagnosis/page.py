"""Page of a diagnosis: one self-contained HTML file that works offline."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from klute_sim.datasets.channels import get_measured_units
from klute_sim.datasets.mechanism import is_model_number
from klute_sim.diagnosis.discrepancy.sparse_regression import format_formula
from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.imperfect_law import FOLD_WORDS
from klute_sim.diagnosis.noise.misfit import SIGNIFICANCE_SIGMAS, estimate_misfit
from klute_sim.diagnosis.rejections import list_rejections
from klute_sim.diagnosis.result import Diagnosis
from klute_sim.diagnosis.selection.forward_selection import MAX_EFFECTS
from klute_sim.diagnosis.selection.predictive_model import compare_errors
from klute_sim.diagnosis.selection.robustness import EquivalentModel
from klute_sim.diagnosis.transfer_prediction import TransferPrediction
from klute_sim.effects import catalogue
from klute_sim.plant.mjcf.model_numbers import get_number_unit
from klute_sim.provenance import collect_versions
from klute_sim.recording.atomic_file import write_atomically
from klute_sim.report.diagnosis import figures
from klute_sim.report.diagnosis import text as words
from klute_sim.report.diagnosis.prediction import build_numbers_table, build_prediction_table, format_figure_name
from klute_sim.report.html import render_template
from klute_sim.report.run_page import PAGE_FILE, convert_table, encode_picture, list_files

AT_BOUND_NOTE = "at a bound"
TEMPLATE = "diagnosis.html"

UNOBSERVED_BY_RIG = {
    "bench": "The body, its joints and the ground: only the device was on the bench.",
    "gait": "The subject and the ground: motion and load were prescribed as measured.",
    "mjcf": "The model beyond its uncertain numbers: its geometry, masses and friction were taken as given.",
}
"""Rig -> what a diagnosis on it cannot observe."""

FIGURE_CAPTIONS = {
    "before_after": "Measured and simulated values in one trial, with their residuals.",
    "gap": "Gap of every channel (root mean square). The noise between repeats is the lower limit of any model.",
    "ranking": "Candidates of every step: improvement predicted by the screening and achieved by the fit.",
    "localization": "Misfit of the fitted trials, in standard deviations of the noise.",
}


def write_page(diagnosis: Diagnosis, folder: Path, predictions: Sequence[TransferPrediction] = ()) -> None:
    """Write the page of ``diagnosis`` into its ``folder``, with the figures of the folder embedded."""
    files = {name: folder / f"{name}.png" for name in FIGURE_CAPTIONS}
    images = {name: encode_picture(file) for name, file in files.items() if file.is_file()}
    entries = [
        _build_other_dataset_entry(prediction, encode_picture(folder / format_figure_name(number)))
        for number, prediction in enumerate(predictions, 1)
    ]
    write_atomically(folder / PAGE_FILE, render_page(diagnosis, images, list_files(folder), entries))


def render_page(
    diagnosis: Diagnosis,
    images: Mapping[str, str],
    files: Sequence[Mapping[str, str]] = (),
    other_datasets: Sequence[Mapping[str, Any]] = (),
) -> str:
    """Return the page with ``images`` (name -> PNG in base 64) as HTML, in which names from the data are escaped.

    ``files`` have a name and a description each; ``other_datasets`` are the predictions of other datasets.
    """
    context = build_page_context(diagnosis) | {"other_datasets": other_datasets}
    return render_template(TEMPLATE, **context, images=images, captions=FIGURE_CAPTIONS, files=files)


def _build_other_dataset_entry(prediction: TransferPrediction, picture: str) -> dict[str, Any]:
    """Return tables, ``picture`` (PNG in base 64) and warnings of the prediction of another dataset."""
    return {
        "tables": [convert_table(build_prediction_table(prediction)), convert_table(build_numbers_table(prediction))],
        "picture": picture,
        "caption": f"Predicted over measured values of '{prediction.dataset_name}', which nothing was fitted to.",
        "warnings": prediction.warnings,
    }


def build_page_context(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return the content of the page except its figures as text for the template."""
    d = diagnosis
    device = d.dataset.device
    return {
        "title": f"Diagnosis of {d.dataset.folder.resolve().name}",
        "verdict": d.verdict,
        "sentence": words.describe_verdict(d),
        "improvement": words.describe_improvement(d),
        "reasons": [words.format_sentence(reason) for reason in d.reasons],
        "probabilities": words.describe_probabilities(d),
        "warnings": _collect_warnings(d),
        "next_step": words.describe_next_step(d),
        "next_experiment": d.next_experiment["sentence"] if d.next_experiment else "",
        "direct_measurements": [measurement.to_dict()["sentence"] for measurement in d.direct_measurements],
        "effects_heading": _format_effects_heading(d),
        "effects": [_build_effect_entry(d, term) for term in d.added_terms],
        "equivalent_models": _build_equivalent_model_entries(d),
        "equation_residuals": words.describe_equation_residuals(d),
        "misfit_regions": [
            {
                "channel": words.humanize_identifier(region.channel),
                "fraction": f"{100.0 * region.fraction:.0f} %",
                "region": region.region or "uniform",
                "concentration": words.format_number(region.concentration, 3),
            }
            for region in d.misfit_regions
        ],
        "gap": _build_gap_rows(d),
        "evaluated_on": d.evaluated_on,
        "noise": _build_noise_rows(d),
        "significance": f"{SIGNIFICANCE_SIGMAS:.0f}",
        "bic_threshold": f"{d.bic_threshold:.0f}",
        "has_repeats": d.has_repeats,
        "split": _build_split_rows(d),
        "split_description": d.split.description,
        "steps": [_build_step_entry(d, index) for index in range(len(d.selection_history))],
        "prediction": _build_prediction_entry(d),
        "rejections": [
            {"name": words.format_term(r.term), "reason": words.format_sentence(r.reason)} for r in list_rejections(d)
        ],
        "device_parameters": _build_device_parameter_rows(d),
        "device_effects": [words.humanize_identifier(name) for name in device.spec.effects],
        "limitations": _list_limitations(d),
        "n_independent": words.format_number(d.n_independent, 3),
        "n_simulations": d.n_simulations,
        "device": device.name,
        "device_digest": device.digest,
        "digest": d.dataset.digest,
        "versions": collect_versions(),
    }


def _format_effects_heading(diagnosis: Diagnosis) -> str:
    if not diagnosis.has_proxies:
        return "Effects"
    kinds = {term.effect_definition.data_driven: None for term in diagnosis.added_terms}
    names = {False: "proxies: effects that come closest", True: "a data-driven term, which identifies no effect"}
    return words.format_sentence(words.join_words([names[kind] for kind in kinds]))


def _collect_warnings(diagnosis: Diagnosis) -> list[str]:
    warnings = [*diagnosis.dataset.remarks, *filter(None, [words.describe_numbers_at_bounds(diagnosis)])]
    fits = {"without added effects": diagnosis.base_fit}
    if diagnosis.added_terms:
        fits["with the added effects"] = diagnosis.final_fit
    for name, fit in fits.items():
        if fit is not None and not fit.converged:
            warnings.append(f"The fit {name} did not converge: its values are unreliable.")
    return warnings


def _build_effect_entry(diagnosis: Diagnosis, term: EffectTerm) -> dict[str, Any]:
    assert diagnosis.final_fit is not None
    sources = [(words.split_key(p.key)[0], p.source) for p in term.parameters if p.source.startswith("assumed")]
    marks = {False: " (a proxy)", True: " (data-driven)"}
    return {
        "name": words.format_term(term),
        "mark": marks[term.effect_definition.data_driven] if diagnosis.has_proxies else "",
        "identifier": term.effect,
        "number": term.number or "",
        "form": term.form,
        "sentence": term.effect_definition.description,
        "equation": format_formula(diagnosis.final_fit)
        if term.effect_definition.data_driven
        else term.form_definition.equation,
        "parameters": _build_parameter_rows(diagnosis.final_fit, term, diagnosis.confidence_intervals),
        "assumed": sources,
    }


def _build_parameter_rows(
    fit: Fit, term: EffectTerm, intervals: Sequence[tuple[float, float]] = ()
) -> list[dict[str, str]]:
    """Return the fitted parameters of ``term``, with ``intervals`` of all parameters of ``fit`` if there are any."""
    rows, bounds_reached = [], fit.find_bounds_reached()
    term_index = fit.hypothesis.terms.index(term)
    for index, (parameter, value) in enumerate(zip(fit.hypothesis.parameters, fit.values, strict=True)):
        if parameter.term_index == term_index:
            name, unit = words.format_parameter_name(parameter, term.channel)
            row = {"name": name, "key": parameter.name, "unit": unit, "value": words.format_number(value)}
            row["declared"] = words.format_number(parameter.initial) if term.number else ""
            if intervals:
                row["value"], row["lower"], row["upper"] = words.format_interval(value, *intervals[index])
            row["note"] = AT_BOUND_NOTE if index in bounds_reached else ""
            rows.append(row)
    return rows


def _build_equivalent_model_entries(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    entries = []
    for model in diagnosis.equivalent_models:
        terms = diagnosis.list_added_terms(model.fit)
        entries.append(
            {
                "name": words.join_words([words.format_term(term) for term in terms]),
                "difference": _format_difference(model),
                "parameters": [row for term in terms for row in _build_parameter_rows(model.fit, term)],
            }
        )
    return entries


def _format_difference(model: EquivalentModel) -> str:
    """Return in words by how much ``model`` is worse or better than the best one."""
    change = "lower" if model.difference < 0.0 else "higher"
    if model.criterion == "BIC":
        return f"BIC {change} by {abs(model.difference):.1f}"
    return f"squared error of prediction {change} by {100.0 * abs(model.difference):.0f} %"


def _build_gap_rows(diagnosis: Diagnosis) -> list[dict[str, str]]:
    rows = []
    for channel, gap in diagnosis.channel_rms.items():
        unit, si = CHANNEL_UNITS[channel]
        parts = {
            "nominal": gap.nominal,
            "refitted": gap.refitted,
            "with_effects": gap.with_effects,
            "noise_floor": gap.noise_floor,
        }
        row = {
            name: "not repeated" if value is None else words.format_number(value / si, 3)
            for name, value in parts.items()
        }
        # Mean squares, because those of noise and misfit add up.
        noise = (gap.noise_floor or 0.0) ** 2
        misfit = gap.refitted**2 - noise
        removed = (
            1.0 - max(0.0, gap.with_effects**2 - noise) / misfit if misfit > 0.1 * noise and gap.noise_floor else None
        )
        row["removed"] = "-" if removed is None or not diagnosis.added_terms else f"{100.0 * removed:.1f} %"
        rows.append({"channel": words.humanize_identifier(channel), "unit": unit, **row})
    return rows


def _build_noise_rows(diagnosis: Diagnosis) -> list[dict[str, str]]:
    rows = []
    fitted = diagnosis.fitted_experiments
    misfits = [
        estimate_misfit(fitted, fit.residuals, diagnosis.noise) if fit is not None else {}
        for fit in (diagnosis.base_fit, diagnosis.final_fit)
    ]
    for channel, noise in diagnosis.noise.items():
        unit, si = CHANNEL_UNITS[channel]
        row = {
            "channel": words.humanize_identifier(channel),
            "unit": unit,
            "sd": words.format_number(noise.std / si, 3),
            "independent": f"{100.0 * noise.independent_fraction:.0f} %",
            "samples": str(noise.n_samples),
        }
        for name, channel_misfits in zip(("before", "after"), misfits, strict=True):
            misfit = channel_misfits.get(channel)
            row[name] = f"{misfit.rms / misfit.noise_rms:.2f} sd ({misfit.significance:.0f} se)" if misfit else "-"
        rows.append(row)
    return rows


def _build_split_rows(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    groups = {trial.name: trial.group for trial in diagnosis.dataset.trials}
    validation = "effects are selected by them; never fitted"
    if diagnosis.prediction is not None:
        validation = "effects are selected by them; fitted as well, because predictions of left-out data decide"
    uses = (
        ("fit", "parameters are fitted to them", diagnosis.split.fit),
        ("validation", validation, diagnosis.split.validation),
        ("test", "they confirm the result or demote it; nothing is chosen with them", diagnosis.split.test),
    )
    return [
        {"use": use, "purpose": purpose, "trials": [{"name": name, "group": groups[name]} for name in names]}
        for use, purpose, names in uses
    ]


def _build_step_entry(diagnosis: Diagnosis, index: int) -> dict[str, Any]:
    step = diagnosis.selection_history[index]
    bars = figures.rank_candidates(diagnosis, step)
    return {
        "number": index + 1,
        "added": words.format_term(step.added_term) if step.added_term else "",
        "reason": words.format_sentence(step.reason),
        "count": len(bars),
        "bars": [
            {
                "name": bar.name,
                "predicted_drop": _format_tenths(bar.predicted_drop),
                "bic_drop": "not refitted" if bar.bic_drop is None else _format_tenths(bar.bic_drop),
                "note": "" if bar.bic_drop is None or bar.converged else "stopped early: too far behind the best",
                "accepted": bar.accepted,
            }
            for bar in bars
        ],
        "gains": [(group, f"{100.0 * gain:.1f} %") for group, gain in step.validation_gains.items()],
    }


def _build_prediction_entry(diagnosis: Diagnosis) -> dict[str, Any] | None:
    """Return the models that were judged by the prediction of left-out data, best first; None without them."""
    prediction = diagnosis.prediction
    if prediction is None:
        return None
    return {
        "left_out": FOLD_WORDS[prediction.fold_kind],
        "folds": prediction.n_folds,
        "models": [
            {
                "name": words.join_words([words.format_term(term) for term in model.terms]) or "no added effect",
                "error": "a simulation diverges" if ratio is None else f"{100.0 * ratio:.0f} %",
                "note": words.humanize_text(model.obstacle),
                "chosen": model is prediction.chosen,
            }
            for model in prediction.models
            for ratio in [compare_errors(model, prediction.base)]
        ],
    }


def _format_tenths(value: float) -> str:
    return f"{round(value, 1) + 0.0:.1f}"  # adding 0 removes the sign of a negative zero


def _get_unit(key: str) -> str:
    """Return the unit of the number ``key`` of a device or of a model."""
    return get_number_unit(key) if is_model_number(key) else words.split_key(key)[1]


def _build_device_parameter_rows(diagnosis: Diagnosis) -> list[dict[str, str]]:
    """Return the device's uncertain numbers: nominal values, and fitted values without and with effects."""
    dataset = diagnosis.dataset
    nominal: dict[str, float] = {**dataset.device.spec.collect_values(), **dataset.nominal_numbers}
    rows = []
    for index, (key, sd) in enumerate(dataset.uncertainties.items()):
        row, notes = {"key": key, "unit": _get_unit(key)}, []
        row["nominal"], row["sd"] = words.format_number(nominal[key]), words.format_number(sd, 3)
        for name, fit, model in (
            ("before", diagnosis.base_fit, "without added effects"),
            ("after", diagnosis.final_fit, "in the final fit"),
        ):
            if fit is None:
                continue
            row[name], row[f"{name}_sds"] = words.format_number(fit.values[index]), f"{fit.x[index]:+.2f}"
            if index in fit.find_bounds_reached():
                notes.append(f"{AT_BOUND_NOTE} {model}")
        row["note"] = ", ".join(notes)
        if diagnosis.confidence_intervals and diagnosis.final_fit is not None:
            row["after"], row["lower"], row["upper"] = words.format_interval(
                diagnosis.final_fit.values[index], *diagnosis.confidence_intervals[index]
            )
        rows.append(row)
    return rows


def _list_limitations(diagnosis: Diagnosis) -> list[str]:
    """Return what this diagnosis did not examine, one sentence each."""
    limitations = []
    if diagnosis.final_fit is None:
        limitations.append("No effect was examined, because the data are insufficient.")
    else:
        candidates = {candidate.term.effect for step in diagnosis.selection_history for candidate in step.candidates}
        skipped = [words.humanize_identifier(name) for name in catalogue.get_named_effects() if name not in candidates]
        if skipped:
            limitations.append(
                "Effects that were excluded, are in the device already, or change nothing in these trials: "
                f"{words.join_words(skipped)}."
            )
        limitations.append(f"Effects that are not in the catalogue, and combinations of more than {MAX_EFFECTS}.")
        limitations.append("Candidates that were screened and not refitted, beyond the prediction of the screening.")
        accepted = {term.identity for term in diagnosis.added_terms}
        if any(
            s.added_term is not None and s.added_term.identity in accepted and not s.validation_gains
            for s in diagnosis.selection_history
        ):
            limitations.append(
                "Whether each effect improves trials that were not fitted: there are no validation trials."
            )
        if diagnosis.evaluated_on == "fit":
            limitations.append(
                "Predictions of the result: there are no usable test trials, so the gap is that of fitted trials."
            )
        if diagnosis.has_input_weights:
            limitations.append(f"Changes of the inputs between their samples. {words.describe_weights(diagnosis)}")
    measured = {channel for trial in diagnosis.dataset.trials for channel in trial.measured}
    missing = [
        words.humanize_identifier(channel)
        for channel in get_measured_units(diagnosis.dataset.channel_source)
        if channel not in measured
    ]
    if missing:
        limitations.append(f"Channels that were not measured: {words.join_words(missing)}.")
    used = diagnosis.noise if diagnosis.final_fit is not None else measured
    unused = [words.humanize_identifier(channel) for channel in sorted(measured) if channel not in used]
    if unused:
        limitations.append(f"Channels that were measured but could not be used: {words.join_words(unused)}.")
    limitations.append(UNOBSERVED_BY_RIG[diagnosis.dataset.rig])
    return limitations
