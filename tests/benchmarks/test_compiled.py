"""The cache of the benchmark's compiled laws."""

from pathlib import Path

from benchmarks.hidden_effects import compiled, law

HOME = Path(compiled.__file__).parent


def test_compiled_cache_depends_on_all_sources() -> None:
    users = {file.name for file in HOME.glob("*.py") if "@cached_njit" in file.read_text("utf-8")}
    assert users <= set(compiled.COMPILED_SOURCES)
    assert law.rate_dependent_tension.py_func.__qualname__.endswith(compiled.SOURCES_DIGEST)
