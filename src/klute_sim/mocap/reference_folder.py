"""Writing of a reference folder: mean stride, metadata, all strides, and the import log."""

import json
from pathlib import Path
from typing import Any

from klute_sim.gait import reference_folder
from klute_sim.mocap.kinematics import filters
from klute_sim.mocap.reference_import import ImportedReference
from klute_sim.mocap.strides.strides import to_recording
from klute_sim.provenance import collect_versions
from klute_sim.recording import parquet

REPORT_FILE = "import.json"
"""Name of the file with summary and log of an import."""


def summarize(imported: ImportedReference) -> dict[str, Any]:
    """Return the results and the log of an import; JSON types only."""
    options = imported.options
    return {
        "format": "klute-sim-import/2",
        "side": imported.side,
        "strides": {side: len(strides) for side, strides in imported.strides.items()},
        "mass_kg": imported.mass,
        "impulse_mass_kg": imported.impulse_mass,
        "stature_m": options.stature,
        "stride_time_s": imported.stride_time,
        "toe_off_pct": imported.toe_off,
        "speed_m_per_s": imported.walking_speed,
        "peaks": {
            "ankle_moment_nm_per_kg": float(imported.table["ankle_plantarflexor_moment_nm_per_kg"].max()),
            "ankle_power_w_per_kg": float(imported.table["ankle_power_w_per_kg"].max()),
            "grf_vertical_n_per_kg": float(imported.table["grf_vertical_n_per_kg"].max()),
        },
        "filters": describe_filters(imported),
        **imported.log.as_json(),
        "versions": collect_versions(),
    }


def describe_filters(imported: ImportedReference) -> dict[str, str]:
    """Return descriptions of filters and thresholds."""
    options = imported.options
    return {
        "angles": filters.describe_filter(options.motion_cutoff),
        "loads": filters.describe_filter(options.load_cutoff),
        "contact": f"vertical load above {options.contact_threshold:g} N",
        "ankle_zero": options.ankle_zero,
    }


def write_reference(imported: ImportedReference, folder: Path) -> dict[str, Any]:
    """Write ``imported`` into the empty ``folder``; return the summary."""
    (folder / reference_folder.CURVES_FILE).write_text(imported.to_csv(), "utf-8", newline="\n")
    (folder / reference_folder.METADATA_FILE).write_text(_format_toml(imported), "utf-8", newline="\n")
    for side, strides in imported.strides.items():
        parquet.write_recording(to_recording(strides, side), folder / f"strides_{side}.parquet")
    summary = summarize(imported)
    (folder / REPORT_FILE).write_text(json.dumps(summary, indent=2, allow_nan=False) + "\n", "utf-8")
    return summary


def _format_toml(imported: ImportedReference) -> str:
    """Return ``reference.toml``; JSON strings are valid TOML basic strings."""
    lines = [
        f'format = "{reference_folder.FORMAT}"',
        f'side = "{imported.side}"',
        f"strides = {len(imported.strides[imported.side])}",
        f"mass_kg = {imported.mass:.6g}",
    ]
    if imported.options.stature is not None:
        lines.append(f"stature_m = {imported.options.stature:.6g}")
    lines.append(f"stride_time_s = {imported.stride_time:.6g}")
    if imported.walking_speed is not None:
        lines.append(f"speed_m_per_s = {imported.walking_speed:.6g}")
    lines.append(f"toe_off_pct = {imported.toe_off:.6g}")
    if imported.log.accepted:
        lines.append(f"accepted = {json.dumps(imported.log.accepted)}")
    lines += ["", "[filters]"]
    lines += [f"{key} = {json.dumps(value)}" for key, value in describe_filters(imported).items()]
    lines += ["", "[conventions]"]
    lines.append(
        'signs = "flexion, dorsiflexion, forward and up positive; moment plantarflexor positive; per kg of mass_kg"'
    )
    lines.append('phase = "heel strike to heel strike of one foot"')
    for entry in imported.log.files:
        lines += [
            "",
            "[[source]]",
            f"file = {json.dumps(entry['file'], ensure_ascii=False)}",
            f'sha256 = "{entry["sha256"]}"',
        ]
    return "\n".join(lines) + "\n"
