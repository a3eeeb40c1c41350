"""Recording of a walk: channels with units from the rows that the time steps wrote."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from klute_sim.gait.body import PROSTHESIS_PREFIX
from klute_sim.plant.coupling import N_BASE_STATES
from klute_sim.recording.recording import Recording
from klute_sim.types import Array
from klute_sim.units import BAR
from klute_sim.walker.person.body import MUSCLES, SIDES
from klute_sim.walker.simulation import state as layout
from klute_sim.walker.simulation.simulator import WalkSimulator
from klute_sim.walker.simulation.stepping import HAT_DOFS, LEG_DOFS, has_muscle

_JOINTS = ("hip", "knee", "ankle")
Columns = list[tuple[str, NDArray[np.floating[Any]]]]


def build_recording(
    simulator: WalkSimulator, rows: Array, pressures: Array | None, provenance: Mapping[str, Any]
) -> Recording:
    """Return the recording of ``rows`` (steps, :attr:`WalkSimulator.record_width`).

    ``pressures`` are the commanded gauge pressures [Pa] of all steps; None: there is no device. Angles are those of the
    joints, flexion and dorsiflexion positive; a moment is that of the muscles, positive the same way, and that of the
    prosthetic ankle is the device's alone. The metabolic energies are sums from the start.
    """
    n_q, dt = int(simulator.model.nq), simulator.settings.dt
    qpos, qvel, applied, actuator = (rows[:, k * n_q : (k + 1) * n_q] for k in range(4))
    sensors = rows[:, 4 * n_q : 4 * n_q + int(simulator.model.nsensordata)]
    state = rows[:, 4 * n_q + int(simulator.model.nsensordata) :]
    columns: Columns = [
        ("time [s]", np.arange(len(rows)) * dt),
        ("phase_estimate [%]", 100.0 * np.minimum(state[:, layout.PHASE_TIME] / state[:, layout.STRIDE_TIME], 1.0)),
        ("hip_x [m]", qpos[:, 0]),
        ("hip_z [m]", qpos[:, 1]),
        ("trunk_lean [deg]", np.degrees(qpos[:, 2] - simulator.settings.slope)),
        ("speed [m/s]", qvel[:, 0]),
        ("push [N]", applied[:, 0]),
    ]
    for side, name in enumerate(SIDES):
        columns += _build_leg(simulator, side, name, qpos, qvel, applied, sensors, state)
    columns += [
        ("metabolic_energy_minetti [J]", state[:, layout.METABOLIC_MINETTI]),
        ("metabolic_energy_bhargava [J]", state[:, layout.METABOLIC_BHARGAVA]),
        ("fiber_work [J]", state[:, layout.FIBER_WORK]),
        ("muscle_joint_work [J]", state[:, layout.MUSCLE_JOINT_WORK]),
    ]
    if simulator.is_prosthetic:
        columns += _build_prosthesis(simulator, qpos, qvel, actuator, state, rows[:, -N_BASE_STATES:], pressures)
    return Recording.from_columns(columns, provenance)


def _build_leg(
    simulator: WalkSimulator, side: int, name: str, qpos: Array, qvel: Array, applied: Array, sensors: Array,
    state: Array,
) -> Columns:  # fmt: skip
    settings, first = simulator.settings, HAT_DOFS + LEG_DOFS * side
    has_calf = has_muscle(settings, side, len(MUSCLES) - 1)
    columns: Columns = []
    for k, joint in enumerate(_JOINTS):
        sign = -1.0 if joint == "ankle" and not has_calf else 1.0
        columns.append((f"{joint}_angle_{name} [deg]", sign * np.degrees(qpos[:, first + k])))
        if joint != "ankle" or has_calf:
            columns.append((f"{joint}_moment_{name} [N*m]", applied[:, first + k]))
            columns.append((f"{joint}_power_{name} [W]", applied[:, first + k] * qvel[:, first + k]))
    vertical = settings.left_load if side == 0 else settings.right_load
    # MuJoCo gives the force of the foot on the ground.
    columns.append((f"grf_forward_{name} [N]", -sensors[:, vertical - 2]))
    columns.append((f"grf_vertical_{name} [N]", -sensors[:, vertical]))
    columns.append((f"stance_{name} [1]", state[:, layout.STANCE + side]))
    for i, muscle in enumerate(MUSCLES):
        if has_muscle(settings, side, i):
            index = side * layout.N_MUSCLES + i
            columns.append((f"activation_{muscle}_{name} [1]", state[:, layout.ACTIVATION + index]))
            force = state[:, layout.TENDON_FORCE + index] * simulator.muscle_rows[i, 0]
            columns.append((f"force_{muscle}_{name} [N]", force))
    return columns


def _build_prosthesis(
    simulator: WalkSimulator, qpos: Array, qvel: Array, actuator: Array, state: Array, device_state: Array,
    pressures: Array | None,
) -> Columns:  # fmt: skip
    model = simulator.model
    ankle = int(model.joint(PROSTHESIS_PREFIX + "ankle").dofadr[0])
    heel = int(model.joint(PROSTHESIS_PREFIX + "heel").dofadr[0])
    columns: Columns = [
        ("pylon_load [1]", state[:, layout.PYLON_LOAD]),
        ("heel_compression [m]", qpos[:, heel]),
    ]
    if pressures is not None and simulator.actuator is not None:
        pressure, offset = device_state.T
        columns += [
            ("pressure_command [bar]", pressures[: len(qpos)] / BAR),
            ("pressure [bar]", pressure),
            ("muscle_length [m]", simulator.actuator.parameters.muscle.resting_length + offset),
            ("device_moment [N*m]", actuator[:, ankle]),
            ("device_power [W]", actuator[:, ankle] * qvel[:, ankle]),
        ]
    return columns
