"""Chapters 5 and 6: the Achilles tendon, whose numbers are lost, and the artificial tendon."""

import numpy as np

from klute_sim.device.device import Device
from klute_sim.errors import InputError
from klute_sim.laws import achilles, tendon
from klute_sim.laws.tendon import TendonParameters
from klute_sim.reproduction.curves import ChapterResult, FigureData, PlotLine
from klute_sim.reproduction.item import Outcome
from klute_sim.types import Array

EXAMPLE_POWER_LAW = achilles.PowerLaw(modulus=1.0e9, exponent=1.8)
"""Assumed constants of the power law; those of the five models are lost."""
MIN_FORCE = 1e-6
"""Least force [N] of a spring that has joined."""


def get_tendon(device: Device) -> TendonParameters:
    """Return the tendon of ``device``; raises InputError when it has none."""
    if device.parameters.tendon.is_rigid:
        raise InputError(f"device '{device.name}' has no tendon, which chapters 5 and 6 are about")
    return device.parameters.tendon


def compute(device: Device) -> ChapterResult:
    """Return the findings and figures of chapters 5 and 6; raises InputError when ``device`` has no tendon."""
    law = get_tendon(device)
    findings: dict[str, Outcome] = {}
    lost_note = "The numbers are lost, and nothing replaces them."
    for name in ("area", "modulus", "exponent"):
        findings[f"table-5.1.{name}"] = Outcome(note=lost_note)
    strain = np.linspace(0.005, 0.06, 40)
    stress = [achilles.stress(EXAMPLE_POWER_LAW, float(value)) for value in strain]
    exponent = float(np.polyfit(np.log(strain), np.log(stress), 1)[0])
    findings["table-5.1.form"] = Outcome(abs(exponent / EXAMPLE_POWER_LAW.exponent - 1.0), True)

    stretch = np.linspace(0.0, 3.0 * max(law.engagement_stretch, 1e-3), 301)
    first_spring = evaluate_tension(law._replace(stiffness_2=0.0), stretch)
    second_spring = evaluate_tension(law, stretch) - first_spring
    is_engaged = stretch > law.engagement_stretch
    before_slope, after_slope = (
        law.stiffness_1,
        float(np.polyfit(stretch[is_engaged], evaluate_tension(law, stretch)[is_engaged], 1)[0]),
    )
    engagement_stretch = (
        float(stretch[np.flatnonzero(second_spring > MIN_FORCE)[0] - 1]) if second_spring.any() else float("nan")
    )
    findings["figs-6.1-6.2.offset"] = Outcome(
        1e3 * engagement_stretch if second_spring.any() else None, engagement_stretch > 0.0
    )
    findings["figs-6.3-6.4.linear-a"] = _check_linearity(stretch, first_spring)
    findings["figs-6.3-6.4.linear-b"] = _check_linearity(stretch[is_engaged], second_spring[is_engaged])
    findings["figs-6.3-6.4.bilinear"] = Outcome(after_slope / before_slope, True)
    findings["figs-6.3-6.4.ka"] = Outcome(1e-3 * law.stiffness_1)
    findings["figs-6.3-6.4.kb"] = Outcome(1e-3 * law.stiffness_2)
    findings["figs-6.3-6.4.repeats"] = Outcome()
    figure = FigureData(
        "6.4",
        "The artificial tendon: its springs, and both together",
        "stretch [mm]",
        "force [N]",
        (
            PlotLine("Ka", 1e3 * stretch, first_spring, "dashed"),
            PlotLine("Kb, from its offset", 1e3 * stretch, second_spring, "dashed"),
            PlotLine("together", 1e3 * stretch, evaluate_tension(law, stretch)),
        ),
        assumption_note="both stiffnesses and the offset",
    )
    return ChapterResult(findings, (figure,))


def evaluate_tension(law: TendonParameters, stretch: Array) -> Array:
    """Return the tension [N] over ``stretch`` [m]."""
    return np.array([tendon.force(law, float(value)) for value in stretch])


def _check_linearity(x: Array, y: Array) -> Outcome:
    deviation = float(np.abs(y - np.polyval(np.polyfit(x, y, 1), x)).max())
    return Outcome(deviation, True)
