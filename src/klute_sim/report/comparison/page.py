"""Page of a comparison: one self-contained HTML file that works offline."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from klute_sim.comparison.comparison import Comparison, ComparisonPart
from klute_sim.comparison.results import as_json
from klute_sim.provenance import collect_versions
from klute_sim.recording.atomic_file import write_atomically
from klute_sim.report.comparison import text as words
from klute_sim.report.comparison.figures import MAX_CHANNELS_PER_FIGURE
from klute_sim.report.comparison.headline import format_headline
from klute_sim.report.html import render_template
from klute_sim.report.run_page import PAGE_FILE, encode_picture, list_files

TEMPLATE = "comparison.html"


def write_page(comparison: Comparison, pictures: Mapping[str, str], folder: Path) -> None:
    """Write the page of ``comparison`` into its ``folder``, with ``pictures`` (part -> PNG file in it) embedded."""
    images = {part: encode_picture(folder / name) for part, name in pictures.items()}
    write_atomically(folder / PAGE_FILE, render_page(comparison, images, list_files(folder)))


def render_page(comparison: Comparison, images: Mapping[str, str], files: Sequence[Mapping[str, str]] = ()) -> str:
    """Return the page as HTML, in which names from the data are escaped.

    ``images`` maps parts to PNG in base 64; ``files`` have a name and a description each.
    """
    return render_template(TEMPLATE, **build_page_context(comparison, images), files=files)


def build_page_context(comparison: Comparison, images: Mapping[str, str]) -> dict[str, Any]:
    """Return the content of the page as text for the template."""
    labels = [series.label for series in comparison.parts[0].series]
    return {
        "title": labels[0] if comparison.is_single else f"{', '.join(labels[1:])} against {labels[0]}",
        "extent_headings": words.EXTENT_HEADINGS if comparison.is_single else (),
        "headline": format_headline(comparison),
        "series": [_build_series_entry(summary) for summary in as_json(comparison)["series"]],
        "remarks": comparison.remarks,
        "parts": [_build_part_entry(part, comparison.domain, images) for part in comparison.parts],
        "omitted_figures": _describe_omitted_figures(comparison, images),
        "explanations": words.explain_numbers(comparison),
        "versions": collect_versions(),
    }


def _describe_omitted_figures(comparison: Comparison, images: Mapping[str, str]) -> list[str]:
    """Return which trials and channels have no figure, one sentence each."""
    sentences = []
    if images and len(images) < len(comparison.parts):
        sentences.append(
            f"The figures show the {len(images)} trials with the largest differences of {len(comparison.parts)}."
        )
    n_channels = max(len(part.differences) for part in comparison.parts)
    if images and n_channels > MAX_CHANNELS_PER_FIGURE:
        sentences.append(
            f"The figures show the {MAX_CHANNELS_PER_FIGURE} channels with the largest differences of {n_channels}."
        )
    return sentences


def _build_series_entry(summary: dict[str, Any]) -> dict[str, Any]:
    sources = [*summary["devices"], *summary["controllers"]]
    repeats = sorted({count for count in summary["repeats"] if count is not None})
    return {
        "label": summary["label"],
        "source": "the human reference" if summary["reference"] else ", ".join(sources),
        "runs": summary["runs"],
        "repeats": "-" if not repeats else str(repeats[0]) if len(repeats) == 1 else f"{repeats[0]} to {repeats[-1]}",
    }


def _build_part_entry(part: ComparisonPart, domain: str, images: Mapping[str, str]) -> dict[str, Any]:
    rows = [
        _build_row_entry(words.DifferenceRow(part, name, label, d), domain)
        for name, differences in part.differences.items()
        for label, d in differences.items()
    ]
    image = images.get(part.name, "")
    extents = [
        {"channel": words.humanize_channel(name), "unit": words.format_unit(part.units[name]), "cells": cells}
        for name, cells in (words.iter_extents(part, domain) if len(part.series) == 1 else ())
    ]
    return {"name": part.name, "rows": rows, "extents": extents, "image": image}


def _build_row_entry(row: words.DifferenceRow, domain: str) -> dict[str, str]:
    part, channel, label, d = row
    return {
        "channel": words.humanize_channel(channel),
        "unit": words.format_unit(part.units[channel]),
        "series": label,
        "bias": words.format_bias(d),
        "rms": words.format_number(d.rms),
        "rms_sd": words.format_number(d.rms_sd),
        "correlation": words.format_correlation(d.correlation),
        "largest": words.format_number(d.max_difference, signed=True),
        "at": words.format_position(d.max_position, domain),
        "compared": f"{100.0 * d.compared_fraction:.0f} %",
        "half": words.format_half_error_interval(row, domain),
        "beyond": words.format_significant_regions(row, domain),
    }
