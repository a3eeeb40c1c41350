"""Chapters 5 and 6: the Achilles tendon, whose numbers are lost, and the artificial tendon."""

import numpy as np

from klute_sim.device.device import Device
from klute_sim.errors import InputError
from klute_sim.laws import achilles, tendon
from klute_sim.laws.tendon import Tendon
from klute_sim.reproduction.curves import Array, ChapterResult, FigureData, PlotLine
from klute_sim.reproduction.item import Finding

EXAMPLE_POWER_LAW = achilles.PowerLaw(modulus=1.0e9, exponent=1.8)
"""Constants (assumed) to try the power law with; the five models' own are lost."""
LINEARITY_TOLERANCE = 1e-6
"""Deviation [N] up to which a curve is a line."""


def compute(device: Device) -> ChapterResult:
    """Everything of chapters 5 and 6, of ``device``; raises InputError if it has no tendon."""
    law = device.parameters.tendon
    if law.is_rigid:
        raise InputError(f"device '{device.name}' has no tendon, which chapters 5 and 6 are about")
    found: dict[str, Finding] = {}
    lost = "The numbers are lost, and nothing replaces them."
    for name in ("area", "modulus", "exponent"):
        found[f"table-5.1.{name}"] = Finding(note=lost)
    strain = np.linspace(0.005, 0.06, 40)
    stress = [achilles.stress(EXAMPLE_POWER_LAW, float(each)) for each in strain]
    recovered = float(np.polyfit(np.log(strain), np.log(stress), 1)[0]) / EXAMPLE_POWER_LAW.exponent
    found["table-5.1.form"] = Finding(recovered, abs(recovered - 1.0) < 1e-9)

    stretch = np.linspace(0.0, 3.0 * max(law.engagement_stretch, 1e-3), 301)
    first = evaluate_tension(law._replace(stiffness_2=0.0), stretch)
    second = evaluate_tension(law, stretch) - first
    beyond = stretch > law.engagement_stretch
    before_slope, after_slope = (
        law.stiffness_1,
        float(np.polyfit(stretch[beyond], evaluate_tension(law, stretch)[beyond], 1)[0]),
    )
    joins = float(stretch[np.flatnonzero(second > LINEARITY_TOLERANCE)[0] - 1]) if second.any() else float("nan")
    found["figs-6.1-6.2.offset"] = Finding(1e3 * joins if second.any() else None, joins > 0.0)
    found["figs-6.3-6.4.linear-a"] = _check_linearity(stretch, first)
    found["figs-6.3-6.4.linear-b"] = _check_linearity(stretch[beyond], second[beyond])
    found["figs-6.3-6.4.bilinear"] = Finding(after_slope / before_slope, after_slope > 1.01 * before_slope)
    found["figs-6.3-6.4.ka"] = Finding(1e-3 * law.stiffness_1)
    found["figs-6.3-6.4.kb"] = Finding(1e-3 * law.stiffness_2)
    found["figs-6.3-6.4.repeats"] = Finding()
    picture = FigureData(
        "6.4",
        "The artificial tendon: its springs, and both together",
        "stretch [mm]",
        "force [N]",
        (
            PlotLine("Ka", 1e3 * stretch, first, "dashed"),
            PlotLine("Kb, from its offset", 1e3 * stretch, second, "dashed"),
            PlotLine("together", 1e3 * stretch, evaluate_tension(law, stretch)),
        ),
        assumption_note="both stiffnesses and the offset",
    )
    return ChapterResult(found, (picture,))


def evaluate_tension(law: Tendon, stretch: Array) -> Array:
    """Tension [N] over ``stretch`` [m]."""
    return np.array([tendon.force(law, float(each)) for each in stretch])


def _check_linearity(x: Array, y: Array) -> Finding:
    apart = float(np.abs(y - np.polyval(np.polyfit(x, y, 1), x)).max())
    return Finding(apart, apart < LINEARITY_TOLERANCE)
