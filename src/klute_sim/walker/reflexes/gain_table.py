"""Every number that a walker's file holds: its meaning, where a search starts, how far it looks, and its bounds."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from klute_sim.types import Array
from klute_sim.walker.reflexes.laws import ReflexGains


class SearchedNumber(NamedTuple):
    """A gain of a leg or a number of the initial state."""

    name: str
    """Name in files."""
    start: float
    """Value of Geyer and Herr (2010) where they give one; otherwise assumed."""
    width: float
    """Standard deviation with which a search begins."""
    low: float
    """Smallest value."""
    high: float
    """Largest value."""
    meaning: str
    """What the number does, with its unit."""


_TONE = (0.01, 0.01, 0.001, 0.3)

GAINS = (
    SearchedNumber("soleus_force", 1.2, 0.12, 0.0, 3.0, "soleus by its own force in stance [1]"),
    SearchedNumber("tibialis_length", 1.1, 0.2, 0.0, 3.0, "tibialis anterior by its length in stance [1]"),
    SearchedNumber("tibialis_offset", 0.71, 0.05, 0.55, 0.9, "length from which tibialis anterior acts [l_opt]"),
    SearchedNumber("tibialis_soleus_force", 0.3, 0.1, 0.0, 2.0, "inhibition of tibialis anterior by soleus [1]"),
    SearchedNumber("gastrocnemius_force", 1.1, 0.12, 0.0, 3.0, "gastrocnemius by its own force in stance [1]"),
    SearchedNumber("vasti_force", 1.15, 0.12, 0.0, 3.0, "vasti by their own force in stance [1]"),
    SearchedNumber("vasti_tone", 0.09, 0.02, 0.01, 0.4, "tone of the vasti in stance [1]"),
    SearchedNumber("knee_extension", 2.0, 0.4, 0.0, 8.0, "inhibition of the vasti near extension [1/rad]"),
    SearchedNumber("knee_offset", math.radians(10), math.radians(2), 0.0, 0.5, "flexion below which it acts [rad]"),
    SearchedNumber("vasti_contralateral_load", 1.2, 0.15, 0.0, 4.0, "inhibition of the trailing vasti by load [1]"),
    SearchedNumber("trunk_angle", 1.91, 0.25, 0.2, 8.0, "hip muscles by the trunk's inclination [1/rad]"),
    SearchedNumber("trunk_rate", 0.25, 0.05, 0.0, 1.5, "hip muscles by the rate of the trunk [s/rad]"),
    SearchedNumber("trunk_reference", 0.105, 0.02, -0.1, 0.35, "inclination that the trunk is held at [rad]"),
    SearchedNumber("glutei_share", 0.68, 0.1, 0.0, 2.0, "glutei over hamstrings in the balance of the trunk [1]"),
    SearchedNumber("hip_load", 1.2, 0.15, 0.2, 4.0, "hip muscles by the load of the leg [1]"),
    SearchedNumber("hip_flexors_double_support", 0.25, 0.05, 0.0, 1.0, "trailing hip flexors in double support [1]"),
    SearchedNumber("glutei_double_support", 0.25, 0.05, 0.0, 1.0, "less of the trailing glutei in double support [1]"),
    SearchedNumber("hip_flexors_length", 0.5, 0.08, 0.0, 3.0, "hip flexors by their length in swing [1]"),
    SearchedNumber("hip_flexors_offset", 0.65, 0.05, 0.2, 1.2, "length from which they act in swing [l_opt]"),
    SearchedNumber("hip_flexors_lean", 1.15, 0.2, -2.0, 5.0, "hip flexors in swing by the lean at toe-off [1/rad]"),
    SearchedNumber("hip_flexors_hamstrings_length", 4.0, 0.5, 0.0, 12.0, "inhibition by stretched hamstrings [1]"),
    SearchedNumber("hamstrings_offset", 0.85, 0.05, 0.5, 1.3, "length of hamstrings from which it acts [l_opt]"),
    SearchedNumber("hamstrings_force", 0.65, 0.08, 0.0, 2.5, "hamstrings by their own force in swing [1]"),
    SearchedNumber("glutei_force", 0.5, 0.08, 0.0, 2.5, "glutei by their own force in swing [1]"),
    SearchedNumber("swing_tone", *_TONE, "tone of the hip muscles in swing [1]"),
    SearchedNumber("stance_tone", 0.05, 0.01, 0.001, 0.3, "tone of the hip muscles in stance [1]"),
    SearchedNumber("soleus_tone", *_TONE, "tone of soleus in stance [1]"),
    SearchedNumber("gastrocnemius_tone", *_TONE, "tone of gastrocnemius in stance [1]"),
    SearchedNumber("tibialis_tone", *_TONE, "tone of tibialis anterior [1]"),
    SearchedNumber("hip_flexors_speed", 0.0, 0.1, -2.0, 2.0, "hip flexors in swing by the speed at toe-off [s/m]"),
    SearchedNumber("vasti_swing_tone", *_TONE, "tone of the vasti in swing [1]"),
    SearchedNumber("knee_swing_damping", 0.0, 0.01, 0.0, 0.3, "vasti by the rate of flexion in swing [s/rad]"),
    SearchedNumber("tibialis_swing_length", 1.1, 0.2, 0.0, 3.0, "tibialis anterior by its length in swing [1]"),
    SearchedNumber("tibialis_swing_offset", 0.80, 0.03, 0.6, 0.95, "length from which it acts in swing [l_opt]"),
    SearchedNumber("placement", 0.0, 0.2, 0.0, 4.0, "hip muscles by the missing angle of the swing leg [1/rad]"),
    SearchedNumber("placement_angle", 0.35, 0.05, 0.0, 0.8, "angle at which the leg is placed [rad]"),
    SearchedNumber("placement_distance", 0.5, 0.2, -2.0, 2.0, "more of it by the stance leg's angle behind [1]"),
    SearchedNumber("placement_speed", 0.1, 0.05, -0.5, 0.8, "more of it by the speed above 1.25 m/s [rad s/m]"),
)
"""Gains of a leg in the order of :class:`klute_sim.walker.reflexes.ReflexGains`."""

INITIAL_STATE = (
    SearchedNumber("speed", 1.3, 0.08, 0.5, 2.0, "forward speed [m/s]"),
    SearchedNumber("rise", 0.0, 0.1, -0.5, 0.5, "upward speed [m/s]"),
    SearchedNumber("lean", 0.08, 0.03, -0.2, 0.4, "inclination of the trunk [rad]"),
    SearchedNumber("hip_left", math.radians(-12), 0.05, -0.6, 0.3, "flexion of the left thigh to gravity [rad]"),
    SearchedNumber("knee_left", 0.105, 0.05, 0.045, 0.7, "flexion of the left knee [rad]"),
    SearchedNumber("hip_right", math.radians(30), 0.05, 0.0, 0.9, "flexion of the right thigh to gravity [rad]"),
    SearchedNumber("knee_right", 0.105, 0.05, 0.045, 0.7, "flexion of the right knee [rad]"),
    SearchedNumber("hip_rate_left", -1.0, 0.3, -4.0, 4.0, "rate of the left hip [rad/s]"),
    SearchedNumber("hip_rate_right", 0.5, 0.5, -6.0, 6.0, "rate of the right hip [rad/s]"),
    SearchedNumber("calf_activation", 0.4, 0.1, 0.01, 1.0, "activation of the left soleus and gastrocnemius [1]"),
    SearchedNumber("vasti_activation", 0.2, 0.05, 0.01, 1.0, "activation of the vasti [1]"),
    SearchedNumber("hip_activation", 0.15, 0.05, 0.01, 1.0, "activation of glutei and hamstrings [1]"),
)
"""Numbers of the initial state: the left leg stands and the right heel is about to strike."""

assert tuple(gain.name for gain in GAINS) == ReflexGains._fields


@dataclass(frozen=True)
class Reflexes:
    """Gains of both legs and initial state of a walker, as rows of numbers."""

    left: Array
    """Gains of the left leg in the order of :data:`GAINS`."""
    right: Array
    """Gains of the right leg."""
    initial: Array
    """Numbers of the initial state in the order of :data:`INITIAL_STATE`."""

    def get_initial(self) -> Mapping[str, float]:
        """Return the initial state by name."""
        return dict(zip((number.name for number in INITIAL_STATE), self.initial.tolist(), strict=True))

    def perturb(self, fraction: float, rng: np.random.Generator) -> "Reflexes":
        """Return reflexes whose gains are 1 + ``fraction`` x times as large, x standard normal, within their bounds.

        The initial state stays. A ``fraction`` of 0 changes nothing and draws no number.
        """
        if fraction == 0.0:
            return self
        low, high = (np.array([getattr(number, name) for number in GAINS]) for name in ("low", "high"))
        left, right = (
            np.clip(row * (1.0 + fraction * rng.standard_normal(len(GAINS))), low, high)
            for row in (self.left, self.right)
        )
        return Reflexes(left, right, self.initial)
