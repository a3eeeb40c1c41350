"""Diagnosis of a synthetic dataset with hidden braid hysteresis (two groups of two trials), and variants of it."""

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
from klute_sim.device.equilibrium import compute_equilibrium_state
from klute_sim.device.rollout import simulate_rollouts
from klute_sim.diagnosis.result import Diagnosis, DiagnosisOptions
from klute_sim.diagnosis.selection.robustness import EquivalentModel
from klute_sim.diagnosis.workflow import diagnose
from klute_sim.effects import catalogue
from klute_sim.units import BAR

SAMPLE_RATE_HZ, DURATION_S, STEPS_PER_SAMPLE = 200.0, 1.2, 10
SLOPE_N_PER_BAR = 12.0
"""Slope [N/bar] of the hidden braid hysteresis."""
HTML_ATTACK = "<script>alert(1)</script>$^$"


def write_synthetic_trial(path: Path, group: int, seed: int) -> None:
    """Write a trial of a length sine and a pressure ramp with noisy readings of force and pressure."""
    device = load_device("klute-3-4-pair").parameters
    samples = np.arange(int(SAMPLE_RATE_HZ * DURATION_S) + 1) / SAMPLE_RATE_HZ
    grid = np.arange(STEPS_PER_SAMPLE * (len(samples) - 1) + 1) / (SAMPLE_RATE_HZ * STEPS_PER_SAMPLE)
    sampled_length = 0.335 + 0.008 * np.sin(2.0 * np.pi * (1.0 + group) * np.maximum(0.0, samples - 0.2))
    sampled_command = BAR * np.interp(samples, [0.0, 0.7, 0.8], [2.5 + 0.5 * group, 2.5 + 0.5 * group, 4.0])
    length, command = np.interp(grid, samples, sampled_length), np.interp(grid, samples, sampled_command)
    effects = catalogue.pack_effects({("braid_hysteresis", "coulomb"): {"slope_n_per_bar": SLOPE_N_PER_BAR}})
    hidden = device._replace(effects=effects)
    rollout = simulate_rollouts(
        hidden, length, command, grid[1], initial_state=compute_equilibrium_state(hidden, length[0], command[0])
    )
    rng, at_samples = np.random.default_rng(seed), slice(None, None, STEPS_PER_SAMPLE)
    count = len(grid[at_samples])
    columns = {
        "time [s]": grid[at_samples],
        "length [mm]": 1e3 * length[at_samples],
        "pressure_command [bar]": command[at_samples] / BAR,
        "force [N]": rollout.tension[at_samples] + rng.normal(0.0, 3.0, count),
        "pressure [bar]": rollout.pressure[at_samples] / BAR + rng.normal(0.0, 0.01, count),
    }
    write_trial(path, columns)


def diagnose_synthetic_dataset(folder: Path) -> Diagnosis:
    """Diagnose two groups of two trials: one group to fit, one to test."""
    text = 'format = "klute-sim-dataset/2"\nrig = "bench"\ndevice = "klute-3-4-pair"\n'
    text += '[uncertain]\n"muscle.c10_kpa" = "10 %"\n"tendon.stiffness_1_n_per_mm" = "10 %"\n'
    for group in (0, 1):
        for repeat in (0, 1):
            write_synthetic_trial(folder / f"g{group}_{repeat}.csv", group, 10 * group + repeat)
            use = ("fit", "test")[group]
            text += f'[[trial]]\nfiles = ["g{group}_{repeat}.csv"]\ngroup = "g{group}"\nuse = "{use}"\n'
    (folder / "dataset.toml").write_text(text)
    return diagnose(dataset.load_dataset(folder), DiagnosisOptions(only=("braid_hysteresis", "sensor_offset")))


def text_of(html: str) -> str:
    """Return the visible text of ``html``."""
    body = re.sub(r"<style>.*?</style>", "", html, flags=re.DOTALL)
    return " ".join(unescape(re.sub(r"<[^>]*>", " ", body)).split())


def rows_of(html: str, section: str) -> list[list[str]]:
    """Return the cells of the tables in a section, row by row."""
    part = re.split(r"<h2", html.split(f'<h2 id="{section}"')[1])[0]
    return [
        [text_of(cell) for cell in re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row, flags=re.DOTALL)]
        for row in re.findall(r"<tr[^>]*>(.*?)</tr>", part, flags=re.DOTALL)
    ]


def axes_of(figure: Any) -> list[Any]:
    return [axis for axis in figure.axes if axis.get_label() != "<colorbar>"]


def without_effects(diagnosis: Diagnosis) -> Diagnosis:
    """Return the diagnosis as if no effect had been accepted."""
    assert diagnosis.base_fit is not None
    step = replace(diagnosis.selection_history[0], added_term=None, reason="no candidate improves the fit enough")
    intervals = diagnosis.confidence_intervals[: diagnosis.base_fit.hypothesis.n_prior_parameters]
    return replace(
        diagnosis,
        final_fit=diagnosis.base_fit,
        added_terms=(),
        confidence_intervals=intervals,
        selection_history=[step],
        reasons=["It fits."],
    )


def with_equivalent_model(diagnosis: Diagnosis) -> Diagnosis:
    other = next(f for f in diagnosis.selection_history[0].refits if f.hypothesis.terms[-1] != diagnosis.added_terms[0])
    return replace(
        diagnosis,
        verdict="indistinguishable",
        equivalent_models=[EquivalentModel(other, 2.25)],
    )


def insufficient(diagnosis: Diagnosis) -> Diagnosis:
    return Diagnosis(
        dataset=diagnosis.dataset,
        split=diagnosis.split,
        verdict="insufficient-data",
        reasons=["No trial is repeated."],
        experiments=diagnosis.experiments,
    )


def with_html_attack(diagnosis: Diagnosis) -> Diagnosis:
    """Return the diagnosis with a script in every name that comes from the data."""
    data = diagnosis.dataset
    trials = tuple(
        replace(t, name=f"{HTML_ATTACK}{k}", group=HTML_ATTACK, device=data.device) for k, t in enumerate(data.trials)
    )
    uncertain = dict(data.uncertainties)
    return replace(
        diagnosis,
        dataset=replace(
            data,
            trials=trials,
            folder=Path(HTML_ATTACK),
            remarks=(f"file {HTML_ATTACK} is odd",),
            uncertainties=uncertain,
        ),
        split=Split((trials[0].name, trials[1].name), (), (trials[2].name, trials[3].name), f"drawn: {HTML_ATTACK}"),
        reasons=[HTML_ATTACK],
        experiments=[
            replace(e, name=t.name, group=HTML_ATTACK) for e, t in zip(diagnosis.experiments, trials, strict=True)
        ],
        fitted_experiments=[
            replace(e, name=f"{HTML_ATTACK}{k}", group=HTML_ATTACK) for k, e in enumerate(diagnosis.fitted_experiments)
        ],
        selection_history=[
            replace(step, validation_gains={HTML_ATTACK: 0.1}, reason=HTML_ATTACK)
            for step in diagnosis.selection_history
        ],
    )
