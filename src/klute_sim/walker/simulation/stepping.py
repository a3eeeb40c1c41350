"""Time steps of the walker: muscles, reflexes, gait events and MuJoCo, in one loop of plain functions of arrays.

As Python this module is the reference; :mod:`klute_sim.walker.simulation.backend` compiles a copy in which the
placeholders are machine code, so that nothing of Python runs inside a walk. Both give the same bits.

A step is semi-implicit: the muscles move by the posture at its start, their moments act during the step, and the
reflexes set the stimulation of the next step.
"""

import math
from typing import Any, NamedTuple

from klute_sim.laws import metabolic_power, muscle_tendon
from klute_sim.walker.person import muscles
from klute_sim.walker.person.muscles import ROW_SIZE  # literal constants for the compiler
from klute_sim.walker.reflexes import laws as reflexes
from klute_sim.walker.reflexes.laws import N_GAINS
from klute_sim.walker.simulation import state as layout

step_model: Any = None
"""Placeholder: takes one step of MuJoCo, given model and data (or their addresses)."""
to_tuple: Any = None
"""Placeholder: converts the first numbers of an array to a tuple."""

FALL_HEIGHT, FALL_LEAN = 0.65, 1.0
"""Height of the hip [m] below which, and inclination of the trunk [rad] beyond which, the walker has fallen."""
OVERLOAD_BW = 1.2
"""Load of a leg [body weights] from which overload counts; people walk with peaks of 1.1 to 1.2."""
KNEE_STOP_ANGLE = 0.045
"""Knee flexion [rad] below which the stop of the knee begins to carry the leg."""
SWING_DORSIFLEXION_ANGLE = math.radians(3.0)
"""Dorsiflexion in swing [rad] that people do not exceed."""
TRUNK_LEAN_ANGLE = math.radians(4.0)
"""Inclination of the trunk [rad] that people do not exceed on level ground."""
CONTACT_ON_BW, CONTACT_OFF_BW = 0.10, 0.05
"""Loads [body weights] at which the phase estimate detects foot strike and toe-off, as on the gait rig."""
NOMINAL_STRIDE_TIME = 1.1
"""Stride time [s] of the phase estimate before the first stride."""
MIN_STRIDE_FRACTION, MAX_STRIDE_FRACTION = 0.6, 1.6
"""Shortest and longest estimate of a stride over the nominal stride time, as on the gait rig."""
SETTLING_STEPS, SETTLING_DT = 200, 0.005
"""Number and duration [s] of the steps in which fibers and tendons find their equilibrium before a walk."""
N_THIGH_MUSCLES = 4
"""Muscles that an amputated leg keeps: the first ones."""
HAT_DOFS, LEG_DOFS = 3, 3
"""Coordinates of the trunk (forward, up, lean) and of a leg (hip, knee, ankle) in MuJoCo's order."""


class LoopSettings(NamedTuple):
    """Constants of a walk."""

    dt: float
    """Time step [s]."""
    body_weight: float
    """Weight [N]."""
    slope: float
    """Slope of the ground [rad], uphill positive."""
    activation_time_constant: float
    """Time constant of the activation [s]."""
    stance_on: float
    """Load [body weights] above which a leg is in stance."""
    stance_off: float
    """Load [body weights] below which a leg is in swing."""
    hip_delay: int
    """Delay of hip and trunk [steps]."""
    knee_delay: int
    """Delay of the knee [steps]."""
    ankle_delay: int
    """Delay of the ankle [steps]."""
    depth: int
    """Depth of the delay lines [samples]."""
    is_prosthetic: int
    """1 with a prosthesis on the right leg."""
    left_load: int
    """Index of the vertical ground reaction of the left leg among MuJoCo's sensors."""
    right_load: int
    """Index of that of the right leg."""
    pylon_load: int
    """Index of the force along the pylon; unused without a prosthesis."""


