"""The device's laws and its step are one source: compiled, they give the same bits as in plain Python."""

import random
import shutil
import subprocess
import sys
import types
from pathlib import Path

import numba
import pytest

from klute_sim.device import dynamics
from klute_sim.device.backend import compiled
from klute_sim.device.backend.packing import ROW_SIZE, pack_parameters, unpack_parameters
from klute_sim.device.device import list_presets, load_device
from klute_sim.device.dynamics import DeviceState
from klute_sim.laws import mckibben
from klute_sim.plant import models


@pytest.mark.parametrize("name", ["klute-1-1-4-pair", "klute-3-4-pair", "klute-1-2"])
def test_compiled_steps_are_bit_identical(name: str) -> None:
    fast = types.SimpleNamespace(**compiled.compile_device_functions())
    parameters = load_device(name).parameters
    pick = random.Random(7)
    rest = parameters.muscle.resting_length
    slow_state = fast_state = DeviceState(0.0, rest)
    for _ in range(2000):
        length = parameters.tendon.slack_length + pick.uniform(0.75, 1.0 if parameters.tendon.is_rigid else 1.06) * rest
        command, h = pick.uniform(-1e5, 7e5), pick.choice([1e-4, 5e-4, 5e-3])
        slow_state = dynamics.advance_state(parameters, slow_state, length, command, h)
        fast_state = DeviceState(*fast.advance(parameters, fast_state, length, command, h))
        assert [x.hex() for x in fast_state[:2]] == [x.hex() for x in slow_state[:2]]
        rate = pick.uniform(-0.5, 0.5)
        pulls = [m.tension(parameters, slow_state, length, rate) for m in (dynamics, fast)]
        assert pulls[0].hex() == pulls[1].hex()


@pytest.mark.parametrize("name", list_presets())
def test_a_row_is_the_device(name: str) -> None:
    parameters = load_device(name).parameters
    assert unpack_parameters(pack_parameters(parameters)) == parameters
    assert len(pack_parameters(parameters)) == ROW_SIZE


def test_every_field_of_a_row_has_its_place() -> None:
    row = [float(k) for k in range(ROW_SIZE)]
    flat = [value for part in unpack_parameters(row) for value in part]
    assert flat == [*row[1:17], True, *row[18:]]
    assert list(compiled.compile_device_functions()["unpack"](tuple(row))) == list(unpack_parameters(tuple(row)))


ALONE = (
    "import numpy as np; from klute_sim.device.device import load; from klute_sim.device.rollout import rollout;"
    "print(rollout(load('klute-3-4').parameters, np.full(3, 0.15), np.full(3, 5e5), 1e-3).tension[-1])"
)


@pytest.mark.long
def test_what_was_compiled_is_named_after_its_sources(tmp_path: Path) -> None:
    """numba itself would go on using machine code of a law that has changed since."""
    package = tmp_path / "klute_sim"
    source = Path(dynamics.__file__).parents[1]
    shutil.copytree(source, package, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(models.get_models_folder(), package / "models", dirs_exist_ok=True)

    def tension() -> float:
        command = [sys.executable, "-c", ALONE]
        done = subprocess.run(command, cwd=tmp_path, env={"PYTHONPATH": str(tmp_path)}, capture_output=True, check=True)
        return float(done.stdout)

    before = tension()
    kept = sorted(package.rglob("*.nbc"))
    assert kept
    assert tension() == before
    assert sorted(package.rglob("*.nbc")) == kept  # the second time, nothing was compiled
    law = package / "laws" / "mckibben.py"
    text, friction = law.read_text("utf-8"), "bladder_force(muscle, length) + friction"
    assert friction in text
    law.write_text(text.replace(friction, "0.0 * length + friction"), "utf-8")
    assert tension() > before + 10.0


def test_every_source_that_is_compiled_is_in_the_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tmp_path / "klute_sim"
    shutil.copytree(Path(dynamics.__file__).parents[1], package, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(dynamics, "__file__", str(package / "device" / "step.py"))
    seen = {compiled._hash_sources.__wrapped__("")}
    sources = ("units.py", "laws/damper.py", "effects/tendon.py", "device/rollout.py", "plant/memory.py")
    for count, name in enumerate(sources, start=2):
        with (package / name).open("a", encoding="utf-8") as file:
            file.write("\n")
        seen.add(compiled._hash_sources.__wrapped__(""))
        assert len(seen) == count
    assert compiled._hash_sources.__wrapped__("constants") not in seen


def test_without_a_place_to_keep_it_compiles_all_the_same() -> None:
    def wrap(signature: str, cache: bool = False, **options: object) -> object:
        if cache:
            raise OSError(28, "No space left on device")
        return numba.njit(signature, **options)

    lock_length = compiled.compile_module(mckibben).lock_length
    muscle = load_device("klute-3-4").parameters.muscle
    assert compiled.compile_cached(wrap, lock_length, signature_for(muscle))(muscle) == mckibben.lock_length(muscle)


def signature_for(muscle: mckibben.Muscle) -> object:
    return numba.float64(numba.typeof(muscle))
