"""Published measurements of a prosthetic foot, not part of the project (see ``KLUTE_SIM_DATA``, docs/real-data.md)."""

import csv
import os
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from scipy.io import loadmat

from klute_sim.datasets import dataset as datasets
from klute_sim.datasets.write import write_trial
from klute_sim.device.device import load_device
from klute_sim.device.rollout import simulate_rollouts
from klute_sim.diagnosis.result import Diagnosis, DiagnosisOptions
from klute_sim.diagnosis.workflow import diagnose
from klute_sim.gait.foot_bench import press_foot
from klute_sim.gait.foot_section import DEFAULT_KEEL_LEVER
from klute_sim.types import Array

DATA = Path(os.environ.get("KLUTE_SIM_DATA", "nowhere")) / "prosthetic_foot_desr"
TORQUE_OFFSET, COMPLIANCE = 1.2, 218.0
"""The authors' corrections: torque offset [N m] and stiffness of the dynamometer [N m/deg]."""
STIFFNESS_ANGLES = 5.0, 10.0
"""Angles [deg] between which the authors determine the stiffness, in both directions."""
BLOCK_TIME = 0.01
"""Length of the blocks whose means are used [s]; the log has a sampling interval of 1.2 ms."""
LEVER_ARM = 40.0
"""Lever arm [mm] that converts torque to tension (assumed constant; no result depends on it)."""
SLACK_LENGTH, STIFFNESS = 100.0, 100.0
"""Slack length [mm] and stiffness [N/mm] of the tendon that stands for the foot (assumed; no result needs them)."""
TAUT_TORQUE = 2.0
"""Elastic torque [N m] above which the loop is compared; at zero, backlash and friction of the foot are alike."""

DEVICE = f"""
name = "foot as a tendon"
[tendon]
slack_length_mm = {SLACK_LENGTH}
stiffness_1_n_per_mm = {STIFFNESS}
stiffness_2_n_per_mm = 0.0
engagement_mm = 0.0
"""

HEADER = """
format = "klute-sim-dataset/2"
rig = "bench"
device = "foot.toml"
"""


class Loop(NamedTuple):
    """One loop of one setting with the authors' corrections; dorsiflexion positive."""

    time: Array
    """Time [s]."""
    angle: Array
    """Angle [deg]."""
    torque: Array
    """Torque [N m]."""

    @property
    def energy_loss(self) -> float:
        """Energy loss of the loop [J]."""
        return float(np.trapezoid(self.torque, np.radians(self.angle)))

    @property
    def stiffness(self) -> float:
        """Stiffness [N m/deg] between the angles :data:`STIFFNESS_ANGLES`."""
        is_in_range = (self.angle > STIFFNESS_ANGLES[0]) & (self.angle < STIFFNESS_ANGLES[1])
        return float(np.polyfit(self.angle[is_in_range], self.torque[is_in_range], 1)[0])

    def split_directions(self) -> tuple[Array, Array, Array]:
        """Return angle [deg], loading torque [N m] and unloading torque [N m] of dorsiflexion, at equal angle steps."""
        top, bottom = int(np.argmax(self.angle)), int(np.argmin(self.angle))
        end = top + int(np.argmax(self.angle[top:] < 0.1))
        angles = np.linspace(0.2, self.angle[top] - 0.2, 200)
        loading = np.interp(angles, np.maximum.accumulate(self.angle[bottom:top]), self.torque[bottom:top])
        unloading = np.interp(angles, np.maximum.accumulate(self.angle[top:end][::-1]), self.torque[top:end][::-1])
        return angles, loading, unloading


