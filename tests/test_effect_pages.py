"""Tests of docs/effects: each effect has a page that matches the catalogue and the laws."""

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
from tests.load_script import load_script

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "docs" / "effects"
HOW_TO_UPDATE = "run `python scripts/effect_pages.py docs/effects`"
MAX_FIGURE_BYTES = 60 * 1024
"""Largest size of a figure of an effect [bytes]."""


@pytest.fixture(scope="module")
def script() -> ModuleType:
    return load_script("effect_pages")


@pytest.fixture(scope="module")
def data() -> dict[str, Any]:
    data: dict[str, Any] = json.loads((FOLDER / "confusable.json").read_text("utf-8"))
    return data


def test_each_effect_has_one_page() -> None:
    pages = {page.stem for page in FOLDER.glob("*.md")} - {"README"}
    assert pages == set(catalogue.get_effects()), HOW_TO_UPDATE


def test_digest_matches_code(script: ModuleType, data: dict[str, Any]) -> None:
    assert data["digest"] == script.compute_digest(), (
        f"the code has changed since docs/effects was written: {HOW_TO_UPDATE}"
    )


def test_pages_are_current(script: ModuleType, data: dict[str, Any]) -> None:
    for name, text in script.render_pages(data).items():
        assert (FOLDER / name).read_text("utf-8") == text, f"docs/effects/{name} is outdated: {HOW_TO_UPDATE}"


def test_each_form_has_a_small_figure() -> None:
    pictures = {path.name: path.stat().st_size for path in (FOLDER / "pictures").iterdir()}
    matrices = {f"matrix_{k}.png" for k in range(len(RIG_CHANGES))}
    drawn_effects = [effect for effect in catalogue.get_effects().values() if effect.kind not in ("body", "mechanism")]
    forms = {f"{effect.name}_{form.name}.png" for effect in drawn_effects for form in effect.forms}
    assert set(pictures) == forms | matrices, HOW_TO_UPDATE
    assert max(pictures[name] for name in forms) < MAX_FIGURE_BYTES


def test_matrices_contain_every_effect_on_every_rig(data: dict[str, Any]) -> None:
    muscle = load_device(data["device"]).spec.muscle
    effects = [e for e in catalogue.get_named_effects().values() if e.kind not in ("body", "mechanism")]
    compared_effects = [e for e in effects if not (e.replaces_switch and getattr(muscle, e.replaces_switch))]
    for number, change in enumerate(RIG_CHANGES):
        with (FOLDER / f"matrix_{number}.csv").open(encoding="utf-8") as file:
            (words, *names), *lines = csv.reader(file)
        assert words == change.description
        assert [line[0] for line in lines] == names
        assert [line[k + 1] for k, line in enumerate(lines)] == ["1.000"] * len(names)
        assert {name.split()[0] for name in names} == {effect.name for effect in compared_effects}, HOW_TO_UPDATE


def test_each_class_has_its_separating_change(data: dict[str, Any]) -> None:
    changes = {change.description for change in RIG_CHANGES[1:]}
    assert data["classes"]
    for group in data["classes"]:
        # Forms of one effect count once; an instrument effect counts once for each channel.
        assert group["n_effects"] == len({label.partition(" (")[0] for label in group["effects"]}) >= 2
        assert group["cosine"] >= 0.95
        assert (group["separated_by"] in changes) == (group["remaining_cosine"] < 0.95)
    # Effects of the base model are compared on another device.
    rows = [row for row in data["effects"] if not catalogue.get_effects()[row["effect"]].replaces_switch]
    grouped = {name for group in data["classes"] for name in group["effects"]}
    assert {pair["effect"] for row in rows for pair in row["similar_effects"]} == grouped


def test_digest_ignores_words(script: ModuleType) -> None:
    source = (ROOT / "src" / "klute_sim" / "effects" / "families" / "supply.py").read_text("utf-8")

    def code(text: str) -> str:
        return str(script._serialise_code(script.ast.parse(text)))

    changed_text = re.sub('"""Return .*?"""', '"""Another sentence."""', source).replace(
        "assumed: a few", "assumed: some"
    )
    assert changed_text != source
    assert code(f"# A remark.\n{changed_text}") == code(source)
    for old, new in (
        ("p.gain * command", "p.gain + command"),
        ("typical=0.04", "typical=0.05"),
        ("apply_offset", "add_offset"),
    ):
        assert old in source
        assert code(source.replace(old, new)) != code(source)


@pytest.mark.long
def test_regeneration_is_reproducible(script: ModuleType, data: dict[str, Any], tmp_path: Path) -> None:
    script.write_pages(tmp_path)
    new_data = json.loads((tmp_path / "confusable.json").read_text("utf-8"))
    assert sorted(path.name for path in tmp_path.rglob("*")) == sorted(path.name for path in FOLDER.rglob("*"))
    assert {key: new_data[key] for key in ("digest", "device", "shown_in")} == {
        key: data[key] for key in ("digest", "device", "shown_in")
    }
    for key in ("classes", "effects"):
        assert len(new_data[key]) == len(data[key])
        for new, old in zip(new_data[key], data[key], strict=True):
            assert_close(new, old)


def assert_close(new: Any, old: Any) -> None:
    """Assert equality, with numbers equal within their rounding."""
    assert type(new) is type(old)
    if isinstance(new, dict):
        assert new.keys() == old.keys()
        for key in new:
            assert_close(new[key], old[key])
    elif isinstance(new, list):
        assert len(new) == len(old)
        for new_item, old_item in zip(new, old, strict=True):
            assert_close(new_item, old_item)
    elif isinstance(new, float):
        assert new == pytest.approx(old, rel=0.01, abs=0.002)
    else:
        assert new == old
