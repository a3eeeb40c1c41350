"""Published measurements of pneumatic cylinders, not part of the project (``KLUTE_SIM_DATA``, docs/real-data.md)."""

import os
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from benchmarks.effect_sizes.friction import LONG, SHORT, measure_muscle_loop
from scipy.signal import find_peaks

from klute_sim.datasets import dataset as datasets
from klute_sim.datasets.write import write_trial
from klute_sim.device.device import parse_device
from klute_sim.device.rollout import simulate_rollouts
from klute_sim.diagnosis.result import Diagnosis, DiagnosisOptions
from klute_sim.diagnosis.selection.naming import find_terms_at_bound
from klute_sim.diagnosis.workflow import diagnose
from klute_sim.effects import catalogue
from klute_sim.types import Array

DATA = Path(os.environ.get("KLUTE_SIM_DATA", "nowhere")) / "cylinder_seals"
PISTON_AREA_N_PER_BAR = 51.9
"""Piston area [N/bar]: a bore of 25.7 mm, without the seal's lip (assumed)."""
BLOCK_TIME = 0.1
"""Length of the blocks whose medians are used [s]: single samples of the laser jump by half a millimetre, which changes
the speed of a stroke by 5 mm/s."""
COMPARED_RANGE = 5.0, 30.0
"""Part of the stroke [mm] where force is compared. Within a millimetre of each reversal the seal rolls before it slides
(a stiffness that a rigid tie does not have), and the bore of some cylinders has marks at 32 mm."""
LENGTH_OFFSET = 190.0
"""Length [mm] of the unit at position 0 of the log (assumed); it pushes as it shortens."""
USES = ("fit", "validation", "fit", "test", "fit", "validation", "fit", "test", "fit")
"""Uses of nine strokes between upper reversals; warming and wear affect all uses."""
EXCLUDED_EFFECTS = ("sensor_drift", "clock_skew")
"""Effects that do not apply: a drift over the log would act between strokes, not in each, and one log has one clock."""

DEVICE = """
name = "pneumatic cylinder"
[cylinder]
extended_length_mm = 200.0
stroke_mm = 60.0
"""
SUPPLY = """
[supply]
pressure_bar = 8.0
rate_bar_per_s = 1000.0
gas_temperature_c = 20.0
"""


class Log(NamedTuple):
    """Log of a cylinder, in medians of blocks."""

    time: Array
    """Time [s]."""
    position: Array
    """Position of the piston, positive inwards [mm]."""
    push: Array
    """Force of the load cell [N]."""
    pressure: Array
    """Gauge pressure in the cylinder [bar]."""
    resistance: Array
    """Resistance of the cylinder [N]: force minus measured pressure times piston area."""
    reversals: Array
    """Indices of the inner reversals of the piston."""


def read_log(file: Path) -> Log:
    """Read columns: time [ms], laser [V], pressure [V], force [V], stroke [mm], pressure [bar], force [N]."""
    raw = np.loadtxt(file)
    time = 1e-3 * raw[:, 0]
    block = (time / BLOCK_TIME).astype(int)
    columns = np.stack([time, raw[:, 4], raw[:, 6], raw[:, 5], raw[:, 6] - PISTON_AREA_N_PER_BAR * raw[:, 5]])
    medians = np.stack([np.median(columns[:, block == b], axis=1) for b in np.unique(block)])
    time, position, push, pressure, resistance = medians.T
    reversals = find_peaks(position, prominence=10.0)[0]
    return Log(time, position, push, pressure, resistance, reversals)


def write_dataset_folder(file: Path, folder: Path) -> Path:
    """Write a log as a dataset with prescribed motion; the tension is minus the resistance."""
    folder.mkdir(parents=True)
    result = read_log(file)
    (folder / "cylinder.toml").write_text(DEVICE, "utf-8")
    lines = ['format = "klute-sim-dataset/2"', 'rig = "bench"', 'device = "cylinder.toml"']
    for index, ((start, end), use) in enumerate(zip(pairwise(result.reversals), USES, strict=True)):
        stroke = slice(start, end + 1)
        position = result.position[stroke]
        columns = {
            "time [s]": result.time[stroke],
            "length [mm]": LENGTH_OFFSET - position,
            "force [N]": np.where(
                (position > COMPARED_RANGE[0]) & (position < COMPARED_RANGE[1]), -result.resistance[stroke], np.nan
            ),
        }
        write_trial(folder / f"stroke_{index}.csv", columns)
        lines += ["[[trial]]", f'files = ["stroke_{index}.csv"]', f'group = "{use}"', f'use = "{use}"']
    (folder / "dataset.toml").write_text("\n".join(lines) + "\n", "utf-8")
    return folder


