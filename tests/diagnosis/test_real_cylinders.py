"""Measured pneumatic cylinders; they are not part of the project (see ``KLUTE_SIM_DATA`` and docs/real-data.md)."""

import os
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import find_peaks

from klute_sim.datasets import dataset as datasets
from klute_sim.datasets.write import write_trial
from klute_sim.diagnosis.workflow import Diagnosis, DiagnosisOptions, diagnose

Array = NDArray[np.float64]

DATA = Path(os.environ.get("KLUTE_SIM_DATA", "nowhere")) / "cylinder_seals"
AREA = 51.9
"""Of the piston [N/bar]: a bore of 25.7 mm, without the seal's lip (assumed)."""
BLOCK = 0.1
"""Of the log, whose medians are taken [s]: single samples of the laser jump by half a millimetre, a stroke's speed by 5
mm/s with them."""
MIDDLE = 5.0, 30.0
"""Of the stroke [mm], where force is compared. Beyond it the seal rolls over before it slides, within a millimetre of
each reversal (a stiffness that a rigid tie does not have), and the bore of some cylinders has marks at 32 mm."""
OFFSET = 190.0
"""Length [mm] of the unit where the log's position is zero (assumed): it pushes as it shortens."""
USES = ("fit", "select", "fit", "show", "fit", "select", "fit", "show", "fit")
"""Of nine strokes, top to top: what warms up or wears shows in all of them."""
NO_SUCH_PART = ("muscle_damping", "bladder_relaxation", "sensor_drift")
"""There is no muscle. The nine strokes are one log, of which a drift would show from stroke to stroke, not in each."""

DEVICE = """
name = "pneumatic cylinder"
description = "A muscle as thin as a hair, with no rubber and no air in it, so that it pulls nothing; a rigid tie."
[muscle]
resting_length_mm = 200.0
braid_length_ratio = 1.10
turns_per_m = 1458.6
bladder_radius_mm = 0.05
bladder_thickness_mm = 0.01
c10_kpa = 0.0
c01_kpa = 0.0
friction_slope_n_per_bar = 0.0
friction_offset_n = 0.0
[supply]
pressure_bar = 1.0
rate_bar_per_s = 1000.0
gas_temperature_c = 20.0
"""


class Log(NamedTuple):
    """A cylinder's, in medians."""

    time: Array
    """[s]"""
    position: Array
    """[mm]: how far the piston is pushed in."""
    push: Array
    """[N], as the load cell has it."""
    rest: Array
    """[N], of it, what the measured pressure on the piston's area leaves: the cylinder's own resistance."""
    tops: Array
    """Samples at which the piston turns round, pushed in."""


def log(file: Path) -> Log:
    """Columns: time [ms], laser [V], pressure [V], force [V], stroke [mm], pressure [bar], force [N]."""
    raw = np.loadtxt(file)
    time = 1e-3 * raw[:, 0]
    block = (time / BLOCK).astype(int)
    columns = np.stack([time, raw[:, 4], raw[:, 6], raw[:, 6] - AREA * raw[:, 5]])
    time, position, push, rest = np.stack([np.median(columns[:, block == b], axis=1) for b in np.unique(block)]).T
    tops = find_peaks(position, prominence=10.0)[0]
    return Log(time, position, push, rest, tops)


def imported(file: Path, folder: Path) -> Path:
    """A log as a dataset: the motion is prescribed, tension is minus the push that pressure leaves."""
    folder.mkdir(parents=True)
    found = log(file)
    (folder / "cylinder.toml").write_text(DEVICE, "utf-8")
    lines = ['format = "klute-sim-dataset/1"', 'rig = "bench"', 'device = "cylinder.toml"']
    for number, ((begin, end), use) in enumerate(zip(pairwise(found.tops), USES, strict=True)):
        stroke = slice(begin, end + 1)
        position = found.position[stroke]
        columns = {
            "time [s]": found.time[stroke],
            "length [mm]": OFFSET - position,
            "pressure_command [bar]": np.zeros(len(position)),
            "force [N]": np.where((position > MIDDLE[0]) & (position < MIDDLE[1]), -found.rest[stroke], np.nan),
        }
        write_trial(folder / f"stroke_{number}.csv", columns)
        lines += ["[[trial]]", f'files = ["stroke_{number}.csv"]', f'group = "{use}"', f'use = "{use}"']
    (folder / "dataset.toml").write_text("\n".join(lines) + "\n", "utf-8")
    return folder


