"""Read all variants and print a table: what was expected, what was found, and the messages of what is wrong."""

import argparse
import importlib.util
import tempfile
from collections.abc import Iterable
from pathlib import Path

from benchmarks.robustness.gait_plausibility import right, wrong
from benchmarks.robustness.gait_plausibility.files import Variant, find_names


def run_variants(variants: Iterable[Variant], *, verbose: bool) -> tuple[int, int]:
    """Print a line for each of ``variants``; return how many were right, and their number."""
    n_right = n_variants = 0
    with tempfile.TemporaryDirectory() as folder:
        for variant in variants:
            names, message = find_names(variant, Path(folder) / str(n_variants))
            is_right = bool(set(variant.expected) & set(names)) if variant.expected else not names
            n_right, n_variants = n_right + is_right, n_variants + 1
            expected = "|".join(variant.expected) or "-"
            found = ", ".join(dict.fromkeys(names)) or "-"
            print(f"{'ok  ' if is_right else 'FAIL'} {variant.kind:9} {variant.name:60} {expected:40} {found}")
            if verbose or not is_right:
                print(f"     {message}")
    return n_right, n_variants


def main() -> None:
    """Print the tables and their totals."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--verbose", action="store_true", help="print all messages")
    parser.add_argument("--kind", help="only files of this kind")
    options = parser.parse_args()
    has_c3d = importlib.util.find_spec("ezc3d") is not None
    for title, variants in (("wrong files", wrong.list_variants()), ("right files", right.list_variants())):
        chosen = [v for v in variants if options.kind in (None, v.kind) and (has_c3d or v.kind != "c3d")]
        n_right, n_variants = run_variants(chosen, verbose=options.verbose)
        print(f"{title}: {n_right} of {n_variants}")


if __name__ == "__main__":
    main()
