"""The experiment that a verdict asks for, done: the same bench, with the change of the rig that was proposed."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
from air import AIR_STEP
from catalogue import load_device, neutral_law, with_effects
from generate import DECIMALS, UNITS, log, table_text
from inputs import SAMPLE, Program
from simulate import Hidden, Noise, reported, wander
from truth import TRACE_STEP

from klute_sim.dataset.dataset import read
from klute_sim.diagnose.propose import CHANGES, Change
from klute_sim.diagnose.protocols import PROTOCOLS

GROUP = "second_round"


def second_round(folder: Path, truth: dict[str, Any], asked: dict[str, Any], out: Path) -> None:
    """Copy the dataset in ``folder`` to ``out`` and add two repeats of what ``verdict.json`` ``asked`` for."""
    change = next(one for one in CHANGES if one.words == (asked["rig_change"] or CHANGES[0].words))
    program = _program(folder, asked["protocol"])
    known = truth.get("known", ())
    base = {**load_device(), **truth["base"]}
    plain = with_effects(*neutral_law(base), known)
    faults = [each for each in truth["instruments"] if each["channel"] not in change.second]
    hidden = Hidden(truth["effects"], faults, truth["strangers"])
    noise, random = Noise(**truth["noise"]), np.random.default_rng([truth["seed"], 2])
    recorded = _recorded(folder, change)
    shutil.rmtree(out, ignore_errors=True)
    shutil.copytree(folder, out)
    lines = []
    for repeat in "ab":
        slow = wander(random, round(program.duration / AIR_STEP) + 1, noise.wander)
        told = reported(program, plain, hidden, slow)
        table = log(random, program, told, noise, recorded, faults)
        name = f"{GROUP}_{repeat}.csv"
        (out / name).write_text(table_text(table), "utf-8")
        lines += ["", "[[trial]]", f'files = ["{name}"]', f'group = "{GROUP}"', 'use = "fit"']
        lines += [f"checked = {json.dumps(list(change.second))}"] if change.second else []
    with (out / "dataset.toml").open("a", encoding="utf-8") as file:
        file.write("\n".join(lines) + "\n")


def _program(folder: Path, protocol: str) -> Program:
    """The inputs of ``protocol`` for the dataset's device, as this bench is told them."""
    asked = PROTOCOLS[protocol].program(read(folder).device)
    samples = np.arange(int(asked.time[-1] / SAMPLE + 1e-6) + 1)
    duration = float(samples[-1] * SAMPLE)
    grid = np.arange(round(duration / TRACE_STEP) + 1) * TRACE_STEP
    length = np.interp(grid, asked.time, asked.unit_length)
    command = np.interp(samples * SAMPLE, asked.time, asked.command)
    return Program(GROUP, "fit", duration, length, command)


def _recorded(folder: Path, change: Change) -> list[str]:
    measured = {channel for trial in read(folder).trials for channel in trial.measured}
    return [channel for channel in DECIMALS if channel in measured | set(change.added) and channel in UNITS]
