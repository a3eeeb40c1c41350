"""Tests of the computed findings of the chapters: known values, and detection of wrong constants."""

import numpy as np
import pytest

from klute_sim.device.device import load_device
from klute_sim.errors import InputError
from klute_sim.laws import hill_tables as tables
from klute_sim.laws.damper import DamperParameters
from klute_sim.laws.hill import ParallelElement
from klute_sim.reproduction import printed
from klute_sim.reproduction.assumptions import make_bench_metrics, perturb_assumptions
from klute_sim.reproduction.chapters import chapter2, chapter3, chapter4, chapter56
from klute_sim.reproduction.curves import ChapterResult
from klute_sim.reproduction.implied_values import compute_implied_values
from klute_sim.reproduction.item import ItemAssessment, assess


def assess_chapter(chapter: ChapterResult) -> dict[str, ItemAssessment]:
    implied, assessments = compute_implied_values(), chapter.findings
    return {
        item.id: assess(item, assessments[item.id], implied.get(item.id))
        for item in printed.list_items()
        if item.id in assessments
    }


def test_chapter_2_recovers_constants_and_contradictions() -> None:
    assessments = assess_chapter(chapter2.compute())
    assert set(assessments) == set(chapter2.compute().findings)
    constants = [
        o
        for o in assessments.values()
        if isinstance(o.item.published, float) and not o.item.id.endswith((".r2", ".fit"))
    ]
    assert len([o for o in constants if o.verdict == "agrees"]) >= 70
    contradictions = {o.item.id for o in assessments.values() if o.verdict != "agrees" and o.verdict != "not-printed"}
    assert contradictions == {
        "table-2.1.insignificant",
        "table-2.3.frog.at-rest",  # 1.02, and the rounding of its constants allows 0.015
        "table-2.3.human.at-rest",
        "table-2.4.rat.at-vmax",
        "table-2.4.frog.at-vmax",
        "table-2.4.cat.at-vmax",
        "table-2.4.bobbert_1986.at-vmax",
        "table-2.4.order",
        "eq-2.5.around",
    }
    assert all(assessments[name].verdict == "source-contradicts-itself" for name in contradictions)


def test_wrong_constant_contradicts_source(monkeypatch: pytest.MonkeyPatch) -> None:
    row = tables.PARALLEL_ELEMENTS["frog"]._replace(constants=ParallelElement(0.0006, 20.36))
    monkeypatch.setitem(tables.PARALLEL_ELEMENTS, "frog", row)
    assessments = assess_chapter(chapter2.compute())
    assert assessments["table-2.1.frog.k2"].verdict == "contradicts-source"
    assert assessments["table-2.1.cat.k2"].verdict == "agrees"


def test_error_of_model_is_not_attributed_to_source(monkeypatch: pytest.MonkeyPatch) -> None:
    row = tables.CONTRACTILE_ELEMENTS["human"]
    assert assess_chapter(chapter2.compute())["table-2.3.human.at-rest"].verdict == "source-contradicts-itself"
    monkeypatch.setitem(tables.CONTRACTILE_ELEMENTS, "human", row._replace(constants=row.constants._replace(k7=-13.5)))
    assessments = assess_chapter(chapter2.compute())
    assert (
        assessments["table-2.3.human.at-rest"].verdict == "contradicts-source"
    )  # 1.30, where the source's constants say 0.84
    assert assessments["table-2.3.human.k7"].verdict == "contradicts-source"


def test_implied_values_of_source() -> None:
    assessments = compute_implied_values()
    assert assessments["table-2.3.human.at-rest"] == pytest.approx(0.84)
    assert assessments["table-2.4.cat.at-vmax"] == pytest.approx(0.0231, abs=1e-4)
    assert assessments["table-2.4.human.at-vmax"] == pytest.approx(0.0)
    assert assessments["table-3.1.1-1-4.radius"] == pytest.approx(8.93, abs=0.005)
    assert assessments["fig-3.4.bladder"] == pytest.approx(394.3)
    statements = {name: holds for name, holds in assessments.items() if isinstance(holds, bool)}
    assert not any(statements.values())
    assert statements.keys() == {"table-2.4.order", "eq-2.5.around"}
    assert assessments["table-2.1.insignificant"] == pytest.approx(0.334, abs=5e-4)
    assert assessments["fig-3.4.proportional"] == pytest.approx(1.418, abs=5e-4)
    assert assessments["fig-3.7.velocity"] == pytest.approx(5.99, abs=0.005)


