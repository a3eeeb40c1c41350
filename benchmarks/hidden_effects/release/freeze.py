"""Freeze datasets of the benchmark into a folder that others can score their methods on.

    python -m benchmarks.hidden_effects.release.freeze OUT                 # all blocks of the bench but adversary
    python -m benchmarks.hidden_effects.release.freeze OUT --count 2       # a small one
    python -m benchmarks.hidden_effects.release.freeze OUT --seed 4711     # one to develop on, with truths.json

The release needs no klute-sim: trials are Parquet, the device and the set-up are TOML, truths are sealed, and score.pyz
scores a folder of answers with nothing but Python.
"""

import argparse
import hashlib
import json
import random
import re
import shutil
import sys
import tempfile
import zipfile
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow.csv
import pyarrow.parquet
from benchmarks.hidden_effects.generate import make_dataset
from benchmarks.hidden_effects.plan import (
    ADVERSARY_BLOCK,
    BLOCK_SIZES,
    GAIT_BLOCKS,
    JOINT_BLOCKS,
    SPLIT_SEEDS,
    sample_datasets,
)
from benchmarks.hidden_effects.release.answers import WITHHELD_FILE
from benchmarks.hidden_effects.release.scorer import NAMES_FILE, OPEN_FILE, SEALED_FILE, seal
from benchmarks.hidden_effects.run import list_excluded
from benchmarks.hidden_effects.score import NUMBER_NAME
from rich.progress import track

import klute_sim
from klute_sim.device.device import load_device
from klute_sim.effects import catalogue
from klute_sim.effects.effect import Effect

HERE = Path(__file__).parent
ROOT = HERE.parents[2]
BENCH_BLOCKS = tuple(block for block in BLOCK_SIZES if block not in (*GAIT_BLOCKS, *JOINT_BLOCKS, ADVERSARY_BLOCK))
"""Blocks that are released: those of the test bench with the physics of the program."""
N_DECOYS = 3
"""Datasets on which the names of one hidden effect are withheld although they are not hidden there. A third of these
datasets hides nothing, so `unexplained` on every withheld dataset is no better than `nothing-missing`."""
SCORER_FILES = tuple(
    f"benchmarks/hidden_effects/{name}.py" for name in ("catalogue", "score", "release/answers", "release/scorer")
)
"""Modules in score.pyz."""
SEALED_TRUTHS = (
    "`truths.sealed`: encoded against reading by accident. **This release is for scores: do not tune on it.** To "
    "develop, make a release with another seed ([below](#a-release-to-develop-on))."
)
"""What the data card says of the truths of a sealed release."""
OPEN_TRUTHS = (
    "`truths.json`, in the open, and the same in `truths.sealed`, which `score.pyz` reads. **This release is to "
    "develop on: read them and tune on it**, and report scores on a sealed release, or on one with another seed."
)
"""What the data card says of the truths of a release to develop on."""


def freeze(
    folder: Path, blocks: Sequence[str], count: int | None, seed: int, *, has_open_truths: bool = False
) -> dict[str, Any]:
    """Write the release into the new folder ``folder``; return the ground truth by name.

    ``count`` limits the datasets of each block, to a random sample that depends on ``seed``. A release to develop on
    also has its truths in the open. An interrupted call leaves no folder. Raises FileExistsError when ``folder``
    exists.
    """
    if folder.exists():
        raise FileExistsError(folder)
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=".part-") as scratch:
        part = Path(scratch) / "release"
        truths = _write_release(part, blocks, count, seed, has_open_truths=has_open_truths)
        part.rename(folder)
    return truths


def _write_release(
    folder: Path, blocks: Sequence[str], count: int | None, seed: int, *, has_open_truths: bool
) -> dict[str, Any]:
    folder.mkdir()
    specs = [spec for block in blocks for spec in sample_datasets(block, count, seed)]
    truths: dict[str, Any] = {}
    order = sorted(specs, key=lambda spec: hashlib.sha256(spec["name"].encode()).hexdigest())  # names tell no block
    named = {f"d{index:04d}": spec for index, spec in enumerate(order)}
    for name, spec in track(named.items(), "freezing", disable=not sys.stderr.isatty()):
        with tempfile.TemporaryDirectory() as scratch:
            arguments = {key: value for key, value in spec.items() if key != "name"}
            truth = make_dataset(Path(scratch) / name, **arguments, truth=Path(scratch) / "truth.json")
            write_parquet_dataset(Path(scratch) / name, folder / "datasets" / name)
        truths[name] = truth
    (folder / SEALED_FILE).write_text(seal(truths), "ascii")
    if has_open_truths:
        (folder / OPEN_FILE).write_text(json.dumps(truths, indent=1) + "\n", "utf-8")
    kinds = {effect.name: effect.kind for effect in select_effects()} | {NUMBER_NAME: "number"}
    (folder / NAMES_FILE).write_text(json.dumps(kinds, indent=1) + "\n", "utf-8")
    (folder / WITHHELD_FILE).write_text(json.dumps(withhold_names(named, seed), indent=1) + "\n", "utf-8")
    write_devices(folder)
    write_scorer(folder / "score.pyz")
    shutil.copy(ROOT / "LICENSE", folder / "LICENSE")
    card = (HERE / "data_card.md").read_text("utf-8")
    n_by_block = Counter(truth["block"] for truth in truths.values())
    fields = {
        "count": str(len(truths)),
        "kinds": ", ".join(f"{block} {n_by_block[block]}" for block in blocks),
        "truths": OPEN_TRUTHS if has_open_truths else SEALED_TRUTHS,
        "version": klute_sim.__version__,
        "effects": list_effects(),
    }
    for field, text in fields.items():
        card = card.replace(f"{{{field}}}", text)
    (folder / "DATA_CARD.md").write_text(card, "utf-8")
    return truths


