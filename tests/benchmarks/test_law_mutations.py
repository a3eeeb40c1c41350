"""The mutations of the laws still apply: every text to replace occurs once, and names and tests exist."""

from pathlib import Path

import pytest
from benchmarks.robustness.law_mutation_table import MUTATIONS, TESTS_OF_FOLDER, Mutation
from benchmarks.robustness.law_mutations import ROOT, apply_mutation


def test_every_mutation_applies_once() -> None:
    assert len({mutation.name for mutation in MUTATIONS}) == len(MUTATIONS) >= 30
    for mutation in MUTATIONS:
        text = (ROOT / "src" / "klute_sim" / mutation.file).read_text("utf-8")
        assert text.count(mutation.old) == 1, mutation.name
        assert mutation.new != mutation.old
    assert {mutation.folder for mutation in MUTATIONS} == set(TESTS_OF_FOLDER)
    assert all((ROOT / test.split("::")[0]).exists() for tests in TESTS_OF_FOLDER.values() for test in tests)


def test_text_that_is_missing_or_occurs_twice_ends_the_program(tmp_path: Path) -> None:
    file = tmp_path / "law.py"
    file.write_text("a = 1\n")
    apply_mutation(tmp_path, Mutation("one", "laws", "law.py", "a = 1", "a = 2"))
    assert file.read_text() == "a = 2\n"
    with pytest.raises(SystemExit, match="occurs 0 times"):
        apply_mutation(tmp_path, Mutation("one", "laws", "law.py", "a = 1", "a = 2"))
    file.write_text("a = 1\na = 1\n")
    with pytest.raises(SystemExit, match="occurs 2 times"):
        apply_mutation(tmp_path, Mutation("one", "laws", "law.py", "a = 1", "a = 2"))
