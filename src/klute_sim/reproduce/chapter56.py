"""Chapters 5 and 6: the Achilles tendon, whose numbers are lost, and the artificial tendon."""

import numpy as np

from klute_sim.device.files import Device
from klute_sim.errors import InputError
from klute_sim.laws import achilles, tendon
from klute_sim.laws.tendon import Tendon
from klute_sim.reproduce.item import Found
from klute_sim.reproduce.picture import Array, Chapter, Line, Picture

EXAMPLE = achilles.PowerLaw(modulus=1.0e9, exponent=1.8)
"""Constants (assumed) to try the power law with; the five models' own are lost."""
STRAIGHT = 1e-6
"""Deviation [N] up to which a curve is a line."""


def compute(device: Device) -> Chapter:
    """Everything of chapters 5 and 6, of ``device``; raises InputError if it has no tendon."""
    law = device.parameters.tendon
    if law.rigid:
        raise InputError(f"device '{device.name}' has no tendon, which chapters 5 and 6 are about")
    found: dict[str, Found] = {}
    lost = "The numbers are lost, and nothing replaces them."
    for name in ("area", "modulus", "exponent"):
        found[f"table-5.1.{name}"] = Found(note=lost)
    strain = np.linspace(0.005, 0.06, 40)
    stress = [achilles.stress(EXAMPLE, float(each)) for each in strain]
    recovered = float(np.polyfit(np.log(strain), np.log(stress), 1)[0]) / EXAMPLE.exponent
    found["table-5.1.form"] = Found(recovered, abs(recovered - 1.0) < 1e-9)

    stretch = np.linspace(0.0, 3.0 * max(law.engagement, 1e-3), 301)
    first = pull(law._replace(stiffness_2=0.0), stretch)
    second = pull(law, stretch) - first
    beyond = stretch > law.engagement
    before_slope, after_slope = law.stiffness_1, float(np.polyfit(stretch[beyond], pull(law, stretch)[beyond], 1)[0])
    joins = float(stretch[np.flatnonzero(second > STRAIGHT)[0] - 1]) if second.any() else float("nan")
    found["figs-6.1-6.2.offset"] = Found(1e3 * joins if second.any() else None, joins > 0.0)
    found["figs-6.3-6.4.linear-a"] = _line(stretch, first)
    found["figs-6.3-6.4.linear-b"] = _line(stretch[beyond], second[beyond])
    found["figs-6.3-6.4.bilinear"] = Found(after_slope / before_slope, after_slope > 1.01 * before_slope)
    found["figs-6.3-6.4.ka"] = Found(1e-3 * law.stiffness_1)
    found["figs-6.3-6.4.kb"] = Found(1e-3 * law.stiffness_2)
    found["figs-6.3-6.4.repeats"] = Found()
    picture = Picture(
        "6.4",
        "The artificial tendon: its springs, and both together",
        "stretch [mm]",
        "force [N]",
        (
            Line("Ka", 1e3 * stretch, first, "dashed"),
            Line("Kb, from its offset", 1e3 * stretch, second, "dashed"),
            Line("together", 1e3 * stretch, pull(law, stretch)),
        ),
        assumed="both stiffnesses and the offset",
    )
    return Chapter(found, (picture,))


def pull(law: Tendon, stretch: Array) -> Array:
    """Tension [N] over ``stretch`` [m]."""
    return np.array([tendon.force(law, float(each)) for each in stretch])


def _line(x: Array, y: Array) -> Found:
    apart = float(np.abs(y - np.polyval(np.polyfit(x, y, 1), x)).max())
    return Found(apart, apart < STRAIGHT)
