"""Which form of a tendon is named: friction in proportion to the tension, layers that slide, a damper, gradual springs.

The data are those of closed formulas, not of the package. About one stretch, at one speed and amplitude, all lose the
same; presses of several amplitudes and speeds tell them apart.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from klute_sim.datasets import dataset as datasets
from klute_sim.datasets.write import write_trial
from klute_sim.diagnosis.result import Diagnosis
from klute_sim.diagnosis.workflow import diagnose
from klute_sim.types import Array

pytestmark = pytest.mark.slow

STIFFNESS, SLACK_LENGTH = 60.0, 100.0
"""Stiffness [N/mm] and slack length [mm] of the tendon."""
INTERVAL, NOISE = 0.01, 2.0
"""Sampling interval [s] and noise [N] of the force."""
PRESSES = ((3.0, 5.0), (6.0, 5.0), (9.0, 5.0), (9.0, 40.0), (3.0, 40.0), (6.0, 15.0), (9.0, 15.0))
"""Strokes [mm] and speeds [mm/s] of presses from 1.5 mm of stretch."""
FRICTION, PRESLIDING = 60.0, 3.0
"""Dry friction [N] of the layers, and the stretch [mm] after which all slide."""
ENGAGEMENT, TRANSITION = 5.0, 0.8
"""Stretch [mm] about which a second spring joins, and the scale [mm] of its distribution."""
LOSS_FRACTION, DAMPING = 0.2, 1.5
"""Lost fraction of the loading work of ``slip``, and damping [N s/mm] of ``viscous``."""
DEVICE = f"""
name = "tendon on a press"
[tendon]
slack_length_mm = {SLACK_LENGTH}
stiffness_1_n_per_mm = {STIFFNESS}
stiffness_2_n_per_mm = {STIFFNESS}
"""


def make_press(stroke: float, speed: float) -> Array:
    """Return the stretch [mm] of presses with rounded corners; before and after them it rests."""
    half = stroke / speed
    time = np.arange(0.0, max(2.0, 4.0 * half) + 1.0, INTERVAL)
    phase = np.maximum(time - 0.5, 0.0) / half
    wave = np.abs(phase - 2.0 * np.round(phase / 2.0))
    wave[phase > 2.0 * np.floor(phase[-1] / 2.0)] = 0.0
    width = 4
    return 1.5 + stroke * np.convolve(
        np.pad(wave, width, mode="edge"), np.full(2 * width + 1, 1.0 / (2 * width + 1)), "valid"
    )


def add_layers(stretch: Array, n_layers: int) -> Array:
    """Return the force [N] of a spring and layers of equal stiffness that slide one after the other.

    The tendon was pulled from slack to its first stretch.
    """
    limits = PRESLIDING * np.arange(1, n_layers + 1) / n_layers
    stiffness = FRICTION / limits.sum()
    elongation, force = np.zeros(n_layers), np.empty(len(stretch))
    for i, move in enumerate(np.diff(stretch, prepend=0.0)):
        elongation = np.clip(elongation + move, -limits, limits)
        force[i] = STIFFNESS * stretch[i] + stiffness * elongation.sum()
    return force


def add_slip(stretch: Array) -> Array:
    """Return the force [N] of a spring with a slider that rubs in proportion to the tension."""
    slider, reach, force = stretch[0], 0.05, np.empty(len(stretch))
    for i, x in enumerate(stretch):
        slider = min(max(slider, x - reach), x + reach)
        force[i] = STIFFNESS * x * (1.0 + LOSS_FRACTION / (2.0 - LOSS_FRACTION) * (x - slider) / reach)
    return force


def add_damper(stretch: Array) -> Array:
    """Return the force [N] of spring and damper side by side."""
    return STIFFNESS * stretch + DAMPING * np.gradient(stretch, INTERVAL)


def join_gradually(stretch: Array) -> Array:
    """Return the force [N] of two springs; of the strands of the second one, each pulls from another stretch on.

    Those stretches have a logistic distribution about the engagement.
    """
    strands = np.linspace(0.0005, 0.9995, 1000)
    starts = ENGAGEMENT + TRANSITION * np.log(strands / (1.0 - strands))
    taut = np.maximum(stretch[:, np.newaxis] - starts, 0.0) - np.maximum(-starts, 0.0)
    return STIFFNESS * (stretch + taut.mean(axis=1))


def diagnose_presses(folder: Path, law: Callable[[Array], Array], engagement: float = 40.0) -> Diagnosis:
    rng = np.random.default_rng(5)
    folder.mkdir()
    (folder / "tendon.toml").write_text(f"{DEVICE}engagement_mm = {engagement}\n", "utf-8")
    lines = ['format = "klute-sim-dataset/2"', 'rig = "bench"', 'device = "tendon.toml"']
    for index, (stroke, speed) in enumerate(PRESSES):
        stretch = make_press(stroke, speed)
        for repeat in "ab":
            columns = {
                "time [s]": INTERVAL * np.arange(len(stretch)),
                "length [mm]": SLACK_LENGTH + stretch,
                "force [N]": law(stretch) + rng.normal(0.0, NOISE, len(stretch)),
            }
            write_trial(folder / f"press_{index}_{repeat}.csv", columns)
            lines += ["[[trial]]", f'files = ["press_{index}_{repeat}.csv"]', f'group = "{stroke:g}_{speed:g}"']
    (folder / "dataset.toml").write_text("\n".join(lines) + "\n", "utf-8")
    return diagnose(datasets.load_dataset(folder))


@pytest.mark.parametrize(
    ("law", "form", "parameters"),
    [
        (partial(add_layers, n_layers=3), "maxwell_slip", {"friction_n": FRICTION, "presliding_mm": PRESLIDING}),
        (partial(add_layers, n_layers=30), "maxwell_slip", {"friction_n": FRICTION}),
        (add_slip, "slip", {"loss_fraction": LOSS_FRACTION}),
        (add_damper, "viscous", {"damping_n_s_per_mm": DAMPING}),
    ],
    ids=["three layers", "thirty layers", "slip", "viscous"],
)
def test_loss_of_a_tendon_is_named_in_its_form(
    law: Callable[[Array], Array], form: str, parameters: dict[str, float], tmp_path: Path
) -> None:
    result = diagnose_presses(tmp_path / "data", law)
    assert [(term.effect, term.form) for term in result.added_terms] == [("tendon_hysteresis", form)], result
    assert result.verdict in ("identified", "identified-in-part")
    assert result.fitted_device is not None
    found = result.fitted_device.spec.effects["tendon_hysteresis"]
    for key, value in parameters.items():
        assert found[key] == pytest.approx(value, rel=0.05)


def test_second_spring_that_joins_gradually_is_named(tmp_path: Path) -> None:
    result = diagnose_presses(tmp_path / "data", join_gradually, ENGAGEMENT)
    assert result.verdict == "identified"
    assert [(t.effect, t.form) for t in result.added_terms] == [("tendon_stiffening", "gradual_engagement")]
    assert result.fitted_device is not None
    found = result.fitted_device.spec.effects["tendon_stiffening"]
    assert found["transition_mm"] == pytest.approx(TRANSITION, rel=0.05)
