"""Generate synthetic measurements with known, separately stored ground truth.

    python -m benchmarks.hidden_effects.generate OUT --block single --count 20 --seed 1

Each dataset is a folder in the documented format of measured datasets. Its ground truth is beside the folder in
``<folder>.truth.json``. A dataset with ground truth is complete and is not generated again.
"""

import argparse
import json
import shutil
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from string import ascii_lowercase
from typing import Any, NamedTuple

import numpy as np
from benchmarks.hidden_effects.adversary.dataset import make_dataset as make_adversary_dataset
from benchmarks.hidden_effects.air import AIR_STEP
from benchmarks.hidden_effects.catalogue import BENCH_CHANNELS, RELATIVE_UNCERTAINTIES
from benchmarks.hidden_effects.device import PRESET_FILE, add_effects, build_neutral_law, load_device
from benchmarks.hidden_effects.imperfect import add_law_error, assign_specimens, scale_law_error
from benchmarks.hidden_effects.inputs import InputProgram, generate_programs, hold_still
from benchmarks.hidden_effects.plan import (
    ADVERSARY_BLOCK,
    BLOCK_SIZES,
    DEFECTS,
    GAIT_BLOCKS,
    JOINT_BLOCKS,
    plan_datasets,
)
from benchmarks.hidden_effects.set_up import change_log, list_numbers
from benchmarks.hidden_effects.simulate import (
    Hidden,
    Noise,
    draw_coloured_noise,
    draw_wander,
    quantise,
    simulate_measurements,
)
from benchmarks.hidden_effects.sizes import EffectSizer

Effects = Sequence[Mapping[str, Any]]
DECIMATION_FACTOR = 5  # trace samples per logged sample
COLUMN_DECIMALS = {"time": 3, "length": 4, "pressure_command": 5, "force": 3, "pressure": 5, "muscle_length": 4}
COLUMN_UNITS = {"time": "s", "length": "mm", "pressure_command": "bar"} | {
    name: channel.unit for name, channel in BENCH_CHANNELS.items()
}


def draw_true_base(rng: np.random.Generator, device: Mapping[str, float]) -> dict[str, float]:
    """Return the actual device: uncertain numbers drawn around nominal within two standard deviations."""
    numbers = dict(device)
    for key, fraction in RELATIVE_UNCERTAINTIES.items():
        z = rng.normal()
        while abs(z) > 2.0:
            z = rng.normal()
        numbers[key] = device[key] * (1.0 + fraction * z)
    return numbers


class DrawnBench(NamedTuple):
    """Bench of a dataset as its seed draws it."""

    base: dict[str, float]
    """Numbers of the actual device."""
    programs: list[InputProgram]
    """Inputs."""
    records_muscle_length: bool
    """Whether the length of the muscle is recorded where nothing else is asked for."""
    noise_rng: np.random.Generator
    """Generator of noise and disturbances."""


def draw_bench(seed: int, device: Mapping[str, float]) -> DrawnBench:
    """Return the bench of ``seed`` with a specimen of ``device``."""
    rngs = [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(4)]
    base, programs = draw_true_base(rngs[0], device), generate_programs(rngs[1])
    return DrawnBench(base, programs, bool(rngs[2].random() < 1 / 3), rngs[3])