def has_muscle(settings: LoopSettings, side: int, muscle: int) -> bool:
    """Return whether the leg has the muscle: an amputated leg lacks those of the calf."""
    return side == 0 or settings.is_prosthetic == 0 or muscle < N_THIGH_MUSCLES


def get_ankle_angle(settings: LoopSettings, side: int, qpos: Any) -> float:
    """Return the ankle angle [rad] for the muscles; 0 for a prosthesis, which none of them crosses."""
    if side == 1 and settings.is_prosthetic != 0:
        return 0.0
    angle: float = qpos[HAT_DOFS + LEG_DOFS * side + 2]
    return angle


def step_muscles(settings: LoopSettings, muscle_rows: Any, qpos: Any, applied: Any, state: Any) -> None:
    """Advance activations and fibers by one step, and write the moments [N*m] into ``applied``."""
    for side in range(layout.N_SIDES):
        first = HAT_DOFS + LEG_DOFS * side
        hip, knee, ankle = qpos[first], qpos[first + 1], get_ankle_angle(settings, side, qpos)
        hip_moment, knee_moment, ankle_moment = 0.0, 0.0, 0.0
        for i in range(layout.N_MUSCLES):
            if not has_muscle(settings, side, i):
                continue
            index = side * layout.N_MUSCLES + i
            muscle = muscles.unpack_muscle(to_tuple(muscle_rows[i], ROW_SIZE))
            unit = muscle.unit
            activation = state[layout.ACTIVATION + index]
            activation += (
                settings.dt / settings.activation_time_constant * (state[layout.STIMULATION + index] - activation)
            )
            previous_length = state[layout.FIBER_LENGTH + index]
            unit_length = muscles.compute_unit_length(muscle, hip, knee, ankle)
            fiber = muscle_tendon.step_fiber(unit, activation, previous_length, unit_length, settings.dt)
            state[layout.ACTIVATION + index] = activation
            state[layout.FIBER_LENGTH + index] = fiber.length
            previous_force = state[layout.TENDON_FORCE + index]
            state[layout.TENDON_FORCE + index] = fiber.tendon_force
            tension = fiber.tendon_force * unit.max_force
            hip_moment -= tension * muscles.compute_arm(muscle.hip, hip)
            knee_moment -= tension * muscles.compute_arm(muscle.knee, knee)
            ankle_moment -= tension * muscles.compute_arm(muscle.ankle, ankle)
            shortening = (previous_length - fiber.length) * unit.optimal_length * unit.max_force
            state[layout.FIBER_WORK] += 0.5 * (previous_force + fiber.tendon_force) * shortening
            state[layout.POSITIVE_FIBER_WORK] += max(0.0, fiber.active_force * shortening)
            state[layout.SQUARED_ACTIVATION] += settings.dt * activation * activation
            state[layout.METABOLIC_MINETTI] += settings.dt * metabolic_power.minetti_alexander_power(
                unit, activation, fiber.velocity
            )
            isometric = activation * muscle_tendon.force_length(fiber.length)
            state[layout.METABOLIC_BHARGAVA] += settings.dt * metabolic_power.bhargava_power(
                unit, muscle.slow_fraction, activation, fiber.length, fiber.velocity, isometric, fiber.active_force
            )
        applied[first] = hip_moment
        applied[first + 1] = knee_moment
        applied[first + 2] = ankle_moment


