"""The mutations of the laws still apply: every text to replace occurs once, and names and tests exist."""

import ast
from pathlib import Path

import pytest
from benchmarks.robustness.law_mutation_table import MUTATIONS, TESTS_OF_FOLDER, Mutation
from benchmarks.robustness.law_mutations import PACKAGE, ROOT, mutate_text


def test_every_mutation_applies_once() -> None:
    assert len({mutation.name for mutation in MUTATIONS}) == len(MUTATIONS) >= 30
    for mutation in MUTATIONS:
        mutated = mutate_text(ROOT / PACKAGE, mutation)
        unchanged = (ROOT / PACKAGE / mutation.file).read_text("utf-8")
        assert ast.dump(ast.parse(mutated)) != ast.dump(ast.parse(unchanged)), mutation.name
    assert {mutation.folder for mutation in MUTATIONS} == set(TESTS_OF_FOLDER)
    assert all((ROOT / test.split("::")[0]).exists() for tests in TESTS_OF_FOLDER.values() for test in tests)


def test_text_that_is_missing_or_occurs_twice_ends_the_program(tmp_path: Path) -> None:
    file, mutation = tmp_path / "law.py", Mutation("law.py", "a = 1", "a = 2")
    file.write_text("a = 1\n")
    assert mutate_text(tmp_path, mutation) == "a = 2\n"
    for text, count in (("b = 1\n", 0), ("a = 1\na = 1\n", 2)):
        file.write_text(text)
        with pytest.raises(SystemExit, match=f"occurs {count} times"):
            mutate_text(tmp_path, mutation)
