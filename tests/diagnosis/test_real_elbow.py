"""Published steps of a pneumatic elbow, not part of the project (see ``KLUTE_SIM_DATA``, docs/real-data.md)."""

import csv
import os
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from klute_sim.datasets.dataset import load_dataset, split_dataset
from klute_sim.datasets.write import write_trial
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.workflow import fit_base_device
from klute_sim.types import Array

DATA = Path(os.environ.get("KLUTE_SIM_DATA", "nowhere")) / "laas_elbow"
FIRST, SECOND = "simwithinitpres1step", "simwithinitpres10step1"
INTERVAL = 0.01

DEVICE = """
name = "elbow-muscle"
description = "One muscle of the elbow; its numbers are assumed and then fitted."
[muscle]
count = 1
resting_length_mm = 181.0
braid_length_ratio = 1.07
turns_per_m = 6.6
bladder_radius_mm = 9.18
bladder_thickness_mm = 1.0
c10_kpa = 118.4
c01_kpa = 105.7
friction_slope_n_per_bar = 10.0
friction_offset_n = 0.0
[tendon]
slack_length_mm = 50.0
stiffness_1_n_per_mm = 100.0
stiffness_2_n_per_mm = 100.0
engagement_mm = 5.0
[supply]
pressure_bar = 6.0
rate_bar_per_s = 1000.0
gas_temperature_c = 20.0
dead_volume_cm3 = 5.0
[effects.pressure_lag]
time_constant_s = 0.1
[effects.pressure_delay]
delay_s = 0.03
[effects.muscle_damping]
form = "viscous"
coefficient_n_s_per_m = 50.0
[mounting]
neutral_muscle_ratio = 0.88
"""

DATASET = """
format = "klute-sim-dataset/2"
rig = "mjcf"
model = "antagonist_joint"
device = "muscle.toml"
prescribed = ["pressure_command_flexor", "pressure_command_extensor"]
measured = ["angle_joint"]
[numbers]
"model.site.flexor_origin.pos_z" = 0.178
"model.site.extensor_origin.pos_z" = 0.165
"model.joint.joint.damping" = 0.2
"model.joint.joint.frictionloss" = 0.1
"model.geom.load.mass" = 1.0
[uncertain]
"model.site.flexor_origin.pos_z" = 0.01
"model.site.extensor_origin.pos_z" = 0.01
"model.joint.joint.damping" = 0.1
"model.joint.joint.frictionloss" = 0.1
"model.geom.load.mass" = 0.4
"muscle.resting_length_mm" = 20
"muscle.braid_length_ratio" = 0.015
"muscle.turns_per_m" = 1.0
"muscle.friction_slope_n_per_bar" = 10
"effects.pressure_lag.time_constant_s" = 0.05
"effects.pressure_delay.delay_s" = 0.015
"effects.muscle_damping.coefficient_n_s_per_m" = 30
"""
"""Twelve uncertain numbers; the pulley has the radius of the model, because lengths and forces scale with it."""


class Section(NamedTuple):
    """A part of a log that begins at rest."""

    name: str
    log: str
    begin: float
    end: float


SECTIONS = (
    Section("first_up", FIRST, 47.9, 54.9),
    Section("first_both", FIRST, 192.0, 206.5),
    Section("second_fill", SECOND, 7.8, 14.8),
    Section("second_up", SECOND, 88.4, 95.4),
    Section("second_down", SECOND, 116.8, 123.5),
    Section("second_vent", SECOND, 123.4, 130.4),
)

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not DATA.exists(), reason="KLUTE_SIM_DATA does not hold these measurements"),
]


def read_log(name: str) -> dict[str, tuple[Array, Array]]:
    """Return time [s] and value of each channel; a ROS bag has a clock for each."""
    with (DATA / f"{name}.csv").open() as file:
        heading, *rows = csv.reader(file)
    table = np.array([[float(cell) if cell.strip() else np.nan for cell in row[:10]] for row in rows])
    table = table[np.isfinite(table).all(axis=1)]
    names = [text.split("/")[-1].removesuffix("_x") for text in heading[::2]]
    return {name: (table[:, 2 * k], table[:, 2 * k + 1]) for k, name in enumerate(names[:5])}


def write_elbow_dataset(folder: Path, fitted: str) -> Path:
    """Write the sections of log ``fitted`` as trials for the fit and those of the other log as test trials."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "muscle.toml").write_text(DEVICE)
    lines = [DATASET]
    logs = {name: read_log(name) for name in (FIRST, SECOND)}
    for section in SECTIONS:
        log, time = logs[section.log], np.arange(section.begin, section.end, INTERVAL)
        columns = {"time [s]": time - section.begin}
        for channel, name in (("effort[6]", "flexor"), ("effort[7]", "extensor")):
            clock, command = log[channel]  # a command holds until the next message
            last = np.clip(np.searchsorted(clock, time, side="right") - 1, 0, len(clock) - 1)
            columns[f"pressure_command_{name} [bar]"] = command[last]
        columns["angle_joint [deg]"] = np.degrees(np.interp(time, *log["position[3]"]))
        write_trial(folder / f"{section.name}.csv", columns)
        use = "fit" if section.log == fitted else "test"
        lines.append(f'[[trial]]\nfiles = ["{section.name}.csv"]\nuse = "{use}"')
    (folder / "dataset.toml").write_text("\n".join(lines))
    return folder


def predict_other_log(folder: Path, fitted: str) -> dict[str, tuple[float, float]]:
    """Fit the sections of log ``fitted``; return trial -> rms misfit over the range of all test trials, and R squared.

    The entry ``all`` holds both for all test trials together.
    """
    dataset = load_dataset(write_elbow_dataset(folder, fitted))
    experiments, simulator = prepare_experiments(dataset, split_dataset(dataset)), Simulator()
    try:
        fit, _ = fit_base_device(dataset, [e for e in experiments if e.use == "fit"], simulator)
        unseen = [e for e in experiments if e.use == "test"]
        readings = simulator.simulate([fit.hypothesis.build_setups(fit.x, unseen)], unseen)[0]
    finally:
        simulator.close()
    measured = {e.name: e.measured["angle_joint"].value for e in unseen}
    misfit = {e.name: measured[e.name] - reading["angle_joint"] for e, reading in zip(unseen, readings, strict=True)}
    measured["all"], misfit["all"] = (np.concatenate(list(rows.values())) for rows in (measured, misfit))
    span = float(np.ptp(measured["all"]))
    return {
        name: (float(np.sqrt(np.mean(r**2))) / span, 1.0 - float(np.mean(r**2) / np.var(measured[name])))
        for name, r in misfit.items()
    }


def test_one_log_predicts_the_steps_of_the_other(tmp_path: Path) -> None:
    results = predict_other_log(tmp_path, FIRST)
    normalised_rms, determination = results["all"]
    assert normalised_rms < 0.05
    assert determination > 0.95
    assert max(rms for rms, _ in results.values()) < 0.08
