"""Import of a synthetic walk from Visual3D's ASCII exports."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from klute_sim.errors import InputError
from klute_sim.mocap import reference_import
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing import mapping
from klute_sim.types import Array
from tests import synthetic_gait
from tests.command_line import run
from tests.synthetic_gait import HUMAN, MASS, Walker

SIGNALS = {
    "hip_flexion_deg": "RIGHT_HIP_ANGLE",
    "knee_flexion_deg": "RIGHT_KNEE_ANGLE",
    "ankle_dorsiflexion_deg": "RIGHT_ANKLE_ANGLE",
    "ankle_plantarflexor_moment_nm_per_kg": "RIGHT_ANKLE_MOMENT",
}
RATE = 200.0
OPTIONS = ImportOptions(mass=MASS, frame_rate=RATE)


def make_columns(walker: Walker) -> dict[tuple[str, str], Array]:
    """Return (signal, component) -> samples of a walk, with three components of each signal."""
    columns = {}
    for quantity, signal in SIGNALS.items():
        values = walker.of(quantity, "right")
        for component, factor in (("X", 1.0), ("Y", 0.1), ("Z", -0.05)):
            columns[signal, component] = factor * values
    columns["RIGHT_GRF", "X"] = 0.02 * walker.of("grf_vertical_n_per_kg", "right")
    columns["RIGHT_GRF", "Y"] = walker.of("grf_forward_n_per_kg", "right")
    columns["RIGHT_GRF", "Z"] = walker.of("grf_vertical_n_per_kg", "right")
    return columns


def write_export(path: Path, recordings: Sequence[dict[tuple[str, str], Array]]) -> Path:
    heads = [(f"walk{k}.c3d", *key) for k, columns in enumerate(recordings, 1) for key in columns]
    samples = [values for columns in recordings for values in columns.values()]
    lines = [["", *(file for file, _, _ in heads)], ["", *(signal for _, signal, _ in heads)]]
    lines += [["", *(["LINK_MODEL_BASED"] * len(heads))], ["", *(["ORIGINAL"] * len(heads))]]
    lines.append(["ITEM", *(component for _, _, component in heads)])
    for row in range(max(map(len, samples))):
        lines.append([str(row + 1), *(f"{v[row]:.6f}" if row < len(v) else "" for v in samples)])
    path.write_text("\n".join("\t".join(line) for line in lines) + "\n")
    return path


@pytest.fixture(scope="module")
def walk() -> dict[tuple[str, str], Array]:
    walker = Walker()
    time = np.arange(walker.time[0], walker.time[-1], 1.0 / RATE)
    return {key: np.interp(time, walker.time, values) for key, values in make_columns(walker).items()}


def test_export_with_a_frame_rate_is_imported(walk: dict[tuple[str, str], Array], tmp_path: Path) -> None:
    imported = reference_import.import_reference([write_export(tmp_path / "v.txt", [walk])], OPTIONS)
    assert imported.stride_time == pytest.approx(1.1, abs=0.02)
    assert imported.table["knee_flexion_deg"][30] == pytest.approx(8.84, abs=0.5)
    assert imported.table["ankle_plantarflexor_moment_nm_per_kg"][30] == pytest.approx(0.69, abs=0.03)
    assert "v.txt: times from the frame numbers at 200 Hz, as specified" in imported.log.derived


def test_times_of_the_export_are_used(walk: dict[tuple[str, str], Array], tmp_path: Path) -> None:
    times = {("TIME", "X"): 3.0 + np.arange(len(walk["RIGHT_GRF", "X"])) / RATE}
    path = write_export(tmp_path / "v.txt", [{**walk, **times}])
    imported = reference_import.import_reference([path], replace(OPTIONS, frame_rate=None))
    assert imported.stride_time == pytest.approx(1.1, abs=0.02)
    with pytest.raises(InputError, match="a frame rate is for Visual3D exports without times"):
        reference_import.import_reference([path], OPTIONS)


def test_recordings_of_one_export_are_trials(walk: dict[tuple[str, str], Array], tmp_path: Path) -> None:
    shorter = {key: values[:-150] for key, values in walk.items()}
    path = write_export(tmp_path / "v.txt", [walk, shorter])
    imported = reference_import.import_reference([path], OPTIONS)
    alone = reference_import.import_reference([write_export(tmp_path / "one.txt", [walk])], OPTIONS)
    assert [entry["file"] for entry in imported.log.files] == ["v.txt (walk1.c3d)", "v.txt (walk2.c3d)"]
    assert len(imported.strides["right"]) > len(alone.strides["right"])
    other = synthetic_gait.treadmill(tmp_path, Walker())
    with pytest.raises(InputError, match=r"v.txt contains 2 recordings, .*: pass it alone, or export each"):
        reference_import.import_reference([path, other], OPTIONS)


def test_export_over_the_gait_cycle_needs_the_duration_of_the_stride(tmp_path: Path) -> None:
    phase = np.linspace(0.0, 1.0, 101)
    names = {**SIGNALS, "grf_vertical_n_per_kg": "RIGHT_GRF_VERTICAL", "grf_forward_n_per_kg": "RIGHT_GRF_FORWARD"}
    stride = {(signal, "X"): HUMAN(quantity, phase) for quantity, signal in names.items()}
    heavier = {key: values * (1.05 if "GRF" in key[0] else 1.0) for key, values in stride.items()}
    path = write_export(tmp_path / "v.txt", [stride, heavier])
    with pytest.raises(
        InputError, match=r"v.txt \(walk1.c3d\) has no time, but 'gait cycle \[%\]' .*--stride-duration"
    ):
        reference_import.import_reference([path], replace(OPTIONS, frame_rate=None))
    imported = reference_import.import_reference([path], ImportOptions(mass=MASS, stride_time=1.2))
    assert len(imported.strides["right"]) == 2
    assert imported.stride_time == pytest.approx(1.2)
    expected = HUMAN("knee_flexion_deg", imported.table["gait_pct"] / 100.0)
    assert imported.table["knee_flexion_deg"] == pytest.approx(expected, abs=0.5)


def test_other_signals_are_mapped(walk: dict[tuple[str, str], Array], tmp_path: Path) -> None:
    odd = {(signal.replace("RIGHT_KNEE_ANGLE", "Knie"), component): v for (signal, component), v in walk.items()}
    path = write_export(tmp_path / "v.txt", [odd])
    with pytest.raises(InputError, match=r"columns not used: 'Knie.X', 'Knie.Y', 'Knie.Z'"):
        reference_import.import_reference([path], OPTIONS)
    (tmp_path / "map.toml").write_text('[right]\nknee_angle = "Knie.X"\n')
    options = replace(OPTIONS, mapping=mapping.read(tmp_path / "map.toml"))
    imported = reference_import.import_reference([path], options)
    assert imported.table["knee_flexion_deg"][30] == pytest.approx(8.84, abs=0.5)


def test_command_asks_for_the_frame_rate(walk: dict[tuple[str, str], Array], tmp_path: Path) -> None:
    path = write_export(tmp_path / "v.txt", [walk])
    process = run("import", path.name, "--mass", str(MASS), "--out", "me", cwd=tmp_path)
    assert process.returncode == 2
    assert process.stderr.strip() == (
        "klute-sim: v.txt: this Visual3D export states no times: pass its frame rate (--frame-rate HZ), or export the "
        "signal TIME with it"
    )
    process = run("import", path.name, "--mass", str(MASS), "--frame-rate", "200", "--out", "me", cwd=tmp_path)
    assert process.returncode == 0, process.stderr
