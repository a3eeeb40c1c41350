"""Score of the localization: in which channels and conditions a hidden effect leaves a misfit, and where one was seen.

    python -m benchmarks.hidden_effects.localization OUT        # results of benchmarks.hidden_effects.run

The true map follows from the laws of the benchmark: the channels with everything hidden, after a refit of the uncertain
numbers, without noise. A cell, one channel in one condition, is *off* if the root mean square there is at least a
quarter of the noise, which is also the smallest misfit that the program calls relevant. The score is
F1 = 2 TP / (2 TP + FP + FN) over all cells of all datasets.
"""

import argparse
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.hidden_effects.archive import find_verdicts
from benchmarks.hidden_effects.device import load_device
from benchmarks.hidden_effects.generate import draw_bench
from benchmarks.hidden_effects.inputs import SAMPLE_INTERVAL, InputProgram
from benchmarks.hidden_effects.simulate import Hidden, Noise
from benchmarks.hidden_effects.sizes import DECIMATION_FACTOR, EffectSizer
from benchmarks.hidden_effects.truth import TRACE_STEP

Cell = tuple[str, str]
"""Channel and condition."""
SCORED_BLOCKS = ("clean", "single", "instrument", "pair", "triple", "twin", "outside", "faint_outside", "wrong_form")
"""Blocks whose misfit comes from hidden effects alone."""
MIN_MISFIT = 0.25
"""Smallest relevant misfit over the noise."""
MIN_SIGNIFICANCE = 4.0
"""Standard errors from which on the program calls a misfit significant."""
MIN_CELL_FRACTION = 0.02
"""Smallest fraction of the samples in a scored cell."""
SMOOTHING_TIME = 0.05
"""Window of the moving averages of the rates [s]."""
MAX_STEADY_PRESSURE_RATE = 0.05e5
"""Rate of the command [Pa/s] up to which the pressure is steady."""
MAX_HELD_SPEED_FRACTION = 0.02
"""Speed over the largest speed up to which the length is held."""
N_RESAMPLES = 2000
"""Number of resamples of the datasets for an interval."""


def label_program(program: InputProgram, max_speed: float) -> np.ndarray:
    """Return the condition of each sample of a size."""
    time = np.arange(len(program.length)) * TRACE_STEP
    width = round(SMOOTHING_TIME / TRACE_STEP)
    window = np.ones(width) / width
    speed = np.convolve(np.gradient(program.length, TRACE_STEP), window, mode="same")
    command = np.interp(time, np.arange(len(program.command)) * SAMPLE_INTERVAL, program.command)
    rate = np.convolve(np.abs(np.gradient(command, TRACE_STEP)), window, mode="same")
    held = MAX_HELD_SPEED_FRACTION * max_speed
    motion = np.where(speed > held, "lengthening, ", np.where(speed < -held, "shortening, ", "held, "))
    pressure = np.where(rate > MAX_STEADY_PRESSURE_RATE, "pressure changes", "steady pressure")
    return np.char.add(motion, pressure)[::DECIMATION_FACTOR]


def compute_true_map(truth: Mapping[str, Any], channels: Sequence[str]) -> dict[Cell, float]:
    """Return the misfit over the noise in each cell of recorded ``channels`` after a refit, without noise."""
    device, noise = load_device(), Noise(**truth["noise"])
    bench = draw_bench(truth["seed"], device)
    sizer = EffectSizer(bench.base, device, bench.programs, channels, noise, truth.get("known", ()))
    hidden = Hidden(truth["effects"], truth["instruments"], truth["strangers"])
    residual = sizer.compute_residual(hidden).reshape(len(channels), -1)
    programs = [program for program in bench.programs if program.use == "fit"]
    max_speed = max(float(np.abs(np.gradient(program.length, TRACE_STEP)).max()) for program in programs)
    labels = np.concatenate([label_program(program, max_speed) for program in programs])
    rounding = {  # the simulation of the instruments does not round: variance over that of the noise
        fault["channel"]: (fault["parameters"]["step"] / getattr(noise, fault["channel"])) ** 2 / 12.0
        for fault in truth["instruments"]
        if fault["name"] == "quantisation"
    }
    cells = {}
    for region in np.unique(labels):
        samples = labels == region
        if samples.mean() >= MIN_CELL_FRACTION:
            for channel, row in zip(channels, residual, strict=True):
                cells[channel, str(region)] = float(np.sqrt(np.mean(row[samples] ** 2) + rounding.get(channel, 0.0)))
    return cells


