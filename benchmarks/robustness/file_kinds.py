"""Kinds of files that a user can give: an intact example of each, and its reader."""

import json
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from unittest import mock

import numpy as np
from benchmarks.robustness import dataset_folders, expression_files
from tests import synthetic_gait as walker

from klute_sim.api.bench import simulate_bench
from klute_sim.bench import run
from klute_sim.bench.protocols import library as protocols_library
from klute_sim.comparison import runs
from klute_sim.comparison.comparison import compare
from klute_sim.controllers import learned, state_machine
from klute_sim.controllers.policy import Policy
from klute_sim.controllers.pressure import load_profile
from klute_sim.datasets import dataset
from klute_sim.device import device as device_device
from klute_sim.device.rollout import simulate_rollouts
from klute_sim.effects import catalogue
from klute_sim.gait import reference
from klute_sim.mocap import reference_import
from klute_sim.mocap.formats import trc
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing import mapping
from klute_sim.parameter_sweep import store
from klute_sim.parameter_sweep.evaluate import METRIC_COLUMNS, CaseResult
from klute_sim.recording import parquet
from klute_sim.recording.recording import Recording
from klute_sim.training import config, training
from klute_sim.viewer.folders import ensure_recording

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
    library: str = ""
    """Optional package that reads them, in a separate process."""


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


def _plan_protocol(paths: Paths) -> object:
    protocol = protocols_library.load_protocol(paths[0])
    return run.plan_protocol(device_device.load_device("klute-1-1-4-pair"), protocol, 5e-4)


CATALOGUE = """from klute_sim import EffectParameter, effect
@effect(
    name="muscle_warming",
    description="The muscle pulls more when it is warm.",
    equation="F (1 + gain)",
    hook="muscle_force",
    parameters=(EffectParameter(key="gain", neutral=0.0, lower=0.0, upper=0.5, typical=0.02, source="assumed"),),
)
def warm_force(p, state, force, muscle, pressure, length, velocity):
    return force * (1.0 + p.gain)
"""


def _load_catalogue(paths: Paths) -> object:
    catalogue.load_user_module.cache_clear()
    with (
        mock.patch.dict(os.environ, {catalogue.CATALOGUE_VARIABLE: str(paths[0])}),
        mock.patch.object(catalogue, "_registered_effects", []),
        mock.patch.object(catalogue.get_effects, "cache_info", return_value=mock.Mock(currsize=0)),
    ):
        return catalogue.load_user_module()


PLAN = {"klute_sim": "1.0", "axes": {"mass_kg": [60.0, 70.0]}, "strides": 3, "code_digest": "0" * 64}


def _sweep_folder(folder: Path) -> list[Path]:
    result_store = store.open_store(folder, PLAN, "sweep")
    result_store.put("key", CaseResult(dict.fromkeys(METRIC_COLUMNS, 1.0), ""))
    (folder / "cases" / "key.json").rename(folder / "key.json")
    (folder / "cases").rmdir()
    return [folder / "sweep.json", folder / "key.json"]


def _resume_sweep(paths: Paths) -> object:
    folder = paths[0].parent
    (folder / "cases").mkdir(exist_ok=True)
    (folder / "key.json").replace(folder / "cases" / "key.json")
    return store.open_store(folder, PLAN, "sweep").get("key")


def _training_folder(folder: Path) -> list[Path]:
    rows = "minutes,steps,episodes,episode_return,episode_steps\n1.0,4096,3,5.5,100\n2.0,8192,6,6.5,120\n"
    return [
        _written(folder / "progress.json", json.dumps({"seed": 1, "minutes": 2.0, "steps": 8192}).encode()),
        _written(folder / "learning_curve.csv", rows.encode()),
        _written(folder / "config.toml", config.read_default_config()),
    ]


def _resume_training(paths: Paths) -> object:
    with mock.patch.object(training, "Training"):  # which needs Stable-Baselines3
        return training.open_training(paths[0].parent, None, None)


def _bench_folder(folder: Path) -> list[Path]:
    simulated = simulate_bench("klute-1-1-4-pair", "isometric", pressures_bar=[2.0])
    simulated.save(folder / "run")
    files = [file for file in (folder / "run").iterdir() if file.name in ("summary.json",) or file.suffix == ".parquet"]
    return [file.rename(folder / file.name) for file in sorted(files)]


def _view_bench_folder(paths: Paths) -> object:
    folder = paths[0].parent
    (folder / "protocol.toml").touch()
    with ensure_recording(folder) as recording:
        return recording


KINDS = {
    kind.name: kind
    for kind in (
        Kind("device", _device, _simulate),
        Kind("dataset", dataset_folders.write_dataset, _split),
        Kind("mat-dataset", dataset_folders.write_mat_dataset, _split),
        Kind("mat73-dataset", dataset_folders.write_hdf5_dataset, _split, library="h5py"),
        Kind("logger-dataset", dataset_folders.write_logger_dataset, _split),
        Kind("columns", expression_files.write_expression, expression_files.use_expression),
        Kind("reference", _reference, lambda paths: reference.load_reference(paths[0].parent)),
        Kind("recording", partial(_recording, ending="parquet"), _compared, text=False),
        Kind("table", partial(_recording, ending="csv"), _compared),
        Kind("opensim", _opensim, _imported),
        Kind("trc", _trc, _imported),
        Kind("treadmill", _table, _imported),
        Kind("c3d", _c3d, _imported, text=False, library="ezc3d"),
        Kind("mapping", partial(_copied, "names.toml", MAPPING.encode), _each(mapping.read)),
        Kind(
            "protocol",
            partial(_copied, "p.toml", lambda: protocols_library.read_protocol_bytes("workloop-phased")),
            _plan_protocol,
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
            partial(_copied, "t.toml", lambda: (Path(config.__file__).parent / "gait.toml").read_bytes()),
            _each(config.load_config),
        ),
        Kind("catalogue", partial(_copied, "effects.py", CATALOGUE.encode), _load_catalogue),
        Kind("sweep-folder", _sweep_folder, _resume_sweep),
        Kind("training-folder", _training_folder, _resume_training),
        Kind("bench-folder", _bench_folder, _view_bench_folder),
    )
}
"""All kinds by name."""