def write_senses(settings: LoopSettings, qpos: Any, qvel: Any, state: Any, slot: int) -> None:
    """Write what the reflexes sense now into sample ``slot`` of the delay lines."""
    lean = qpos[2] - settings.slope
    start = layout.DELAY_LINES + slot * layout.N_SENSES
    for side in range(layout.N_SIDES):
        first, m = HAT_DOFS + LEG_DOFS * side, side * layout.N_MUSCLES
        s = start + side * layout.N_LEG_SENSES
        state[s] = state[layout.TENDON_FORCE + m + 5]
        state[s + 1] = state[layout.FIBER_LENGTH + m + 6]
        state[s + 2] = state[layout.TENDON_FORCE + m + 4]
        state[s + 3] = state[layout.TENDON_FORCE + m + 3]
        state[s + 4] = qpos[first + 1]
        state[s + 5] = qvel[first + 1]
        state[s + 6] = state[layout.LOAD + side]
        state[s + 7] = state[layout.TENDON_FORCE + m + 2]
        state[s + 8] = state[layout.TENDON_FORCE + m]
        state[s + 9] = state[layout.FIBER_LENGTH + m + 1]
        state[s + 10] = state[layout.FIBER_LENGTH + m + 2]
        # Thigh and shank are equally long, so the line from hip to ankle halves the angle between them.
        state[s + 11] = qpos[first] - lean - 0.5 * qpos[first + 1]
    trunk = start + layout.N_SIDES * layout.N_LEG_SENSES
    state[trunk] = lean
    state[trunk + 1] = qvel[2]
    state[trunk + 2] = qvel[0]


def read_leg_senses(settings: LoopSettings, state: Any, count: int, side: int) -> reflexes.LegSenses:
    """Return the delayed senses of a leg at step ``count``."""
    offset = layout.DELAY_LINES + side * layout.N_LEG_SENSES
    hip = offset + (count - settings.hip_delay) % settings.depth * layout.N_SENSES
    knee = offset + (count - settings.knee_delay) % settings.depth * layout.N_SENSES
    ankle = offset + (count - settings.ankle_delay) % settings.depth * layout.N_SENSES
    return reflexes.LegSenses(
        state[ankle],
        state[ankle + 1],
        state[ankle + 2],
        state[knee + 3],
        state[knee + 4],
        state[knee + 5],
        state[hip + 6],
        state[hip + 7],
        state[hip + 8],
        state[hip + 9],
        state[hip + 10],
        state[hip + 11],
    )


def read_trunk_senses(settings: LoopSettings, state: Any, count: int) -> reflexes.TrunkSenses:
    """Return the delayed senses of the trunk at step ``count``."""
    slot = (count - settings.hip_delay) % settings.depth
    trunk = layout.DELAY_LINES + slot * layout.N_SENSES + layout.N_SIDES * layout.N_LEG_SENSES
    return reflexes.TrunkSenses(state[trunk], state[trunk + 1], state[trunk + 2])


def update_stance(settings: LoopSettings, state: Any, side: int, load: float, trunk: reflexes.TrunkSenses) -> None:
    """Note a foot strike or a toe-off of a leg with delayed ``load`` [body weights]."""
    if state[layout.STANCE + side] < 0.5:
        if load > settings.stance_on:
            state[layout.STANCE + side] = 1.0
            state[layout.STRIKE_TIME + side] = state[layout.STEP_COUNT] * settings.dt
    elif load < settings.stance_off:
        state[layout.STANCE + side] = 0.0
        state[layout.TOE_OFF_LEAN + side] = trunk.lean
        state[layout.TOE_OFF_SPEED + side] = trunk.speed


def step_reflexes(settings: LoopSettings, left: Any, right: Any, state: Any, count: int) -> None:
    """Set the stimulations from the delayed senses; ``left`` and ``right`` are the gains of the legs."""
    trunk = read_trunk_senses(settings, state, count)
    left_leg, right_leg = read_leg_senses(settings, state, count, 0), read_leg_senses(settings, state, count, 1)
    update_stance(settings, state, 0, left_leg.load, trunk)
    update_stance(settings, state, 1, right_leg.load, trunk)
    is_double = state[layout.STANCE] > 0.5 and state[layout.STANCE + 1] > 0.5
    for side in range(layout.N_SIDES):
        gains, leg, other = (left, left_leg, right_leg) if side == 0 else (right, right_leg, left_leg)
        if state[layout.STANCE + side] > 0.5:
            is_trailing = is_double and state[layout.STRIKE_TIME + side] < state[layout.STRIKE_TIME + 1 - side]
            stimulations = reflexes.stimulate_stance(gains, leg, trunk, other.load, is_trailing)
        else:
            stimulations = reflexes.stimulate_swing(
                gains,
                leg,
                trunk,
                other.leg_angle,
                state[layout.TOE_OFF_LEAN + side],
                state[layout.TOE_OFF_SPEED + side],
            )
        for i in range(layout.N_MUSCLES):
            if has_muscle(settings, side, i):
                state[layout.STIMULATION + side * layout.N_MUSCLES + i] = stimulations[i]


