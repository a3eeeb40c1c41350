"""The report of a diagnosis as one HTML file that needs nothing else, not even a network."""

import base64
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from klute_sim.datasets.channels import MEASURED_CHANNELS
from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.noise.repeats import SIGNIFICANCE_SIGMAS, estimate_misfit
from klute_sim.diagnosis.selection.forward_selection import MAX_EFFECTS
from klute_sim.diagnosis.selection.sparse_regression import format_formula
from klute_sim.diagnosis.workflow import Diagnosis
from klute_sim.effects import catalogue
from klute_sim.provenance import collect_versions
from klute_sim.report.diagnosis import figures as pictures
from klute_sim.report.diagnosis import text as words
from klute_sim.report.html import render_template

AT_BOUND_NOTE = "at the end of what is allowed"
TEMPLATE = "diagnosis.html"
BOUND_TOLERANCE = 1e-6
"""Distance from a bound, over the whole range, at which a fitted number stands at it."""

UNOBSERVED_BY_RIG = {
    "bench": "The body, its joints and the ground: the device alone was on the bench.",
    "gait": "Whoever walked, and the ground: motion and load were taken as they were measured.",
}
"""Rig -> what no diagnosis on it sees."""

FIGURE_CAPTIONS = {
    "before_after": "Measured and simulated in one trial, and what is left between them.",
    "gap": "The gap of every channel (root mean square). No model can go below the noise, which repeats show.",
    "ranking": "Candidates in every step: what the screening promised and what a full fit kept of it.",
    "where": "Where the fitted trials and the simulation differ, in standard deviations of the noise.",
}


def write_page(diagnosis: Diagnosis, path: Path, rrd_file: str = "") -> None:
    """Write the page of ``diagnosis`` to ``path``, with its pictures in it.

    It links to the rerun ``recording`` beside it, if there is one.
    """
    images = {}
    for name, figure in pictures.build_figures(diagnosis):
        content = io.BytesIO()
        figure.savefig(content, format="png", dpi=pictures.DPI)
        images[name] = base64.b64encode(content.getvalue()).decode("ascii")
    path.write_text(render_page(diagnosis, images, rrd_file), "utf-8")


def render_page(diagnosis: Diagnosis, images: Mapping[str, str], rrd_file: str = "") -> str:
    """The page with ``images`` (name -> PNG in base 64) in it; every name in the data is escaped."""
    return render_template(
        TEMPLATE, **build_page_context(diagnosis), images=images, captions=FIGURE_CAPTIONS, recording=rrd_file
    )


def build_page_context(diagnosis: Diagnosis) -> dict[str, Any]:
    """Everything on the page but its pictures, in words."""
    d = diagnosis
    device = d.dataset.device
    return {
        "title": f"Diagnosis of {d.dataset.folder.name}",
        "verdict": d.verdict,
        "sentence": words.describe_verdict(d),
        "improvement": words.describe_improvement(d),
        "reasons": [words.format_sentence(reason) for reason in d.reasons],
        "warnings": _collect_warnings(d),
        "next": d.next_experiment["sentence"] if d.next_experiment else "",
        "title_of_effects": _format_effects_heading(d),
        "effects": [_build_effect_entry(d, term) for term in d.added_terms],
        "rivals": _build_equivalent_model_entries(d),
        "equation": words.describe_equation_residuals(d),
        "where": [
            {
                "channel": words.humanize_identifier(place.channel),
                "share": f"{100.0 * place.fraction:.0f} %",
                "region": place.region or "everywhere alike",
                "concentration": words.format_number(place.concentration, 3),
            }
            for place in d.misfit_regions
        ],
        "gap": _build_gap_rows(d),
        "shown_on": d.evaluated_on,
        "noise": _build_noise_rows(d),
        "certain": f"{SIGNIFICANCE_SIGMAS:.0f}",
        "decisive": f"{d.bic_threshold:.0f}",
        "repeated": d.has_repeats,
        "split": _build_split_rows(d),
        "how": d.split.description,
        "steps": [_build_step_entry(d, number) for number in range(len(d.selection_history))],
        "base": _build_device_parameter_rows(d),
        "inside": [words.humanize_identifier(name) for name in device.spec.effects],
        "unseen": _list_limitations(d),
        "effective": words.format_number(d.n_independent, 3),
        "rollouts": d.n_simulations,
        "device": device.name,
        "device_digest": device.digest,
        "digest": d.dataset.digest,
        "versions": collect_versions(),
    }


def _format_effects_heading(diagnosis: Diagnosis) -> str:
    if diagnosis.verdict != "unexplained":
        return "Effects"
    kinds = {term.effect_definition.data_driven: None for term in diagnosis.added_terms}
    names = {False: "proxies: effects that come closest", True: "a data-driven term, which names nothing"}
    return words.format_sentence(words.join_words([names[kind] for kind in kinds]))