def half_difference(found: Log, force: Array) -> float:
    """Half of what ``force`` differs by between the directions at equal positions [N]: the median of all strokes."""
    where = np.linspace(*MIDDLE, 101)
    halves = []
    for begin, end in pairwise(found.tops):
        turn = begin + int(np.argmin(found.position[begin:end]))
        way_out, way_in = slice(begin, turn + 1), slice(turn, end + 1)
        out = np.interp(where, found.position[way_out][::-1], force[way_out][::-1])
        halves.append(0.5 * (np.interp(where, found.position[way_in], force[way_in]) - out))
    return float(np.median(halves))


def speeds(found: Log) -> list[float]:
    """Median of each direction [m/s], the cylinder's shortening negative."""
    rate = -1e-3 * np.gradient(found.position, found.time)
    middle = (found.position > MIDDLE[0]) & (found.position < MIDDLE[1])
    return [float(np.median(rate[middle & (sign * rate > 0.0)])) for sign in (-1.0, 1.0)]


def friction(found: Diagnosis, at: list[float]) -> float:
    """Half of what the model's friction differs by between the two speeds ``at`` [N], slipping steadily.

    That of the named seal, and what a data-driven term beside it makes of it: a dry friction and a negative slope with
    speed are a friction that falls with speed, in two parts.
    """
    assert found.final_fit is not None
    hypothesis = found.final_fit.hypothesis
    unknowns = list(zip(hypothesis.parameters, found.final_fit.values, strict=True))
    forces = np.zeros(len(at))
    for number, term in enumerate(hypothesis.terms):
        fitted = {unknown.key: value for unknown, value in unknowns if unknown.term_index == number}
        form = term.form_definition
        own = tuple(parameter.to_si(fitted.get(parameter.key, parameter.neutral)) for parameter in form.parameters)
        for k, rate in enumerate(at):
            if term.effect == "seal_friction":
                memory = (0.0,) * form.n_states
                if form.n_states:  # what its speed has taken off the peak
                    memory = (1.0 - float(np.exp(-((rate / own[2]) ** 2))), abs(rate), 0.0)
                forces[k] += form.laws["damper_force"](own, memory, 0.0, rate)
            elif term.effect == "unknown_force":
                muscle = hypothesis.device.parameters.muscle
                forces[k] += form.laws["muscle_force"](own, (), 0.0, muscle, 0.0, 0.9 * muscle.resting_length, rate)
    return 0.5 * float(np.ptp(forces))


NAMED = {"O-ring257_1bar", "O-ring257_7bar", "X-ring257_7bar"}
"""Where repeats differ by so much that a constant friction is all there is to tell."""
FILES = sorted(DATA.glob("*.csv"))


@pytest.mark.skipif(not FILES, reason="KLUTE_SIM_DATA does not hold these measurements")
def test_the_cylinders_differ_between_the_directions_as_their_readme_says() -> None:
    logs = [log(file) for file in FILES]
    halves = [half_difference(each, each.push) for each in logs]
    assert len(FILES) == 12
    assert 6.5 < min(halves) < 7.5
    assert 20.5 < max(halves) < 21.5
    # A quarter to a third of it is the regulator's: the pressure is higher while the piston is pushed in.
    shares = [half_difference(each, each.rest) / half for each, half in zip(logs, halves, strict=True)]
    assert min(shares) > 0.6
    assert max(shares) < 0.8


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_the_seals_of_measured_cylinders_rub(file: Path, tmp_path: Path) -> None:
    found = diagnose(datasets.load_dataset(imported(file, tmp_path / "data")), DiagnosisOptions(exclude=NO_SUCH_PART))
    effects = {term.effect for term in found.added_terms}
    measured = log(file)
    half = half_difference(measured, measured.rest)
    assert "seal_friction" in effects
    assert friction(found, speeds(measured)) == pytest.approx(half, rel=0.2)
    # The area of the bore is not quite the seal's: what is off by that is told as an instrument's fault.
    assert effects <= {"seal_friction", "sensor_offset", "sensor_lag", "unknown_force"}
    assert (found.verdict == "named") == (file.stem in NAMED)
    assert found.verdict in ("named", "unexplained")
    assert found.channel_rms["force"].with_effects < 0.25 * found.channel_rms["force"].nominal
