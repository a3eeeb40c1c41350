"""Datasets of the adversary, with their sealed ground truth."""

import json
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.hidden_effects.adversary.protocol import InputProgram, draw_programs
from benchmarks.hidden_effects.adversary.rig import read_device_numbers
from benchmarks.hidden_effects.adversary.sensors import SENSORS, draw_wander, list_signals, noise_level, record_trial
from benchmarks.hidden_effects.adversary.setup import (
    DECLARED,
    REGISTRATION_M,
    SetUp,
    Sizes,
    draw_declared,
    list_present,
    make_set_up,
    measure_departures,
    remove_hidden,
)
from benchmarks.hidden_effects.adversary.simulate import simulate

ROOT = Path(__file__).parents[3]
PRESET_FILE = ROOT / "src" / "klute_sim" / "device" / "presets" / "klute-3-4-pair.toml"
VALVE_SECTIONS = """
[valve]
fill_dm3_per_s_bar = 1.0
fill_critical_ratio = 0.5
exhaust_dm3_per_s_bar = 1.0
exhaust_critical_ratio = 0.5
command = "pressure"
gain_per_bar = 5.0
drive = "proportional"

[chamber]
exponent = 1.4
thermal_time_constant_s = 0.3
"""
"""What a device file says of the valve: the nearest that ISO 6358 has to a nozzle, and adiabatic air with a wall."""
VALVE_SUPPLY_BAR = 7.0
REPEATS = "ab"
COLUMN_DECIMALS = {"time": 3, "length": 3, "pressure_command": 4, "force": 2, "pressure": 5, "muscle_length": 3}
COLUMN_UNITS = {"time": "s", "length": "mm", "pressure_command": "bar"} | {k: s.unit for k, s in SENSORS.items()}
MUSCLE_LENGTH_SHARE = 1.0 / 3.0
"""Share of the datasets with the length of the muscle."""


def make_dataset(
    folder: Path,
    seed: int,
    *,
    departures: Mapping[str, Mapping[str, float]],
    number_errors: Mapping[str, float],
    valve: bool,
    hidden: Mapping[str, Any] | None,
    rig: str = "some",
    block: str = "adversary",
    truth: Path | None = None,
) -> dict[str, Any]:
    """Write the dataset ``folder`` and its ground truth (default: ``<folder>.truth.json``); return the ground truth.

    The other arguments are those of :func:`cases.draw_case`. Rig, inputs and noise depend on ``seed`` only.
    """
    streams = [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(4)]
    device_text = build_device_text(valve)
    nominal = read_device_numbers(device_text)
    set_up = make_set_up(draw_declared(streams[0], nominal), departures, number_errors, hidden)
    registration = float(streams[0].normal(0.0, REGISTRATION_M))
    programs = draw_programs(streams[1])
    channels = ["force", "pressure"]
    if streams[2].random() < MUSCLE_LENGTH_SHARE:
        channels.append("muscle_length")
    tables = record_trials(streams[3], set_up, programs, channels, registration)
    ground_truth: dict[str, Any] = {
        "seed": seed,
        "block": block,
        "effects": [],
        "instruments": [],
        "strangers": [],
        "numbers": [],
        "deleted": False,
        "defect": None,
        "repeats": len(REPEATS),
        "rig": rig,
        "valve": valve,
        "departures": departures,
        "number_errors": number_errors,
        "registration_mm": 1e3 * registration,
        "base": {key: set_up.numbers[key] for key in DECLARED},
        "nominal": {key: nominal[key] for key in DECLARED},
        **_measure_contents(set_up, nominal, programs, channels, departures, number_errors, hidden, valve=valve),
        "noise": {channel: noise_level(channel) for channel in channels},
        "groups": {program.group: program.use for program in programs},
    }
    if hidden is not None:
        ground_truth[hidden["kind"]] = [hidden["entry"]]
    uses = {f"{program.group}_{repeat}": program.use for program in programs for repeat in REPEATS}
    _write(folder, truth or Path(f"{folder}.truth.json"), tables, uses, device_text if valve else None, ground_truth)
    return ground_truth


