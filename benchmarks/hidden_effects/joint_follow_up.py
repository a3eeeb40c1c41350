"""Follow-up measurement on a joint: the trial that a verdict proposes, with the proposed change of the rig."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.hidden_effects.air import AIR_STEP
from benchmarks.hidden_effects.catalogue import JOINT_CHANNELS, TENDONS
from benchmarks.hidden_effects.follow_up import FOLLOW_UP_GROUP
from benchmarks.hidden_effects.imperfect import SEEN_SPECIMENS
from benchmarks.hidden_effects.joints import (
    SAMPLE_INTERVAL,
    WANDER,
    Floats,
    JointNumbers,
    build_joint,
    format_table,
    load_nominal,
    make_errors,
    simulate_channels,
    stays_off_stops,
)
from benchmarks.hidden_effects.simulate import draw_wander

from klute_sim.diagnosis.planning.joint_proposals import list_rig_changes
from klute_sim.diagnosis.planning.proposals import RigChange
from klute_sim.mechanism.protocols import TESTS, ProtocolSettings, plan_test
from klute_sim.units import BAR

REDUCTION, MAX_REDUCTIONS = 0.8, 8
"""Factor of the pressure difference, applied until the joint stays off its stops, and how often at most."""


def make_follow_up(folder: Path, truth: dict[str, Any], requested: dict[str, Any], target_folder: Path) -> None:
    """Copy the dataset in ``folder`` to ``target_folder`` and add two repeats of the ``requested`` experiment.

    Whoever records it reduces the difference where the joint reaches a stop.
    """
    changes = list_rig_changes(list(JOINT_CHANNELS), TENDONS)
    change = next(c for c in changes if c.description == (requested["rig_change"] or changes[0].description))
    numbers = build_joint({**load_nominal(), **truth["base"]}, (*truth["effects"], *truth["strangers"]))
    commands = _build_commands(requested, numbers)
    faults = [fault for fault in truth["instruments"] if fault["channel"] not in change.reference_channels]
    law_error, specimen = truth.get("law_error"), SEEN_SPECIMENS[0]
    rng = np.random.default_rng([truth["seed"], 2])
    shutil.rmtree(target_folder, ignore_errors=True)
    shutil.copytree(folder, target_folder)
    lines = []
    for repeat in "ab":
        wander = draw_wander(rng, round((commands.shape[1] - 1) * SAMPLE_INTERVAL / AIR_STEP) + 1, WANDER)
        errors = make_errors(law_error, specimen)
        channels = simulate_channels(numbers, commands, wander, faults, errors, load_cells=change.added_channels)
        file = f"{FOLLOW_UP_GROUP}_{repeat}.csv"
        (target_folder / file).write_text(format_table(rng, commands, channels, faults), "utf-8")
        lines += ["", "[[trial]]", f'files = ["{file}"]', f'group = "{FOLLOW_UP_GROUP}"', 'use = "fit"']
        lines += [f"trusted = {json.dumps(list(change.reference_channels))}"] if change.reference_channels else []
        lines += [f'specimen = "{specimen}"'] if law_error is not None else []
    _extend_dataset_file(target_folder / "dataset.toml", change, lines)


def _build_commands(requested: dict[str, Any], numbers: JointNumbers) -> Floats:
    """Return both pressure commands [Pa] (2, samples) of the ``requested`` trial, which stay off the stops."""
    for power in range(MAX_REDUCTIONS + 1):
        difference = REDUCTION**power * requested["difference_bar"] * BAR
        settings = ProtocolSettings(requested["mean_bar"] * BAR, difference, 0.0)
        trials = [trial for test in TESTS for trial in plan_test(test, settings)]
        trial = next(trial for trial in trials if trial.name == requested["protocol"])
        time = SAMPLE_INTERVAL * np.arange(round(trial.duration / SAMPLE_INTERVAL) + 1)
        difference = trial.difference(time)
        commands = np.stack([trial.mean_pressure + difference, trial.mean_pressure - difference])
        if stays_off_stops(numbers, commands):
            break
    return commands


def _extend_dataset_file(path: Path, change: RigChange, lines: list[str]) -> None:
    """Declare the channels that ``change`` adds, and append ``lines``."""
    text = path.read_text("utf-8")
    if change.added_channels:
        measured = list(JOINT_CHANNELS)
        text = text.replace(f"measured = {measured!r}", f"measured = {[*measured, *change.added_channels]!r}")
    path.write_text(text + "\n".join(lines) + "\n", "utf-8")
