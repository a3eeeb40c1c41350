"""Page of the documentation with the stated and the measured sizes of the effects."""

from collections.abc import Sequence

from benchmarks.effect_sizes.rows import ROWS
from benchmarks.effect_sizes.size import PRESET, EffectSize

COMMAND = "python -m benchmarks.effect_sizes docs/effect-sizes.md"
HEAD = "| effect, form | parameters | quantity | stated | measured | deviation |\n|---|---|---|---|---|---|\n"


def format_row(row: EffectSize, measured: float) -> str:
    """Return the line of the table for ``row`` and its ``measured`` value."""
    shown = float(f"{measured:.4g}")
    deviation = round(100.0 * (shown / row.stated - 1.0), 1) + 0.0  # no negative zero
    parameters = ", ".join(f"`{key}` = {value:g}" for key, value in row.parameters.items())
    return (
        f"| {row.effect}, {row.form} | {parameters} | {row.quantity} | {row.stated:.4g} | {shown:.4g} "
        f"| {deviation:+.1f} % |\n"
    )


def render_page(measured: Sequence[float]) -> str:
    """Return the text of the page with the ``measured`` value of every row."""
    table = "".join(format_row(row, value) for row, value in zip(ROWS, measured, strict=True))
    return f"""<!-- Written by `{COMMAND}`. Change the rows in benchmarks/effect_sizes instead. -->

# Sizes of the effects

Each parameter of an [effect](effects.md) states a size: the energy that a loop loses, a stiffness, a time constant, a
flow. *Stated* is what the equation of the form gives, in closed form or by a quadrature of its own. *Measured* is what
tension or pressure show in a simulation of the device `{PRESET}` with that effect. A test allows a deviation of 2 %.

The form `slip` of `tendon_hysteresis` loses less than stated, because its friction changes sign over 0.1 mm after a
reversal.

{HEAD}{table}"""


def parse_measured(text: str) -> list[float]:
    """Return the measured values on a page, in the order of its rows."""
    lines = text.partition(HEAD)[2].splitlines()
    return [float(line.split("|")[5]) for line in lines if line.startswith("|")]
