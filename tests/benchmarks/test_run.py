"""Test the order in which a run of the benchmark works."""

import json
import subprocess
from collections import Counter
from pathlib import Path

import pytest
from benchmarks.hidden_effects import run
from benchmarks.hidden_effects.metrics import compute_metrics
from benchmarks.hidden_effects.page import render_page
from benchmarks.hidden_effects.plan import BLOCK_SIZES, TARGET_SIZES
from benchmarks.hidden_effects.run import BenchmarkRun, main, plan_run

BLOCKS = ("clean", "single", "pair", "defective")


@pytest.mark.parametrize("done", [0.1, 0.5, 0.9])
def test_interrupted_run_has_the_same_share_of_every_block(done: float) -> None:
    specs = plan_run(BLOCKS, None, seed=1)
    finished = Counter(spec["block"] for spec in specs[: round(done * len(specs))])
    for block in BLOCKS:
        assert finished[block] == pytest.approx(done * BLOCK_SIZES[block], abs=1)


def test_interrupted_run_samples_the_effects_of_a_block() -> None:
    """The datasets of a block are ordered by effect and size: in order, one seed after another would see the first."""
    plan = plan_run(("single",), None, seed=1)
    beginning = plan[:30]
    assert len({effect["name"] for spec in beginning for effect in spec["effects"]}) > 12
    assert {effect["wanted"] for spec in beginning for effect in spec["effects"]} == set(TARGET_SIZES)
    other = [spec["name"].rsplit("_", 1)[1] for spec in plan_run(("single",), None, seed=2)[:30]]
    assert other != [spec["name"].rsplit("_", 1)[1] for spec in beginning]


def test_shards_are_the_whole_run() -> None:
    names = [spec["name"] for spec in plan_run(BLOCKS, None, seed=1)]
    shards = [spec["name"] for part in "12" for spec in plan_run(BLOCKS, None, seed=1, shard=f"{part}/2")]
    assert sorted(shards) == sorted(names) == sorted(set(names))


@pytest.mark.parametrize("shard", ["0/4", "5/4", "1", "a/2"])
def test_impossible_shard_is_refused(shard: str) -> None:
    with pytest.raises(ValueError, match="I from 1 to N"):
        plan_run(BLOCKS, None, seed=1, shard=shard)


def test_folder_without_results_is_refused_with_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["run", str(tmp_path), "--seed", "77", "78", "--finished"])
    with pytest.raises(SystemExit):
        main()
    assert "has no result of seed 77, 78 in these blocks" in capsys.readouterr().err


def test_crash_of_the_program_is_an_outcome_and_ends_no_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The next run tries the dataset again, so nothing is stored."""
    crash = subprocess.CompletedProcess([], -11, "", "Segmentation fault")
    monkeypatch.setattr(run, "run_measured", lambda command: (crash, 2.0, 1.5))
    truth = {"block": "clean", "effects": [], "instruments": [], "strangers": [], "size": 0.0}
    spec = plan_run(("clean",), 1, seed=1)[0]
    (tmp_path / f"{spec['name']}.truth.json").write_text(json.dumps(truth))
    row, others = BenchmarkRun(tmp_path, 1, {}).process_dataset(spec)
    assert (row.outcome, others) == ("failed", {})
    assert list((tmp_path / "results").iterdir()) == []
    alarms = next(one for one in compute_metrics([row]) if one.name == "false alarms on clean data")
    assert (alarms.value, alarms.n) == (0.0, 1)
    assert "| failed | Segmentation fault |" in render_page([row], {}, {})
    assert run.score_verdict({**truth, "defect": "dead_channel"}, row.verdict) == "failed"