def test_chapter_3_recovers_table_3_1_and_fig_3_4() -> None:
    assessments = assess_chapter(chapter3.compute())
    assert all(
        o.verdict == "agrees"
        for name, o in assessments.items()
        if name.startswith("table-3.1") and "radius" not in name and o.item.published is not None
    )
    assert [assessments[f"table-3.1.{size}.radius"].verdict for size in ("1-1-4", "3-4", "1-2")] == [
        "source-contradicts-itself",
        "agrees",
        "agrees",
    ]
    assert assessments["fig-3.4.bladder"].finding.value == pytest.approx(394.3, abs=0.1)
    assert assessments["fig-3.4.geometric"].finding.value == pytest.approx(394.3 + 263.0, rel=0.02)
    assert assessments["fig-3.4.difference"].verdict == "agrees"
    for name in ("geometric", "bladder", "everywhere", "proportional"):
        assert assessments[f"fig-3.4.{name}"].verdict == "source-contradicts-itself", name
    for letter in "abc":
        assert assessments[f"fig-3.6.2.5{letter}"].verdict == "source-contradicts-itself"
    assert assessments["fig-3.6.2.5a"].finding.value > 0.0  # hollow, where muscle's curve is domed
    assert assessments["fig-3.6.stop"].verdict == assessments["fig-3.8.twice"].verdict == "agrees"
    assert assessments["fig-3.6.first-order"].verdict == "agrees"
    assert not chapter3.check_first_order(np.full(len(chapter3.COMMON_LENGTH_RATIOS), 0.8)).holds
    assert not chapter3.check_first_order(5.0 * chapter3.COMMON_LENGTH_RATIOS).holds
    assert assessments["table-3.1.3-4.turns-round"].finding.value == pytest.approx(1.36, abs=0.005)
    assert assessments["table-3.1.1-1-4.empty"].finding.value == pytest.approx(109.8)


def test_chapter_4_requires_variable_orifice() -> None:
    device = load_device("klute-3-4-pair")
    assessments = assess_chapter(chapter4.compute(device))
    assert assessments["fig-4.3.required-100"].finding.value == pytest.approx(1.084, rel=0.005)  # the design point
    assert assessments["fig-4.3.varies"].finding.value > 2.0
    assert assessments["fig-4.8.exponent"].finding.value == pytest.approx(2.0)
    assert assessments["eq-4.loss"].finding.value == pytest.approx(2.69, abs=0.005)
    assert assessments["figs-4.10-4.11.passive"].verdict == assessments["fig-4.9.stop"].verdict == "agrees"
    assert assessments["fig-4.12.ideal"].finding.value == pytest.approx(0.0, abs=1e-12)
    assert assessments["fig-4.12.fixed"].finding.value < assessments["fig-4.12.alone"].finding.value
    assert assessments["fig-4.12.best"].finding.value < assessments["fig-4.12.fixed"].finding.value
    # 0.56 of the error is left: not near, by the measure that stands with it.
    assert assessments["fig-4.12.near"].verdict == "contradicts-source"
    wide_orifices = device.with_changes(
        {f"damper.orifice_{direction}_mm": 10.0 for direction in ("concentric", "eccentric")}, "test"
    )
    assert assess_chapter(chapter4.compute(wide_orifices))["fig-4.12.near"].finding.value == pytest.approx(
        1.0, abs=1e-3
    )
    assert chapter4.check_passivity(DamperParameters(1e4, 1e4)).value == 0.0
    assert (chapter4.check_passivity(DamperParameters(1e4, -1e4)).value or 0.0) > 0.0
    assert (chapter4.check_passivity(DamperParameters(-1e4, 1e4)).value or 0.0) > 0.0
    with pytest.raises(InputError, match="has no damper"):
        chapter4.compute(load_device("klute-3-4"))


