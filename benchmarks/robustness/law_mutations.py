"""Mutate the laws, the effects and the ledger one by one: the tests of their own folder must notice each mutation.

    python -m benchmarks.robustness.law_mutations                 # all, about half an hour on one core
    python -m benchmarks.robustness.law_mutations --only tendon   # those whose name contains the word
    python -m benchmarks.robustness.law_mutations --list

Each mutation replaces a text that occurs exactly once in a file; the program ends with an error where it does not. The
mutated copy of the package runs without compilation. A mutation is *killed* if a test fails, and *survives* otherwise;
the exit code is 1 with a survivor. The unchanged copy must pass first.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

from benchmarks.robustness.law_mutation_table import MUTATIONS, TESTS_OF_FOLDER, Mutation

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = Path("src", "klute_sim")
TIME_LIMIT_S = 1200
"""Time limit of the tests of one mutation [s]; a mutation that never ends counts as killed."""
PYTHON_ONLY_PLUGIN = '''"""Run every backend as plain Python, so that no mutation is compiled."""

from klute_sim.device.backend import select

select.select_backend = lambda backend, find_incompatibility: "python"
select.explain_missing_compiler = lambda: "no mutation is compiled"
'''


class MutationResult(NamedTuple):
    """Result of the tests of one mutation."""

    mutation: Mutation
    killed_by: str
    """First failed test; '' for a survivor."""
    seconds: float


def mutate_text(package: Path, mutation: Mutation) -> str:
    """Return the mutated file of ``package``; exits where the text to replace does not occur exactly once."""
    text = (package / mutation.file).read_text("utf-8")
    if text.count(mutation.old) != 1:
        sys.exit(f"{mutation.name}: {mutation.old!r} occurs {text.count(mutation.old)} times, not 1")
    return text.replace(mutation.old, mutation.new)


def run_tests(folder: str, mutation: Mutation | None) -> tuple[str, float]:
    """Return the first failed test, or '', and the duration [s] of the tests of ``folder`` on a mutated copy."""
    start = time.monotonic()
    with tempfile.TemporaryDirectory() as scratch:
        source = Path(scratch) / "src"
        shutil.copytree(ROOT / "src", source, ignore=shutil.ignore_patterns("__pycache__"))
        (source / "python_only.py").write_text(PYTHON_ONLY_PLUGIN, "utf-8")
        if mutation is not None:
            (source / "klute_sim" / mutation.file).write_text(mutate_text(ROOT / PACKAGE, mutation), "utf-8")
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-n0", "-p", "no:cacheprovider", "-p", "python_only"]
        # Without compilation there are no two backends to compare.
        command += ["-k", "not bit_identical", "--no-header", "-rfE", "--tb=no", *TESTS_OF_FOLDER[folder]]
        environment = {**os.environ, "PYTHONPATH": f"{source}{os.pathsep}{ROOT}", "PYTHONDONTWRITEBYTECODE": "1"}
        try:
            run = subprocess.run(
                command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=TIME_LIMIT_S, check=False
            )
        except subprocess.TimeoutExpired:
            return "time limit", time.monotonic() - start
    failures = [line for line in run.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    if run.returncode not in (0, 1) or (run.returncode == 1 and not failures):
        sys.exit(f"the tests of {folder} did not run:\n{run.stdout[-2000:]}{run.stderr[-2000:]}")
    return failures[0].split(" - ")[0].split(" ", 1)[1] if failures else "", time.monotonic() - start


def run_mutation(mutation: Mutation) -> MutationResult:
    """Return what the tests of the folder of ``mutation`` say."""
    killed_by, seconds = run_tests(mutation.folder, mutation)
    print(f"{'killed' if killed_by else 'SURVIVES':9}{seconds:6.0f} s  {mutation.name}: {killed_by}", flush=True)
    return MutationResult(mutation, killed_by, seconds)


def main() -> int:
    """Run the mutations and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="run the mutations whose name contains this text")
    parser.add_argument("--jobs", type=int, default=1, help="number of mutations at the same time")
    parser.add_argument("--list", action="store_true", help="check that every text occurs once, and list the mutations")
    arguments = parser.parse_args()
    chosen = [mutation for mutation in MUTATIONS if arguments.only in mutation.name]
    if not chosen:
        sys.exit(f"no mutation contains {arguments.only!r}; see --list")
    for mutation in MUTATIONS:
        mutate_text(ROOT / PACKAGE, mutation)
    if arguments.list:
        print("\n".join(f"{m.name}: {m.old!r} -> {m.new!r}" for m in chosen))
        return 0
    with ThreadPoolExecutor(arguments.jobs) as pool:
        folders = sorted({mutation.folder for mutation in chosen})
        for folder, (failure, seconds) in zip(
            folders, pool.map(lambda folder: run_tests(folder, None), folders), strict=True
        ):
            if failure:
                sys.exit(f"the unchanged package fails {failure}")
            print(f"unchanged{seconds:6.0f} s  {folder}", flush=True)
        results = list(pool.map(run_mutation, chosen))
    survivors = [result.mutation.name for result in results if not result.killed_by]
    print(f"{len(results) - len(survivors)} of {len(results)} killed; survivors: {', '.join(survivors) or 'none'}")
    return 1 if survivors else 0


if __name__ == "__main__":
    sys.exit(main())
