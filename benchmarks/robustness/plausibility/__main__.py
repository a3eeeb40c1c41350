"""Run all variants and print a table: what was expected, what was found, and the messages of what is wrong."""

import argparse
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from benchmarks.robustness.plausibility import device_files, recordings, right_trials, wrong_trials

FindNames = Callable[[Any, Path], tuple[tuple[str, ...], str]]


def run_variants(variants: Iterable[Any], find_names: FindNames, *, verbose: bool) -> tuple[int, int]:
    """Print a line for each of ``variants``; return how many were right, and their number."""
    n_right = n_variants = 0
    with tempfile.TemporaryDirectory() as folder:
        for variant in variants:
            names, message = find_names(variant, Path(folder) / str(n_variants))
            is_right = variant.expected in names if variant.expected else not names
            n_right, n_variants = n_right + is_right, n_variants + 1
            print(f"{'ok  ' if is_right else 'FAIL'} {variant.name:50} {variant.expected:32} {', '.join(names)}")
            if message and (verbose or not is_right):
                print(f"     {message}")
    return n_right, n_variants


def main() -> None:
    """Print all tables and their totals."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--verbose", action="store_true", help="print all messages")
    options = parser.parse_args()
    totals = []
    for title, variants, find_names in (
        ("wrong bench trials", wrong_trials.list_variants(), recordings.find_names),
        ("right bench trials", right_trials.list_variants(), recordings.find_names),
        ("wrong device files", device_files.list_wrong(), device_files.find_names),
        ("right device files", device_files.list_right(), device_files.find_names),
    ):
        n_right, n_variants = run_variants(variants, find_names, verbose=options.verbose)
        totals.append(f"{title}: {n_right} of {n_variants}")
    print("\n".join(totals))


if __name__ == "__main__":
    main()