def update_phase(settings: LoopSettings, state: Any) -> None:
    """Update the estimated phase of the right leg: time since the last foot strike and duration of the last stride."""
    load = state[layout.PYLON_LOAD]
    state[layout.PHASE_TIME] += settings.dt
    if state[layout.PHASE_CONTACT] < 0.5:
        if load > CONTACT_ON_BW:
            state[layout.PHASE_CONTACT] = 1.0
            # A bounce is not a new stride.
            if state[layout.PHASE_TIME] > MIN_STRIDE_FRACTION * NOMINAL_STRIDE_TIME:
                state[layout.STRIDE_TIME] = min(state[layout.PHASE_TIME], MAX_STRIDE_FRACTION * NOMINAL_STRIDE_TIME)
                state[layout.PHASE_TIME] = 0.0
    elif load < CONTACT_OFF_BW:
        state[layout.PHASE_CONTACT] = 0.0


def measure_step(settings: LoopSettings, qpos: Any, sensors: Any, state: Any) -> None:
    """Read the loads of the last step and add to the sums over the walk."""
    state[layout.LOAD] = abs(sensors[settings.left_load]) / settings.body_weight
    state[layout.LOAD + 1] = abs(sensors[settings.right_load]) / settings.body_weight
    if settings.is_prosthetic != 0:
        state[layout.PYLON_LOAD] = -sensors[settings.pylon_load] / settings.body_weight
    else:
        state[layout.PYLON_LOAD] = state[layout.LOAD + 1]
    lean = abs(qpos[2] - settings.slope)
    state[layout.TRUNK_LEAN] += settings.dt * max(0.0, lean - TRUNK_LEAN_ANGLE)
    for side in range(layout.N_SIDES):
        first = HAT_DOFS + LEG_DOFS * side
        overload = max(0.0, state[layout.LOAD + side] - OVERLOAD_BW)
        state[layout.OVERLOAD] += settings.dt * overload * overload
        state[layout.KNEE_STOP] += settings.dt * max(0.0, KNEE_STOP_ANGLE - qpos[first + 1])
        if state[layout.STANCE + side] < 0.5 and has_muscle(settings, side, N_THIGH_MUSCLES):
            excess = max(0.0, qpos[first + 2] - SWING_DORSIFLEXION_ANGLE)
            state[layout.SWING_DORSIFLEXION] += settings.dt * excess


def settle_muscles(settings: LoopSettings, muscle_rows: Any, qpos: Any, state: Any) -> None:
    """Bring fibers and tendons into equilibrium at the posture and the activations of ``state``."""
    for side in range(layout.N_SIDES):
        first = HAT_DOFS + LEG_DOFS * side
        ankle = get_ankle_angle(settings, side, qpos)
        for i in range(layout.N_MUSCLES):
            if not has_muscle(settings, side, i):
                continue
            index = side * layout.N_MUSCLES + i
            muscle = muscles.unpack_muscle(to_tuple(muscle_rows[i], ROW_SIZE))
            unit_length = muscles.compute_unit_length(muscle, qpos[first], qpos[first + 1], ankle)
            activation = state[layout.ACTIVATION + index]
            for _ in range(SETTLING_STEPS):
                fiber = muscle_tendon.step_fiber(
                    muscle.unit, activation, state[layout.FIBER_LENGTH + index], unit_length, SETTLING_DT
                )
                state[layout.FIBER_LENGTH + index] = fiber.length
                state[layout.TENDON_FORCE + index] = fiber.tendon_force


