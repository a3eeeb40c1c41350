"""Through the whole source: nothing is left out, and what moves comes out as it should."""

import numpy as np
import pytest

from klute_sim.device.device import load_device
from klute_sim.errors import InputError
from klute_sim.reproduction import printed
from klute_sim.reproduction.chapters import (
    chapter2,
    chapter3,
    chapter3_dynamic,
    chapter4,
    chapter7,
    chapter8,
    chapter56,
)
from klute_sim.reproduction.item import assess
from klute_sim.reproduction.run import Reproduction, run_reproduction

PAIR = load_device("klute-3-4-pair")
EXPERIMENTS = (
    *(".r2", "fig-2.6.cat", "fig-2.7.", "table-2.1.rat", "fig-3.3.ratio", "fig-3.5.fit", "fig-3.7.ripple"),
    "figs-6.3-6.4.repeats",
)
"""Printed, but about measured points that are not."""


@pytest.fixture(scope="module")
def found() -> Reproduction:
    return run_reproduction(PAIR)


def test_every_printed_item_is_compared(found: Reproduction) -> None:
    assert [o.item.id for o in found.assessments] == [item.id for item in printed.list_items()]
    compared = [o for o in found.assessments if o.verdict != "not-printed"]
    assert len(compared) >= 60
    worth = [o for o in compared if not o.item.is_input]
    assert len(worth) >= 60  # besides what is taken over as it is
    left = {o.item.id for o in found.assessments if o.item.published is not None} - {o.item.id for o in compared}
    assert left == {name for name in left if any(part in name for part in EXPERIMENTS)}
    lost = [o for o in found.assessments if o.item.published is None]
    assert all(o.verdict == "not-printed" for o in lost)
    assert len([o for o in lost if o.finding.value is not None]) >= 60  # computed from what is assumed


def test_nothing_is_computed_that_nobody_asked_for(found: Reproduction) -> None:
    chapters = [
        *(chapter.compute() for chapter in (chapter2, chapter3, chapter3_dynamic)),
        *(chapter.compute(PAIR) for chapter in (chapter4, chapter56, chapter7)),
    ]
    computed = set().union(*(chapter.findings for chapter in chapters))
    asked = {o.item.id for o in found.assessments}
    assert computed <= asked
    assert {name for name in asked - computed if not name.startswith(("table-8", "timing", "figs-8"))} == set()


def test_the_verdicts_on_what_was_measured(found: Reproduction) -> None:
    by = {o.item.id: o for o in found.assessments}
    assert [o.item.id for o in found.assessments if o.item.is_measured] == [
        "fig-3.4.geometric",
        "fig-3.4.bladder",
        "fig-3.9.slow",
        "fig-3.9.fast",
        "fig-3.9.loss",
    ]
    assert by["fig-3.9.slow"].finding.value == pytest.approx(736.0, abs=1.0)
    assert by["fig-3.9.slow"].verdict == "agrees"
    assert by["fig-3.9.fast"].finding.value == pytest.approx(736.0, abs=1.0)  # the law has no velocity in the muscle
    assert by["fig-3.9.fast"].verdict == by["fig-3.9.loss"].verdict == "contradicts-source"
    # It holds for the model, and the same source's Fig. 3.9 says that it does not for the actuator.
    assert by["fig-3.7.velocity"].finding.holds
    assert by["fig-3.7.velocity"].verdict == "source-contradicts-itself"
    wrong = {o.item.id for o in found.assessments if o.verdict == "contradicts-source"}
    assert wrong == {"fig-3.9.fast", "fig-3.9.loss", "fig-4.12.near"}
    assert all(not item["note"].startswith(" ") for item in found.to_records())


def test_the_claims_about_the_unit_and_its_work_hold(found: Reproduction) -> None:
    by = {o.item.id: o for o in found.assessments}
    for name in ("pressure", "shortening", "lengthening", "length"):
        assert by[f"figs-7.4-7.5.{name}"].verdict == "agrees", name
    assert by["fig-7.6.lengths"].verdict == by["timing.timing"].verdict == by["figs-8.1-8.4.square"].verdict == "agrees"
    for table, sign in (("table-8.1", 1.0), ("table-8.2", -1.0)):
        work = [o.finding.value for o in found.assessments if o.item.id.startswith(f"{table}.p")]
        assert len(work) == 16
        assert all(value is not None and sign * value > 0.0 for value in work)
        assert by[f"{table}.grows"].verdict == by[f"{table}.velocity"].verdict == "agrees"


def test_pictures_are_there_and_finite(found: Reproduction) -> None:
    numbers = [picture.number for picture in found.figures]
    assert len(numbers) == len(set(numbers)) >= 22
    for picture in found.figures:
        values = [line.y for line in picture.lines] + ([picture.surface.z] if picture.surface else [])
        assert values
        assert all(np.isfinite(value).all() for value in values), picture.number


def test_a_supplied_number_is_compared(found: Reproduction) -> None:
    computed = next(o for o in found.assessments if o.item.id == "table-8.1.p5-v100").finding
    assert computed.value is not None
    for given, verdict in ((1.05 * computed.value, "agrees"), (1.2 * computed.value, "contradicts-source")):
        supplied = printed.list_items({"table-8.1.p5-v100": given})
        item = next(item for item in supplied if item.id == "table-8.1.p5-v100")
        assert assess(item, computed).verdict == verdict


@pytest.mark.parametrize("name", ["klute-3-4", "klute-1-1-4"])
def test_a_bare_muscle_is_no_unit(name: str) -> None:
    with pytest.raises(InputError, match=r"has no (damper|tendon), which chapter"):
        run_reproduction(load_device(name))


def test_chapter_8_is_the_bench_s_own_protocol() -> None:
    assert chapter8.compute(PAIR).findings["table-8.1.p5-v200"].value == pytest.approx(15.8, abs=0.2)
