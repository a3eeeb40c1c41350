"""A sweep over 50 made subjects: scaled and perturbed references of people of 45 to 115 kg."""

import csv
from pathlib import Path

import numpy as np
import pytest

import klute_sim as ks
from klute_sim.gait.reference import MAX_GRF_TRACKING_RMS_BW
from klute_sim.gait.reference_folder import CURVES_FILE
from klute_sim.types import Array
from tests.gait.reference_files import write_reference_folder

N_SUBJECTS = 50
WAVES = {"hip_flexion_deg": 2.0, "knee_flexion_deg": 2.0, "ankle_dorsiflexion_deg": 1.5, "shank_forward_deg": 1.0}
"""Scale of the perturbation of each angle [deg]."""
LOADS = ("grf_vertical_n_per_kg", "grf_forward_n_per_kg")


def make_subject(folder: Path, rng: np.random.Generator) -> None:
    """Write a subject whose angles are scaled, shifted and bent by three harmonics, and whose loads are scaled."""
    write_reference_folder(
        folder,
        mass=float(rng.uniform(45.0, 115.0)),
        stature=float(rng.uniform(1.5, 1.95)),
        stride_time=float(rng.uniform(0.95, 1.3)),
        load_ratio=float(rng.uniform(0.85, 1.15)),
    )
    with (folder / CURVES_FILE).open(encoding="utf-8", newline="") as file:
        names, *rows = csv.reader(file)
    curves = dict(zip(names, np.array(rows, dtype=float).T, strict=True))
    phase = curves["gait_pct"] / 100.0

    def make_wave(scale: float) -> Array:
        harmonics = [rng.normal() / k * np.cos(2.0 * np.pi * (k * phase + rng.random())) for k in (1, 2, 3)]
        return np.asarray(scale * np.sum(harmonics, axis=0))

    for name, scale in WAVES.items():
        curves[name] = rng.uniform(0.9, 1.1) * curves[name] + make_wave(scale)
        if name != "shank_forward_deg":  # the zeros of joint angles differ between laboratories, that of gravity not
            curves[name] += rng.normal(0.0, 2.0)
    for name in LOADS:
        curves[name] *= 1.0 + 0.05 * rng.normal()
    with (folder / CURVES_FILE).open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(names)
        writer.writerows(zip(*(curves[name].tolist() for name in names), strict=True))


@pytest.mark.slow
def test_fifty_subjects_walk_without_a_trip_and_carry_their_load(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for number in range(N_SUBJECTS):
        make_subject(tmp_path / f"subject-{number:02d}", rng)
    result = ks.sweep(
        references=str(tmp_path / "subject-*"), controllers="profile", strides=3, time_step=1e-3, folder=tmp_path / "s"
    )
    assert len(result.rows) == N_SUBJECTS
    for row in result.rows:
        assert row["failure"] is None
        assert not row["trips"]
        assert row["grf_vertical_tracking_rms [1]"] < 0.5 * MAX_GRF_TRACKING_RMS_BW
        assert not row["load_not_tracked"]
        assert row["toe_clearance [mm]"] > 10.0
    assert sum(row["contact_lost"] for row in result.rows) <= 2
