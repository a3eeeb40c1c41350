"""Tests with damaged files of every kind; ``python -m tests.fuzz`` runs ten thousand of each."""

import random
from importlib.util import find_spec
from pathlib import Path

import pytest

from klute_sim.errors import InputError
from tests import fuzz, fuzz_kinds

FEW_CASES = {"c3d": 8}
"""Number of cases in the default run; 40 for all other kinds."""


def _skip_without_extra(name: str) -> None:
    if name == "c3d" and find_spec("ezc3d") is None:
        pytest.skip("needs the extra c3d")


@pytest.mark.parametrize("name", fuzz_kinds.KINDS)
def test_damaged_file_is_read_or_refused_in_one_sentence(name: str) -> None:
    _skip_without_extra(name)
    assert fuzz.cases(name, 0, FEW_CASES.get(name, 40)) == {}


@pytest.mark.long
@pytest.mark.parametrize("name", fuzz_kinds.KINDS)
def test_a_thousand_more_damaged_files(name: str) -> None:
    _skip_without_extra(name)
    assert fuzz.apart(name, 100_000, 100 if name == "c3d" else 1000) == {}


def test_damage_is_reproducible() -> None:
    content = b"time [s],force [N]\n" + b"".join(b"%d,%d\n" % (k, k * k) for k in range(50))
    damaged_contents = [fuzz.damaged(content, random.Random(k), text=True) for k in range(200)]
    assert damaged_contents == [fuzz.damaged(content, random.Random(k), text=True) for k in range(200)]
    assert sum(damaged != content for damaged in damaged_contents) > 180
    assert len(set(damaged_contents)) > 170


@pytest.mark.parametrize(
    ("use", "message"),
    [
        (lambda paths: paths[0].read_text("utf-8").index("nothing like it"), "ValueError"),
        (lambda paths: (paths[0].parent.parent.parent / "beside").write_text("outside"), "open"),
        (lambda paths: (_ for _ in ()).throw(InputError("")), "no sentence"),
    ],
    ids=["traceback", "outside", "nothing said"],
)
def test_failures_are_detected(use: object, message: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def make(folder: Path) -> list[Path]:
        (folder / "text").write_text("a text", "utf-8")
        return [folder / "text"]

    calls = []

    def after_the_first(paths: list[Path]) -> None:
        calls.append(paths)
        if len(calls) > 1:
            use(paths)

    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(fuzz.tempfile, "tempdir", str(tmp_path))
    monkeypatch.setitem(fuzz_kinds.KINDS, "made", fuzz_kinds.Kind("made", make, after_the_first))
    failures = fuzz.cases("made", 0, 3)
    assert sorted(failures) == [0, 1, 2]
    assert all(message in failure for failure in failures.values())


def test_crash_is_detected_and_remaining_cases_run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    fake = tmp_path / "fake.py"
    fake.write_text(
        "import os, sys\n"
        "first, count = int(sys.argv[-3]), int(sys.argv[-1])\n"
        "for number in range(first, first + count):\n"
        "    print(number, flush=True)\n"
        "    if number == 4: os.abort()\n",
        "utf-8",
    )
    monkeypatch.setattr(fuzz, "__file__", str(fake))
    failures = fuzz.apart("device", 0, 8)
    assert list(failures) == [4]
    assert "ended with" in failures[4]
