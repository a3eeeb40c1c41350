"""docs/effects: a page for every effect, which says what the catalogue says and what the laws do."""

import csv
import json
import re
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from klute_sim.device.device import load_device
from klute_sim.diagnosis.planning.proposals import RIG_CHANGES
from klute_sim.effects import catalogue
from tests import load_script as scripts

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "docs" / "effects"
AGAIN = "run `python scripts/effect_pages.py docs/effects`"
LARGEST = 60 * 1024
"""Bytes of a picture of an effect."""


@pytest.fixture(scope="module")
def script() -> ModuleType:
    return scripts.script("effect_pages")


@pytest.fixture(scope="module")
def data() -> dict[str, Any]:
    found: dict[str, Any] = json.loads((FOLDER / "confusable.json").read_text("utf-8"))
    return found


def test_every_effect_has_its_page_and_none_is_left_over() -> None:
    pages = {page.stem for page in FOLDER.glob("*.md")} - {"README"}
    assert pages == set(catalogue.get_effects()), AGAIN


def test_the_numbers_are_of_these_laws(script: ModuleType, data: dict[str, Any]) -> None:
    assert data["digest"] == script.digest(), f"a law has changed since docs/effects was written: {AGAIN}"


def test_the_pages_are_what_would_be_written(script: ModuleType, data: dict[str, Any]) -> None:
    for name, text in script.pages(data).items():
        assert (FOLDER / name).read_text("utf-8") == text, f"docs/effects/{name} is old: {AGAIN}"


def test_every_form_has_a_picture_that_is_small() -> None:
    pictures = {path.name: path.stat().st_size for path in (FOLDER / "pictures").iterdir()}
    matrices = {f"matrix_{k}.png" for k in range(len(RIG_CHANGES))}
    drawn = [effect for effect in catalogue.get_effects().values() if effect.kind != "body"]
    forms = {f"{effect.name}_{form.name}.png" for effect in drawn for form in effect.forms}
    assert set(pictures) == forms | matrices, AGAIN
    assert max(pictures[name] for name in forms) < LARGEST


def test_the_matrices_hold_every_effect_on_every_rig(data: dict[str, Any]) -> None:
    own = load_device(data["device"]).spec.muscle
    told = [e for e in catalogue.get_named_effects().values() if e.kind != "body"]
    whole = [e for e in told if not (e.replaces_switch and getattr(own, e.replaces_switch))]
    for number, change in enumerate(RIG_CHANGES):
        with (FOLDER / f"matrix_{number}.csv").open(encoding="utf-8") as file:
            (words, *names), *lines = csv.reader(file)
        assert words == change.description
        assert [line[0] for line in lines] == names
        assert [line[k + 1] for k, line in enumerate(lines)] == ["1.000"] * len(names)
        assert {name.split()[0] for name in names} == {effect.name for effect in whole}, AGAIN


def test_each_class_has_the_change_that_splits_it(data: dict[str, Any]) -> None:
    changes = {change.description for change in RIG_CHANGES[1:]}
    assert data["classes"]
    for group in data["classes"]:
        assert group["size"] == len(group["effects"]) >= 2
        assert group["cosine"] >= 0.95
        assert (group["split_by"] in changes) == (group["cosine_then"] < 0.95)
    # What the base model has is compared on another device.
    rows = [row for row in data["effects"] if not catalogue.get_effects()[row["effect"]].replaces_switch]
    grouped = {name for group in data["classes"] for name in group["effects"]}
    assert {pair["effect"] for row in rows for pair in row["alike"]} == grouped


def test_the_digest_is_of_code_and_not_of_words(script: ModuleType) -> None:
    source = (ROOT / "src" / "klute_sim" / "effects" / "supply.py").read_text("utf-8")

    def code(text: str) -> str:
        return str(script._code(script.ast.parse(text)))

    said = re.sub('"""Pressure .*?"""', '"""Another sentence."""', source).replace("assumed: a few", "assumed: some")
    assert said != source
    assert code(f"# A remark.\n{said}") == code(source)
    for old, new in (
        ("own[0] * command", "own[0] + command"),
        ("typical=0.04", "typical=0.05"),
        ("_reached", "_target"),
    ):
        assert old in source
        assert code(source.replace(old, new)) != code(source)


@pytest.mark.long
def test_written_again_all_is_the_same(script: ModuleType, data: dict[str, Any], tmp_path: Path) -> None:
    script.write(tmp_path)
    again = json.loads((tmp_path / "confusable.json").read_text("utf-8"))
    assert sorted(path.name for path in tmp_path.rglob("*")) == sorted(path.name for path in FOLDER.rglob("*"))
    assert {key: again[key] for key in ("digest", "device", "shown_in")} == {
        key: data[key] for key in ("digest", "device", "shown_in")
    }
    for key in ("classes", "effects"):
        assert len(again[key]) == len(data[key])
        for new, old in zip(again[key], data[key], strict=True):
            assert_alike(new, old)


def assert_alike(new: Any, old: Any) -> None:
    """Equal, numbers within what is lost by rounding."""
    assert type(new) is type(old)
    if isinstance(new, dict):
        assert new.keys() == old.keys()
        for key in new:
            assert_alike(new[key], old[key])
    elif isinstance(new, list):
        assert len(new) == len(old)
        for each, other in zip(new, old, strict=True):
            assert_alike(each, other)
    elif isinstance(new, float):
        assert new == pytest.approx(old, rel=0.01, abs=0.002)
    else:
        assert new == old