def _collect_warnings(diagnosis: Diagnosis) -> list[str]:
    found = list(diagnosis.dataset.remarks)
    fits = {"the device as it was": diagnosis.base_fit}
    if diagnosis.added_terms:
        fits["the device with what was found"] = diagnosis.final_fit
    for name, fit in fits.items():
        if fit is not None and not fit.converged:
            found.append(f"The fit of {name} did not converge: do not trust its numbers.")
    return found


def _build_effect_entry(diagnosis: Diagnosis, term: EffectTerm) -> dict[str, Any]:
    assert diagnosis.final_fit is not None
    sources = [(words.split_key(p.key)[0], p.source) for p in term.parameters if p.source.startswith("assumed")]
    marks = {False: " (a proxy)", True: " (data-driven)"}
    return {
        "name": words.format_term(term),
        "mark": marks[term.effect_definition.data_driven] if diagnosis.verdict == "unexplained" else "",
        "identifier": term.effect,
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
    """The fitted numbers of ``term``, with ``intervals`` of all unknowns if there are any."""
    rows = []
    place = fit.hypothesis.terms.index(term)
    for number, (unknown, value) in enumerate(zip(fit.hypothesis.parameters, fit.values, strict=True)):
        if unknown.term_index == place:
            name, unit = words.format_parameter_name(unknown, term.channel)
            row = {"name": name, "key": unknown.key, "unit": unit, "value": words.format_number(value)}
            if intervals:
                row["value"], row["low"], row["high"] = words.format_interval(value, *intervals[number])
            row["note"] = _format_bound_note(unknown.lower, unknown.upper, value)
            rows.append(row)
    return rows


def _format_bound_note(lower: float, upper: float, value: float) -> str:
    if np.isfinite(upper - lower) and min(value - lower, upper - value) <= BOUND_TOLERANCE * (upper - lower):
        return AT_BOUND_NOTE
    return ""


def _build_equivalent_model_entries(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    found = []
    for rival in diagnosis.equivalent_models:
        other = rival.fit.hypothesis.terms[-1]
        worse = (
            f"worse by {rival.bic_difference:.1f}"
            if rival.bic_difference >= 0.0
            else f"better by {-rival.bic_difference:.1f}"
        )
        found.append(
            {
                "name": words.format_term(other),
                "replaces": words.format_term(rival.replaces),
                "worse": worse,
                "numbers": _build_parameter_rows(rival.fit, other),
            }
        )
    return found


def _build_gap_rows(diagnosis: Diagnosis) -> list[dict[str, str]]:
    rows = []
    for channel, gap in diagnosis.channel_rms.items():
        unit, si = CHANNEL_UNITS[channel]
        parts = {"before": gap.nominal, "refitted": gap.refitted, "after": gap.with_effects, "floor": gap.noise_floor}
        row = {
            name: "not repeated" if value is None else words.format_number(value / si, 3)
            for name, value in parts.items()
        }
        # In squares, because noise adds to a gap in squares.
        floor = (gap.noise_floor or 0.0) ** 2
        above = gap.refitted**2 - floor
        gone = 1.0 - max(0.0, gap.with_effects**2 - floor) / above if above > 0.1 * floor and gap.noise_floor else None
        row["gone"] = "-" if gone is None or not diagnosis.added_terms else f"{100.0 * gone:.1f} %"
        rows.append({"channel": words.humanize_identifier(channel), "unit": unit, **row})
    return rows


def _build_noise_rows(diagnosis: Diagnosis) -> list[dict[str, str]]:
    rows = []
    fitted = [e for e in diagnosis.experiments if e.use == "fit" and e.measured]
    left = [
        estimate_misfit(fitted, fit.residuals, diagnosis.noise) if fit is not None else {}
        for fit in (diagnosis.base_fit, diagnosis.final_fit)
    ]
    for channel, noise in diagnosis.noise.items():
        unit, si = CHANNEL_UNITS[channel]
        row = {
            "channel": words.humanize_identifier(channel),
            "unit": unit,
            "deviation": words.format_number(noise.std / si, 3),
            "share": f"{100.0 * noise.independent_fraction:.0f} %",
            "samples": str(noise.n_samples),
        }
        for name, each in zip(("before", "after"), left, strict=True):
            own = each.get(channel)
            row[name] = f"{own.rms / own.noise_rms:.2f} sd ({own.significance:.0f} se)" if own else "-"
        rows.append(row)
    return rows


def _build_split_rows(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    groups = {trial.name: trial.group for trial in diagnosis.dataset.trials}
    uses = (
        ("fit", "fitted", diagnosis.split.fit),
        ("select", "to choose among effects by, never fitted", diagnosis.split.validation),
        ("show", "opened when everything was decided", diagnosis.split.test),
    )
    return [
        {"use": use, "purpose": purpose, "trials": [{"name": name, "group": groups[name]} for name in names]}
        for use, purpose, names in uses
    ]


def _build_step_entry(diagnosis: Diagnosis, index: int) -> dict[str, Any]:
    step = diagnosis.selection_history[index]
    bars = pictures.rank_candidates(diagnosis, step)
    return {
        "number": index + 1,
        "added": words.format_term(step.added_term) if step.added_term else "",
        "why": words.format_sentence(step.reason),
        "count": len(bars),
        "bars": [
            {
                "name": bar.name,
                "promised": _format_tenths(bar.predicted_drop),
                "fall": "not refitted" if bar.bic_drop is None else _format_tenths(bar.bic_drop),
                "note": "" if bar.bic_drop is None or bar.converged else "stopped early: too far behind",
                "accepted": bar.accepted,
            }
            for bar in bars
        ],
        "gains": [(group, f"{100.0 * gain:.1f} %") for group, gain in step.validation_gains.items()],
    }


def _format_tenths(value: float) -> str:
    return f"{round(value, 1) + 0.0:.1f}"  # no minus before a zero


def _build_device_parameter_rows(diagnosis: Diagnosis) -> list[dict[str, str]]:
    """The device's uncertain numbers: nominal, and fitted without and with effects."""
    nominal, rows = diagnosis.dataset.device.spec.collect_values(), []
    for number, (key, deviation) in enumerate(diagnosis.dataset.uncertainties.items()):
        row, notes = {"key": key, "unit": words.split_key(key)[1]}, []
        row["nominal"], row["deviation"] = words.format_number(nominal[key]), words.format_number(deviation, 3)
        for name, fit, which in (
            ("before", diagnosis.base_fit, "with nothing added"),
            ("after", diagnosis.final_fit, "in the end"),
        ):
            if fit is None:
                continue
            unknown = fit.hypothesis.parameters[number]
            row[name], row[f"{name}_steps"] = words.format_number(fit.values[number]), f"{fit.x[number]:+.2f}"
            if _format_bound_note(unknown.lower, unknown.upper, fit.values[number]):
                notes.append(f"{which} {AT_BOUND_NOTE}")
        row["note"] = ", ".join(notes)
        if diagnosis.confidence_intervals and diagnosis.final_fit is not None:
            row["after"], row["low"], row["high"] = words.format_interval(
                diagnosis.final_fit.values[number], *diagnosis.confidence_intervals[number]
            )
        rows.append(row)
    return rows


def _list_limitations(diagnosis: Diagnosis) -> list[str]:
    """What this diagnosis says nothing about, one sentence each."""
    found = []
    if diagnosis.final_fit is None:
        found.append("No effect was looked for, because the data cannot answer.")
    else:
        tried = {candidate.term.effect for step in diagnosis.selection_history for candidate in step.candidates}
        rest = [words.humanize_identifier(name) for name in catalogue.get_named_effects() if name not in tried]
        if rest:
            found.append(
                f"Effects left out, in the device already, or without any change in these trials: {words.join_words(rest)}."
            )
        found.append(f"Effects that the catalogue does not know, and more than {MAX_EFFECTS} at a time.")
        found.append("Candidates that were screened and not refitted, beyond what the screening promised.")
        kept = {(term.effect, term.channel) for term in diagnosis.added_terms}
        if any(
            s.added_term is not None and (s.added_term.effect, s.added_term.channel) in kept and not s.validation_gains
            for s in diagnosis.selection_history
        ):
            found.append("Whether trials that were not fitted gain from each effect: there was no second group.")
        if diagnosis.evaluated_on == "fit":
            found.append("How well the result predicts: no trial was kept back to show, the gap is of fitted ones.")
    measured = {channel for trial in diagnosis.dataset.trials for channel in trial.measured}
    missing = [
        words.humanize_identifier(channel)
        for channel in MEASURED_CHANNELS[diagnosis.dataset.rig]
        if channel not in measured
    ]
    if missing:
        found.append(f"Channels that were not measured: {words.join_words(missing)}.")
    weighed = diagnosis.noise if diagnosis.final_fit is not None else measured
    idle = [
        words.humanize_identifier(channel)
        for channel in CHANNEL_UNITS
        if channel in measured and channel not in weighed
    ]
    if idle:
        found.append(f"Channels that were measured but could not be used: {words.join_words(idle)}.")
    found.append(UNOBSERVED_BY_RIG[diagnosis.dataset.rig])
    return found
