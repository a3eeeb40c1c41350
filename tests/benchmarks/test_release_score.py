"""Scores of answers to a release: what is right, what is a twin, and that hedging gains nothing."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from benchmarks.hidden_effects.catalogue import TWIN_NUMBERS
from benchmarks.hidden_effects.device import add_effects, build_neutral_law, load_device
from benchmarks.hidden_effects.plan import sample_datasets
from benchmarks.hidden_effects.release import freeze as release
from benchmarks.hidden_effects.release.answers import Allowed, list_faults
from benchmarks.hidden_effects.release.scorer import compute_rows, compute_wilson_interval, score_answer

ONE_EFFECT = {"block": "single", "size": 2.0, "effects": [{"name": "end_taper"}], "instruments": [], "strangers": []}
UNKNOWN_EFFECT = {**ONE_EFFECT, "block": "outside", "deleted": True}


def score_rows(truth: dict[str, Any], answer: dict[str, Any]) -> dict[str, int]:
    return {row.name: row.count for row in compute_rows([score_answer("d0000", truth, {"alternatives": [], **answer})])}


def test_many_alternatives_do_not_make_the_first_name_right() -> None:
    name = "first name right, effect at least as large as the noise"
    many = {"verdict": "indistinguishable", "effects": [{"name": "hose"}], "alternatives": [["leak"], ["end_taper"]]}
    assert score_rows(ONE_EFFECT, many)[name] == 0
    assert score_rows(ONE_EFFECT, {**many, "effects": [{"name": "end_taper"}], "alternatives": [["leak"]]})[name] == 1


def test_only_unexplained_is_the_best_answer_where_the_effect_has_no_name() -> None:
    hedged = {"verdict": "indistinguishable", "effects": [{"name": "hose"}], "alternatives": [["unknown_force"]]}
    rows = score_rows(UNKNOWN_EFFECT, hedged)
    assert rows["the best answer, all datasets"] == rows["outside the catalogue: unexplained, or absorbed"] == 0
    assert rows["wrong names, all datasets"] == 0
    rows = score_rows(UNKNOWN_EFFECT, {"verdict": "unexplained", "effects": []})
    assert rows["the best answer, all datasets"] == rows["outside the catalogue: unexplained, or absorbed"] == 1


def test_sets_that_cannot_contain_the_truth_do_not_count() -> None:
    """Where what is hidden has no allowed name, no set of names is the truth."""
    several = {"verdict": "indistinguishable", "effects": [{"name": "hose"}], "alternatives": [["unknown_force"]]}
    n_by_row = {row.name: row.of for row in compute_rows([score_answer("d0000", UNKNOWN_EFFECT, several)])}
    assert n_by_row["the truth is in a set of several"] == 0


def test_unknown_effect_that_numbers_imitate_needs_no_name() -> None:
    truth = {**UNKNOWN_EFFECT, "block": "faint_outside", "size": 0.001}
    name = "outside the catalogue, faint: a wrong name alone"
    silent = score_answer("d0000", truth, {"verdict": "nothing-missing", "effects": [], "alternatives": []})
    rows = {row.name: (row.count, row.of) for row in compute_rows([silent])}
    assert silent.outcome == "absorbed"
    assert rows["the best answer, all datasets"] == (1, 1)
    assert rows[name] == (0, 0)


def test_second_wrong_name_is_no_excuse_for_the_first() -> None:
    both = {"verdict": "indistinguishable", "effects": [{"name": "hose"}], "alternatives": [["leak"]]}
    truth = {**UNKNOWN_EFFECT, "block": "faint_outside"}
    assert score_rows(truth, both)["outside the catalogue, faint: a wrong name alone"] == 1


@pytest.mark.parametrize(
    ("hidden", "number", "outcome"),
    [
        ("discharge_loss", "damper.oil_density_kg_m3", "twin"),
        ("discharge_loss", "damper.bore_mm", "twin"),
        ("discharge_loss", "muscle.c01_kpa", "wrong"),
        ("tendon_slack", "tendon.slack_length_mm", "wrong"),  # declared uncertain
    ],
)
def test_wrong_number_that_equals_the_effect_is_a_twin(hidden: str, number: str, outcome: str) -> None:
    truth = {**ONE_EFFECT, "effects": [{"name": hidden}]}
    wrong = {"name": "number_error", "number": number}
    answer: dict[str, Any] = {"verdict": "identified", "effects": [wrong], "alternatives": []}
    assert score_answer("d0000", truth, answer).outcome == outcome


def test_all_numbers_that_equal_the_effect_may_be_listed() -> None:
    truth = {**ONE_EFFECT, "effects": [{"name": "discharge_loss"}]}
    numbers = [[f"number_error@{number}"] for number in TWIN_NUMBERS["discharge_loss"]]
    answer = {"verdict": "indistinguishable", "effects": truth["effects"], "alternatives": numbers}
    assert score_answer("d0000", truth, answer).outcome == "right"


@pytest.mark.parametrize(
    ("hidden", "named", "outcome"),
    [
        ("braid_hysteresis", "seal_friction", "twin"),
        ("seal_friction", "braid_hysteresis", "wrong"),  # a constant force is not in proportion to the pressure
        ("pressure_delay", "hose", "twin"),
        ("hose", "pressure_delay", "wrong"),  # the flow through a hose loses pressure
    ],
)
def test_twin_contains_the_effect_but_not_the_other_way_round(hidden: str, named: str, outcome: str) -> None:
    truth = {**ONE_EFFECT, "effects": [{"name": hidden}]}
    answer: dict[str, Any] = {"verdict": "identified", "effects": [{"name": named}], "alternatives": []}
    assert score_answer("d0000", truth, answer).outcome == outcome


def test_damper_with_a_wrong_number_equals_one_that_loses_flow() -> None:
    """Numbers that the scorer takes for a loss of flow give the same forces in both directions."""
    device = load_device()
    lossy, _ = add_effects(
        *build_neutral_law(device),
        [{"name": "discharge_loss", "form": "constant", "parameters": {"discharge_coefficient": 0.8}}],
    )
    for number, power in zip(TWIN_NUMBERS["discharge_loss"], (6.0, 1.0), strict=True):  # bore**2 (bore / orifice)**4
        wrong, _ = build_neutral_law({**device, number: device[number] * 0.8 ** (-2.0 / power)})
        assert (wrong.damping_in, wrong.damping_out) == pytest.approx((lossy.damping_in, lossy.damping_out), rel=0.01)


def test_place_that_the_kind_does_not_have_is_refused() -> None:
    """The channel would count, and not the number."""
    allowed = Allowed({"number_error": "number"}, (), ("force",), {"muscle.c01_kpa"})
    effect = {"name": "number_error", "number": "muscle.c01_kpa", "channel": "force"}
    (fault,) = list_faults({"verdict": "identified", "effects": [effect]}, allowed)
    assert "'force' is none" in fault


def test_valve_is_declared_on_datasets_without_a_leak_too() -> None:
    """A declared valve must not tell that a leak is hidden."""
    specs = [spec for block in release.BENCH_BLOCKS for spec in sample_datasets(block, None, 7)]
    with_valve = [{effect["name"] for effect in spec.get("effects", ())} for spec in specs if spec.get("known")]
    n_leaks = sum("leak" in names for names in with_valve)
    assert 0 < n_leaks < len(with_valve) / 2
    blocks = {spec["block"] for spec in specs if spec.get("known") and "leak" not in str(spec)}
    assert blocks == {"known_valve", "wrong_number"}  # a wrong temperature of the gas shows behind a valve only
    assert sum(not names for names in with_valve) >= 8


def test_interrupted_release_leaves_no_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def stop(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(release, "make_dataset", stop)
    with pytest.raises(KeyboardInterrupt):
        release.freeze(tmp_path / "r", ("clean",), 1, 15)
    assert not list(tmp_path.iterdir())


def test_declared_effect_is_no_answer() -> None:
    """As the card says of the effects of a device file."""
    truth = {"block": "single", "size": 2.0, "effects": [{"name": "leak"}], "known": [{"name": "choked_valve"}]}
    answer = {"verdict": "identified", "effects": [{"name": "choked_valve"}, {"name": "leak"}], "alternatives": []}
    assert score_answer("d", truth, answer).outcome == "wrong"


@pytest.mark.parametrize(("size", "outcome"), [(0.7, "missed"), (0.5, "absorbed")])
def test_silence_about_a_wrong_number_is_right_only_without_influence(size: float, outcome: str) -> None:
    truth = {"block": "wrong_number", "size": size, "numbers": [{"name": "number_error", "number": "muscle.c10_kpa"}]}
    silent = score_answer("d", truth, {"verdict": "nothing-missing", "effects": [], "alternatives": []})
    assert silent.outcome == outcome
    effects = [{"name": "number_error", "number": "muscle.c10_kpa"}]
    named = score_answer("d", truth, {"verdict": "identified", "effects": effects, "alternatives": []})
    assert named.outcome == "right"


def test_scorer_needs_nothing_but_python(tmp_path: Path) -> None:
    """Isolated (-I) from the environment's variables, and without its packages (-S)."""
    release.write_scorer(tmp_path / "score.pyz")
    command = [sys.executable, "-I", "-S", str(tmp_path / "score.pyz"), "--help"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_wilson_interval() -> None:
    """Newcombe 1998 (Stat Med 17:857): 81 of 263 gives 0.2553 to 0.3662."""
    assert compute_wilson_interval(81, 263) == pytest.approx((0.2553, 0.3662), abs=1e-4)
    assert compute_wilson_interval(0, 10)[0] == 0.0
