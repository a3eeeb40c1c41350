"""Intact datasets of each kind of trial file, for mutations."""

from importlib import resources
from pathlib import Path

import numpy as np
from scipy.io import savemat

from klute_sim.datasets.trial_files import text
from klute_sim.recording import parquet
from klute_sim.recording.recording import Recording

DATASET = """format = "klute-sim-dataset/2"
rig = "bench"
device = "klute-3-4-pair"
[uncertain]
"tendon.stiffness_2_n_per_mm" = "10 %"
[[trial]]
files = ["fit_1_a.csv"]
group = "one"
[trial.device]
"muscle.resting_length_mm" = 170.0
[[trial]]
files = ["b.parquet"]
trusted = ["force"]
"""


def write_dataset(folder: Path) -> list[Path]:
    """Write a dataset of a CSV and a Parquet file."""
    content = (resources.files("klute_sim.datasets") / "example" / "fit_1_a.csv").read_bytes()
    file = text.parse_delimited_text(content, "fit_1_a.csv")
    columns = zip(file.headings, file.read_columns(range(len(file.headings))), strict=True)
    parquet.write_recording(Recording.from_columns(columns), folder / "b.parquet")
    return [
        _write(folder / "dataset.toml", DATASET.encode()),
        _write(folder / "fit_1_a.csv", content),
        folder / "b.parquet",
    ]


MAT_DATASET = """format = "klute-sim-dataset/2"
rig = "bench"
device = "klute-3-4-pair"
[columns]
time = "row / rate [s]"
length = "run.length [mm]"
pressure_command = "(run.volts - 0.5) * 2 [bar]"
force = "data(:,2) [N]"
[[trial]]
files = ["a.mat"]
[[trial]]
files = ["b.mat"]
"""


def write_mat_dataset(folder: Path) -> list[Path]:
    """Write a dataset of two MAT-files, one of them compressed."""
    n = 200
    run = {"length": np.full(n, 340, np.int16), "volts": np.full(n, 2.0), "note": "text"}
    content = {"rate": 100.0, "run": run, "data": np.column_stack((np.zeros(n), np.full(n, 690.0)))}
    for name, is_compressed in (("a", False), ("b", True)):
        savemat(folder / f"{name}.mat", content, do_compression=is_compressed)
    return [_write(folder / "dataset.toml", MAT_DATASET.encode()), folder / "a.mat", folder / "b.mat"]


def write_hdf5_dataset(folder: Path) -> list[Path]:
    """Write a dataset of a MAT-file of version 7.3."""
    import h5py

    n = 200
    columns = {
        "t": np.arange(n) * 0.01,
        "length": np.full(n, 340.0),
        "command": np.full(n, 3.0),
        "f": np.full(n, 690.0),
    }
    with h5py.File(folder / "a.mat", "w", userblock_size=512) as file:
        for name, values in columns.items():
            file.create_dataset(name, data=values[np.newaxis], chunks=True, compression="gzip")
    text = MAT_DATASET.partition("[columns]")[0] + "[columns]\n"
    text += 'time = "t [s]"\nlength = "length [mm]"\npressure_command = "command [bar]"\nforce = "f [N]"\n'
    return [_write(folder / "dataset.toml", f'{text}[[trial]]\nfiles = ["a.mat"]\n'.encode()), folder / "a.mat"]


LOGGER_DATASET = """format = "klute-sim-dataset/2"
rig = "bench"
device = "klute-3-4-pair"
heading_row = 4
[columns]
time = "t"
force = "(2.5 * `Load cell [V]`) * 100 [N]"
[noise]
length = "0.2 mm"
[tolerance]
force = "2 %"
[[trial]]
files = ["a.txt"]
specimen = "A"
"""


def write_logger_dataset(folder: Path) -> list[Path]:
    """Write a dataset of a logger's text: preamble, decimal commas and Windows encoding."""
    rows = [f"{k};340,0;3,05;2,7{k % 7}" for k in range(100)]
    heading = ["Logger 7", "Operator;Müller", "", "t [ms];length [mm];pressure_command [bar];Load cell [V]"]
    return [
        _write(folder / "dataset.toml", LOGGER_DATASET.encode()),
        _write(folder / "a.txt", "\n".join([*heading, *rows]).encode("cp1252")),
    ]


def _write(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path
