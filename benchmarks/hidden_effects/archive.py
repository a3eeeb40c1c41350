"""Archive the truths and verdicts of a run, so that anybody can score them again or continue the run.

    python -m benchmarks.hidden_effects.archive OUT benchmarks/hidden_effects/results/test_1313.tar.xz
    tar -xf benchmarks/hidden_effects/results/test_1313.tar.xz -C OUT           # OUT exists
    python -m benchmarks.hidden_effects.run OUT --seed 1313 --finished

OUT is a folder of :mod:`benchmarks.hidden_effects.run`. Datasets are left out: they follow from their seeds.
"""

import argparse
import re
import tarfile
from pathlib import Path

RESULT_NAME = re.compile(r"(?P<dataset>[a-z_]+_\d+_\d{3})(?P<second>_second)?_[0-9a-f]{12}\.json")
"""Name of the file of a verdict of klute-sim; those of other methods have another one."""


def list_archived_files(folder: Path) -> list[Path]:
    """Return the verdicts in ``folder`` and the truths of their datasets."""
    matches = [(file, RESULT_NAME.fullmatch(file.name)) for file in sorted((folder / "results").iterdir())]
    verdicts = {file: match["dataset"] for file, match in matches if match}
    truths = [folder / f"{dataset}.truth.json" for dataset in dict.fromkeys(verdicts.values())]
    return [*truths, *verdicts]


def find_verdicts(folder: Path) -> dict[str, Path]:
    """Return dataset -> file of its verdict in ``folder``, without follow-ups.

    Raises ValueError if verdicts of several codes are stored for a dataset, which would count more than once.
    """
    verdicts: dict[str, Path] = {}
    for file in sorted((folder / "results").glob("*.json")):
        match = RESULT_NAME.fullmatch(file.name)
        if match and not match["second"] and verdicts.setdefault(match["dataset"], file) != file:
            raise ValueError(f"{folder}: results of several codes for {match['dataset']}; keep those of one")
    return verdicts


def write_archive(folder: Path, archive: Path) -> int:
    """Write the truths and verdicts of ``folder`` to ``archive``; return the number of files."""
    files = list_archived_files(folder)
    with tarfile.open(archive, "w:xz") as tar:
        for file in files:
            tar.add(file, file.relative_to(folder), filter=_without_owner)
    return len(files)


def _without_owner(entry: tarfile.TarInfo) -> tarfile.TarInfo:
    entry.uid = entry.gid = 0
    entry.uname = entry.gname = ""
    return entry


def main() -> None:
    """Write the archive."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder of benchmarks.hidden_effects.run")
    parser.add_argument("archive", type=Path, help="file to write, *.tar.xz")
    arguments = parser.parse_args()
    if not (arguments.out / "results").is_dir():
        parser.error(f"{arguments.out} has no folder 'results'; name the OUT of benchmarks.hidden_effects.run")
    print(f"{write_archive(arguments.out, arguments.archive)} files in {arguments.archive}")


if __name__ == "__main__":
    main()
