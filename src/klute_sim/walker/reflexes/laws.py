"""Reflexes of a walking leg as pure functions: delayed senses in, stimulations of the muscles out.

Stance and swing follow Geyer and Herr (IEEE TNSRE 18:263, 2010); the placement of the swing leg by the distance and the
speed of the trunk follows Song and Geyer (J Physiol 593:3493, 2015), with the leg's angle in place of its muscles'
lengths. Forces are over F_max, lengths over l_opt, loads in body weights, angles in rad. There is no pattern generator:
the gait arises from the reflexes and the mechanics of the body.
"""

from typing import NamedTuple

MIN_STIMULATION = 0.01
"""Stimulation of a muscle at rest [1] (Geyer and Herr 2010)."""
MAX_LOAD = 1.5
"""Load above which the reflexes of stance do not grow further [body weights] (assumed)."""


class ReflexGains(NamedTuple):
    """Gains, offsets and tones of the reflexes of one leg; ``klute_sim.walker.reflexes.gain_table`` explains each."""

    soleus_force: float
    tibialis_length: float
    tibialis_offset: float
    tibialis_soleus_force: float
    gastrocnemius_force: float
    vasti_force: float
    vasti_tone: float
    knee_extension: float
    knee_offset: float
    vasti_contralateral_load: float
    trunk_angle: float
    trunk_rate: float
    trunk_reference: float
    glutei_share: float
    hip_load: float
    hip_flexors_double_support: float
    glutei_double_support: float
    hip_flexors_length: float
    hip_flexors_offset: float
    hip_flexors_lean: float
    hip_flexors_hamstrings_length: float
    hamstrings_offset: float
    hamstrings_force: float
    glutei_force: float
    swing_tone: float
    stance_tone: float
    soleus_tone: float
    gastrocnemius_tone: float
    tibialis_tone: float
    hip_flexors_speed: float
    vasti_swing_tone: float
    knee_swing_damping: float
    tibialis_swing_length: float
    tibialis_swing_offset: float
    placement: float
    placement_angle: float
    placement_distance: float
    placement_speed: float


N_GAINS = len(ReflexGains._fields)
"""Number of gains of a leg."""


class LegSenses(NamedTuple):
    """What the reflexes of a leg sense, each after its delay."""

    soleus_force: float
    """Tension of soleus [F_max]."""
    tibialis_length: float
    """Fiber length of tibialis anterior [l_opt]."""
    gastrocnemius_force: float
    """Tension of gastrocnemius [F_max]."""
    vasti_force: float
    """Tension of the vasti [F_max]."""
    knee_angle: float
    """Knee flexion [rad]."""
    knee_rate: float
    """Rate of knee flexion [rad/s]."""
    load: float
    """Ground reaction of the leg [body weights]."""
    hamstrings_force: float
    """Tension of the hamstrings [F_max]."""
    glutei_force: float
    """Tension of the glutei [F_max]."""
    hip_flexors_length: float
    """Fiber length of the hip flexors [l_opt]."""
    hamstrings_length: float
    """Fiber length of the hamstrings [l_opt]."""
    leg_angle: float
    """Angle of the line from hip to ankle to gravity, forward positive [rad]."""


class TrunkSenses(NamedTuple):
    """What the reflexes sense of the trunk, after the delay of the hip."""

    lean: float
    """Inclination to gravity, forward positive [rad]."""
    lean_rate: float
    """Rate of the inclination [rad/s]."""
    speed: float
    """Forward speed of the hip [m/s]."""


class Stimulations(NamedTuple):
    """Stimulations of the muscles of a leg in the order of :data:`klute_sim.walker.person.body.MUSCLES` [1]."""

    glutei: float
    hip_flexors: float
    hamstrings: float
    vasti: float
    gastrocnemius: float
    soleus: float
    tibialis_anterior: float


REFERENCE_SPEED = 1.25
"""Speed from which the reflexes of swing measure deviations [m/s]."""


def limit(stimulation: float) -> float:
    """Return ``stimulation`` limited to :data:`MIN_STIMULATION` ... 1."""
    return min(max(stimulation, MIN_STIMULATION), 1.0)


