"""``klute_sim/AnkleBench-v0``: control of the device alone on a tensile tester, for a target force or for efficient
work.
"""

from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from klute_sim.bench.build import build_tester, compute_servo_commands, place_crosshead
from klute_sim.controllers.pressure import load_default_profile
from klute_sim.device.device import DEFAULT_DEVICE, Device
from klute_sim.device.dynamics import compute_taut_state, compute_tension
from klute_sim.envs.ankle_gait import make_action_space, validate_action
from klute_sim.envs.tasks.actions import ActionDecoder, select_action_kind
from klute_sim.envs.tasks.bench_task import (
    AIR_MASS_OFFSET_G,
    BENCH_TASKS,
    FORCE_ERROR_SCALE,
    OBSERVATIONS,
    SMOOTHNESS_WEIGHT,
    WORK_REWARD_WEIGHT,
    BenchTrajectory,
    TrajectoryGenerator,
)
from klute_sim.envs.tasks.energy_accounting import DeviceStates, EnergyAccounting
from klute_sim.envs.tasks.options import resolve_device
from klute_sim.errors import InputError, SimulationError
from klute_sim.plant import callbacks
from klute_sim.plant.actuator import DeviceActuator
from klute_sim.units import BAR

Observation = NDArray[np.float32]
CONTROL_INTERVAL = 0.01
"""Interval between two actions [s]."""
MAX_DURATION = 600.0
"""Longest episode [s]."""
ZERO_PHASE, SINGLE_MASK = np.zeros(1), np.ones(1, dtype=np.bool_)


