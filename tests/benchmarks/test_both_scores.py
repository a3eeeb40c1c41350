"""The table of our own page and that of the released scorer have one rule: both score the archived verdicts."""

import json
import shutil
from pathlib import Path

import pytest
from benchmarks.hidden_effects.archive import find_verdicts
from benchmarks.hidden_effects.metrics import DatasetResult, compute_metrics
from benchmarks.hidden_effects.release.freeze import BENCH_BLOCKS
from benchmarks.hidden_effects.release.scorer import ScoredAnswer, compute_rows, score_answer
from benchmarks.hidden_effects.score import score_verdict

RESULTS = Path(__file__).parents[2] / "benchmarks" / "hidden_effects" / "results"
ROWS = {
    "exact set, pairs": "exact set, two effects",
    "exact set, singles at least as large as the noise": "exact set, one effect",
    "exact set, triples": "exact set, three effects",
    "false alarms on clean data": "an effect is named in clean data",
    "first name right, effect at least as large as the noise": (
        "first name right, effect at least as large as the noise"
    ),
    "imperfect law: names right": "imperfect law: names right",
    "imperfect law: a name without an effect": "imperfect law: a name without an effect",
    "indistinguishable sets contain the truth": "the truth is in a set of several",
    "outside the catalogue at 2 and 0.7 times the noise: a wrong name alone": (
        "outside the catalogue, faint: a wrong name alone"
    ),
    "a form outside the catalogue at 8, 2 and 0.7 times the noise: a wrong name alone": (
        "a form outside the catalogue: a wrong name alone"
    ),
    "wrong name, all blocks of the bench": "wrong names, all datasets",
    "wrong number: a wrong name alone": "wrong number: a wrong name alone",
    "wrong number: named, in the indistinguishable set, or without influence": (
        "wrong number: in a set, or without influence"
    ),
}
"""Row of our page -> row of the released scorer that counts the same."""


@pytest.fixture(scope="module", params=[1313, 909, 9797])
def scores(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[list, list]:
    """Results of the released blocks of one archive, scored both ways; an answer has nothing but verdict and names."""
    folder = tmp_path_factory.mktemp("archive")
    shutil.unpack_archive(RESULTS / f"test_{request.param}.tar.xz", folder)
    results: list[DatasetResult] = []
    answers: list[ScoredAnswer] = []
    for name, file in find_verdicts(folder).items():
        truth = json.loads((folder / f"{name}.truth.json").read_text("utf-8"))
        if truth["block"] in BENCH_BLOCKS:
            verdict = json.loads(file.read_text("utf-8"))
            results.append(DatasetResult(name, truth, verdict, score_verdict(truth, verdict)))
            names = [{key: effect.get(key) for key in ("name", "channel", "number")} for effect in verdict["effects"]]
            answer = {"verdict": verdict["verdict"], "effects": names, "alternatives": verdict["alternatives"]}
            answers.append(score_answer(name, truth, answer))
    return results, answers


def test_every_outcome_is_the_same(scores: tuple[list, list]) -> None:
    results, answers = scores
    assert len(results) > 30
    assert {row.name: row.outcome for row in results} == {answer.name: answer.outcome for answer in answers}


def test_rows_that_count_the_same_agree(scores: tuple[list, list]) -> None:
    results, answers = scores
    metrics = {metric.name: metric for metric in compute_metrics(results)}
    rows = {row.name: row for row in compute_rows(answers)}
    for name, released in ROWS.items():
        assert metrics[name].n == rows[released].of, name
        assert round((metrics[name].value or 0.0) * metrics[name].n) == rows[released].count, name