def count_cells(true_map: Mapping[Cell, float], verdict: Mapping[str, Any]) -> tuple[int, int, int, int]:
    """Return the numbers of true and false positives, and of false and true negatives, among the cells of both maps."""
    counts = [0, 0, 0, 0]
    for cell in verdict.get("misfit_map", ()):
        size = true_map.get((cell["channel"], cell["region"]))
        if size is None:
            continue
        is_seen = cell["misfit_over_noise"] > MIN_MISFIT and cell["significance"] > MIN_SIGNIFICANCE
        is_off = size >= MIN_MISFIT
        counts[{(True, True): 0, (True, False): 1, (False, True): 2, (False, False): 3}[is_seen, is_off]] += 1
    return counts[0], counts[1], counts[2], counts[3]


def score_cells(counts: Iterable[tuple[int, int, int, int]]) -> dict[str, float]:
    """Return F1, precision and recall of all cells together; nan where nothing was seen or nothing is off."""
    true_positives, false_positives, false_negatives, _ = np.sum(list(counts), axis=0)
    with np.errstate(invalid="ignore"):
        return {
            "cells": float(np.sum(list(counts))),
            "f1": float(2 * true_positives / np.float64(2 * true_positives + false_positives + false_negatives)),
            "precision": float(true_positives / np.float64(true_positives + false_positives)),
            "recall": float(true_positives / np.float64(true_positives + false_negatives)),
        }


def bootstrap_f1(counts: Sequence[tuple[int, int, int, int]]) -> tuple[float, float]:
    """Return the 95 % interval of F1 over datasets, whose cells are not independent, by resampling datasets."""
    samples = np.random.default_rng(0).integers(len(counts), size=(N_RESAMPLES, len(counts)))
    true_positives, false_positives, false_negatives, _ = np.array(counts)[samples].sum(axis=1).T
    with np.errstate(invalid="ignore"):
        f1 = 2 * true_positives / (2 * true_positives + false_positives + false_negatives)
    low, high = np.nanpercentile(f1, [2.5, 97.5])
    return float(low), float(high)


def main() -> None:
    """Score the results in a folder and print a row for each block."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder of datasets and results")
    arguments = parser.parse_args()
    by_block: dict[str, list[tuple[int, int, int, int]]] = {}
    try:
        verdicts = find_verdicts(arguments.out)
    except ValueError as error:
        parser.error(str(error))
    if not verdicts:
        parser.error(f"{arguments.out / 'results'} has no verdict")
    for name, file in verdicts.items():
        truth = json.loads((arguments.out / f"{name}.truth.json").read_text("utf-8"))
        if truth["block"] in SCORED_BLOCKS:
            verdict = json.loads(file.read_text("utf-8"))
            counts = count_cells(compute_true_map(truth, list(verdict["gap"])), verdict)
            by_block.setdefault(truth["block"], []).append(counts)
    rows = {**by_block, "all": [counts for block in by_block.values() for counts in block]}
    for block, counts in rows.items():
        score = score_cells(counts)
        text = ", ".join(f"{key} {value:.3g}" for key, value in score.items())
        low, high = bootstrap_f1(counts) if score["f1"] > 0.0 else (np.nan, np.nan)
        print(f"{block}: {len(counts)} datasets, {text}, 95 % interval of F1 {low:.3g} to {high:.3g}")


if __name__ == "__main__":
    main()
