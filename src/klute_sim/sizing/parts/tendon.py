"""Sizing of the two springs of the tendon (chapters 5-6)."""

from klute_sim.laws.tendon import TendonParameters
from klute_sim.laws.tendon import force as tension
from klute_sim.sizing.choices import DesignAssumptions


def size_tendon(force: float, resting_length: float, assumptions: DesignAssumptions) -> TendonParameters:
    """Return the tendon whose stretch under ``force`` [N] is the assumed strain.

    The strain is relative to the slack length of the tendon plus the ``resting_length`` [m] of the muscle.

    Assumed, because the values of Figs. 6.3 and 6.4 are missing: the load sharing of the springs (60 : 140, the second
    engages at 5 mm of 100 mm, as in the 3/4 in pair), and the strain. The strain is the peak of the Achilles tendon in
    walking (Kharazi et al. 2021: 4.0 %), taken over muscle and tendon because this muscle is not in parallel with a
    longer one.
    """
    stretch = assumptions.tendon_strain * (assumptions.slack_length + resting_length)
    engagement = assumptions.engagement_fraction * assumptions.slack_length
    unit_tendon = TendonParameters(
        assumptions.slack_length, 1.0, assumptions.second_spring_ratio, engagement, is_rigid=False
    )
    stiffness_1 = force / tension(unit_tendon, stretch)
    return unit_tendon._replace(stiffness_1=stiffness_1, stiffness_2=stiffness_1 * assumptions.second_spring_ratio)
