"""Layout of the walker's state: one flat vector of numbers.

It holds everything that the walker knows beyond MuJoCo's state: muscles, delay lines, gait events, the estimated gait
phase and sums over the walk. A copy of it and of MuJoCo's state resumes a walk exactly.
"""

from klute_sim.walker.person.body import MUSCLES, SIDES
from klute_sim.walker.reflexes.laws import LegSenses, TrunkSenses

N_MUSCLES, N_SIDES = len(MUSCLES), len(SIDES)
N_LEG_SENSES, N_TRUNK_SENSES = len(LegSenses._fields), len(TrunkSenses._fields)
N_SENSES = N_SIDES * N_LEG_SENSES + N_TRUNK_SENSES
"""Numbers in one sample of the delay lines: left leg, right leg, trunk."""

ACTIVATION = 0
"""Activations [1], left leg first."""
FIBER_LENGTH = ACTIVATION + N_SIDES * N_MUSCLES
"""Fiber lengths [l_opt]."""
STIMULATION = FIBER_LENGTH + N_SIDES * N_MUSCLES
"""Stimulations [1]."""
TENDON_FORCE = STIMULATION + N_SIDES * N_MUSCLES
"""Tensions [F_max]."""
STANCE = TENDON_FORCE + N_SIDES * N_MUSCLES
"""1 for a leg in stance."""
STRIKE_TIME = STANCE + N_SIDES
"""Time of the last foot strike of each leg [s]."""
TOE_OFF_LEAN = STRIKE_TIME + N_SIDES
"""Inclination of the trunk at the last toe-off of each leg [rad]."""
TOE_OFF_SPEED = TOE_OFF_LEAN + N_SIDES
"""Forward speed at the last toe-off of each leg [m/s]."""
LOAD = TOE_OFF_SPEED + N_SIDES
"""Vertical ground reaction of each leg [body weights], as MuJoCo evaluated it in the last step."""
PYLON_LOAD = LOAD + N_SIDES
"""Compression of the pylon [body weights]; without a prosthesis the load of the right leg."""
PHASE_CONTACT = PYLON_LOAD + 1
"""1 while the phase estimate takes the right leg to be in contact."""
PHASE_TIME = PHASE_CONTACT + 1
"""Time since the last foot strike of the right leg [s]."""
STRIDE_TIME = PHASE_TIME + 1
"""Duration of the last stride of the right leg [s]."""
STEP_COUNT = STRIDE_TIME + 1
"""Number of time steps taken."""
METABOLIC_MINETTI = STEP_COUNT + 1
"""Metabolic energy after Minetti and Alexander [J]."""
METABOLIC_BHARGAVA = METABOLIC_MINETTI + 1
"""Metabolic energy after Bhargava et al. [J]."""
SQUARED_ACTIVATION = METABOLIC_BHARGAVA + 1
"""Integral of the sum of squared activations [s]."""
OVERLOAD = SQUARED_ACTIVATION + 1
"""Integral of the squared load above the overload threshold, over both legs [body weights^2 * s]."""
KNEE_STOP = OVERLOAD + 1
"""Integral of the knees' angle beyond the onset of their stop [rad * s]."""
SWING_DORSIFLEXION = KNEE_STOP + 1
"""Integral of the dorsiflexion beyond that of people in swing, over feet of flesh [rad * s]."""
TRUNK_LEAN = SWING_DORSIFLEXION + 1
"""Integral of the inclination of the trunk beyond that of people, to either side [rad * s]."""
FIBER_WORK = TRUNK_LEAN + 1
"""Work of the fibers, positive while they shorten [J]."""
POSITIVE_FIBER_WORK = FIBER_WORK + 1
"""Positive part of the work of the contractile elements [J]."""
MUSCLE_JOINT_WORK = POSITIVE_FIBER_WORK + 1
"""Work of the muscles on the joints [J]."""
PUSH_WORK = MUSCLE_JOINT_WORK + 1
"""Work of pushes on the trunk [J]."""
DELAY_LINES = PUSH_WORK + 1
"""Ring buffer of the senses: one sample of :data:`N_SENSES` per time step."""


def compute_state_size(depth: int) -> int:
    """Return the length of a state with delay lines of ``depth`` samples."""
    return DELAY_LINES + depth * N_SENSES
