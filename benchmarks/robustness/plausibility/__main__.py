"""Run all variants and print a table: what was expected, what was found, and the messages of what is wrong."""

import argparse
import tempfile
from collections.abc import Iterable
from pathlib import Path

from benchmarks.robustness.plausibility import right_trials, wrong_trials
from benchmarks.robustness.plausibility.recordings import Variant, find_names


def run_variants(variants: Iterable[Variant], *, verbose: bool) -> tuple[int, int]:
    """Print a line for each of ``variants``; return how many were right, and their number."""
    n_right = n_variants = 0
    with tempfile.TemporaryDirectory() as folder:
        for variant in variants:
            names, message = find_names(variant, Path(folder) / str(n_variants))
            is_right = variant.expected in names if variant.expected else not names
            n_right, n_variants = n_right + is_right, n_variants + 1
            print(f"{'ok  ' if is_right else 'FAIL'} {variant.name:50} {variant.expected:32} {', '.join(names)}")
            if verbose or not is_right:
                print(f"     {message}")
    return n_right, n_variants


def main() -> None:
    """Print all tables and their totals."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--verbose", action="store_true", help="print all messages")
    options = parser.parse_args()
    for title, variants in (
        ("wrong trials", wrong_trials.list_variants()),
        ("right trials", right_trials.list_variants()),
    ):
        n_right, n_variants = run_variants(variants, verbose=options.verbose)
        print(f"{title}: {n_right} of {n_variants}")


if __name__ == "__main__":
    main()
