"""The two springs of the tendon (chapters 5-6)."""

from klute_sim.laws.tendon import Tendon
from klute_sim.laws.tendon import force as tension
from klute_sim.sizing.choices import DesignAssumptions


def size_tendon(force: float, resting_length: float, assumptions: DesignAssumptions) -> Tendon:
    """The tendon that ``force`` [N] stretches by the assumed strain of tendon plus muscle (``resting_length`` [m]).

    Assumed, because the values of Figs. 6.3 and 6.4 are missing: how the springs share the load (60 : 140, the second
    joins at 5 mm of 100 mm, as in the 3/4 in pair), and the strain, which is the Achilles tendon's peak in walking
    (Kharazi et al. 2021: 4.0 %), taken over muscle and tendon because this muscle is not in parallel with a longer one.
    """
    stretch = assumptions.tendon_strain * (assumptions.slack_length + resting_length)
    engagement = assumptions.engagement_fraction * assumptions.slack_length
    unit = Tendon(assumptions.slack_length, 1.0, assumptions.second_spring_ratio, engagement, is_rigid=False)
    first = force / tension(unit, stretch)
    return unit._replace(stiffness_1=first, stiffness_2=first * assumptions.second_spring_ratio)
