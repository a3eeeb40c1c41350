"""The example dataset of the package is what the benchmark's laws generate today."""

from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from benchmarks.hidden_effects.example import write_example


@pytest.mark.slow
def test_shipped_example_follows_the_laws_of_the_benchmark(tmp_path: Path) -> None:
    write_example(tmp_path)
    shipped = Path(str(resources.files("klute_sim.datasets") / "example"))
    names = {file.name for file in tmp_path.iterdir()}
    assert names | {"README.txt"} == {file.name for file in shipped.iterdir()}
    assert (tmp_path / "dataset.toml").read_text() == (shipped / "dataset.toml").read_text()
    for name in names - {"dataset.toml"}:
        made, stored = ((folder / name).read_text().splitlines() for folder in (tmp_path, shipped))
        assert made[0] == stored[0]
        # Processors may differ in the last of the four digits that a file has at least.
        assert np.allclose(np.loadtxt(made[1:], delimiter=","), np.loadtxt(stored[1:], delimiter=","), atol=2e-3)
