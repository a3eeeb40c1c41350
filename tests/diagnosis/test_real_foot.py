"""A measured prosthetic foot; it is not part of the project (see ``KLUTE_SIM_DATA`` and docs/real-data.md)."""

import csv
import os
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.io import loadmat
from scipy.optimize import curve_fit

from klute_sim.datasets import dataset as datasets
from klute_sim.datasets.write import write_trial
from klute_sim.diagnosis.workflow import diagnose

Array = NDArray[np.float64]

DATA = Path(os.environ.get("KLUTE_SIM_DATA", "nowhere")) / "prosthetic_foot_desr"
ZERO, COMPLIANCE = 1.2, 218.0
"""The authors' corrections: of the torque [N m], and the dynamometer's stiffness [N m/deg]."""
STEEP = 5.0, 10.0
"""Angles [deg] between which the authors take the stiffness, both ways."""
BLOCK = 0.02
"""Of the log, whose medians are taken [s]; it was sampled every 1.2 ms."""
ARM = 40.0
"""Lever arm [mm] by which torque is made tension and angle length (assumed, constant; no result depends on it)."""
SLACK, REST = 100.0, 200.0
"""Tendon and muscle [mm] (assumed: only their sum matters)."""

DEVICE = """
name = "foot as a tendon"
description = "A muscle as thin as a hair, always against its stop at resting length, so that only the tendon pulls."
[muscle]
resting_length_mm = {rest:g}
braid_length_ratio = 1.10
turns_per_m = 1458.6
bladder_radius_mm = 0.05
bladder_thickness_mm = 0.01
c10_kpa = 0.0
c01_kpa = 0.0
friction_slope_n_per_bar = 0.0
friction_offset_n = 0.0
[tendon]
slack_length_mm = {slack:g}
stiffness_1_n_per_mm = {first:g}
stiffness_2_n_per_mm = {second:g}
engagement_mm = {joins:g}
[supply]
pressure_bar = 1.0
rate_bar_per_s = 1000.0
gas_temperature_c = 20.0
"""

HEAD = """
format = "klute-sim-dataset/1"
rig = "bench"
device = "foot.toml"
[uncertain]
"tendon.stiffness_1_n_per_mm" = "30 %"
"tendon.stiffness_2_n_per_mm" = "30 %"
"tendon.engagement_mm" = "30 %"
[[trial]]
files = ["loop.csv"]
"""


class Loop(NamedTuple):
    """One loop of one setting, corrected as the authors do; dorsiflexion positive."""

    time: Array
    """[s]"""
    angle: Array
    """[deg]"""
    torque: Array
    """[N m]"""

    @property
    def whole(self) -> float:
        """What the loop loses [J]."""
        return float(np.trapezoid(self.torque, np.radians(self.angle)))

    @property
    def stiffness(self) -> float:
        """[N m/deg] between the angles :data:`STEEP`."""
        steep = (self.angle > STEEP[0]) & (self.angle < STEEP[1])
        return float(np.polyfit(self.angle[steep], self.torque[steep], 1)[0])

    def both_ways(self) -> tuple[Array, Array, Array]:
        """Dorsiflexion on even steps: angle [deg], torque [N m] on the way there, and on the way back."""
        top, bottom = int(np.argmax(self.angle)), int(np.argmin(self.angle))
        end = top + int(np.argmax(self.angle[top:] < 0.1))
        even = np.linspace(0.2, self.angle[top] - 0.2, 200)
        there = np.interp(even, np.maximum.accumulate(self.angle[bottom:top]), self.torque[bottom:top])
        back = np.interp(even, np.maximum.accumulate(self.angle[top:end][::-1]), self.torque[top:end][::-1])
        return even, there, back