def fill_delay_lines(settings: LoopSettings, qpos: Any, qvel: Any, state: Any) -> None:
    """Fill the delay lines with what the walker senses now, as if it had always been so."""
    for slot in range(settings.depth):
        write_senses(settings, qpos, qvel, state, slot)


def has_fallen(settings: LoopSettings, qpos: Any) -> bool:
    """Return whether the hip is too low, the trunk leans too far, or the posture is not finite."""
    is_upright = qpos[1] > FALL_HEIGHT and abs(qpos[2] - settings.slope) < FALL_LEAN
    return not is_upright


def compute_muscle_power(applied: Any, qvel: Any) -> float:
    """Return the power [W] of the muscles on the joints."""
    power = 0.0
    for i in range(HAT_DOFS, HAT_DOFS + 2 * LEG_DOFS):
        power += applied[i] * qvel[i]
    return power


def take_steps(
    settings: LoopSettings,
    muscle_rows: Any,
    left_row: Any,
    right_row: Any,
    model: Any,
    data: Any,
    qpos: Any,
    qvel: Any,
    applied: Any,
    actuator_moments: Any,
    sensors: Any,
    device_state: Any,
    state: Any,
    push: float,
    n_steps: int,
    record: Any,
) -> int:
    """Take up to ``n_steps`` steps, and return how many were taken before a fall.

    ``model`` and ``data`` are MuJoCo's (or their addresses); the arrays after them are views of its memory. ``push`` is
    a forward force on the hip [N]. ``record`` (n, columns) receives a row per step, or has no rows: positions and
    velocities before the step, then the forces evaluated there, the head of the state after it, and at its end the
    state of the device before it (what ``record`` has columns for).
    """
    left = reflexes.ReflexGains(*to_tuple(left_row, N_GAINS))
    right = reflexes.ReflexGains(*to_tuple(right_row, N_GAINS))
    n_q, n_sensors = len(qpos), len(sensors)
    n_values = 4 * n_q + n_sensors + layout.DELAY_LINES
    for k in range(n_steps):
        if has_fallen(settings, qpos):
            return k
        count = int(state[layout.STEP_COUNT])
        step_muscles(settings, muscle_rows, qpos, applied, state)
        applied[0] = push
        write_senses(settings, qpos, qvel, state, count % settings.depth)
        step_reflexes(settings, left, right, state, count)
        is_recorded = k < len(record)
        if is_recorded:
            for i in range(n_q):
                record[k, i] = qpos[i]
                record[k, n_q + i] = qvel[i]
                record[k, 2 * n_q + i] = applied[i]
            for i in range(record.shape[1] - n_values):
                record[k, n_values + i] = device_state[i]
        power_before = compute_muscle_power(applied, qvel)
        push_power_before = push * qvel[0]
        step_model(model, data)
        # The mean of both velocities gives the work that changes the kinetic energy.
        work = 0.5 * settings.dt * (power_before + compute_muscle_power(applied, qvel))
        state[layout.MUSCLE_JOINT_WORK] += work
        state[layout.PUSH_WORK] += 0.5 * settings.dt * (push_power_before + push * qvel[0])
        state[layout.STEP_COUNT] = count + 1.0
        measure_step(settings, qpos, sensors, state)
        update_phase(settings, state)
        if is_recorded:
            for i in range(n_q):
                record[k, 3 * n_q + i] = actuator_moments[i]
            for i in range(n_sensors):
                record[k, 4 * n_q + i] = sensors[i]
            for i in range(layout.DELAY_LINES):
                record[k, 4 * n_q + n_sensors + i] = state[i]
    return n_steps