def write_seal_folder(seal: str, folder: Path) -> Path:
    """Write the logs of a seal at all pressures as one dataset: motion and measured pressure are prescribed."""
    folder.mkdir(parents=True)
    (folder / "cylinder.toml").write_text(DEVICE + SUPPLY, "utf-8")
    lines = ['format = "klute-sim-dataset/2"', 'rig = "bench"', 'device = "cylinder.toml"']
    for pressure, log in zip(PRESSURES.tolist(), read_seal(seal), strict=True):
        for index, ((start, end), use) in enumerate(zip(pairwise(log.reversals), USES, strict=True)):
            stroke = slice(start, end + 1)
            position = log.position[stroke]
            is_compared = (position > COMPARED_RANGE[0]) & (position < COMPARED_RANGE[1])
            columns = {
                "time [s]": log.time[stroke],
                "length [mm]": LENGTH_OFFSET - position,
                "pressure_command [bar]": log.pressure[stroke],
                "force [N]": np.where(is_compared, -log.resistance[stroke], np.nan),
            }
            name = f"{pressure:.0f}_bar_{index}.csv"
            write_trial(folder / name, columns)
            group = f"{use}_{pressure:.0f}_bar"
            lines += ["[[trial]]", f'files = ["{name}"]', f'group = "{group}"', f'use = "{use}"']
    (folder / "dataset.toml").write_text("\n".join(lines) + "\n", "utf-8")
    return folder


def half_difference(result: Log, force: Array) -> float:
    """Return half the difference of ``force`` between the directions at equal positions [N], the median of strokes."""
    positions = np.linspace(*COMPARED_RANGE, 101)
    half_differences = []
    for start, end in pairwise(result.reversals):
        outer_reversal = start + int(np.argmin(result.position[start:end]))
        outward_samples, inward_samples = slice(start, outer_reversal + 1), slice(outer_reversal, end + 1)
        outward = np.interp(positions, result.position[outward_samples][::-1], force[outward_samples][::-1])
        half_differences.append(
            0.5 * (np.interp(positions, result.position[inward_samples], force[inward_samples]) - outward)
        )
    return float(np.median(half_differences))


def compute_speeds(result: Log) -> list[float]:
    """Return the median speed in each direction [m/s], shortening negative."""
    rate = -1e-3 * np.gradient(result.position, result.time)
    is_in_range = (result.position > COMPARED_RANGE[0]) & (result.position < COMPARED_RANGE[1])
    return [float(np.median(rate[is_in_range & (sign * rate > 0.0)])) for sign in (-1.0, 1.0)]


def compute_friction(result: Diagnosis, speeds: list[float]) -> float:
    """Return half the difference of the model's steady friction between the two ``speeds`` [N].

    It includes the identified seal and a data-driven term: dry friction and a negative slope with speed together are
    a friction that falls with speed.
    """
    assert result.final_fit is not None
    hypothesis = result.final_fit.hypothesis
    parameters = list(zip(hypothesis.parameters, result.final_fit.values, strict=True))
    forces = np.zeros(len(speeds))
    for index, term in enumerate(hypothesis.terms):
        fitted_values = {parameter.name: value for parameter, value in parameters if parameter.term_index == index}
        form = term.form_definition
        values = {p.key: fitted_values.get(p.key, p.neutral) for p in form.parameters}
        p = form.pack(values)
        for k, speed in enumerate(speeds):
            if term.effect == "seal_friction":
                state, muscle = form.make_zero_state(), hypothesis.device.parameters.muscle
                for step in range(2000 if form.n_states else 0):  # to the internal state at steady speed
                    length = muscle.resting_length + speed * 1e-3 * (step + 1)
                    state = form.state_type(*form.laws["next_state"](p, state, muscle, 0.0, 0.0, length, 0.0, 1e-3))
                forces[k] += form.laws["damper_force"](p, state, 0.0, speed)
            elif term.effect == "unknown_force":
                muscle = hypothesis.device.parameters.muscle
                length = 0.9 * muscle.resting_length
                forces[k] += form.laws["muscle_force"](p, form.make_zero_state(), 0.0, muscle, 0.0, length, speed)
    return 0.5 * float(np.ptp(forces))