def withhold_names(specs: Mapping[str, Mapping[str, Any]], seed: int) -> dict[str, list[str]]:
    """Return dataset -> names that are withheld there, for the specifications ``specs`` by dataset.

    Where what is hidden is to have no name, these are its name and those of its twins. The same names are withheld on
    up to :data:`N_DECOYS` datasets of other blocks that have them neither hidden nor as twins, so that they tell
    nothing; ``seed`` draws these. A valve that is declared on one is declared on all, because a hidden leak needs it.
    """
    withheld = {name: sorted(list_excluded(spec["effects"])) for name, spec in specs.items() if spec.get("deleted")}
    blocks = {specs[name]["block"] for name in withheld}
    others = [name for name, spec in specs.items() if spec["block"] not in blocks]
    random.Random(f"{seed} withheld").shuffle(others)
    for name, names in list(withheld.items()) * N_DECOYS:
        for other in others:
            is_alike = specs[other].get("known") == specs[name].get("known")
            if is_alike and other not in withheld and not set(names) & list_hidden_names(specs[other]):
                withheld[other] = names
                break
    return dict(sorted(withheld.items()))


def list_hidden_names(spec: Mapping[str, Any]) -> set[str]:
    """Return the names that ``spec`` hides, and those of their twins."""
    groups = ("effects", "instruments", "strangers", "numbers")
    return set(list_excluded([effect for group in groups for effect in spec.get(group, ())]))


def write_parquet_dataset(source: Path, target: Path) -> None:
    """Copy the dataset ``source``; its CSV trials become Parquet with the same columns."""
    shutil.copytree(source, target)
    for file in sorted(target.glob("*.csv")):
        pyarrow.parquet.write_table(pyarrow.csv.read_csv(file), file.with_suffix(".parquet"))
        file.unlink()
    description = target / "dataset.toml"
    text = description.read_text("utf-8")
    description.write_text(re.sub(r'(files = \["[^"]+)\.csv"\]', r'\1.parquet"]', text), "utf-8")


def write_devices(folder: Path) -> None:
    """Write the device file of each preset that a dataset names."""
    names = {
        match[1]
        for file in (folder / "datasets").glob("*/dataset.toml")
        if (match := re.search(r'(?m)^device = "([^"]+)"$', file.read_text("utf-8"))) and not match[1].endswith(".toml")
    }
    (folder / "devices").mkdir()
    for name in sorted(names):
        (folder / "devices" / f"{name}.toml").write_bytes(load_device(name).content)


def write_scorer(path: Path) -> None:
    """Write the scorer as one file that Python runs."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for package in ("benchmarks", "benchmarks/hidden_effects", "benchmarks/hidden_effects/release"):
            archive.writestr(zipfile.ZipInfo(f"{package}/__init__.py"), "")
        for file in SCORER_FILES:
            archive.writestr(zipfile.ZipInfo(file), (ROOT / file).read_text("utf-8"))
        main = "import sys\n\nfrom benchmarks.hidden_effects.release.scorer import main\n\nsys.exit(main())\n"
        archive.writestr(zipfile.ZipInfo("__main__.py"), main)


def select_effects() -> list[Effect]:
    """Return the effects that a test bench can have: those of the device and of the instruments."""
    return [effect for effect in catalogue.get_named_effects().values() if effect.kind in ("device", "instrument")]


def list_effects() -> str:
    """Return the names that an answer may use, as Markdown lists of each kind."""
    lines = ["Of the device:", ""]
    lines += [f"- `{effect.name}`: {effect.description}" for effect in select_effects() if effect.kind == "device"]
    lines += ["", "Faults of an instrument, each with its channel:", ""]
    lines += [f"- `{effect.name}`: {effect.description}" for effect in select_effects() if effect.kind == "instrument"]
    return "\n".join([*lines, "", "`number_error`: a number of the device file is wrong; never one of `[uncertain]`."])


def main() -> None:
    """Freeze and say what was written."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="new folder of the release")
    parser.add_argument("--block", choices=BENCH_BLOCKS, action="append", help="may be repeated  [default: all]")
    parser.add_argument("--count", type=int, help="datasets of every block, at random  [default: all]")
    seeds = parser.add_mutually_exclusive_group()
    seeds.add_argument("--split", choices=tuple(SPLIT_SEEDS), default="test", help="[default: test]")
    seeds.add_argument("--seed", type=int, help="seed of a release to develop on, with truths.json")
    options = parser.parse_args()
    if options.out.exists():
        parser.error(f"{options.out} exists; choose a new folder")
    seed = SPLIT_SEEDS[options.split] if options.seed is None else options.seed
    blocks, is_own = options.block or BENCH_BLOCKS, options.seed is not None
    truths = freeze(options.out, blocks, options.count, seed, has_open_truths=is_own)
    size = sum(file.stat().st_size for file in options.out.rglob("*") if file.is_file()) / 1e6
    print(f"{len(truths)} datasets, {size:.1f} MB in {options.out}; DATA_CARD.md says how to answer and score them.")


if __name__ == "__main__":
    main()
