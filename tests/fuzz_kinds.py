"""Kinds of files for fuzzing: an intact example of each, and its reader."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from klute_sim.bench.protocols import library as protocols_library
from klute_sim.comparison import runs
from klute_sim.comparison.comparison import compare
from klute_sim.controllers import learned, state_machine
from klute_sim.controllers.policy import Policy
from klute_sim.controllers.pressure import load_profile
from klute_sim.datasets import dataset
from klute_sim.device import device as device_device
from klute_sim.device.rollout import simulate_rollouts
from klute_sim.gait import reference
from klute_sim.mocap import reference_import
from klute_sim.mocap.formats import trc
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing import mapping
from klute_sim.recording import parquet
from klute_sim.recording.recording import Recording
from klute_sim.training import config
from tests import synthetic_gait as walker

Paths = Sequence[Path]
STEPS = 40


@dataclass(frozen=True)
class Kind:
    """One kind of file."""

    name: str
    """Name of the kind."""
    make: Callable[[Path], list[Path]]
    """Function that writes intact files into a folder."""
    use: Callable[[Paths], object]
    """Function that reads them as a command does."""
    text: bool = True
    """Whether the files are text."""


def _device(folder: Path) -> list[Path]:
    text = device_device.load_device("klute-1-1-4-pair-valve").content.decode()
    text += '\n[effects.braid_hysteresis]\nform = "coulomb"\nslope_n_per_bar = 8.0\n'
    return [_written(folder / "device.toml", text.encode())]


def _written(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def _simulate(paths: Paths) -> None:
    device = device_device.load_device(paths[0])
    length = np.full(STEPS, 0.95 * device_device.load_device("klute-1-1-4-pair").parameters.muscle.resting_length)
    simulate_rollouts(device.parameters, length + 0.05, np.full(STEPS, 1e5), 5e-4)


DATASET = """format = "klute-sim-dataset/2"
rig = "bench"
device = "klute-3-4-pair"
[uncertain]
"tendon.stiffness_2_n_per_mm" = "10 %"
[[trial]]
files = ["a.csv"]
group = "one"
[trial.device]
"muscle.resting_length_mm" = 180.0
[[trial]]
files = ["b.parquet"]
trusted = ["force"]
"""


def _dataset(folder: Path) -> list[Path]:
    time = np.arange(30) * 0.01
    columns = [
        ("time [s]", time),
        ("length [mm]", 340.0 + np.sin(time)),
        ("pressure_command [bar]", np.full(30, 3.0)),
        ("force [N]", 600.0 + time),
    ]
    rows = [",".join(name for name, _ in columns)]
    rows += [",".join(f"{value:g}" for value in row) for row in zip(*(each for _, each in columns), strict=True)]
    parquet.write_recording(Recording.from_columns(columns), folder / "b.parquet")
    return [
        _written(folder / "dataset.toml", DATASET.encode()),
        _written(folder / "a.csv", "\n".join(rows).encode()),
        folder / "b.parquet",
    ]


def _split(paths: Paths) -> object:
    return dataset.split_dataset(dataset.load_dataset(paths[0].parent))


def _recording(folder: Path, ending: str) -> list[Path]:
    phase = np.tile(np.linspace(0.0, 99.0, 100), 3)
    columns = [
        ("time [s]", np.arange(300) * 0.01),
        ("stride [1]", np.repeat([1.0, 2.0, 3.0], 100)),
        ("gait_phase [%]", phase),
        ("ankle_angle [deg]", 10 * np.sin(phase / 16.0)),
        ("ankle_moment [N*m]", 100 * np.sin(phase / 32.0)),
    ]
    if ending == "parquet":
        parquet.write_recording(Recording.from_columns(columns, {"options": {"mass_kg": 70.0}}), folder / "run.parquet")
        return [folder / "run.parquet"]
    rows = [",".join(name for name, _ in columns)]
    rows += [",".join(f"{value:g}" for value in row) for row in zip(*(each for _, each in columns), strict=True)]
    return [_written(folder / "run.csv", "\n".join(rows).encode())]


def _compared(paths: Paths) -> object:
    return compare(runs.read_runs([f"one={paths[0]}", f"other={paths[0]}"]))


def _reference(folder: Path) -> list[Path]:
    stated = 'format = "klute-sim-reference/1"\nmass_kg = 70.0\nstature_m = 1.75\nstride_time_s = 1.1\n'
    whole = (Path(reference.__file__).parent / "normative_gait.csv").read_bytes()
    return [_written(folder / "reference.toml", stated.encode()), _written(folder / "reference.csv", whole)]


def _short() -> walker.Walker:
    return walker.Walker(seconds=2.5)


def _opensim(folder: Path) -> list[Path]:
    return walker.opensim(folder, _short())


def _trc(folder: Path) -> list[Path]:
    loads = walker.opensim(folder, _short())[1]
    trc.write(walker.markers(_short()), folder / "markers.trc")
    return [folder / "markers.trc", loads]


def _table(folder: Path) -> list[Path]:
    return [walker.treadmill(folder, walker.Walker())]  # whose belt starts while others have walked two strides


def _c3d(folder: Path) -> list[Path]:
    return [walker.c3d(folder, _short())]


def _imported(paths: Paths) -> object:
    return reference_import.import_reference(paths, ImportOptions(mass=70.0))


MAPPING = """[right]
knee_angle = "RKneeFlex"
ankle_angle = { column = "RAnkle", unit = "deg", sign = -1, zero = -90.0 }
[markers.right]
ankle = ["RMALL", "RMALM"]
[axes]
forward = "-y"
up = "z"
"""


def _policy(folder: Path) -> list[Path]:
    layers = [
        (np.ones((4, 8), np.float32), np.zeros(4, np.float32)),
        (np.ones((1, 4), np.float32), np.zeros(1, np.float32)),
    ]
    made = {"config": {"environment": {"action": "residual", "residual_bar": 0.7}}}
    Policy(np.ones(8, np.float32), layers, "tanh", False, made).save(folder / "policy.npz")
    return [folder / "policy.npz"]


def _copied(name: str, content: Callable[[], bytes], folder: Path) -> list[Path]:
    return [_written(folder / name, content())]


def _each(reader: Callable[[Path], object]) -> Callable[[Paths], object]:
    return lambda paths: [reader(path) for path in paths]


def _shipped(name: str) -> bytes:
    return (Path(state_machine.__file__).parent / name).read_bytes()


def _protocol(paths: Paths) -> object:
    return protocols_library.parse_protocol(protocols_library.read_protocol_bytes(str(paths[0])), str(paths[0]))


KINDS = {
    kind.name: kind
    for kind in (
        Kind("device", _device, _simulate),
        Kind("dataset", _dataset, _split),
        Kind("reference", _reference, lambda paths: reference.load_reference(paths[0].parent)),
        Kind("recording", partial(_recording, ending="parquet"), _compared, text=False),
        Kind("table", partial(_recording, ending="csv"), _compared),
        Kind("opensim", _opensim, _imported),
        Kind("trc", _trc, _imported),
        Kind("treadmill", _table, _imported),
        Kind("c3d", _c3d, _imported, text=False),
        Kind("mapping", partial(_copied, "names.toml", MAPPING.encode), _each(mapping.read)),
        Kind(
            "protocol",
            partial(_copied, "p.toml", lambda: protocols_library.read_protocol_bytes("workloop-phased")),
            _protocol,
        ),
        Kind(
            "profile",
            partial(_copied, "p.csv", lambda: _shipped("tuned_profile.csv")),
            _each(load_profile),
        ),
        Kind(
            "machine",
            partial(_copied, "m.toml", lambda: _shipped("state_machine.toml")),
            _each(state_machine.load_state_machine),
        ),
        Kind("policy", _policy, _each(learned.load_policy_controller), text=False),
        Kind(
            "training",
            partial(_copied, "t.toml", lambda: (Path(config.__file__).parent / "default.toml").read_bytes()),
            _each(config.load_config),
        ),
    )
}
