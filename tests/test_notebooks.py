"""Every notebook runs from top to bottom in a new process."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

NOTEBOOKS = sorted((Path(__file__).parents[1] / "examples" / "notebooks").glob("*.ipynb"))


def test_there_are_three_notebooks() -> None:
    assert len(NOTEBOOKS) == 3


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs(path: Path, tmp_path: Path) -> None:
    cells = [cell for cell in json.loads(path.read_text("utf-8"))["cells"] if cell["cell_type"] == "code"]
    assert cells
    assert not any(cell["outputs"] for cell in cells), "clear the outputs before you commit a notebook"
    code = tmp_path / "notebook.py"  # a file, because compiled effects are read from their source
    code.write_text("\n".join("".join(cell["source"]) for cell in cells), "utf-8")
    process = subprocess.run(
        [sys.executable, str(code)], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=900
    )
    assert process.returncode == 0, process.stderr