def make_dataset(
    folder: Path,
    seed: int,
    *,
    effects: Effects = (),
    instruments: Effects = (),
    strangers: Effects = (),
    numbers: Effects = (),
    logging: Mapping[str, Any] | None = None,
    deleted: bool = False,
    repeats: int = 2,
    known: Effects = (),
    block: str = "single",
    noise: Noise | None = None,
    defect: str | None = None,
    law_error: Mapping[str, Any] | None = None,
    muscle_length: bool | None = None,
    truth: Path | None = None,
    device_file: Path = PRESET_FILE,
) -> dict[str, Any]:
    """Write the dataset ``folder`` and its ground truth; return the ground truth.

    Device, inputs and noise depend on ``seed`` only, so the same seed with another effect is the same bench. Effects
    with a ``wanted`` size over the noise are scaled to it. ``deleted`` effects are removed from the catalogue of the
    diagnosis. ``known`` effects are in the device file. With ``law_error`` (:mod:`imperfect`) the law of the program is
    imperfect, specimens differ, and a ``wanted`` size is one over this error. ``numbers`` of the device file are wrong,
    and ``logging`` changes the log (:mod:`set_up`). ``muscle_length`` selects that channel; by default it is recorded
    in a third of the datasets and where a fault requires it. ``truth`` defaults to ``<folder>.truth.json``.
    """
    if defect is not None and defect not in DEFECTS:
        raise ValueError(f"defect {defect!r} is none of {', '.join(DEFECTS)}")
    noise = noise or Noise()
    device = load_device(device_file)
    bench = draw_bench(seed, device)
    wrong_numbers = list_numbers(numbers)
    base, programs = {**bench.base, **wrong_numbers}, bench.programs
    is_required = any(fault["channel"] == "muscle_length" for fault in instruments)
    recorded_channels = ["force", "pressure"]
    if is_required or (bench.records_muscle_length if muscle_length is None else muscle_length):
        recorded_channels.append("muscle_length")
    if defect == "no_excitation":
        programs = [hold_still(program) for program in programs]

    neutral = add_effects(*build_neutral_law(base), known)
    if law_error is not None:
        clean = [simulate_measurements(program, neutral, Hidden()) for program in programs]
        law_error = scale_law_error(law_error, programs, clean)
        multiple = law_error["rms_n"] / BENCH_CHANNELS["force"].noise
        effects = [{**e, "wanted": multiple * e["wanted"]} if "wanted" in e else e for e in effects]
    hidden = Hidden(effects, instruments, strangers)
    size = 0.0
    if wrong_numbers or any("wanted" in effect for group in hidden for effect in group):
        sizer = EffectSizer(bench.base, device, programs, recorded_channels, noise, known)
        hidden = Hidden(
            *([sizer.scale_effect(effect) if "wanted" in effect else effect for effect in group] for group in hidden)
        )
        size = sizer.measure_size(hidden, wrong_numbers)
    specimens = assign_specimens(programs) if law_error is not None else {}
    tables: dict[str, dict[str, np.ndarray]] = {}
    trials, differences = [], {name: [] for name in recorded_channels}
    for program in programs:
        for repeat in "a" if defect == "no_repeats" else ascii_lowercase[:repeats]:
            wander = draw_wander(bench.noise_rng, round(program.duration / AIR_STEP) + 1, noise.wander)
            signals = simulate_measurements(program, neutral, hidden, wander)
            if law_error is not None:
                signals = add_law_error(signals, program, law_error, specimens[program.name])
            displayed = {name: quantise(name, values, hidden.instruments) for name, values in signals.items()}
            if repeat == "a" and any(hidden):
                reference = simulate_measurements(program, neutral, Hidden(), wander)
                for name in recorded_channels:
                    differences[name].append((displayed[name] - reference[name])[::DECIMATION_FACTOR])
            tables[f"{program.name}_{repeat}.csv"] = record_trial(
                bench.noise_rng, program, signals, noise, recorded_channels, hidden.instruments
            )
            trials.append((f"{program.name}_{repeat}.csv", program.name, program.use))
    if defect is not None:
        _apply_defect(tables, defect)
    if logging is not None:
        levels = {name: BENCH_CHANNELS[name].noise for name in recorded_channels}
        tables = change_log(bench.noise_rng, tables, levels, logging)

    noise_levels = {name: getattr(noise, name) or BENCH_CHANNELS[name].noise for name in recorded_channels}
    raw_sizes = {name: _rms(np.concatenate(d)) / noise_levels[name] if d else 0.0 for name, d in differences.items()}
    most_affected = max(raw_sizes, key=lambda name: raw_sizes[name])
    ground_truth = {
        "seed": seed,
        "block": block,
        **{kind: list(group) for kind, group in hidden._asdict().items()},
        "deleted": deleted,
        "repeats": repeats,
        **({"known": list(known)} if known else {}),
        "defect": defect,
        **({"numbers": list(numbers)} if numbers else {}),
        **({"logging": dict(logging)} if logging is not None else {}),
        **({"law_error": law_error} if law_error is not None else {}),
        "base": {key: base[key] for key in RELATIVE_UNCERTAINTIES},
        "nominal": {key: device[key] for key in RELATIVE_UNCERTAINTIES},
        "size": size,
        "raw_size": raw_sizes[most_affected],
        "most_affected": most_affected if raw_sizes[most_affected] > 0.0 else None,
        "raw_size_by_channel": raw_sizes,
        "noise": noise._asdict(),
        "groups": {program.name: program.use for program in programs},
    }
    _write_dataset(
        Path(folder), truth or Path(f"{folder}.truth.json"), tables, trials, device_file, known, specimens, ground_truth
    )
    return ground_truth


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def record_trial(
    rng: np.random.Generator,
    program: InputProgram,
    signals: Mapping[str, np.ndarray],
    noise: Noise,
    recorded_channels: list[str],
    instruments: Effects,
) -> dict[str, np.ndarray]:
    """Return the columns of one trial: logged inputs, and ``signals`` with noise as displayed."""
    n = len(program.command)
    table = {
        "time": np.arange(n) / 200.0,
        "length": program.length[::DECIMATION_FACTOR] * 1e3 + rng.normal(0.0, noise.logged_length, n),
        "pressure_command": program.command / 1e5 + rng.normal(0.0, noise.logged_command, n),
    }
    for name in BENCH_CHANNELS:  # drawn for all channels, so that omitting one does not change the others
        values = signals[name][::DECIMATION_FACTOR] + draw_coloured_noise(rng, n, getattr(noise, name))
        if name in recorded_channels:
            table[name] = quantise(name, values, instruments)
    return table


