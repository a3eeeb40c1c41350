"""Generate the example dataset of the package again, after a change of the benchmark's laws.

    python -m benchmarks.hidden_effects.example src/klute_sim/datasets/example

Then draw the figure of its diagnosis again: ``python scripts/command_pictures.py docs/pictures --only view-diagnose``.
"""

import argparse
import shutil
import tempfile
from pathlib import Path

from benchmarks.hidden_effects.generate import make_dataset

SEED = 2026
"""Seed of device, inputs and noise."""
HIDDEN_EFFECT = {"name": "braid_hysteresis", "form": "coulomb", "parameters": {"slope_n_per_bar": 7.0}}
"""Effect that the diagnosis has to find."""


def write_example(folder: Path) -> None:
    """Write the trials and ``dataset.toml`` of the example into ``folder``."""
    with tempfile.TemporaryDirectory() as scratch:
        made = Path(scratch) / "example"
        make_dataset(made, SEED, effects=[HIDDEN_EFFECT], muscle_length=False)
        for file in made.iterdir():
            shutil.copyfile(file, folder / file.name)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="folder of the example, whose files are replaced")
    write_example(parser.parse_args().folder)
