"""Mutated files of every kind; ``python -m benchmarks.robustness.mutations`` runs ten thousand of each."""

import random
import subprocess
import sys
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from unittest import mock

import pytest
from benchmarks.robustness import cases, expression_files, file_kinds, mutations

from klute_sim.datasets.trial_files import expressions
from klute_sim.errors import InputError

FEW_CASES = {"c3d": 6, "mat73-dataset": 3}
"""Number of cases of one test; 15 of all other kinds."""
SLOW_KINDS = {"bench-folder", "c3d", "mat73-dataset", "treadmill"}
"""Kinds that take seconds."""


def _skip_without_extra(name: str) -> None:
    library = file_kinds.KINDS[name].library
    if library and find_spec(library) is None:
        pytest.skip(f"needs {library}")


@pytest.mark.parametrize(
    "name",
    [pytest.param(kind, marks=pytest.mark.slow if kind in SLOW_KINDS else []) for kind in file_kinds.KINDS],
)
def test_mutated_file_is_read_or_refused_in_one_sentence(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    _skip_without_extra(name)
    monkeypatch.setattr(cases, "MAX_MEGABYTES", 2000.0)  # the process of the tests holds more than one of a campaign
    result = cases.run_cases(name, 0, FEW_CASES.get(name, 15))
    assert result.failures == {}
    assert result.count == FEW_CASES.get(name, 15)


@pytest.mark.long
@pytest.mark.parametrize("name", file_kinds.KINDS)
def test_a_thousand_more_mutated_files(name: str) -> None:
    _skip_without_extra(name)
    count = 100 if file_kinds.KINDS[name].library else 1000
    results = mutations.run_campaign([name], 100_000, count, out=None, keep=None, jobs=1)
    assert results[name].count == count
    assert results[name].failures == {}


@pytest.mark.parametrize("suffix", [".csv", ".toml", ".mot"])
def test_mutations_are_reproducible(suffix: str) -> None:
    content = b"time [s],force [N]\nkey = 1.0\n" + b"".join(b"%d,%d\n" % (k, k * k) for k in range(50))
    kind = file_kinds.KINDS["table"]
    mutated = [cases.mutate(content, random.Random(k), kind, suffix) for k in range(200)]
    assert mutated == [cases.mutate(content, random.Random(k), kind, suffix) for k in range(200)]
    assert sum(each != content for each in mutated) > 160
    assert len(set(mutated)) > 140


@pytest.mark.parametrize("operator", ["+", "-", "*", "/"])
def test_wrong_arithmetic_of_expressions_is_a_failure(
    operator: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    paths = expression_files.write_expression(tmp_path)
    expression_files.use_expression(paths)
    monkeypatch.setitem(expressions._OPERATIONS, operator, lambda left, right: left + 2.0 * right)
    with pytest.raises(AssertionError, match="is not"):
        expression_files.use_expression(paths)


def test_mutated_expressions_reach_the_second_evaluation(tmp_path: Path) -> None:
    """Most others are refused; without accepted ones, the second evaluation would compare nothing."""
    original, results = expression_files.EXPRESSION.encode(), []
    for number in range(60):
        file = tmp_path / f"force{expression_files.SUFFIX}"
        file.write_bytes(expression_files.change_expression(original, random.Random(number)))
        with mock.patch.object(expression_files, "_compare", wraps=expression_files._compare) as compare:
            with suppress(InputError):
                expression_files.use_expression([file])
            results.append(compare.called)
    assert sum(results) > 6


def _read_missing_text(paths: list[Path]) -> None:
    paths[0].read_bytes().index(b"nothing like it")


def _write_outside(paths: list[Path]) -> None:
    (paths[0].parent.parent.parent / "beside").write_text("outside")


def _say_nothing(paths: list[Path]) -> None:
    raise InputError("")


def _use_memory(paths: list[Path]) -> None:
    bytearray(b"x" * 10_000_000)


@pytest.mark.parametrize(
    ("use", "message"),
    [
        (_read_missing_text, "ValueError"),
        (_write_outside, "open"),
        (_say_nothing, "no sentence"),
        (_use_memory, "more than 1 MB"),
    ],
)
def test_failures_are_detected(use: object, message: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def make(folder: Path) -> list[Path]:
        (folder / "text").write_text("a text", "utf-8")
        return [folder / "text"]

    calls = []

    def fail_after_the_first(paths: list[Path]) -> None:
        calls.append(paths)
        if len(calls) > 1:
            use(paths)

    if use is _use_memory:
        monkeypatch.setattr(cases, "MAX_MEGABYTES", 1.0)
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setitem(file_kinds.KINDS, "made", file_kinds.Kind("made", make, fail_after_the_first))
    failures = cases.run_cases("made", 0, 3).failures
    assert sorted(failures) == [0, 1, 2]
    assert all(message in failure for failure in failures.values())


def test_crash_is_detected_and_remaining_cases_run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    fake = tmp_path / "fake.py"
    fake.write_text(
        "import json, os, sys\n"
        "first, count = int(sys.argv[-3]), int(sys.argv[-1])\n"
        "for number in range(first, first + count):\n"
        "    print(number, flush=True)\n"
        "    if number == 4: os.abort()\n"
        "print(json.dumps({'count': count, 'refused': 1, 'failures': {}}))\n",
        "utf-8",
    )
    monkeypatch.setattr(mutations, "__file__", str(fake))
    result = mutations.run_in_process("device", 0, 8)
    assert list(result.failures) == [4]
    assert "the process ended with" in result.failures[4]
    assert result.count == 8


def test_campaign_resumes_and_prints_a_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    started = []

    def run(name: str, first: int, count: int, keep: Path | None) -> cases.ChunkResult:
        started.append(first)
        if len(started) == 3:
            raise KeyboardInterrupt
        return cases.ChunkResult(count, 10, {first: "a traceback"} if first == 250 else {}, 1.5, 120.0)

    monkeypatch.setattr(mutations, "run_in_process", run)
    with pytest.raises(KeyboardInterrupt):
        mutations.run_campaign(["device"], 0, 1000, out=tmp_path, keep=None, jobs=1)
    results = mutations.run_campaign(["device"], 0, 1000, out=tmp_path, keep=None, jobs=1)
    assert len(started) == 5
    assert len(set(started)) == 4
    assert results["device"].failures == {250: "a traceback"}
    assert mutations.format_table(results).splitlines()[1].split() == ["device", "1000", "40", "1", "1.5", "120"]


@pytest.mark.slow
def test_module_shows_its_options() -> None:
    command = [sys.executable, "-m", "benchmarks.robustness.mutations", "--help"]
    shown = subprocess.run(command, capture_output=True, text=True, check=True, cwd=Path(__file__).parents[2]).stdout
    assert "--keep" in shown