def stimulate_stance(
    gains: ReflexGains, leg: LegSenses, trunk: TrunkSenses, contralateral_load: float, is_trailing: bool
) -> Stimulations:
    """Return the stimulations in stance; ``is_trailing`` in double support for the leg that stood first.

    Calf and vasti bear the load by positive force feedback, the knee's extension is limited, and the hip keeps the
    trunk upright in proportion to the load. The trailing leg prepares its swing.
    """
    load = min(leg.load, MAX_LOAD)
    vasti = gains.vasti_tone + gains.vasti_force * leg.vasti_force
    if leg.knee_angle < gains.knee_offset and leg.knee_rate < 0.0:
        vasti -= gains.knee_extension * (gains.knee_offset - leg.knee_angle)
    error = trunk.lean - gains.trunk_reference
    upright = gains.trunk_angle * error + gains.trunk_rate * trunk.lean_rate
    upright_glutei = gains.glutei_share * gains.trunk_angle * error + gains.trunk_rate * trunk.lean_rate
    glutei = gains.stance_tone + gains.hip_load * load * max(upright_glutei, 0.0)
    hip_flexors = gains.stance_tone + gains.hip_load * load * max(-upright, 0.0)
    if is_trailing:
        vasti -= gains.vasti_contralateral_load * min(contralateral_load, MAX_LOAD)
        glutei -= gains.glutei_double_support
        hip_flexors += gains.hip_flexors_double_support
    tibialis = gains.tibialis_tone + gains.tibialis_length * (leg.tibialis_length - gains.tibialis_offset)
    return Stimulations(
        limit(glutei),
        limit(hip_flexors),
        limit(gains.stance_tone + gains.hip_load * load * max(upright, 0.0)),
        limit(vasti),
        limit(gains.gastrocnemius_tone + gains.gastrocnemius_force * leg.gastrocnemius_force),
        limit(gains.soleus_tone + gains.soleus_force * leg.soleus_force),
        limit(tibialis - gains.tibialis_soleus_force * leg.soleus_force),
    )


def stimulate_swing(
    gains: ReflexGains, leg: LegSenses, trunk: TrunkSenses, stance_leg_angle: float, toe_off_lean: float,
    toe_off_speed: float,
) -> Stimulations:  # fmt: skip
    """Return the stimulations in swing; ``toe_off_lean`` [rad] and ``toe_off_speed`` [m/s] are those at its start.

    Hip flexors swing the leg, hamstrings and glutei stop it. The leg is placed at an angle that grows with the distance
    of the trunk from the stance foot and with the speed.
    """
    target = (
        gains.placement_angle
        - gains.placement_distance * stance_leg_angle
        + gains.placement_speed * (trunk.speed - REFERENCE_SPEED)
    )
    placement = gains.placement * (target - leg.leg_angle)
    hip_flexors = (
        gains.swing_tone
        + gains.hip_flexors_lean * (toe_off_lean - gains.trunk_reference)
        + gains.hip_flexors_speed * (toe_off_speed - REFERENCE_SPEED)
        + gains.hip_flexors_length * (leg.hip_flexors_length - gains.hip_flexors_offset)
        - gains.hip_flexors_hamstrings_length * max(0.0, leg.hamstrings_length - gains.hamstrings_offset)
        + max(placement, 0.0)
    )
    vasti = gains.vasti_swing_tone + gains.knee_swing_damping * max(0.0, leg.knee_rate)
    tibialis = gains.tibialis_tone + gains.tibialis_swing_length * (leg.tibialis_length - gains.tibialis_swing_offset)
    return Stimulations(
        limit(gains.swing_tone + gains.glutei_force * leg.glutei_force + max(-placement, 0.0)),
        limit(hip_flexors),
        limit(gains.swing_tone + gains.hamstrings_force * leg.hamstrings_force),
        limit(vasti),
        MIN_STIMULATION,
        MIN_STIMULATION,
        limit(tibialis),
    )
