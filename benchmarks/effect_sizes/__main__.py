"""Print the table of stated and measured sizes as Markdown: ``python -m benchmarks.effect_sizes``."""

from collections.abc import Iterable

from benchmarks.effect_sizes.rows import ROWS
from benchmarks.effect_sizes.size import EffectSize


def format_table(rows: Iterable[EffectSize]) -> str:
    """Return ``rows`` with their measurements as a Markdown table."""
    lines = ["| effect, form | parameters | quantity | stated | measured | deviation |", "|---|---|---|---|---|---|"]
    for row in rows:
        measured = row.measure()
        parameters = ", ".join(f"{key} = {value:g}" for key, value in row.parameters.items())
        deviation = 100.0 * (measured / row.stated - 1.0)
        lines.append(
            f"| {row.effect}, {row.form} | {parameters} | {row.quantity} | {row.stated:.4g} | {measured:.4g} "
            f"| {deviation:+.1f} % |"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    print(format_table(ROWS))
