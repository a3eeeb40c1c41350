"""Motion files of a synthetic walk in every format, for the tests of imports."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from klute_sim.mocap import trial
from klute_sim.mocap.formats import storage, trc
from klute_sim.mocap.formats.storage import Storage
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.kinematics.leg import Leg
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing import sources
from klute_sim.mocap.reference_import import ImportedReference
from tests import synthetic_gait
from tests.synthetic_gait import MASS, Walker

RAW = ImportOptions(mass=MASS, motion_cutoff=0.0, load_cutoff=0.0, ankle_zero="file")


ROW_30 = {
    "hip_angle": 4.62 - 0.3 * (26.75 - 27.28),
    "knee_angle": 8.84 - 0.3 * (2.48 - 3.65),
    "ankle_angle": 8.02 - 0.3 * (-0.25 + 0.52),
    "shank_angle": 8.26 - 0.3 * (-20.24 + 19.59),
    "ankle_moment": 70 * 0.6909,
    "grf_vertical": 70 * 7.7176,
    "grf_forward": 70 * -0.2597,
}


def write_opensim(folder: Path) -> list[Path]:
    return synthetic_gait.opensim(folder, Walker())


def write_older_knee(folder: Path) -> list[Path]:
    return synthetic_gait.opensim(folder, Walker(), knee_sign=-1.0)


def write_treadmill(folder: Path) -> list[Path]:
    return [synthetic_gait.treadmill(folder, Walker())]


def write_parquet(folder: Path) -> list[Path]:
    rows = np.genfromtxt(synthetic_gait.treadmill(folder, Walker()), delimiter=",", names=True)
    columns = {name: rows[name] for name in rows.dtype.names}
    for name in [n for n in columns if n.endswith("Angle")]:
        columns[f"{name} [deg]"] = np.degrees(columns.pop(name))
    pq.write_table(pa.table(columns), folder / "t.parquet")
    return [folder / "t.parquet"]


def write_markers(folder: Path) -> list[Path]:
    trc.write(synthetic_gait.markers(Walker()), folder / "m.trc")
    return [folder / "m.trc", write_opensim(folder)[1]]


def write_c3d(folder: Path) -> list[Path]:
    pytest.importorskip("ezc3d", reason="the extra 'c3d' is not installed")
    return [synthetic_gait.c3d(folder, Walker())]


def extract_legs(files: list[Path], options: ImportOptions, log: ImportLog | None = None) -> dict[str, Leg]:
    group = [source for file in files for source in sources.read(file)]
    return {leg.side: leg for leg in trial.extract_legs(group, options, log or ImportLog())}


def edit_columns(
    path: Path, change: Callable[[str, np.ndarray], np.ndarray | None], degrees: bool | None = None
) -> None:
    """Rewrite the storage file at ``path`` with ``change`` applied to every column; None removes a column."""
    old = storage.read(path)
    changed = {label: change(label, samples) for label, samples in old.columns.items()}
    columns = {label: samples for label, samples in changed.items() if samples is not None}
    storage.write(Storage(columns, old.in_degrees if degrees is None else degrees), path)


def flip(file: int, part: str) -> Callable[[list[Path]], None]:
    return lambda paths: edit_columns(paths[file], lambda label, s: -s if part in label else s)


def has_sentence(imported: ImportedReference, section: str, part: str) -> bool:
    return any(part in sentence for sentence in getattr(imported.log, section))


def get_paths(folder: Path) -> list[Path]:
    return [folder / name for name in ("ik.mot", "grf.mot", "id.sto")]


def remove_columns(file: int, part: str) -> Callable[[list[Path]], list[Path]]:
    def remove(paths: list[Path]) -> list[Path]:
        edit_columns(paths[file], lambda label, s: None if part in label else s)
        return paths

    return remove


def empty_columns(file: int, part: str) -> Callable[[list[Path]], list[Path]]:
    def empty(paths: list[Path]) -> list[Path]:
        edit_columns(paths[file], lambda label, s: np.full(len(s), np.nan) if part in label else s)
        return paths

    return empty