class AnkleBenchEnv(gymnasium.Env[Observation, NDArray[np.float32]], gymnasium.utils.EzPickle):
    """The muscle-tendon unit between a load cell and a crosshead that prescribes its length.

    A smaller problem than gait with the same device: control of force, or of work, through pressure, damper and tendon.

    ## Action space

    ``Box(-1, 1, (1,), float32)``, held for 10 ms: gauge pressure from 0 (-1) to the supply pressure (1), or, for a
    device
    that takes valve openings, the opening from exhaust (-1) to fill (1). Values outside are clipped; NaN is refused.

    ## Observation space

    ``Box((5,), float32)``, clipped to the bounds:

    | # | observation | unit | low | high |
    |---|---|---|---|---|
    | 0 | length of the unit beyond the middle of its travel | cm | -20 | 20 |
    | 1 | velocity of the unit, lengthening positive | m/s | -5 | 5 |
    | 2 | force on the load cell, pulling positive | kN | -20 | 20 |
    | 3 | gauge pressure | bar | 0 | 20 |
    | 4 | target force; 0 in the task work | kN | 0 | 20 |

    ## Tasks and rewards

    | task | objective |
    |---|---|
    | ``force`` | pull with a force that changes smoothly at random while the crosshead moves likewise |
    | ``work`` | do as much work per gram of air as possible over a cycle of the crosshead |

    | term | value |
    |---|---|
    | ``reward_force`` | exp(-d²/2), d = deviation from the target force, in 5 % of the maximum force; task ``force`` |
    | ``reward_work`` | at the end of each cycle 0.1 per J/g: work over air mass plus 0.1 g; task ``work`` |
    | ``reward_smoothness`` | -0.05 times the squared change of the action |

    The crosshead moves between the lengths of a just taut unit with the muscle at 0.88 and 0.97 of its resting length.
    Target forces are 0.1 to 0.5 of the maximum force, that of the muscle at mid travel and supply pressure. Length and
    force are sums of four sines of up to 1.5 Hz; a cycle is one sine of ``cycle_duration`` seconds.

    ``info`` holds the terms, ``force_n``, ``pressure_command_bar`` (or ``valve_command``), air and work of the interval
    under the names of ``klute_sim/AnkleGait``, and at the end of a cycle ``cycle_work_j`` and ``cycle_air_g``.

    ## Episode

    An episode starts with a just taut tendon and a random pressure between 0 and a quarter of the supply pressure (0
    for
    a device that takes valve openings). It is truncated after ``duration`` seconds and terminated when a state is not
    finite.

    ## Versions

    * v0: first version.
    """

    metadata: dict[str, Any] = {"render_modes": [], "render_fps": round(1.0 / CONTROL_INTERVAL)}  # noqa: RUF012

    def __init__(
        self,
        *,
        task: str = "force",
        device: Device | str | Path = DEFAULT_DEVICE,
        duration: float = 5.0,
        cycle_duration: float = 1.0,
        time_step: float = 5e-4,
        backend: str = "auto",
        render_mode: None = None,
    ) -> None:
        """Create the environment of a ``task`` for a ``device`` (preset, path or Device).

        ``duration`` [s] of an episode, ``cycle_duration`` [s] of the task work, ``time_step`` [s]; ``backend`` is auto,
        compiled or python. Raises InputError when an option is invalid.
        """
        gymnasium.utils.EzPickle.__init__(**locals())
        if task not in BENCH_TASKS:
            raise InputError(f"task is '{task}'; allowed: {', '.join(BENCH_TASKS)}")
        self._steps_per_action = _count_intervals("time_step", CONTROL_INTERVAL, time_step, "divisors of 10 ms")
        self._actions_per_cycle = _count_intervals(
            "cycle_duration", cycle_duration, CONTROL_INTERVAL, "multiples of 10 ms from 100 ms", min_count=10
        )
        if not cycle_duration <= duration <= MAX_DURATION:
            raise InputError(
                f"duration is {duration:g} s; allowed: a cycle ({cycle_duration:g} s) to {MAX_DURATION:g} s"
            )
        self._actions_per_episode, bench_device = round(duration / CONTROL_INTERVAL), resolve_device(device)
        self.model = build_tester(bench_device, time_step)
        """MuJoCo model of the tester including the device."""
        self.data = mujoco.MjData(self.model)
        """State of the simulation."""
        self.render_mode = render_mode
        self.action_space = make_action_space()
        low, high = (np.array([row[k] for row in OBSERVATIONS], dtype=np.float32) for k in (2, 3))
        self.observation_space = spaces.Box(low, high, dtype=np.float32)
        self._task, self._backend = task, callbacks.choose_backend(backend)
        self._trajectory_generator = TrajectoryGenerator(
            bench_device, task, self._actions_per_episode, CONTROL_INTERVAL, time_step, cycle_duration
        )
        self._actuator = DeviceActuator(self.model, "muscle_tendon")
        parameters = self._actuator.parameters
        kind = select_action_kind(None, parameters.supply.command_is_opening != 0.0, bench_device.name)
        self._action_decoder = ActionDecoder(
            kind, parameters, load_default_profile(), 1.0, 1, self._steps_per_action, time_step
        )
        self._energy = EnergyAccounting(parameters, 1, self._backend)
        self._servo_ctrl_index = int(self.model.actuator_ctrladr[self.model.actuator("servo").id])
        self._load_cell_index = int(self.model.sensor("load_cell").adr[0])
        self._action_count, self._previous_action, self._cycle_totals = 0, ZERO_PHASE, {"work": 0.0, "air": 0.0}

    @property
    def dt(self) -> float:
        """Return the interval between two actions [s]."""
        return CONTROL_INTERVAL

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode with a new trajectory; ``options`` are not used."""
        super().reset(seed=seed)
        self._trajectory: BenchTrajectory = self._trajectory_generator.sample(self.np_random)
        self._servo_commands = compute_servo_commands(self._trajectory.unit_length, self.model.opt.timestep)
        parameters, length = self._actuator.parameters, self._trajectory.unit_length
        initial_state = compute_taut_state(
            parameters, float(length[0]), self.np_random.uniform(0.0, 0.25 * parameters.supply.max_pressure)
        )
        mujoco.mj_resetData(self.model, self.data)
        self._actuator.set_state(self.data, initial_state)
        load = compute_tension(parameters, initial_state, float(length[0]), 0.0)
        place_crosshead(self.data, float(length[0]), float(length[1] - length[0]) / self.model.opt.timestep, load)
        self.data.ctrl[self._servo_ctrl_index] = self._servo_commands[0]
        self._actuator.set_command(
            self.data, 0.0 if parameters.supply.command_is_opening != 0.0 else initial_state.pressure
        )
        with callbacks.device_callbacks(self._backend):
            mujoco.mj_forward(self.model, self.data)
        self._action_count, self._cycle_totals = 0, {"work": 0.0, "air": 0.0}
        self._previous_action = self._action_decoder.reset(SINGLE_MASK, np.array([initial_state.pressure / BAR]))
        self._energy.reset(SINGLE_MASK, self._device_states())
        return self._observe(), {}

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Hold ``action`` for one interval; raises InputError when it is NaN."""
        valid_action = np.clip(validate_action(action, (1,)), -1.0, 1.0)
        command, servo_index = (
            self._action_decoder.decode(valid_action, ZERO_PHASE),
            self._action_count * self._steps_per_action,
        )
        with callbacks.device_callbacks(self._backend):
            try:
                for steps, scheduled_command in self._action_decoder.schedule_commands(command, SINGLE_MASK):
                    self.data.ctrl[self._actuator.ctrl_address] = scheduled_command[0]
                    for target in self._servo_commands[servo_index : servo_index + steps]:
                        self.data.ctrl[self._servo_ctrl_index] = target
                        callbacks.step_model(self.model, self.data)
                    servo_index += steps
            except SimulationError:
                self.data.act[self._actuator.act_address] = np.nan  # under either law, a failed device ends the episode
        self._action_count += 1
        energy = {
            name: float(value[0]) for name, value in self._energy.update(SINGLE_MASK, self._device_states()).items()
        }
        action_change, self._previous_action = float(valid_action[0] - self._previous_action[0]), valid_action
        terms = {"reward_smoothness": SMOOTHNESS_WEIGHT * action_change * action_change}
        command_is_opening = self._actuator.parameters.supply.command_is_opening != 0.0
        info = {
            "force_n": self._measured_force(),
            "valve_command" if command_is_opening else "pressure_command_bar": float(command[0]),
        }
        if self._task == "force":
            error = (self._measured_force() - self._trajectory.target_force[self._action_count]) / (
                FORCE_ERROR_SCALE * self._trajectory_generator.max_force
            )
            terms["reward_force"] = float(np.exp(-0.5 * error * error))
        else:
            terms["reward_work"] = self._cycle_reward(energy, info)
        is_finite = bool(np.isfinite(self.data.qpos).all() and np.isfinite(self.data.act).all())
        if not is_finite:
            terms = dict.fromkeys(terms, 0.0)
        truncated = is_finite and self._action_count >= self._actions_per_episode
        return self._observe(), sum(terms.values()), not is_finite, truncated, {**terms, **info, **energy}

    def _cycle_reward(self, energy: dict[str, float], info: dict[str, float]) -> float:
        """Return the reward of the cycle that ends now and add its totals to ``info``; 0 within a cycle."""
        self._cycle_totals["work"] += energy["work_delivered_j"]
        self._cycle_totals["air"] += energy["air_g"]
        if self._action_count % self._actions_per_cycle:
            return 0.0
        work, air = self._cycle_totals["work"], self._cycle_totals["air"]
        info["cycle_work_j"], info["cycle_air_g"] = work, air
        self._cycle_totals = {"work": 0.0, "air": 0.0}
        return WORK_REWARD_WEIGHT * work / (air + AIR_MASS_OFFSET_G)

    def _measured_force(self) -> float:
        # The sensor measures the force of the unit on the load cell along x.
        return -float(self.data.sensordata[self._load_cell_index])

    def _observe(self) -> Observation:
        observation = np.array(
            [
                100.0 * (self._actuator.get_unit_length(self.data) - self._trajectory_generator.mean_length),
                self._actuator.get_unit_rate(self.data),
                1e-3 * self._measured_force(),
                float(self.data.act[self._actuator.act_address]),
                1e-3 * float(self._trajectory.target_force[self._action_count]),
            ]
        )
        low, high = ([row[k] for row in OBSERVATIONS] for k in (2, 3))
        return np.asarray(np.clip(np.nan_to_num(observation), low, high), dtype=np.float32)

    def _device_states(self) -> DeviceStates:
        data, first = self.data, self._actuator.act_address
        return DeviceStates(
            pressure=data.act[None, first] * BAR,
            muscle_length=self._actuator.parameters.muscle.resting_length + data.act[None, first + 1],
            muscle_velocity=data.act_dot[None, first + 1],
            unit_length=data.actuator_length[None, self._actuator.out_address],
            internal_state=data.act[None, first + 2 : first + self._actuator.n_states],
        )


def _count_intervals(name: str, total: float, interval: float, allowed: str, min_count: int = 1) -> int:
    """Return the number of ``interval`` in ``total`` [s]; raises InputError when it is not an integer."""
    count = round(total / interval) if interval > 0.0 and np.isfinite(total / interval) else 0
    if count < min_count or abs(count * interval - total) > 1e-9:
        raise InputError(f"{name} is {1e3 * (interval if name == 'time_step' else total):g} ms; allowed: {allowed}")
    return count
