"""The experiment that a verdict asks for, done: the same bench, with the change of the rig that was proposed."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.hidden_effects.air import AIR_STEP
from benchmarks.hidden_effects.catalogue import add_effects, build_neutral_law, load_device
from benchmarks.hidden_effects.generate import COLUMN_DECIMALS, COLUMN_UNITS, format_table, record_trial
from benchmarks.hidden_effects.inputs import SAMPLE_INTERVAL, InputProgram
from benchmarks.hidden_effects.simulate import Hidden, Noise, draw_wander, simulate_measurements
from benchmarks.hidden_effects.truth import TRACE_STEP

from klute_sim.bench.protocols.identification import PROTOCOLS
from klute_sim.datasets.dataset import load_dataset
from klute_sim.diagnosis.planning.proposals import RIG_CHANGES, RigChange

FOLLOW_UP_GROUP = "second_round"


def make_follow_up(folder: Path, truth: dict[str, Any], requested: dict[str, Any], target_folder: Path) -> None:
    """Copy the dataset in ``folder`` to ``out`` and add two repeats of what ``verdict.json`` ``asked`` for."""
    change = next(
        one for one in RIG_CHANGES if one.description == (requested["rig_change"] or RIG_CHANGES[0].description)
    )
    program = _build_program(folder, requested["protocol"])
    known = truth.get("known", ())
    base = {**load_device(), **truth["base"]}
    plain = add_effects(*build_neutral_law(base), known)
    faults = [each for each in truth["instruments"] if each["channel"] not in change.reference_channels]
    hidden = Hidden(truth["effects"], faults, truth["strangers"])
    noise, random = Noise(**truth["noise"]), np.random.default_rng([truth["seed"], 2])
    recorded = _list_recorded_channels(folder, change)
    shutil.rmtree(target_folder, ignore_errors=True)
    shutil.copytree(folder, target_folder)
    lines = []
    for repeat in "ab":
        slow = draw_wander(random, round(program.duration / AIR_STEP) + 1, noise.wander)
        told = simulate_measurements(program, plain, hidden, slow)
        table = record_trial(random, program, told, noise, recorded, faults)
        name = f"{FOLLOW_UP_GROUP}_{repeat}.csv"
        (target_folder / name).write_text(format_table(table), "utf-8")
        lines += ["", "[[trial]]", f'files = ["{name}"]', f'group = "{FOLLOW_UP_GROUP}"', 'use = "fit"']
        lines += [f"checked = {json.dumps(list(change.reference_channels))}"] if change.reference_channels else []
    with (target_folder / "dataset.toml").open("a", encoding="utf-8") as file:
        file.write("\n".join(lines) + "\n")


def _build_program(folder: Path, protocol: str) -> InputProgram:
    """The inputs of ``protocol`` for the dataset's device, as this bench is told them."""
    asked = PROTOCOLS[protocol].build_program(load_dataset(folder).device)
    samples = np.arange(int(asked.time[-1] / SAMPLE_INTERVAL + 1e-6) + 1)
    duration = float(samples[-1] * SAMPLE_INTERVAL)
    grid = np.arange(round(duration / TRACE_STEP) + 1) * TRACE_STEP
    length = np.interp(grid, asked.time, asked.unit_length)
    command = np.interp(samples * SAMPLE_INTERVAL, asked.time, asked.command)
    return InputProgram(FOLLOW_UP_GROUP, "fit", duration, length, command)


def _list_recorded_channels(folder: Path, change: RigChange) -> list[str]:
    measured = {channel for trial in load_dataset(folder).trials for channel in trial.measured}
    return [
        channel
        for channel in COLUMN_DECIMALS
        if channel in measured | set(change.added_channels) and channel in COLUMN_UNITS
    ]