def settings() -> list[dict[str, str]]:
    """What is known of each setting."""
    with (DATA / "summary_desr.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def loop(setting: dict[str, str]) -> Loop:
    """As recorded, angle [rad] and torque [N m], corrected."""
    series = loadmat(DATA / "DESR_Characterization_Data.mat", squeeze_me=True, struct_as_record=False)
    raw = getattr(series[setting["set"]], f"x{setting['spring_pos_mm']}")
    torque = raw.torque - ZERO
    return Loop(raw.timeJIM, np.degrees(raw.angleJIM) - torque / COMPLIANCE, torque)


def imported(of: Loop, folder: Path) -> Path:
    """Dorsiflexion as a dataset; the device's two springs are those that fit the loop best."""
    folder.mkdir(parents=True)
    block = (of.time / BLOCK).astype(int)
    columns = np.stack(of)
    time, angle, torque = np.stack([np.median(columns[:, block == b], axis=1) for b in np.unique(block)]).T
    bottom, top = int(np.argmin(angle)), int(np.argmax(angle))
    begin, end = bottom + int(np.argmax(angle[bottom:] > 0.0)), top + int(np.argmax(angle[top:] < 0.1))
    taut = begin + int(np.argmax(torque[begin:] > 2.0))
    stretch, force = ARM * np.radians(angle - angle[taut])[begin:end], 1e3 * torque[begin:end] / ARM

    def springs(x: Array, first: float, second: float, joins: float) -> Array:
        found: Array = first * np.maximum(0.0, x) + second * np.maximum(0.0, x - joins)
        return found

    best = curve_fit(
        springs, stretch, np.maximum(0.0, force), p0=[100.0, 200.0, 3.0], bounds=([0.1, 0, 0], [1e4, 1e4, 8.0])
    )
    first, second, joins = best[0]
    device = DEVICE.format(rest=REST, slack=SLACK, first=first, second=second, joins=joins)
    (folder / "foot.toml").write_text(device, "utf-8")
    (folder / "dataset.toml").write_text(HEAD, "utf-8")
    loaded = {
        "time [s]": time[begin:end],
        "length [mm]": REST + SLACK + stretch,
        "pressure_command [bar]": np.zeros(end - begin),
        "force [N]": np.where(force > 0.0, force, np.nan),  # a tendon does not push
    }
    write_trial(folder / "loop.csv", loaded)
    return folder


pytestmark = pytest.mark.skipif(not DATA.exists(), reason="KLUTE_SIM_DATA does not hold these measurements")


def test_the_loops_are_those_that_the_authors_printed() -> None:
    every = settings()
    assert len(every) == 11
    for setting in every:
        found = loop(setting)
        assert found.whole == pytest.approx(float(setting["loop_J"]), rel=0.02)
        assert found.stiffness == pytest.approx(float(setting["stiff_df_Nm_per_deg"]), rel=0.005)


def test_most_of_the_foots_loops_are_no_tendons_hysteresis() -> None:
    """A passive tendon never pulls harder on the way back. This foot does: it stores and releases elsewhere."""
    for setting in settings():
        even, there, back = loop(setting).both_ways()
        stored, returned = (float(np.trapezoid(torque, np.radians(even))) for torque in (there, back))
        more = even[back > there + 0.05 * there.max()]
        if setting["set"] == "DESR_N":
            assert 3.0 < more.min() < more.max() < 8.5
            assert -0.05 < 1.0 - returned / stored < 0.08
        else:
            assert not len(more)
            assert 0.08 < 1.0 - returned / stored < 0.16


@pytest.mark.parametrize("which", ["DESR_N_CAM1", "DESR_N_CAM2"])
def test_one_loop_is_too_little_to_name_a_hysteresis(which: str, tmp_path: Path) -> None:
    """Two straight springs miss the loop by more than it loses, and without a repeat nobody knows what is noise."""
    found = diagnose(
        datasets.load_dataset(imported(loop(next(s for s in settings() if s["set"] == which)), tmp_path / "data"))
    )
    assert found.verdict == "insufficient-data"
    assert any("No trial is repeated" in reason for reason in found.reasons)
    assert found.added_terms == ()
    assert 50.0 < found.channel_rms["force"].with_effects < 150.0
