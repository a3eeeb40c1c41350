"""The report of a diagnosis as one HTML file that needs nothing else, not even a network."""

import base64
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from klute_sim.dataset.channels import MEASURED
from klute_sim.diagnose.diagnosis import Diagnosis
from klute_sim.diagnose.experiment import UNITS
from klute_sim.diagnose.fallback import formula
from klute_sim.diagnose.fit import Fit
from klute_sim.diagnose.hypothesis import Term
from klute_sim.diagnose.noise import CERTAIN, misfit
from klute_sim.diagnose.search import MOST_EFFECTS
from klute_sim.effects import catalogue
from klute_sim.provenance import versions
from klute_sim.report import diagnosis_figures as pictures
from klute_sim.report import diagnosis_words as words
from klute_sim.report.html import rendered

AT_END = "at the end of what is allowed"
TEMPLATE = "diagnosis.html"
AT_BOUND = 1e-6
"""Distance from a bound, over the whole range, at which a fitted number stands at it."""

BESIDE = {
    "bench": "The body, its joints and the ground: the device alone was on the bench.",
    "gait": "Whoever walked, and the ground: motion and load were taken as they were measured.",
}
"""Rig -> what no diagnosis on it sees."""

CAPTIONS = {
    "before_after": "Measured and simulated in one trial, and what is left between them.",
    "gap": "The gap of every channel (root mean square). No model can go below the noise, which repeats show.",
    "ranking": "Candidates in every step: what the screening promised and what a full fit kept of it.",
    "where": "Where the fitted trials and the simulation differ, in standard deviations of the noise.",
}


def write(diagnosis: Diagnosis, path: Path, recording: str = "") -> None:
    """Write the page of ``diagnosis`` to ``path``, with its pictures in it.

    It links to the rerun ``recording`` beside it, if there is one.
    """
    images = {}
    for name, figure in pictures.figures(diagnosis):
        content = io.BytesIO()
        figure.savefig(content, format="png", dpi=pictures.DPI)
        images[name] = base64.b64encode(content.getvalue()).decode("ascii")
    path.write_text(render(diagnosis, images, recording), "utf-8")


def render(diagnosis: Diagnosis, images: Mapping[str, str], recording: str = "") -> str:
    """The page with ``images`` (name -> PNG in base 64) in it; every name in the data is escaped."""
    return rendered(TEMPLATE, **content(diagnosis), images=images, captions=CAPTIONS, recording=recording)


def content(diagnosis: Diagnosis) -> dict[str, Any]:
    """Everything on the page but its pictures, in words."""
    d = diagnosis
    device = d.dataset.device
    return {
        "title": f"Diagnosis of {d.dataset.folder.name}",
        "verdict": d.verdict,
        "sentence": words.verdict(d),
        "improvement": words.improvement(d),
        "reasons": [words.sentence(reason) for reason in d.reasons],
        "warnings": _warnings(d),
        "next": d.next_experiment["sentence"] if d.next_experiment else "",
        "title_of_effects": _title_of_effects(d),
        "effects": [_effect(d, term) for term in d.found],
        "rivals": _rivals(d),
        "equation": words.equation(d),
        "where": [
            {
                "channel": words.spoken(place.channel),
                "share": f"{100.0 * place.share:.0f} %",
                "region": place.region or "everywhere alike",
                "concentration": words.number(place.concentration, 3),
            }
            for place in d.where
        ],
        "gap": _gap(d),
        "shown_on": d.shown_on,
        "noise": _noise(d),
        "certain": f"{CERTAIN:.0f}",
        "decisive": f"{d.decisive:.0f}",
        "repeated": d.repeated,
        "split": _split(d),
        "how": d.split.how,
        "steps": [_step(d, number) for number in range(len(d.steps))],
        "base": _base(d),
        "inside": [words.spoken(name) for name in device.spec.effects],
        "unseen": _unseen(d),
        "effective": words.number(d.effective, 3),
        "rollouts": d.rollouts,
        "device": device.name,
        "device_digest": device.digest,
        "digest": d.dataset.digest,
        "versions": versions(),
    }


