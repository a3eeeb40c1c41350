"""Damaged files of every kind; ``python tests/fuzz.py`` tries ten thousand of each."""

import random
from importlib.util import find_spec
from pathlib import Path

import pytest

from klute_sim.errors import InputError
from tests import fuzz as fuzz
from tests import fuzz_kinds as fuzz_kinds

FEW = {"c3d": 8}
"""Cases of the default run; 40 of all others."""


def _asks(name: str) -> None:
    if name == "c3d" and find_spec("ezc3d") is None:
        pytest.skip("needs the extra c3d")


@pytest.mark.parametrize("name", fuzz_kinds.KINDS)
def test_damaged_files_are_read_or_refused_in_a_sentence(name: str) -> None:
    _asks(name)
    assert fuzz.cases(name, 0, FEW.get(name, 40)) == {}


@pytest.mark.long
@pytest.mark.parametrize("name", fuzz_kinds.KINDS)
def test_so_are_a_thousand_more(name: str) -> None:
    _asks(name)
    assert fuzz.apart(name, 100_000, 100 if name == "c3d" else 1000) == {}


def test_damage_is_made_again_by_its_number_and_is_damage() -> None:
    whole = b"time [s],force [N]\n" + b"".join(b"%d,%d\n" % (k, k * k) for k in range(50))
    made = [fuzz.damaged(whole, random.Random(k), text=True) for k in range(200)]
    assert made == [fuzz.damaged(whole, random.Random(k), text=True) for k in range(200)]
    assert sum(each != whole for each in made) > 180
    assert len(set(made)) > 170


@pytest.mark.parametrize(
    ("use", "told"),
    [
        (lambda paths: paths[0].read_text("utf-8").index("nothing like it"), "ValueError"),
        (lambda paths: (paths[0].parent.parent.parent / "beside").write_text("outside"), "open"),
        (lambda paths: (_ for _ in ()).throw(InputError("")), "no sentence"),
    ],
    ids=["traceback", "outside", "nothing said"],
)
def test_what_goes_wrong_is_found(use: object, told: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
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
    found = fuzz.cases("made", 0, 3)
    assert sorted(found) == [0, 1, 2]
    assert all(told in said for said in found.values())


def test_a_case_that_ends_its_process_is_found_and_the_rest_is_done(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
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
    found = fuzz.apart("device", 0, 8)
    assert list(found) == [4]
    assert "ended with" in found[4]