PRESSURES = np.array([1.0, 3.0, 5.0, 7.0])
"""Nominal pressures of the logs of each seal [bar]."""


def read_seal(seal: str) -> list[Log]:
    """Return the logs of a seal at all pressures."""
    return [read_log(DATA / f"{seal}_{pressure:.0f}bar.csv") for pressure in PRESSURES]


def compute_force_over_position(log: Log) -> tuple[Array, Array]:
    """Return half the difference and the mean of both directions [N] over the compared range, medians of strokes."""
    positions = np.linspace(*COMPARED_RANGE, 11)
    forces = []
    for start, end in pairwise(log.reversals):
        outer_reversal = start + int(np.argmin(log.position[start:end]))
        outward, inward = slice(start, outer_reversal + 1), slice(outer_reversal, end + 1)
        forces.append(
            [
                np.interp(positions, log.position[inward], log.resistance[inward]),
                np.interp(positions, log.position[outward][::-1], log.resistance[outward][::-1]),
            ]
        )
    inwards, outwards = np.median(forces, axis=0)
    return 0.5 * (inwards - outwards), 0.5 * (inwards + outwards)


def compute_misfit_of_one_seal(logs: list[Log], force_n: float, growth_per_bar: float) -> Array:
    """Return measured minus simulated tension [N] of whole logs at all pressures, by one device on a rigid tie.

    The simulation receives the measured motion and pressure. An offset and an error of the area are fitted.
    """
    device = parse_device((DEVICE + SUPPLY).encode(), "cylinder").parameters
    friction = {"force_n": force_n, "growth_per_bar": growth_per_bar, "stiffness_n_per_mm": 50.0}
    device = device._replace(effects=catalogue.pack_effects({("seal_friction", "pressure"): friction}))
    misfit, columns = [], []
    for log in logs:
        moving = slice(log.reversals[0], log.reversals[-1] + 1)
        time = np.arange(log.time[moving][0], log.time[moving][-1], 0.01)
        length = 1e-3 * (LENGTH_OFFSET - np.interp(time, log.time, log.position))
        tension = simulate_rollouts(device, length, 1e5 * np.interp(time, log.time, log.pressure), 0.01).tension
        misfit.append(-log.resistance[moving] - np.interp(log.time[moving], time, tension))
        columns.append(np.stack([np.ones_like(log.time[moving]), log.pressure[moving]], axis=1))
    measured, known = np.concatenate(misfit), np.concatenate(columns)
    return measured - known @ np.linalg.lstsq(known, measured, rcond=None)[0]


FILES = sorted(DATA.glob("*.csv"))

pytestmark = [
    pytest.mark.extras,
    pytest.mark.skipif(not FILES, reason="KLUTE_SIM_DATA does not hold these measurements"),
]


def test_direction_dependence_matches_the_published_values() -> None:
    logs = [read_log(file) for file in FILES]
    half_differences = [half_difference(record, record.push) for record in logs]
    assert len(FILES) == 12
    assert 6.5 < min(half_differences) < 7.5
    assert 20.5 < max(half_differences) < 21.5
    # The regulator causes a quarter to a third of it: the pressure is higher while the piston moves inwards.
    fractions = [
        half_difference(record, record.resistance) / difference
        for record, difference in zip(logs, half_differences, strict=True)
    ]
    assert min(fractions) > 0.6
    assert max(fractions) < 0.8


