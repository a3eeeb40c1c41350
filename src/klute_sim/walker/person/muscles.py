"""Length, moment arms and force of the muscles of a leg: pure functions of numbers.

Flexion of hip and knee and dorsiflexion are positive. A positive moment turns a joint that way.
"""

import math
from typing import NamedTuple

from klute_sim.laws.muscle_tendon import MuscleTendon


class JointArm(NamedTuple):
    """Path of a muscle over one joint."""

    arm: float
    """Largest arm [m], positive where a positive angle lengthens the muscle; 0: the muscle does not cross the joint."""
    reference: float
    """Angle of the reference length [rad]."""
    max_arm_angle: float
    """Angle of the largest arm [rad]."""
    varies: float
    """1 where the arm follows a cosine, 0 where it is constant."""


class MuscleRow(NamedTuple):
    """Parameters of a muscle with its path."""

    unit: MuscleTendon
    """Muscle-tendon unit."""
    slow_fraction: float
    """Share of slow fibers [1]."""
    hip: JointArm
    """Path over the hip."""
    knee: JointArm
    """Path over the knee."""
    ankle: JointArm
    """Path over the ankle."""


ROW_SIZE = 17
"""Number of numbers of a muscle."""


def unpack_muscle(row: tuple[float, ...]) -> MuscleRow:
    """Return the muscle in ``row``, :data:`ROW_SIZE` numbers in the order of the fields."""
    return MuscleRow(
        MuscleTendon(row[0], row[1], row[2], row[3]),
        row[4],
        JointArm(row[5], row[6], row[7], row[8]),
        JointArm(row[9], row[10], row[11], row[12]),
        JointArm(row[13], row[14], row[15], row[16]),
    )


def compute_excursion(path: JointArm, angle: float) -> float:
    """Return the change of muscle length [m] from the reference to joint ``angle`` [rad]: the integral of the arm."""
    if path.arm == 0.0:
        return 0.0
    if path.varies == 0.0:
        return path.arm * (angle - path.reference)
    return path.arm * (math.sin(angle - path.max_arm_angle) - math.sin(path.reference - path.max_arm_angle))


def compute_arm(path: JointArm, angle: float) -> float:
    """Return dl/dq [m] at joint ``angle`` [rad]; the moment of a tension F is -F dl/dq."""
    if path.arm == 0.0 or path.varies == 0.0:
        return path.arm
    return path.arm * math.cos(angle - path.max_arm_angle)


def compute_unit_length(muscle: MuscleRow, hip: float, knee: float, ankle: float) -> float:
    """Return the length [m] of the muscle-tendon unit at the joint angles [rad]."""
    return (
        muscle.unit.optimal_length
        + muscle.unit.slack_length
        + compute_excursion(muscle.hip, hip)
        + compute_excursion(muscle.knee, knee)
        + compute_excursion(muscle.ankle, ankle)
    )
