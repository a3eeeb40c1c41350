"""Mutation campaign: mutated files are read as by a command; each must be read, or refused in one sentence.

    python -m benchmarks.robustness.mutations --out FOLDER                    # 10 000 of each kind, two processes
    python -m benchmarks.robustness.mutations --out FOLDER --kind trc --kind c3d --count 500
    python -m benchmarks.robustness.mutations --kind trc --first 1234 --count 1 --keep damaged

Failures are other errors than those of the package, messages of several lines, more than 30 s, more than 1 GB, and
files opened for writing outside of the scratch folder. The number of a case reproduces it. Cases run in separate
processes, so crashes are detected, too. Finished chunks are stored in FOLDER; the same command resumes.
"""

import argparse
import json
import os
import subprocess
import sys
import warnings
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from functools import partial
from pathlib import Path

from benchmarks.robustness import cases, file_kinds
from benchmarks.robustness.cases import ChunkResult

CHUNK_SIZE = 250
"""Number of cases per process."""
MAX_ADDRESS_SPACE = 6 * 1024**3
"""Limit of the address space of a process [bytes], which libraries reserve far beyond the memory that they use."""
ROOT = Path(__file__).parents[2]
"""Folder of the project."""


def run_in_process(name: str, first: int, count: int, keep: Path | None = None) -> ChunkResult:
    """Run cases in a separate process, and go on with the next case after a crash."""
    result, end = ChunkResult(), first + count
    while first < end:
        command = [sys.executable, __file__, "--here", "--kind", name]
        command += ["--first", str(first), "--count", str(end - first)]
        command += ["--keep", str(keep)] if keep is not None else []
        process = subprocess.run(
            command, env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=False
        )
        lines = process.stdout.splitlines()
        if process.returncode == 0:
            result.add(_parse_result(lines[-1]))
            return result
        numbers = [int(line) for line in lines if line.isdigit()]
        if not numbers:
            raise RuntimeError(f"intact files of kind '{name}' cannot be read: {process.stderr[-2000:]}")
        crash = f"the process ended with {process.returncode}: {process.stderr[-500:]}"
        result.add(ChunkResult(numbers[-1] + 1 - first, 0, {numbers[-1]: crash}))
        first = numbers[-1] + 1
    return result


def _parse_result(line: str) -> ChunkResult:
    content = json.loads(line)
    content["failures"] = {int(number): failure for number, failure in content["failures"].items()}
    return ChunkResult(**content)


def _run_stored_chunk(name: str, first: int, count: int, out: Path | None, keep: Path | None) -> ChunkResult:
    """Return the stored result of a chunk, or run it and store its result in the folder ``out``."""
    file = None if out is None else out / f"{name}_{first}_{count}.json"
    if file is not None and file.is_file():
        return _parse_result(file.read_text("utf-8"))
    result = run_in_process(name, first, count, keep)
    if file is not None:
        temporary = file.with_suffix(".tmp")
        temporary.write_text(json.dumps(asdict(result)), "utf-8")
        temporary.replace(file)
    return result


def run_campaign(
    names: Sequence[str], first: int, count: int, *, out: Path | None, keep: Path | None, jobs: int
) -> dict[str, ChunkResult]:
    """Return the result by kind of file; a line on stderr reports each finished chunk."""
    results = {name: ChunkResult() for name in names}
    chunks = [
        (name, start, min(CHUNK_SIZE, first + count - start))
        for name in names
        for start in range(first, first + count, CHUNK_SIZE)
    ]
    with ThreadPoolExecutor(jobs) as pool:
        for (name, start, _), result in zip(
            chunks, pool.map(lambda chunk: _run_stored_chunk(*chunk, out, keep), chunks), strict=True
        ):
            results[name].add(result)
            print(f"{name} {start}: {len(result.failures)} failures", file=sys.stderr, flush=True)
    return results


def format_table(results: dict[str, ChunkResult]) -> str:
    """Return one line for each kind of file."""
    lines = [f"{'kind':16}{'cases':>8}{'refused':>9}{'failures':>10}{'slowest [s]':>13}{'peak [MB]':>11}"]
    for name, result in results.items():
        lines.append(
            f"{name:16}{result.count:8}{result.refused:9}{len(result.failures):10}{result.slowest_seconds:13.1f}"
            f"{result.peak_megabytes:11.0f}"
        )
    return "\n".join(lines)


def _limit_address_space() -> None:
    if sys.platform != "win32":
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MAX_ADDRESS_SPACE, MAX_ADDRESS_SPACE))


def main() -> int:
    """Parse the command line, run the campaign and print its table; return 1 after a failure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kind", choices=tuple(file_kinds.KINDS), action="append", help="[default: all]")
    parser.add_argument("--count", type=int, default=10_000, help="number of cases of each kind  [default: 10000]")
    parser.add_argument("--first", type=int, default=0, help="number of the first case  [default: 0]")
    parser.add_argument("--jobs", type=int, default=2, help="number of processes  [default: 2]")
    parser.add_argument("--out", type=Path, help="folder for the results of finished chunks, which are not run again")
    parser.add_argument("--keep", type=Path, help="folder for the files of failures")
    parser.add_argument("--here", action="store_true", help="run one kind in this process, as each process does")
    options = parser.parse_args()
    for folder in filter(None, (options.out, options.keep)):
        folder.mkdir(parents=True, exist_ok=True)
    if options.here:
        _limit_address_space()
        warnings.simplefilter("ignore")
        report = partial(print, flush=True)
        result = cases.run_cases(options.kind[0], options.first, options.count, options.keep, report)
        print(json.dumps(asdict(result)))
        return 0
    results = run_campaign(
        options.kind or list(file_kinds.KINDS),
        options.first,
        options.count,
        out=options.out,
        keep=options.keep,
        jobs=options.jobs,
    )
    for name, result in results.items():
        for number, failure in result.failures.items():
            print(f"{name} {number}: {failure}")
    print(format_table(results))
    return 1 if any(result.failures for result in results.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
