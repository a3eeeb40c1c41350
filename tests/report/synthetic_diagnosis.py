"""A diagnosis for the tests of its report: hysteresis hidden in two groups of two trials; and variants of it."""

import re
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np

from klute_sim.datasets import dataset
from klute_sim.datasets.split import Split
from klute_sim.datasets.write import write_trial
from klute_sim.device.device import load_device
from klute_sim.device.dynamics import compute_equilibrium_state
from klute_sim.device.rollout import simulate_rollouts
from klute_sim.diagnosis.selection.robustness import EquivalentModel
from klute_sim.diagnosis.workflow import Diagnosis, DiagnosisOptions, diagnose
from klute_sim.effects import catalogue
from klute_sim.units import BAR

RATE, TIME, FINE = 200.0, 1.2, 10
SLOPE = 12.0
"""Of the hidden braid hysteresis [N/bar]."""
EVIL = "<script>alert(1)</script>$^$"


def trial(path: Path, group: int, seed: int) -> None:
    """A ramp and a step with hidden hysteresis, seen by a noisy load cell and a noisy gauge."""
    device = load_device("klute-3-4-pair").parameters
    samples = np.arange(int(RATE * TIME) + 1) / RATE
    grid = np.arange(FINE * (len(samples) - 1) + 1) / (RATE * FINE)
    moved = 0.335 + 0.008 * np.sin(2.0 * np.pi * (1.0 + group) * np.maximum(0.0, samples - 0.2))
    stepped = BAR * np.interp(samples, [0.0, 0.7, 0.8], [2.5 + 0.5 * group, 2.5 + 0.5 * group, 4.0])
    length, command = np.interp(grid, samples, moved), np.interp(grid, samples, stepped)
    effects = catalogue.pack_effects({("braid_hysteresis", "coulomb"): {"slope_n_per_bar": SLOPE}})
    hidden = device._replace(effects=effects)
    found = simulate_rollouts(
        hidden, length, command, grid[1], initial_state=compute_equilibrium_state(hidden, length[0], command[0])
    )
    random, every = np.random.default_rng(seed), slice(None, None, FINE)
    count = len(grid[every])
    columns = {
        "time [s]": grid[every],
        "length [mm]": 1e3 * length[every],
        "pressure_command [bar]": command[every] / BAR,
        "force [N]": found.tension[every] + random.normal(0.0, 3.0, count),
        "pressure [bar]": found.pressure[every] / BAR + random.normal(0.0, 0.01, count),
    }
    write_trial(path, columns)


def diagnosed(folder: Path) -> Diagnosis:
    """Two groups of two trials, one to fit and one to show."""
    text = 'format = "klute-sim-dataset/1"\nrig = "bench"\ndevice = "klute-3-4-pair"\n'
    text += '[uncertain]\n"muscle.c10_kpa" = "10 %"\n"tendon.stiffness_1_n_per_mm" = "10 %"\n'
    for group in (0, 1):
        for repeat in (0, 1):
            trial(folder / f"g{group}_{repeat}.csv", group, 10 * group + repeat)
            use = ("fit", "show")[group]
            text += f'[[trial]]\nfiles = ["g{group}_{repeat}.csv"]\ngroup = "g{group}"\nuse = "{use}"\n'
    (folder / "dataset.toml").write_text(text)
    return diagnose(dataset.load_dataset(folder), DiagnosisOptions(only=("braid_hysteresis", "sensor_offset")))


def text_of(html: str) -> str:
    """What a reader sees of ``html``."""
    body = re.sub(r"<style>.*?</style>", "", html, flags=re.DOTALL)
    return " ".join(unescape(re.sub(r"<[^>]*>", " ", body)).split())


def rows_of(html: str, section: str) -> list[list[str]]:
    """Cells of the tables in a section, row by row."""
    part = re.split(r"<h2", html.split(f'<h2 id="{section}"')[1])[0]
    return [
        [text_of(cell) for cell in re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row, flags=re.DOTALL)]
        for row in re.findall(r"<tr[^>]*>(.*?)</tr>", part, flags=re.DOTALL)
    ]


def axes_of(figure: Any) -> list[Any]:
    return [axis for axis in figure.axes if axis.get_label() != "<colorbar>"]


def clean(found: Diagnosis) -> Diagnosis:
    """``found`` as it would be if no effect had been accepted."""
    assert found.base_fit is not None
    step = replace(found.selection_history[0], added_term=None, reason="nothing promises enough")
    intervals = found.confidence_intervals[: found.base_fit.hypothesis.n_device_parameters]
    return replace(
        found,
        final_fit=found.base_fit,
        added_terms=(),
        confidence_intervals=intervals,
        selection_history=[step],
        reasons=["It fits."],
    )


def rivalled(found: Diagnosis) -> Diagnosis:
    other = next(f for f in found.selection_history[0].refits if f.hypothesis.terms[-1] != found.added_terms[0])
    return replace(found, verdict="ambiguous", equivalent_models=[EquivalentModel(other, found.added_terms[0], 2.25)])


def bare(found: Diagnosis) -> Diagnosis:
    return Diagnosis(
        dataset=found.dataset,
        split=found.split,
        verdict="insufficient-data",
        reasons=["No trial is repeated."],
        experiments=found.experiments,
    )


def evil(found: Diagnosis) -> Diagnosis:
    """``found`` with a name that attacks everywhere a name comes from the data."""
    data = found.dataset
    trials = tuple(replace(t, name=f"{EVIL}{k}", group=EVIL, device=data.device) for k, t in enumerate(data.trials))
    uncertain = dict(data.uncertainties)
    return replace(
        found,
        dataset=replace(
            data, trials=trials, folder=Path(EVIL), remarks=(f"file {EVIL} is odd",), uncertainties=uncertain
        ),
        split=Split((trials[0].name, trials[1].name), (), (trials[2].name, trials[3].name), f"drawn: {EVIL}"),
        reasons=[EVIL],
        experiments=[replace(e, name=t.name, group=EVIL) for e, t in zip(found.experiments, trials, strict=True)],
        selection_history=[
            replace(step, validation_gains={EVIL: 0.1}, reason=EVIL) for step in found.selection_history
        ],
    )
