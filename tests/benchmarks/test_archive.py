"""Test the archive of a run, and the score of stored results."""

import json
import shutil
import tarfile
from pathlib import Path

import pytest
from benchmarks.hidden_effects.archive import find_verdicts, write_archive
from benchmarks.hidden_effects.calibrate import load_rows
from benchmarks.hidden_effects.plan import plan_datasets
from benchmarks.hidden_effects.run import BenchmarkRun, compute_code_digest

CODE, OTHER_CODE = "0123456789ab", "ba9876543210"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A run whose first clean dataset has a verdict of klute-sim and one of another method."""
    truth = {"block": "clean", "effects": [], "instruments": [], "strangers": [], "size": 0.0}
    answer = {"verdict": "nothing-missing", "effects": [], "alternatives": [], "gap": {}}
    (tmp_path / "results").mkdir()
    (tmp_path / "clean_909_000.truth.json").write_text(json.dumps(truth))
    (tmp_path / f"results/clean_909_000_{CODE}.json").write_text(json.dumps(answer))
    (tmp_path / f"results/clean_909_000_plain_bic_{CODE}.json").write_text(json.dumps(answer))
    return tmp_path


def test_unpacked_archive_has_the_same_score(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    archive, copy = folder / "run.tar.xz", tmp_path_factory.mktemp("copy")
    assert write_archive(folder, archive) == 2
    with tarfile.open(archive) as tar:
        assert sorted(tar.getnames()) == ["clean_909_000.truth.json", f"results/clean_909_000_{CODE}.json"]
    shutil.unpack_archive(archive, copy)
    first, second = plan_datasets("clean", 2, 909)
    row = BenchmarkRun(copy, 1, {}).load_finished(first)
    assert row == BenchmarkRun(folder, 1, {}).load_finished(first)
    assert row is not None
    assert row.outcome == "right"
    assert BenchmarkRun(copy, 1, {}).load_finished(second) is None
    assert compute_code_digest() != CODE  # a result of any code is scored


def test_results_of_two_codes_are_refused(folder: Path) -> None:
    (folder / f"results/clean_909_000_{OTHER_CODE}.json").write_text("{}")
    with pytest.raises(ValueError, match="2 codes"):
        BenchmarkRun(folder, 1, {}).load_finished(plan_datasets("clean", 1, 909)[0])
    with pytest.raises(ValueError, match="several codes"):
        load_rows(folder, [909])


def test_follow_ups_and_other_methods_are_no_verdicts(folder: Path) -> None:
    (folder / f"results/clean_909_000_second_{CODE}.json").write_text("{}")
    assert find_verdicts(folder) == {"clean_909_000": folder / f"results/clean_909_000_{CODE}.json"}
    assert len(load_rows(folder, [909])) == 1