@pytest.mark.parametrize(("seal", "growth"), [("O-ring257", 0.13), ("Kidney_lc", 0.13)])
def test_measured_friction_grows_with_pressure_as_the_effect_states(seal: str, growth: float) -> None:
    """One force and one growth describe a seal at four pressures, by loops that the device simulates."""
    logs = read_seal(seal)
    measured = np.array([half_difference(log, log.resistance) for log in logs])
    slope, force = np.polyfit(PRESSURES, measured, 1)
    assert slope / force == pytest.approx(growth, abs=0.02)
    pressed = {"force_n": force, "growth_per_bar": slope / force, "stiffness_n_per_mm": 50.0}
    stroke = LONG - SHORT
    for pressure, value in zip(PRESSURES.tolist(), measured, strict=True):
        simulated = measure_muscle_loop("seal_friction", "pressure", pressed, pressure) / (2.0 * stroke)
        assert simulated == pytest.approx(value, rel=0.08)


def test_one_seal_on_a_rigid_tie_describes_whole_strokes_at_all_pressures() -> None:
    logs = read_seal("O-ring257")
    grows = compute_misfit_of_one_seal(logs, 4.2, 0.13)
    constant = compute_misfit_of_one_seal(logs, 6.2, 1e-9)
    assert np.sqrt(np.mean(grows**2)) < 1.1  # N, reversals and all: the loops are 11 to 18 N high
    assert np.sqrt(np.mean(grows**2)) < 0.7 * np.sqrt(np.mean(constant**2))


def test_force_of_the_kidney_seal_along_the_stroke_is_no_friction() -> None:
    """It is equal in both directions and grows with the square of the pressure, while the friction is constant."""
    changes = []
    for log in read_seal("Kidney_lc"):
        friction, mean = compute_force_over_position(log)
        assert np.ptp(friction) < 0.13 * friction.mean()
        changes.append(mean[0] - mean[-1])
    factor = np.sum(changes * PRESSURES**2) / np.sum(PRESSURES**4)
    assert changes == pytest.approx(factor * PRESSURES**2, abs=1.2)
    assert factor == pytest.approx(0.29, abs=0.03)  # N/bar^2 over 25 mm


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_seal_friction_of_measured_cylinders_is_identified(file: Path, tmp_path: Path) -> None:
    result = diagnose(
        datasets.load_dataset(write_dataset_folder(file, tmp_path / "data")), DiagnosisOptions(exclude=EXCLUDED_EFFECTS)
    )
    effects = {term.effect for term in result.added_terms}
    measured = read_log(file)
    difference = half_difference(measured, measured.resistance)
    assert "seal_friction" in effects
    assert compute_friction(result, compute_speeds(measured)) == pytest.approx(difference, rel=0.2)
    # The seal's area differs from that of the bore; the difference appears as an instrument effect.
    assert effects <= {"seal_friction", "sensor_offset"}
    assert result.verdict in ("identified", "identified-in-part")
    assert result.held_out == "confirmed"
    assert result.final_fit is not None
    assert not find_terms_at_bound(result.final_fit)
    if result.prediction is not None:
        assert result.prediction.share > 0.7
    # The force of the lip seal depends on the position, too, by 13 N at 7 bar.
    assert result.channel_rms["force"].with_effects < 0.4 * result.channel_rms["force"].nominal


@pytest.mark.parametrize(
    ("seal", "force", "growth"), [("O-ring257", 4.2, 0.13), ("Kidney_lc", 6.2, 0.13), ("X-ring257", 3.5, 0.28)]
)
def test_one_law_of_friction_is_identified_over_all_pressures_of_a_seal(
    seal: str, force: float, growth: float, tmp_path: Path
) -> None:
    result = diagnose(
        datasets.load_dataset(write_seal_folder(seal, tmp_path / "data")), DiagnosisOptions(exclude=EXCLUDED_EFFECTS)
    )
    assert result.added_terms[0].effect == "seal_friction"
    assert result.added_terms[0].form == "pressure"
    assert {term.effect for term in result.added_terms} <= {"seal_friction", "sensor_offset"}
    assert result.verdict in ("identified", "identified-in-part")
    assert result.held_out == "confirmed"
    assert result.final_fit is not None
    assert not find_terms_at_bound(result.final_fit)
    intervals = dict(
        zip((p.name for p in result.final_fit.hypothesis.parameters), result.confidence_intervals, strict=True)
    )
    assert intervals["force_n"][0] < force < intervals["force_n"][1]
    assert intervals["growth_per_bar"][0] < growth < intervals["growth_per_bar"][1]