def _title_of_effects(d: Diagnosis) -> str:
    if d.verdict != "unexplained":
        return "Effects"
    kinds = {term.entry.data_driven: None for term in d.found}
    names = {False: "proxies: effects that come closest", True: "a data-driven term, which names nothing"}
    return words.sentence(words.joined([names[kind] for kind in kinds]))


def _warnings(d: Diagnosis) -> list[str]:
    found = list(d.dataset.remarks)
    fits = {"the device as it was": d.base}
    if d.found:
        fits["the device with what was found"] = d.final
    for name, fit in fits.items():
        if fit is not None and not fit.converged:
            found.append(f"The fit of {name} did not converge: do not trust its numbers.")
    return found


def _effect(d: Diagnosis, term: Term) -> dict[str, Any]:
    assert d.final is not None
    sources = [(words.split_key(p.key)[0], p.source) for p in term.parameters if p.source.startswith("assumed")]
    marks = {False: " (a proxy)", True: " (data-driven)"}
    return {
        "name": words.term(term),
        "mark": marks[term.entry.data_driven] if d.verdict == "unexplained" else "",
        "identifier": term.effect,
        "form": term.form,
        "sentence": term.entry.sentence,
        "equation": formula(d.final) if term.entry.data_driven else term.law.equation,
        "parameters": _numbers(d.final, term, d.intervals),
        "assumed": sources,
    }


def _numbers(fit: Fit, term: Term, intervals: Sequence[tuple[float, float]] = ()) -> list[dict[str, str]]:
    """The fitted numbers of ``term``, with ``intervals`` of all unknowns if there are any."""
    rows = []
    place = fit.hypothesis.terms.index(term)
    for number, (unknown, value) in enumerate(zip(fit.hypothesis.unknowns, fit.values, strict=True)):
        if unknown.term == place:
            name, unit = words.unknown(unknown, term.channel)
            row = {"name": name, "key": unknown.key, "unit": unit, "value": words.number(value)}
            if intervals:
                row["value"], row["low"], row["high"] = words.told_apart(value, *intervals[number])
            row["note"] = _note(unknown.low, unknown.high, value)
            rows.append(row)
    return rows


def _note(low: float, high: float, value: float) -> str:
    if np.isfinite(high - low) and min(value - low, high - value) <= AT_BOUND * (high - low):
        return AT_END
    return ""


def _rivals(d: Diagnosis) -> list[dict[str, Any]]:
    found = []
    for rival in d.rivals:
        other = rival.fit.hypothesis.terms[-1]
        worse = f"worse by {rival.difference:.1f}" if rival.difference >= 0.0 else f"better by {-rival.difference:.1f}"
        found.append(
            {
                "name": words.term(other),
                "replaces": words.term(rival.replaces),
                "worse": worse,
                "numbers": _numbers(rival.fit, other),
            }
        )
    return found


def _gap(d: Diagnosis) -> list[dict[str, str]]:
    rows = []
    for channel, gap in d.gap.items():
        unit, si = UNITS[channel]
        parts = {"before": gap.before, "refitted": gap.refitted, "after": gap.after, "floor": gap.floor}
        row = {name: "not repeated" if value is None else words.number(value / si, 3) for name, value in parts.items()}
        # In squares, because noise adds to a gap in squares.
        floor = (gap.floor or 0.0) ** 2
        above = gap.refitted**2 - floor
        gone = 1.0 - max(0.0, gap.after**2 - floor) / above if above > 0.1 * floor and gap.floor else None
        row["gone"] = "-" if gone is None or not d.found else f"{100.0 * gone:.1f} %"
        rows.append({"channel": words.spoken(channel), "unit": unit, **row})
    return rows


def _noise(d: Diagnosis) -> list[dict[str, str]]:
    rows = []
    fitted = [e for e in d.experiments if e.use == "fit" and e.measured]
    left = [misfit(fitted, fit.residuals, d.noise) if fit is not None else {} for fit in (d.base, d.final)]
    for channel, noise in d.noise.items():
        unit, si = UNITS[channel]
        row = {
            "channel": words.spoken(channel),
            "unit": unit,
            "deviation": words.number(noise.deviation / si, 3),
            "share": f"{100.0 * noise.independent:.0f} %",
            "samples": str(noise.samples),
        }
        for name, each in zip(("before", "after"), left, strict=True):
            own = each.get(channel)
            row[name] = f"{own.size / own.floor:.2f} sd ({own.certainty:.0f} se)" if own else "-"
        rows.append(row)
    return rows


