"""Follow-up measurement: the experiment that a verdict proposes, on the same bench with the proposed change of the
rig.
"""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.hidden_effects.air import AIR_STEP
from benchmarks.hidden_effects.device import add_effects, build_neutral_law, load_device
from benchmarks.hidden_effects.generate import COLUMN_DECIMALS, COLUMN_UNITS, format_table, record_trial
from benchmarks.hidden_effects.imperfect import SEEN_SPECIMENS, add_law_error
from benchmarks.hidden_effects.inputs import SAMPLE_INTERVAL, InputProgram
from benchmarks.hidden_effects.set_up import list_numbers
from benchmarks.hidden_effects.simulate import Hidden, Noise, draw_wander, simulate_measurements
from benchmarks.hidden_effects.truth import TRACE_STEP
from scipy.interpolate import PchipInterpolator

from klute_sim.bench.protocols.library import load_identification_protocols
from klute_sim.datasets.dataset import load_dataset
from klute_sim.diagnosis.planning.proposals import RIG_CHANGES, RigChange

FOLLOW_UP_GROUP = "follow_up"


def make_follow_up(folder: Path, truth: dict[str, Any], requested: dict[str, Any], target_folder: Path) -> None:
    """Copy the dataset in ``folder`` to ``target_folder`` and add two repeats of the ``requested`` experiment."""
    change = next(
        rig_change
        for rig_change in RIG_CHANGES
        if rig_change.description == (requested["rig_change"] or RIG_CHANGES[0].description)
    )
    program = _build_program(folder, requested["protocol"])
    known = truth.get("known", ())
    base = {**load_device(), **truth["base"], **list_numbers(truth.get("numbers", ()))}
    neutral = add_effects(*build_neutral_law(base), known)
    faults = [fault for fault in truth["instruments"] if fault["channel"] not in change.reference_channels]
    hidden, law_error = Hidden(truth["effects"], faults, truth["strangers"]), truth.get("law_error")
    noise, rng = Noise(**truth["noise"]), np.random.default_rng([truth["seed"], 2])
    channels = _list_recorded_channels(folder, change)
    shutil.rmtree(target_folder, ignore_errors=True)
    shutil.copytree(folder, target_folder)
    lines = []
    for repeat in "ab":
        wander = draw_wander(rng, round(program.duration / AIR_STEP) + 1, noise.wander)
        signals = simulate_measurements(program, neutral, hidden, wander)
        if law_error is not None:
            signals = add_law_error(signals, program, law_error, SEEN_SPECIMENS[0])
        table = record_trial(rng, program, signals, noise, channels, faults)
        name = f"{FOLLOW_UP_GROUP}_{repeat}.csv"
        (target_folder / name).write_text(format_table(table), "utf-8")
        lines += ["", "[[trial]]", f'files = ["{name}"]', f'group = "{FOLLOW_UP_GROUP}"', 'use = "fit"']
        lines += [f'specimen = "{SEEN_SPECIMENS[0]}"'] if law_error is not None else []
        lines += [f"trusted = {json.dumps(list(change.reference_channels))}"] if change.reference_channels else []
    with (target_folder / "dataset.toml").open("a", encoding="utf-8") as file:
        file.write("\n".join(lines) + "\n")


def _build_program(folder: Path, protocol: str) -> InputProgram:
    """Return the inputs of ``protocol`` for the device of the dataset."""
    commands = load_identification_protocols()[protocol].build_program(load_dataset(folder).device)
    samples = np.arange(int(commands.time[-1] / SAMPLE_INTERVAL + 1e-6) + 1)
    duration = float(samples[-1] * SAMPLE_INTERVAL)
    grid = np.arange(round(duration / TRACE_STEP) + 1) * TRACE_STEP
    length = PchipInterpolator(commands.time, commands.unit_length)(grid)  # a crosshead has mass
    command = np.interp(samples * SAMPLE_INTERVAL, commands.time, commands.command)
    return InputProgram(FOLLOW_UP_GROUP, "fit", duration, length, command)


def _list_recorded_channels(folder: Path, change: RigChange) -> list[str]:
    measured = {channel for trial in load_dataset(folder).trials for channel in trial.measured}
    return [
        channel
        for channel in COLUMN_DECIMALS
        if channel in measured | set(change.added_channels) and channel in COLUMN_UNITS
    ]