def test_tendon_is_bilinear() -> None:
    assessments = assess_chapter(chapter56.compute(load_device("klute-3-4-pair")))
    for name in ("figs-6.3-6.4.linear-a", "figs-6.3-6.4.linear-b", "figs-6.3-6.4.bilinear", "figs-6.1-6.2.offset"):
        assert assessments[name].verdict == "agrees", name
    assert assessments["figs-6.1-6.2.offset"].finding.value == pytest.approx(5.0)
    assert assessments["figs-6.3-6.4.bilinear"].finding.value == pytest.approx(200.0 / 60.0)
    single_spring_device = load_device("klute-3-4-pair").with_changes({"tendon.stiffness_2_n_per_mm": 0.0}, "test")
    single_spring = assess_chapter(chapter56.compute(single_spring_device))
    assert single_spring["figs-6.1-6.2.offset"].verdict == "contradicts-source"
    assert single_spring["figs-6.1-6.2.offset"].finding.value is None
    with pytest.raises(InputError, match="has no tendon"):
        chapter56.compute(load_device("klute-3-4"))


def test_figures_have_finite_numbers() -> None:
    pair = load_device("klute-3-4-pair")
    for chapter in (chapter2.compute(), chapter3.compute(), chapter4.compute(pair), chapter56.compute(pair)):
        for figure in chapter.figures:
            assert figure.lines or figure.surface
            for line in figure.lines:
                assert line.x.shape == line.y.shape
                assert np.isfinite(line.y).all(), figure.number
            if figure.surface:
                assert figure.surface.z.shape == (len(figure.surface.y), len(figure.surface.x))


def test_influence_of_assumed_numbers() -> None:
    device = load_device("klute-3-4-pair")
    assessments = {row.key: row for row in perturb_assumptions(device, make_bench_metrics(device))}
    assert set(assessments) == set(device.spec.collect_assumptions())
    assert not any(row.reason.startswith("assumed") for row in assessments.values())
    nominal = make_bench_metrics(device)(device)
    assert nominal["net work of a cycle"] > 5.0  # pressure while shortening: the device works
    assert nominal["isometric force"] == pytest.approx(1472.0, rel=0.01)
    assert nominal["force shortening at 300 mm/s"] < nominal["isometric force"]
    assert nominal["force lengthening at 150 mm/s"] > nominal["isometric force"]
    wider_orifice = assessments["damper.orifice_concentric_mm"].relative_changes
    assert wider_orifice["force shortening at 300 mm/s"] > 0.05  # a wider orifice takes less
    assert wider_orifice["isometric force"] == pytest.approx(0.0, abs=1e-6)
    assert wider_orifice["force lengthening at 150 mm/s"] == pytest.approx(0.0, abs=1e-6)
    assert assessments["damper.orifice_eccentric_mm"].relative_changes["force lengthening at 150 mm/s"] < -0.02
    assert assessments["supply.gas_temperature_c"].relative_changes["air in the muscle"] == pytest.approx(
        293.15 / 303.15 - 1.0
    )
    assert assessments["tendon.slack_length_mm"].relative_changes["isometric force"] < -0.05  # the muscle hangs shorter
    mounting = assessments["mounting.neutral_muscle_ratio"]
    assert mounting.perturbed_value < mounting.value  # it cannot be larger by that much
    assert not any(mounting.relative_changes.values())


def test_bare_muscle_has_assumptions() -> None:
    device = load_device("klute-1-2")
    assessments = {row.key: row for row in perturb_assumptions(device, make_bench_metrics(device))}
    assert assessments["supply.rate_bar_per_s"].relative_changes["time to 90 % of force"] < -0.05
