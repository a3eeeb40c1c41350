"""The compiled backend: the same source gives the same bits as plain Python."""

import shutil
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest

from klute_sim.device import dynamics
from klute_sim.device.backend import compiled
from klute_sim.device.backend.packing import ROW_SIZE, pack_parameters, unpack_parameters
from klute_sim.device.device import list_presets, load_device
from klute_sim.device.recorded_rollout import record_rollout
from klute_sim.laws import mckibben
from klute_sim.plant import models
from tests.compiled_function import make_callable


@pytest.mark.parametrize("name", ["klute-1-1-4-pair", "klute-3-4-pair", "klute-1-2"])
def test_compiled_steps_are_bit_identical(name: str) -> None:
    """Any length and any command, so that the tendon becomes slack and taut again, and air flows both ways."""
    p = load_device(name).parameters
    rng = np.random.default_rng(7)
    for step in (1e-4, 5e-4, 5e-3):
        length = p.tendon.slack_length + rng.uniform(0.75, 1.0 if p.tendon.is_rigid else 1.06, 700) * (
            p.muscle.resting_length
        )
        command = rng.uniform(-1e5, 7e5, len(length))
        compiled_record, python_record = (
            record_rollout(p, length, command, step, backend=backend) for backend in ("compiled", "python")
        )
        for column in ("tension", "pressure", "length", "velocity"):
            assert getattr(compiled_record, column).tobytes() == getattr(python_record, column).tobytes()


@pytest.mark.parametrize("name", list_presets())
def test_packed_row_unpacks_to_the_same_parameters(name: str) -> None:
    parameters = load_device(name).parameters
    assert unpack_parameters(pack_parameters(parameters)) == parameters
    assert len(pack_parameters(parameters)) == ROW_SIZE


def test_unpacking_reads_every_field_of_a_row() -> None:
    row = [float(k) for k in range(ROW_SIZE)]
    flat = [value for part in unpack_parameters(row) for value in part]
    assert flat == [*row[1:22], True, *row[23:]]
    unpack_compiled = make_callable(compiled.compile_device_functions()["unpack_parameters"])
    assert list(unpack_compiled(tuple(row))) == list(unpack_parameters(tuple(row)))


SCRIPT = (
    "import numpy as np; from klute_sim.device.device import load_device\n"
    "from klute_sim.device.rollout import simulate_rollouts\n"
    "print(simulate_rollouts(load_device('klute-3-4').parameters, np.full(3, 0.15), np.full(3, 5e5), 1e-3).tension[-1])"
)


@pytest.mark.long
def test_cache_entry_depends_on_the_sources(tmp_path: Path) -> None:
    """The cache of numba alone would keep the machine code of a law that has changed."""
    package = tmp_path / "klute_sim"
    source = Path(dynamics.__file__).parents[1]
    shutil.copytree(source, package, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(models.get_models_folder(), package / "models", dirs_exist_ok=True)

    def tension() -> float:
        command = [sys.executable, "-c", SCRIPT]
        result = subprocess.run(
            command, cwd=tmp_path, env={"PYTHONPATH": str(tmp_path)}, capture_output=True, check=True
        )
        return float(result.stdout)

    before = tension()
    cached_files = sorted(package.rglob("*.nbc"))
    assert cached_files
    assert tension() == before
    assert sorted(package.rglob("*.nbc")) == cached_files  # nothing is compiled the second time
    law = package / "laws" / "mckibben.py"
    text, friction = law.read_text("utf-8"), "bladder_force(muscle, length) + friction"
    assert friction in text
    law.write_text(text.replace(friction, "0.0 * length + friction"), "utf-8")
    assert tension() > before + 10.0


def test_source_hash_covers_every_compiled_source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tmp_path / "klute_sim"
    shutil.copytree(Path(dynamics.__file__).parents[1], package, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(dynamics, "__file__", str(package / "device" / "step.py"))
    hashes = {compiled._hash_sources.__wrapped__("")}
    sources = ("units.py", "laws/damper.py", "effects/tendon.py", "device/rollout.py", "plant/memory.py")
    for count, name in enumerate(sources, start=2):
        with (package / name).open("a", encoding="utf-8") as file:
            file.write("\n")
        hashes.add(compiled._hash_sources.__wrapped__(""))
        assert len(hashes) == count
    assert compiled._hash_sources.__wrapped__("constants") not in hashes


def test_compilation_works_without_a_writable_cache() -> None:
    def wrap(signature: str, cache: bool = False, **options: object) -> object:
        if cache:
            raise OSError(28, "No space left on device")
        return numba.njit(signature, **options)

    lock_length = compiled.compile_module(mckibben).lock_length
    muscle = load_device("klute-3-4").parameters.muscle
    assert compiled.compile_cached(wrap, lock_length, signature_for(muscle))(muscle) == mckibben.lock_length(muscle)


def signature_for(muscle: mckibben.MuscleParameters) -> object:
    return numba.float64(numba.typeof(muscle))
