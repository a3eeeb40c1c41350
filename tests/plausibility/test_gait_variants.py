"""Gait files that are wrong in a known way are refused by name, and unusual ones that are right are read.

``python -m benchmarks.robustness.gait_plausibility`` prints all of them as a table.
"""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from benchmarks.robustness.gait_plausibility import files, right, wrong
from benchmarks.robustness.gait_plausibility.files import Variant

from klute_sim.gait.reference import load_reference
from klute_sim.mocap import reference_folder
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.reference_import import import_reference
from klute_sim.plausibility.finding import ImplausibleInputError

WRONG = wrong.list_variants()
RIGHT = right.list_variants()
SMALLEST_SHARE_NAMED = 0.95
MAX_DEFAULT_VARIANTS = 24


def _select(variants: list[Variant]) -> list[Variant]:
    """Return the ``variants`` that this environment can write."""
    has_c3d = importlib.util.find_spec("ezc3d") is not None
    return [variant for variant in variants if has_c3d or variant.kind != "c3d"]


def _describe(variant: Variant) -> str:
    return f"{variant.kind}: {variant.name}"


def test_suite_is_large() -> None:
    assert len(WRONG) >= 80
    assert len(RIGHT) >= 30
    assert {variant.kind for variant in WRONG} == {variant.kind for variant in RIGHT}


@pytest.mark.parametrize("variant", WRONG[:: len(WRONG) // MAX_DEFAULT_VARIANTS], ids=_describe)
def test_wrong_file_is_named(variant: Variant, tmp_path: Path) -> None:
    if variant.kind == "c3d":
        pytest.importorskip("ezc3d", reason="the extra 'c3d' is not installed")
    names, message = files.find_names(variant, tmp_path / "files")
    assert set(names) & set(variant.expected), message
    assert "\n" not in message


@pytest.mark.parametrize("variant", RIGHT[:: len(RIGHT) // MAX_DEFAULT_VARIANTS], ids=_describe)
def test_right_file_is_read(variant: Variant, tmp_path: Path) -> None:
    if variant.kind == "c3d":
        pytest.importorskip("ezc3d", reason="the extra 'c3d' is not installed")
    assert files.find_names(variant, tmp_path / "files") == ([], "")


@pytest.mark.slow
def test_nearly_all_wrong_files_are_named(tmp_path: Path) -> None:
    variants = _select(WRONG)
    missed = [
        _describe(variant)
        for number, variant in enumerate(variants)
        if not set(variant.expected) & set(files.find_names(variant, tmp_path / str(number))[0])
    ]
    assert len(missed) <= (1.0 - SMALLEST_SHARE_NAMED) * len(variants), missed


@pytest.mark.slow
def test_no_right_file_is_refused(tmp_path: Path) -> None:
    refused = {
        _describe(variant): names
        for number, variant in enumerate(_select(RIGHT))
        if (names := files.find_names(variant, tmp_path / str(number))[0])
    }
    assert refused == {}


def test_accepted_finding_stays_accepted_in_the_imported_folder(tmp_path: Path) -> None:
    table = files.make_table(wrong.Walker())
    table = wrong.times("AnkleMoment", 0.06)(table)
    path = files.write_table(table, tmp_path / "walk.csv")
    with pytest.raises(ImplausibleInputError) as error:
        import_reference([path], ImportOptions())
    names = {finding.name for finding in error.value.findings}
    for _ in range(5):  # one mistake can have consequences that are found later
        try:
            imported = import_reference([path], ImportOptions(accept=frozenset(names)))
            break
        except ImplausibleInputError as other:
            new = {finding.name for finding in other.findings} - names
            assert new
            names |= new
    assert set(imported.log.accepted) == names
    assert any(sentence.startswith("accepted: ") for sentence in imported.log.warnings)
    (tmp_path / "me").mkdir()
    reference_folder.write_reference(imported, tmp_path / "me")
    load_reference(tmp_path / "me")


def test_accepted_finding_of_a_reference_is_kept(tmp_path: Path) -> None:
    columns = {"gait_pct": np.linspace(0.0, 100.0, 51)}
    columns |= wrong.times(wrong.FORWARD, -1.0)(wrong.Walker().compute_curves(columns["gait_pct"] / 100.0))
    path = files.write_table(columns, tmp_path / "reference.csv")
    with pytest.raises(ImplausibleInputError, match=f"--accept {wrong.FORWARD}-sign"):
        load_reference(path)
    reference = load_reference(path, accept=[f"{wrong.FORWARD}-sign"])
    assert [finding.name for finding in reference.accepted] == [f"{wrong.FORWARD}-sign"]