def record_trials(
    rng: np.random.Generator,
    set_up: SetUp,
    programs: Sequence[InputProgram],
    channels: Sequence[str],
    registration: float,
) -> dict[str, dict[str, np.ndarray]]:
    """Return the columns of all trials by name; the regulator wanders in each repeat on its own."""
    rig, tables = set_up.build(), {}
    for program in programs:
        for repeat in REPEATS:
            command = program.command + draw_wander(rng, len(program.command))
            signals = list_signals(simulate(program.length, np.maximum(command, 0.0), rig))
            recorded = {channel: signals[channel] for channel in channels}
            tables[f"{program.group}_{repeat}"] = record_trial(rng, program, recorded, set_up.faults, registration)
    return tables


def _measure_contents(
    set_up: SetUp,
    nominal: Mapping[str, float],
    programs: Sequence[InputProgram],
    channels: Sequence[str],
    departures: Mapping[str, Mapping[str, float]],
    number_errors: Mapping[str, float],
    hidden: Mapping[str, Any] | None,
    *,
    valve: bool,
) -> dict[str, Any]:
    """Return the sizes of the hidden effect and of all departures, and the names of what is present."""
    sizes = Sizes(set_up, nominal, programs, channels)
    contributions = measure_departures(set_up, sizes, departures, number_errors)
    plain = set_up if hidden is None else remove_hidden(set_up, hidden)
    raw = sizes.measure(plain)
    most_affected = max(raw, key=lambda channel: raw[channel])
    textbook = SetUp({**nominal, **{key: set_up.numbers[key] for key in DECLARED}}, {}, {})
    return {
        "contributions": contributions,
        "present": list_present(contributions, valve),
        "size": sizes.measure_refitted(plain) if hidden is not None else 0.0,
        "raw_size": raw[most_affected],
        "most_affected": most_affected if hidden is not None else None,
        "raw_size_by_channel": raw,
        "law_size": Sizes(plain, nominal, programs, channels).measure_refitted(textbook),
    }


def build_device_text(valve: bool) -> str:
    """Return the device file that a dataset declares: the preset, or the preset behind a valve."""
    text = PRESET_FILE.read_text("utf-8")
    if not valve:
        return text
    text = text.replace('name = "klute-3-4-pair"', 'name = "pair-behind-valve"', 1)
    head, _, tail = text.partition("[supply]\npressure_bar = 5.0")
    head += f"[supply]\npressure_bar = {VALVE_SUPPLY_BAR}"
    body, _, sources = tail.partition("\n[sources]")
    return f"{head}{body}{VALVE_SECTIONS}\n[sources]{sources}"


def _write(
    folder: Path,
    truth: Path,
    tables: Mapping[str, Mapping[str, np.ndarray]],
    uses: Mapping[str, str],
    device_text: str | None,
    ground_truth: Mapping[str, Any],
) -> None:
    """Write the data under a temporary name, rename it, and write the ground truth last to mark completion."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    device = PRESET_FILE.stem if device_text is None else "device.toml"
    lines = ['format = "klute-sim-dataset/2"', 'rig = "bench"', f'device = "{device}"', "", "[uncertain]"]
    lines += [f'"{key}" = "{100 * share:g} %"' for key, share in DECLARED.items()]
    for name, use in uses.items():
        group = name.rpartition("_")[0]
        lines += ["", "[[trial]]", f'files = ["{name}.csv"]', f'group = "{group}"', f'use = "{use}"']
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=".part-") as scratch:
        part = Path(scratch) / "dataset"
        part.mkdir()
        (part / "dataset.toml").write_text("\n".join(lines) + "\n", "utf-8")
        if device_text is not None:
            (part / device).write_text(device_text, "utf-8")
        for name, table in tables.items():
            (part / f"{name}.csv").write_text(_format_table(table), "utf-8")
        if folder.exists():
            shutil.rmtree(folder)
        part.rename(folder)
    truth.parent.mkdir(parents=True, exist_ok=True)
    partial = truth.with_name(f".part-{truth.name}")
    partial.write_text(json.dumps(ground_truth, indent=1) + "\n", "utf-8")
    partial.rename(truth)


def _format_table(table: Mapping[str, np.ndarray]) -> str:
    head = ",".join(f"{name} [{COLUMN_UNITS[name]}]" for name in table)
    columns = [[f"{value:.{COLUMN_DECIMALS[name]}f}" for value in values] for name, values in table.items()]
    return "\n".join([head, *(",".join(row) for row in zip(*columns, strict=True))]) + "\n"
