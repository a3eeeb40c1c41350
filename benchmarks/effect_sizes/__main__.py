"""Measure the sizes of the effects and print their page, or write it.

python -m benchmarks.effect_sizes                       # print
python -m benchmarks.effect_sizes docs/effect-sizes.md  # write
"""

import sys
from pathlib import Path

from benchmarks.effect_sizes.page import render_page
from benchmarks.effect_sizes.rows import ROWS


def main(arguments: list[str]) -> int:
    """Print the page, or write it to the file in ``arguments``."""
    if len(arguments) > 1 or any(argument.startswith("-") for argument in arguments):
        sys.exit(__doc__)
    text = render_page([row.measure() for row in ROWS])
    if arguments:
        Path(arguments[0]).write_text(text, "utf-8")
    else:
        print(text, end="")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