def read_settings() -> list[dict[str, str]]:
    """Return the published properties of each setting."""
    with (DATA / "summary_desr.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def read_loop(setting: dict[str, str]) -> Loop:
    """Read the loop of ``setting`` and apply the corrections."""
    series = loadmat(DATA / "DESR_Characterization_Data.mat", squeeze_me=True, struct_as_record=False)
    raw = getattr(series[setting["set"]], f"x{setting['spring_pos_mm']}")
    torque = raw.torque - TORQUE_OFFSET
    return Loop(raw.timeJIM, np.degrees(raw.angleJIM) - torque / COMPLIANCE, torque)


def compute_elastic_curve(loop: Loop) -> tuple[Array, Array]:
    """Return angles [deg] and the elastic torque [N m]: the mean of both directions, not decreasing."""
    angles, loading, unloading = loop.split_directions()
    return angles, np.maximum.accumulate(0.5 * (loading + unloading))


def average_blocks(loop: Loop, parity: int) -> tuple[Array, Array, Array]:
    """Return the means of time [s], angle [deg] and torque [N m] over blocks of every other sample."""
    columns = np.stack(loop)[:, parity::2]
    block = (columns[0] / BLOCK_TIME).astype(int)
    time, angle, torque = np.stack([columns[:, block == b].mean(axis=1) for b in np.unique(block)]).T
    return time, angle, torque


def write_dataset_folder(loop: Loop, folder: Path) -> Path:
    """Write dorsiflexion as a dataset of a tendon without a muscle, whose length follows the elastic curve.

    The foot is progressive, and the tendon of the device is linear. The length is therefore that at which the linear
    tendon has the elastic torque, so that only what is not elastic is left to explain. The fraction of the energy that
    is lost does not depend on this choice. Every other sample makes a repeat: both show the noise of the sensors.
    """
    folder.mkdir(parents=True)
    (folder / "foot.toml").write_text(DEVICE, "utf-8")
    angles, elastic = compute_elastic_curve(loop)
    taut_angle = angles[int(np.argmax(elastic > TAUT_TORQUE))]
    _, angle, _ = average_blocks(loop, 0)
    bottom, top = int(np.argmin(angle)), int(np.argmax(angle))
    start = bottom + int(np.argmax(angle[bottom:] > taut_angle))
    end = top + int(np.argmax(angle[top:] < taut_angle))
    header = HEADER
    for repeat in (0, 1):
        time, angle, torque = (column[start:end] for column in average_blocks(loop, repeat))
        force = 1e3 * torque / LEVER_ARM
        trial_columns = {
            "time [s]": time,
            "length [mm]": SLACK_LENGTH + 1e3 * np.interp(angle, angles, elastic) / LEVER_ARM / STIFFNESS,
            "force [N]": np.where(force > 0.0, force, np.nan),  # a tendon does not push
        }
        write_trial(folder / f"loop_{repeat}.csv", trial_columns)
        header += f'[[trial]]\nfiles = ["loop_{repeat}.csv"]\ngroup = "loop"\nuse = "fit"\ntrusted = ["force"]\n'
    (folder / "dataset.toml").write_text(header, "utf-8")
    return folder


def diagnose_setting(setting: dict[str, str], folder: Path) -> Diagnosis:
    """Return the diagnosis of the loop of ``setting``; the numbers of the tendon were chosen and cannot be wrong."""
    dataset = datasets.load_dataset(write_dataset_folder(read_loop(setting), folder / "data"))
    return diagnose(dataset, DiagnosisOptions(exclude=("number_error",)))


def compute_measured_loss(setting: dict[str, str]) -> float:
    """Return the energy that dorsiflexion loses over the energy of loading."""
    angles, loading, unloading = read_loop(setting).split_directions()
    return float(1.0 - np.trapezoid(unloading, angles) / np.trapezoid(loading, angles))


def compute_simulated_loss(result: Diagnosis) -> float:
    """Return the energy that the found device loses in the loop over the energy of loading."""
    assert result.fitted_device is not None
    length = result.dataset.trials[0].prescribed["length"]
    time = np.arange(length.time[0], length.time[-1], 1e-3)
    stretch = np.interp(time, length.time, length.value)
    tension = simulate_rollouts(result.fitted_device.parameters, stretch, np.zeros(len(time)), 1e-3).tension
    work = tension[1:] * np.diff(stretch)
    return float(work.sum() / work[work > 0.0].sum())


def get_keel_stiffness(name: str) -> float:
    """Return the stiffness [N m/deg] of the keel of a preset about the ankle."""
    foot = load_device("klute-1-1-4-pair").with_foot(name).spec.foot
    forefoot = foot.get_forefoot() if foot is not None else None
    assert forefoot is not None
    return float(np.radians(forefoot.stiffness * DEFAULT_KEEL_LEVER**2))


CATEGORIES = ["dynamic-response-low", "dynamic-response-medium", "dynamic-response-high"]
SPRING_POSITIONS_OF_N = ["00", "10", "20", "25", "30", "33", "35", "40", "45"]

pytestmark = [
    pytest.mark.extras,
    pytest.mark.skipif(not DATA.exists(), reason="KLUTE_SIM_DATA does not hold these measurements"),
]


def test_loops_have_the_published_energy_loss_and_stiffness() -> None:
    all_settings = read_settings()
    assert len(all_settings) == 11
    for setting in all_settings:
        result = read_loop(setting)
        assert result.energy_loss == pytest.approx(float(setting["loop_J"]), rel=0.02)
        assert result.stiffness == pytest.approx(float(setting["stiff_df_Nm_per_deg"]), rel=0.005)


def test_most_loops_are_not_tendon_hysteresis() -> None:
    """A passive tendon never pulls harder during unloading; this foot does, because it stores energy elsewhere."""
    for setting in read_settings():
        angles, loading, unloading = read_loop(setting).split_directions()
        stored, returned = (float(np.trapezoid(torque, np.radians(angles))) for torque in (loading, unloading))
        stronger_unloading = angles[unloading > loading + 0.05 * loading.max()]
        if setting["set"] == "DESR_N":
            assert 3.0 < stronger_unloading.min() < stronger_unloading.max() < 8.5
            assert -0.05 < 1.0 - returned / stored < 0.08
        else:
            assert not len(stronger_unloading)
            assert 0.08 < 1.0 - returned / stored < 0.16


@pytest.mark.parametrize("cam", ["CAM1", "CAM2"])
def test_setting_that_loses_energy_is_named(cam: str, tmp_path: Path) -> None:
    setting = next(s for s in read_settings() if s["set"] == f"DESR_N_{cam}")
    result = diagnose_setting(setting, tmp_path)
    assert result.verdict == "identified-in-part"
    assert [term.effect for term in result.added_terms] == ["tendon_hysteresis"]
    assert result.prediction is not None
    assert result.prediction.share > 0.7
    assert result.channel_rms["force"].with_effects < 0.5 * result.channel_rms["force"].refitted
    assert compute_simulated_loss(result) == pytest.approx(compute_measured_loss(setting), abs=0.03)


@pytest.mark.parametrize("position", SPRING_POSITIONS_OF_N)
def test_setting_that_moves_energy_is_not_named(position: str, tmp_path: Path) -> None:
    setting = next(s for s in read_settings() if s["set"] == "DESR_N" and s["spring_pos_mm"] == position)
    result = diagnose_setting(setting, tmp_path)
    assert result.verdict == "unexplained"
    assert result.prediction is None or result.prediction.share == 0.0


def test_categories_cover_the_stiffer_half_of_the_settings() -> None:
    """By their slope, low is the setting of 30 mm, medium that of 45 mm, and high is stiffer than any."""
    slopes = {s["spring_pos_mm"]: read_loop(s).stiffness for s in read_settings() if s["set"] == "DESR_N"}
    assert list(slopes) == SPRING_POSITIONS_OF_N
    low, medium, high = (get_keel_stiffness(name) for name in CATEGORIES)
    assert min(slopes, key=lambda position: abs(slopes[position] - low)) == "30"
    assert low == pytest.approx(slopes["30"], rel=0.06)
    assert min(slopes, key=lambda position: abs(slopes[position] - medium)) == "45"
    assert medium == pytest.approx(slopes["45"], rel=0.04)
    assert high > 1.4 * max(slopes.values())


def test_measured_foot_is_progressive_and_the_keel_is_not() -> None:
    """A linear keel misses each loading curve by 7 to 14 % of its peak; a category alone by 11 % or more."""
    for setting in read_settings():
        angles, loading, _ = read_loop(setting).split_directions()
        best = float(np.sum(angles * loading) / np.sum(angles**2))
        misfit = float(np.sqrt(np.mean((best * angles - loading) ** 2))) / loading.max()
        assert 0.06 < misfit < 0.15
        of_categories = [
            float(np.sqrt(np.mean((get_keel_stiffness(name) * angles - loading) ** 2))) / loading.max()
            for name in CATEGORIES
        ]
        assert min(of_categories) > 0.10
        assert min(of_categories) == of_categories[0]


def test_section_with_the_numbers_of_a_setting_has_its_loop() -> None:
    """The bench test of a foot with stiffness and loss of the setting CAM1 gives its stiffness and its loss."""
    measured = read_loop(next(s for s in read_settings() if s["set"] == "DESR_N_CAM1"))
    angles, loading, unloading = measured.split_directions()
    stored, returned = (float(np.trapezoid(torque, np.radians(angles))) for torque in (loading, unloading))
    stiffness = float(np.sum(angles * loading) / np.sum(angles**2))
    changes = {
        "foot.forefoot_stiffness_n_per_mm": 1e-3 * float(np.degrees(stiffness)) / DEFAULT_KEEL_LEVER**2,
        "foot.keel_loss_pct": 100.0 * (1.0 - returned / stored),
    }
    device = load_device("klute-1-1-4-pair").with_foot("dynamic-response-low").with_changes(changes)
    result = press_foot(device, "forefoot", max_load=float(loading.max()) / DEFAULT_KEEL_LEVER)
    torque = result.load * result.lever  # the load moves towards the ankle while the foot bends
    angle = np.degrees(np.cumsum(np.gradient(result.deflection) / result.lever))
    angle += float(np.interp(torque.min(), loading, angles)) - angle.min()
    assert np.ptp(torque) / np.ptp(angle) == pytest.approx(stiffness, rel=0.05)
    assert result.loss == pytest.approx(1.0 - returned / stored, abs=0.02)
    top = int(np.argmax(angle))
    misfit = np.interp(angle[:top], angles, loading) - torque[:top]
    assert 0.02 < np.sqrt(np.mean(misfit**2)) / loading.max() < 0.10
