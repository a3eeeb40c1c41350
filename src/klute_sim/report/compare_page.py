"""A comparison as one HTML file that needs nothing else, not even a network."""

import base64
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from klute_sim.compare.comparison import Comparison, Part
from klute_sim.compare.results import as_json
from klute_sim.provenance import versions
from klute_sim.report import compare_words as words
from klute_sim.report.compare_figures import MOST_CHANNELS
from klute_sim.report.html import rendered

TEMPLATE = "comparison.html"


def write(found: Comparison, pictures: Mapping[str, bytes], path: Path, recording: str = "") -> None:
    """Write the page of ``found`` to ``path``, with ``pictures`` (part -> PNG) in it.

    It links to the rerun ``recording`` beside it, if there is one.
    """
    path.write_text(render(found, pictures, recording), "utf-8")


def render(found: Comparison, pictures: Mapping[str, bytes], recording: str = "") -> str:
    """The page; every name in the data is escaped."""
    return rendered(TEMPLATE, **content(found, pictures), recording=recording)


def content(found: Comparison, pictures: Mapping[str, bytes]) -> dict[str, Any]:
    """Everything on the page, in words."""
    labels = [series.label for series in found.parts[0].series]
    return {
        "title": labels[0] if found.alone else f"{', '.join(labels[1:])} against {labels[0]}",
        "alone": words.EXTENT if found.alone else (),
        "series": [_series(told) for told in as_json(found)["series"]],
        "remarks": found.remarks,
        "parts": [_part(part, found.over, pictures) for part in found.parts],
        "undrawn": _undrawn(found, pictures),
        "rules": words.rules(found),
        "versions": versions(),
    }


def _undrawn(found: Comparison, pictures: Mapping[str, bytes]) -> list[str]:
    """What has no picture, one sentence each."""
    said = []
    if pictures and len(pictures) < len(found.parts):
        said.append(f"Drawn are the {len(pictures)} trials with the largest differences of {len(found.parts)}.")
    most = max(len(part.differences) for part in found.parts)
    if pictures and most > MOST_CHANNELS:
        said.append(f"Drawn are the {MOST_CHANNELS} channels with the largest differences of {most}.")
    return said


def _series(told: dict[str, Any]) -> dict[str, Any]:
    made = [*told["devices"], *told["controllers"]]
    repeats = sorted({count for count in told["repeats"] if count is not None})
    return {
        "label": told["label"],
        "what": "the human reference" if told["reference"] else ", ".join(made),
        "runs": told["runs"],
        "repeats": "-" if not repeats else str(repeats[0]) if len(repeats) == 1 else f"{repeats[0]} to {repeats[-1]}",
    }


def _part(part: Part, over: str, pictures: Mapping[str, bytes]) -> dict[str, Any]:
    rows = [
        _row(words.Row(part, name, label, d), over)
        for name, own in part.differences.items()
        for label, d in own.items()
    ]
    image = base64.b64encode(pictures[part.name]).decode("ascii") if part.name in pictures else ""
    alone = [
        {"channel": words.spoken(name), "unit": words.unit(part.units[name]), "cells": cells}
        for name, cells in (words.extents(part, over) if len(part.series) == 1 else ())
    ]
    return {"name": part.name, "rows": rows, "alone": alone, "image": image}


def _row(row: words.Row, over: str) -> dict[str, str]:
    part, channel, label, d = row
    return {
        "channel": words.spoken(channel),
        "unit": words.unit(part.units[channel]),
        "series": label,
        "bias": words.bias(d),
        "rms": words.number(d.rms),
        "rms_sd": words.number(d.rms_sd),
        "correlation": words.number(d.correlation, ".4f"),
        "largest": words.number(d.largest, "+.3g"),
        "at": words.place(d.at, over),
        "compared": f"{100.0 * d.share:.0f} %",
        "half": words.half(row, over),
        "beyond": words.beyond(d, over),
    }