def _apply_defect(tables: dict[str, dict[str, np.ndarray]], defect: str) -> None:
    """Damage the recorded data in place."""
    if defect == "dead_channel":
        for table in tables.values():
            table["force"][:] = 0.037
    elif defect == "clock_backwards":
        table = list(tables.values())[2]
        k = len(table["time"]) // 2
        table["time"][k:] -= 0.25
    elif defect == "saturated_force":
        limit = 0.45 * max(float(table["force"].max()) for table in tables.values())
        for table in tables.values():
            np.minimum(table["force"], limit, out=table["force"])


def _write_dataset(
    folder: Path,
    truth: Path,
    tables: Mapping[str, Mapping[str, np.ndarray]],
    trials: Sequence[tuple[str, str, str]],
    device_file: Path,
    known: Effects,
    specimens: Mapping[str, str],
    ground_truth: Mapping[str, Any],
) -> None:
    """Write the data under a temporary name, rename it, and write the ground truth last to mark completion."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    device = "device.toml" if known else device_file.stem
    lines = ['format = "klute-sim-dataset/2"', 'rig = "bench"', f'device = "{device}"', "", "[uncertain]"]
    lines += [f'"{key}" = "{share * 100:g} %"' for key, share in RELATIVE_UNCERTAINTIES.items()]
    for file, group, use in trials:
        lines += ["", "[[trial]]", f'files = ["{file}"]', f'group = "{group}"', f'use = "{use}"']
        lines += [f'specimen = "{specimens[group]}"'] if specimens else []
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=".part-") as temporary:
        part = Path(temporary) / "dataset"
        part.mkdir()
        (part / "dataset.toml").write_text("\n".join(lines) + "\n", "utf-8")
        if known:
            (part / device).write_text(device_file.read_text("utf-8") + _format_effect_sections(known), "utf-8")
        for file, table in tables.items():
            (part / file).write_text(format_table(table), "utf-8")
        if folder.exists():
            shutil.rmtree(folder)
        part.rename(folder)
    truth.parent.mkdir(parents=True, exist_ok=True)
    partial = truth.with_name(f".part-{truth.name}")
    partial.write_text(json.dumps(ground_truth, indent=1) + "\n", "utf-8")
    partial.rename(truth)


def format_table(table: Mapping[str, np.ndarray]) -> str:
    """Return the text of a trial file with the columns of ``table``."""
    header = ",".join(f"{name} [{COLUMN_UNITS[name]}]" for name in table)
    columns = [[f"{value:.{COLUMN_DECIMALS[name]}f}" for value in values] for name, values in table.items()]
    rows = [",".join(row) for row in zip(*columns, strict=True)]
    return "\n".join([header, *rows]) + "\n"


def _format_effect_sections(known: Effects) -> str:
    """Return ``known`` effects in the format of device files."""
    lines = []
    for effect in known:
        lines += ["", f"[effects.{effect['name']}]", f'form = "{effect["form"]}"']
        lines += [f"{key} = {value}" for key, value in effect["parameters"].items()]
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str] | None = None) -> None:
    """Generate a block of datasets."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder that will hold the datasets")
    parser.add_argument(
        "--block", choices=[block for block in BLOCK_SIZES if block not in GAIT_BLOCKS + JOINT_BLOCKS], default="single"
    )
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--typical", action="store_true", help="every parameter at its typical value")
    parser.add_argument("--truth", type=Path, help="truth file (needs --count 1), or else a folder for them")
    parser.add_argument("--device", type=Path, default=PRESET_FILE, help="device file of the nominal device")
    options = parser.parse_args(arguments)
    if options.block == ADVERSARY_BLOCK and options.device != PRESET_FILE:
        parser.error(f"--device does not apply to block {ADVERSARY_BLOCK}; leave it out")
    specs = plan_datasets(options.block, options.count, options.seed, typical=options.typical)
    if options.truth is not None and options.truth.suffix == ".json" and len(specs) != 1:
        parser.error("--truth FILE.json needs --count 1; give a folder for several")
    start = time.perf_counter()
    for i, spec in enumerate(specs, start=1):
        name = spec.pop("name")
        folder = options.out / name
        truth = options.truth or options.out
        truth = truth if truth.suffix == ".json" else truth / f"{name}.truth.json"
        if truth.exists() and folder.exists():
            word = "is there"
        else:
            if options.block == ADVERSARY_BLOCK:
                sealed = make_adversary_dataset(folder, **spec, truth=truth)
            else:
                sealed = make_dataset(folder, **spec, truth=truth, device_file=options.device)
            word = f"raw size {sealed['raw_size']:.2f} on {sealed['most_affected']}"
        print(f"{i}/{len(specs)} {name}: {word} ({time.perf_counter() - start:.0f} s)", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
