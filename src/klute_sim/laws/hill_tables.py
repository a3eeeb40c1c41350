"""Constants of biological muscle as printed (dissertation Tables 2.1-2.4, Figs. 2.2-2.8), keyed by muscle or model.

Entries that the source does not print are missing: a muscle without a row is not in a table, other gaps are ``None``.
Lengths are in m and speeds in m/s, printed in mm and mm/s; forces are in N. Ranges are those of l/l0 in the fit.
"""

from typing import NamedTuple

from klute_sim.laws.hill import ClosedInterval, ContractileElement, HillCurve, ParallelElement, SeriesElement

_MM = 1e-3


class MuscleScale(NamedTuple):
    """Length and force that normalize Tables 2.1-2.3."""

    resting_length: float
    """l0, length at which the isometric force is largest [m]."""
    isometric_force: float
    """F0, largest isometric force [N]."""


class ParallelRow(NamedTuple):
    """One row of Table 2.1."""

    constants: ParallelElement
    """Constants of (2.1)."""
    valid_range: ClosedInterval | None
    """Range of l/l0 [1]; ``None`` for the curve of a model, printed without a range."""


class ContractileRow(NamedTuple):
    """One row of Table 2.3."""

    constants: ContractileElement
    """Constants of (2.3)."""
    valid_range: ClosedInterval | None
    """Range of l/l0 [1]; ``None`` for the equation of a model, printed without a range."""


class HillRow(NamedTuple):
    """One row of Table 2.4."""

    constants: HillCurve
    """Constants of (2.4), with the default saturation, because the table has none."""
    isometric_force: float | None
    """F0 of this experiment [N], not that of Tables 2.1-2.3."""
    max_velocity: float | None
    """Vmax, largest shortening velocity [m/s]."""


MUSCLE_SCALES: dict[str, MuscleScale] = {
    "rat": MuscleScale(27.0 * _MM, 0.29),  # for (2.2) and (2.3)
    "frog": MuscleScale(31.0 * _MM, 0.67),
    "cat": MuscleScale(31.9 * _MM, 0.18),
    "human": MuscleScale(215.9 * _MM, 193.1),
    "woittiez_1984": MuscleScale(60.0 * _MM, 3000.0),  # both printed in parentheses
    "bobbert_van_ingen_schenau_1990": MuscleScale(61.0 * _MM, 2430.0),
}
"""l0 and F0 of the muscles and models of Tables 2.1-2.3."""

PARALLEL_ELEMENTS: dict[str, ParallelRow] = {
    "frog": ParallelRow(ParallelElement(0.0006, 20.63), ClosedInterval(0.94, 1.39)),
    "cat": ParallelRow(ParallelElement(0.0301, 9.16), ClosedInterval(1.00, 1.40)),
    "human": ParallelRow(ParallelElement(0.0037, 10.43), ClosedInterval(1.05, 1.29)),
    "woittiez_1984": ParallelRow(ParallelElement(0.0787, 7.93), None),
    "bobbert_van_ingen_schenau_1990": ParallelRow(ParallelElement(0.00001, 24.59), None),
}
"""Table 2.1, parallel element (2.1). The rat's has no constants: see :data:`RAT_PARALLEL_ONSET_LENGTH`.

The text calls the parallel force insignificant up to about 1.2 l0. These constants say so for frog, human and Bobbert
& van Ingen Schenau (3 % of F0 or less there), but not for the cat (16 %) and Woittiez (33 %).
"""

RAT_PARALLEL_ONSET_LENGTH = 1.20
"""Length over l0 [1] up to which the rat's parallel element is printed as negligible (Table 2.1)."""

SERIES_ELEMENTS: dict[str, SeriesElement] = {
    "rat": SeriesElement(0.027, 0.079),
    "frog": SeriesElement(0.014, 0.049),
    "cat": SeriesElement(0.028, 0.083),
}
"""Table 2.2, series element (2.2); Fig. 2.3 shows 0.5 to 1 F0."""

CONTRACTILE_ELEMENTS: dict[str, ContractileRow] = {
    "rat": ContractileRow(ContractileElement(-4.50, 8.95, -3.45), ClosedInterval(0.7, 1.2)),
    "frog": ContractileRow(ContractileElement(-6.79, 14.69, -6.88), ClosedInterval(0.68, 1.34)),
    "cat": ContractileRow(ContractileElement(-5.71, 11.52, -4.81), ClosedInterval(0.73, 1.35)),
    "human": ContractileRow(ContractileElement(-13.43, 28.23, -13.96), ClosedInterval(0.82, 1.28)),
    "woittiez_1984": ContractileRow(ContractileElement(-6.25, 12.50, -5.25), None),
    "bobbert_1986": ContractileRow(ContractileElement(-6.25, 12.50, -5.25), None),  # printed as Woittiez's
}
"""Table 2.3, isometric force against length (2.3).

The human fit is 0.84 at l0 and nowhere above 0.88, not 1; the frog's is 1.07 at its top and just below 0 (-0.03) at the
short end of its own range. Bobbert & van Ingen Schenau 1990 (digitised in the source) has no equation.
"""

HILL_CURVES: dict[str, HillRow] = {
    "rat": HillRow(HillCurve(0.356, 0.38), 4.30, 144.0 * _MM),
    "frog": HillRow(HillCurve(0.27, 0.28), 0.67, 42.0 * _MM),
    "cat": HillRow(HillCurve(0.27, 0.30), 0.18, 191.0 * _MM),
    "human": HillRow(HillCurve(0.81, 0.81), 200.0, 1115.0 * _MM),  # Ralston
    "woittiez_1984": HillRow(HillCurve(0.224, 0.224), None, None),
    "bobbert_1986": HillRow(HillCurve(0.41, 0.39), 3000.0, 756.0 * _MM),  # human triceps surae
    "bobbert_van_ingen_schenau_1990": HillRow(HillCurve(0.41, 0.41), 2430.0, 780.0 * _MM),  # human triceps surae
    "hof_van_den_berg_1981": HillRow(HillCurve(0.12, 0.12), None, None),  # human triceps surae
}
"""Table 2.4, force against velocity (2.4).

Where a/F0 differs from b/Vmax (rat, frog, cat, Bobbert 1986) the force at Vmax is not 0 but -1.4 to +2.3 % of F0. The
text orders the curves human, rat, frog, cat from the top; these constants put the cat above the frog at every speed.
For the same reason the rest of the order reverses near Vmax (rat and cat at 0.88 Vmax, human and rat at 0.90).
"""

ECCENTRIC_SATURATIONS: dict[str, float] = {"hatze": 1.3, "hof_van_den_berg_1981a": 1.2, "lehman": 1.8}
"""Eccentric force at great speed over isometric force [1] of the three models in Fig. 2.6; the cat is near 1.3."""

GENERIC_CONTRACTILE_ELEMENT = ContractileElement(-6.9, 13.8, -5.9)
"""Isometric parabola (2.3) of the generic muscle of Fig. 2.8."""

GENERIC_HILL_CURVE = HillCurve(0.28, 0.28)
"""Force against velocity (2.4) of the generic muscle of Fig. 2.8."""
