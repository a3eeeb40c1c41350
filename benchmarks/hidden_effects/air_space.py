"""Room for the air, from the drawing of a muscle: the bores of its bladders, and the fittings and hoses.

A braid thread of length ``B`` winds ``N`` times around the muscle. Unrolled, it is the hypotenuse of a triangle whose
legs are the muscle's length and ``N`` circumferences. The bladder's outside lies against the threads. Its rubber keeps
its volume, so that its cross-section is as many times larger as the muscle is shorter; the rest of the circle is bore.
"""

import math

from benchmarks.hidden_effects.compiled import cached_njit
from benchmarks.hidden_effects.law import Law


@cached_njit
def air_space(L: float, v: float, dead_volume: float, law: Law) -> tuple[float, float]:
    """Return the room for the air [m3] of all muscles at ``L``, and its growth [m3/s] while they lengthen at ``v``."""
    circumference = math.sqrt(law.braid_length * law.braid_length - L * L) / law.turns
    circumference_rate = -L * v / (circumference * law.turns * law.turns)
    circle = circumference * circumference / (4.0 * math.pi)
    circle_rate = circumference * circumference_rate / (2.0 * math.pi)
    shortening = law.resting_length / L
    rubber = math.pi * (law.outer_radius - law.inner_radius) * (law.outer_radius + law.inner_radius) * shortening
    rubber_rate = -rubber * v / L
    bore, bore_rate = circle - rubber, circle_rate - rubber_rate
    return law.n_muscles * bore * L + dead_volume, law.n_muscles * (bore_rate * L + bore * v)