def _split(d: Diagnosis) -> list[dict[str, Any]]:
    groups = {trial.name: trial.group for trial in d.dataset.trials}
    uses = (
        ("fit", "fitted", d.split.fit),
        ("select", "to choose among effects by, never fitted", d.split.select),
        ("show", "opened when everything was decided", d.split.show),
    )
    return [
        {"use": use, "purpose": purpose, "trials": [{"name": name, "group": groups[name]} for name in names]}
        for use, purpose, names in uses
    ]


def _step(d: Diagnosis, number: int) -> dict[str, Any]:
    step = d.steps[number]
    bars = pictures.ranked(d, step)
    return {
        "number": number + 1,
        "added": words.term(step.added) if step.added else "",
        "why": words.sentence(step.why),
        "count": len(bars),
        "bars": [
            {
                "name": bar.name,
                "promised": _tenths(bar.promised),
                "fall": "not refitted" if bar.fall is None else _tenths(bar.fall),
                "note": "" if bar.fall is None or bar.finished else "stopped early: too far behind",
                "accepted": bar.accepted,
            }
            for bar in bars
        ],
        "gains": [(group, f"{100.0 * gain:.1f} %") for group, gain in step.gains.items()],
    }


def _tenths(value: float) -> str:
    return f"{round(value, 1) + 0.0:.1f}"  # no minus before a zero


def _base(d: Diagnosis) -> list[dict[str, str]]:
    """The device's uncertain numbers: nominal, and fitted without and with effects."""
    nominal, rows = d.dataset.device.spec.numbers(), []
    for number, (key, deviation) in enumerate(d.dataset.uncertain.items()):
        row, notes = {"key": key, "unit": words.split_key(key)[1]}, []
        row["nominal"], row["deviation"] = words.number(nominal[key]), words.number(deviation, 3)
        for name, fit, which in (("before", d.base, "with nothing added"), ("after", d.final, "in the end")):
            if fit is None:
                continue
            unknown = fit.hypothesis.unknowns[number]
            row[name], row[f"{name}_steps"] = words.number(fit.values[number]), f"{fit.steps[number]:+.2f}"
            if _note(unknown.low, unknown.high, fit.values[number]):
                notes.append(f"{which} {AT_END}")
        row["note"] = ", ".join(notes)
        if d.intervals and d.final is not None:
            row["after"], row["low"], row["high"] = words.told_apart(d.final.values[number], *d.intervals[number])
        rows.append(row)
    return rows


def _unseen(d: Diagnosis) -> list[str]:
    """What this diagnosis says nothing about, one sentence each."""
    found = []
    if d.final is None:
        found.append("No effect was looked for, because the data cannot answer.")
    else:
        tried = {candidate.term.effect for step in d.steps for candidate in step.candidates}
        rest = [words.spoken(name) for name in catalogue.named() if name not in tried]
        if rest:
            found.append(
                f"Effects left out, in the device already, or without any change in these trials: {words.joined(rest)}."
            )
        found.append(f"Effects that the catalogue does not know, and more than {MOST_EFFECTS} at a time.")
        found.append("Candidates that were screened and not refitted, beyond what the screening promised.")
        kept = {(term.effect, term.channel) for term in d.found}
        if any(s.added is not None and (s.added.effect, s.added.channel) in kept and not s.gains for s in d.steps):
            found.append("Whether trials that were not fitted gain from each effect: there was no second group.")
        if d.shown_on == "fit":
            found.append("How well the result predicts: no trial was kept back to show, the gap is of fitted ones.")
    measured = {channel for trial in d.dataset.trials for channel in trial.measured}
    missing = [words.spoken(channel) for channel in MEASURED[d.dataset.rig] if channel not in measured]
    if missing:
        found.append(f"Channels that were not measured: {words.joined(missing)}.")
    weighed = d.noise if d.final is not None else measured
    idle = [words.spoken(channel) for channel in UNITS if channel in measured and channel not in weighed]
    if idle:
        found.append(f"Channels that were measured but could not be used: {words.joined(idle)}.")
    found.append(BESIDE[d.dataset.rig])
    return found
