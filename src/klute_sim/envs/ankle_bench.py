"""``klute_sim/AnkleBench-v0``: the device alone on a tensile tester, pulling as asked or working on little air."""

from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from klute_sim.control.pressure import tuned
from klute_sim.device.files import DEFAULT_PROSTHESIS, Device
from klute_sim.device.step import taut, tension
from klute_sim.envs.actions import Actions, kind_for
from klute_sim.envs.ankle_gait import action_space, checked
from klute_sim.envs.bench_task import (
    CLOSE,
    EASY_AIR,
    OBSERVATIONS,
    SMOOTHNESS,
    TASKS,
    WORTH,
    Course,
    Courses,
)
from klute_sim.envs.books import Books, DeviceStates
from klute_sim.envs.options import device_of
from klute_sim.errors import InputError, SimulationError
from klute_sim.plant import router
from klute_sim.plant.actuator import DeviceActuator
from klute_sim.rigs.bench.build import build, servo_commands, stand
from klute_sim.units import BAR

Observation = NDArray[np.float32]
INTERVAL = 0.01
"""Between two actions [s]."""
MOST_SECONDS = 600.0
NOW, ONE = np.zeros(1), np.ones(1, dtype=np.bool_)


class AnkleBenchEnv(gymnasium.Env[Observation, NDArray[np.float32]], gymnasium.utils.EzPickle):
    """The muscle-tendon unit between a load cell and a crosshead that prescribes its length.

    A smaller problem than walking, with the same device: how to command a force, or work, through pressure, damper
    and tendon.

    ## Action space

    ``Box(-1, 1, (1,), float32)``, held for 10 ms: gauge pressure from none (-1) to all that the supply has (1), or, for
    a device that takes openings, the opening of its valve from exhaust (-1) to fill (1). What is beyond is clipped;
    NaN is refused.

    ## Observation space

    ``Box((5,), float32)``, clipped to the bounds:

    | # | observation | unit | low | high |
    |---|---|---|---|---|
    | 0 | length of the unit beyond the middle of its way | cm | -20 | 20 |
    | 1 | velocity of the unit, lengthening positive | m/s | -5 | 5 |
    | 2 | force on the load cell, pulling positive | kN | -20 | 20 |
    | 3 | gauge pressure | bar | 0 | 20 |
    | 4 | force wanted; 0 in the task work | kN | 0 | 20 |

    ## Tasks and rewards

    | task | what to do |
    |---|---|
    | ``force`` | pull with a force that changes smoothly at random while the crosshead moves likewise |
    | ``work`` | do as much work per gram of air as possible over a cycle of the crosshead |

    | term | value |
    |---|---|
    | ``reward_force`` | exp(-d²/2), d = distance from the force wanted, in 5 % of the strongest force; task ``force`` |
    | ``reward_work`` | at the end of each cycle 0.1 per J/g: its work over its air plus 0.1 g; task ``work`` |
    | ``reward_smoothness`` | -0.05 times the squared change of the action |

    The crosshead moves between the lengths of a just taut unit with the muscle at 0.88 and 0.97 of its resting length.
    Forces wanted are 0.1 to 0.5 of the strongest, which is what the muscle holds in the middle under all the supply's
    pressure. Both courses are sums of four sines of up to 1.5 Hz; a cycle is one sine of ``cycle`` seconds.

    ``info`` holds the terms, ``force_n``, ``pressure_command_bar`` (or ``valve_command``), air and work of the
    interval under the names of ``klute_sim/AnkleGait``, and at the end of a cycle ``cycle_work_j`` and ``cycle_air_g``.

    ## Episode

    Starts with the tendon just taut, at a pressure anywhere between 0 and a quarter of the supply's (0 if the device
    takes openings). Truncated after ``seconds``; terminated when a state is not finite.

    ## Versions

    * v0: first version.
    """

    metadata: dict[str, Any] = {"render_modes": [], "render_fps": round(1.0 / INTERVAL)}  # noqa: RUF012

    def __init__(
        self,
        *,
        task: str = "force",
        device: Device | str | Path = DEFAULT_PROSTHESIS,
        seconds: float = 5.0,
        cycle: float = 1.0,
        step: float = 5e-4,
        law: str = "auto",
        render_mode: None = None,
    ) -> None:
        """A ``task`` for a ``device`` (preset, file or Device), ``seconds`` long; a ``cycle`` [s] and ``step`` [s].

        ``law`` is one of :data:`klute_sim.device.installation.LAWS`. Raises InputError for what cannot be.
        """
        gymnasium.utils.EzPickle.__init__(**locals())
        if task not in TASKS:
            raise InputError(f"task is '{task}'; allowed: {', '.join(TASKS)}")
        self._each = _whole("step", INTERVAL, step, "what divides 10 ms evenly")
        self._cycle = _whole("cycle", cycle, INTERVAL, "a whole number of 10 ms, 100 ms or more", least=10)
        if not cycle <= seconds <= MOST_SECONDS:
            raise InputError(f"seconds is {seconds:g}; allowed: a cycle ({cycle:g}) to {MOST_SECONDS:g}")
        self._length, own = round(seconds / INTERVAL), device_of(device)
        self.model = build(own, step)
        """The MuJoCo model of the tester, with the device in it."""
        self.data = mujoco.MjData(self.model)
        """The simulation."""
        self.render_mode = render_mode
        self.action_space = action_space()
        low, high = (np.array([row[k] for row in OBSERVATIONS], dtype=np.float32) for k in (2, 3))
        self.observation_space = spaces.Box(low, high, dtype=np.float32)
        self._task, self._law = task, router.choose(law)
        self._courses = Courses(own, task, self._length, INTERVAL, step, cycle)
        self._actuator = DeviceActuator(self.model, "muscle_tendon")
        parameters = self._actuator.parameters
        kind = kind_for(None, parameters.supply.opens != 0.0, own.name)
        self._actions = Actions(kind, parameters, tuned(), 1.0, 1, self._each, step)
        self._books = Books(parameters, 1, self._law)
        self._servo = int(self.model.actuator_ctrladr[self.model.actuator("servo").id])
        self._cell = int(self.model.sensor("load_cell").adr[0])
        self._steps, self._action, self._spent = 0, NOW, {"work": 0.0, "air": 0.0}

    @property
    def dt(self) -> float:
        """Time between two actions [s]."""
        return INTERVAL

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """A new course; there are no ``options``."""
        super().reset(seed=seed)
        self._course: Course = self._courses.draw(self.np_random)
        self._told = servo_commands(self._course.length, self.model.opt.timestep)
        parameters, length = self._actuator.parameters, self._course.length
        begin = taut(parameters, float(length[0]), self.np_random.uniform(0.0, 0.25 * parameters.supply.pressure))
        mujoco.mj_resetData(self.model, self.data)
        self._actuator.set_state(self.data, begin)
        load = tension(parameters, begin, float(length[0]), 0.0)
        stand(self.data, float(length[0]), float(length[1] - length[0]) / self.model.opt.timestep, load)
        self.data.ctrl[self._servo] = self._told[0]
        self._actuator.command(self.data, 0.0 if parameters.supply.opens != 0.0 else begin.pressure)
        with router.installed(self._law):
            mujoco.mj_forward(self.model, self.data)
        self._steps, self._spent = 0, {"work": 0.0, "air": 0.0}
        self._action = self._actions.begin(ONE, np.array([begin.pressure / BAR]))
        self._books.begin(ONE, self._device())
        return self._observe(), {}

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Hold ``action`` for one interval; raises InputError if it is no number."""
        chosen = np.clip(checked(action, (1,)), -1.0, 1.0)
        command, k = self._actions.asked(chosen, NOW), self._steps * self._each
        with router.installed(self._law):
            try:
                for steps, asked in self._actions.due(command, ONE):
                    self.data.ctrl[self._actuator.ctrl] = asked[0]
                    for target in self._told[k : k + steps]:
                        self.data.ctrl[self._servo] = target
                        router.step(self.model, self.data)
                    k += steps
            except SimulationError:
                self.data.act[self._actuator.act] = np.nan  # under either law, a failed device ends the episode
        self._steps += 1
        books = {name: float(value[0]) for name, value in self._books.turn(ONE, self._device()).items()}
        change, self._action = float(chosen[0] - self._action[0]), chosen
        terms = {"reward_smoothness": SMOOTHNESS * change * change}
        opens = self._actuator.parameters.supply.opens != 0.0
        told = {"force_n": self._force(), "valve_command" if opens else "pressure_command_bar": float(command[0])}
        if self._task == "force":
            apart = (self._force() - self._course.wanted[self._steps]) / (CLOSE * self._courses.strongest)
            terms["reward_force"] = float(np.exp(-0.5 * apart * apart))
        else:
            terms["reward_work"] = self._worth(books, told)
        finite = bool(np.isfinite(self.data.qpos).all() and np.isfinite(self.data.act).all())
        if not finite:
            terms = dict.fromkeys(terms, 0.0)
        truncated = finite and self._steps >= self._length
        return self._observe(), sum(terms.values()), not finite, truncated, {**terms, **told, **books}

    def _worth(self, books: dict[str, float], told: dict[str, float]) -> float:
        """What the cycle that ends now is worth, which is ``told``; 0 within a cycle."""
        self._spent["work"] += books["work_delivered_j"]
        self._spent["air"] += books["air_g"]
        if self._steps % self._cycle:
            return 0.0
        work, air = self._spent["work"], self._spent["air"]
        told["cycle_work_j"], told["cycle_air_g"] = work, air
        self._spent = {"work": 0.0, "air": 0.0}
        return WORTH * work / (air + EASY_AIR)

    def _force(self) -> float:
        return -float(self.data.sensordata[self._cell])  # the sensor tells what the unit does to the cell, along x

    def _observe(self) -> Observation:
        sensed = np.array(
            [
                100.0 * (self._actuator.unit_length(self.data) - self._courses.middle),
                self._actuator.unit_rate(self.data),
                1e-3 * self._force(),
                float(self.data.act[self._actuator.act]),
                1e-3 * float(self._course.wanted[self._steps]),
            ]
        )
        low, high = ([row[k] for row in OBSERVATIONS] for k in (2, 3))
        return np.asarray(np.clip(np.nan_to_num(sensed), low, high), dtype=np.float32)

    def _device(self) -> DeviceStates:
        data, first = self.data, self._actuator.act
        return DeviceStates(
            pressure=data.act[None, first] * BAR,
            length=self._actuator.parameters.muscle.resting_length + data.act[None, first + 1],
            rate=data.act_dot[None, first + 1],
            unit_length=data.actuator_length[None, self._actuator.out],
            remembered=data.act[None, first + 2 : first + self._actuator.states],
        )


def _whole(name: str, whole: float, part: float, allowed: str, least: int = 1) -> int:
    """How many times ``part`` goes into ``whole`` [s]; raises InputError if that is no whole number."""
    count = round(whole / part) if part > 0.0 and np.isfinite(whole / part) else 0
    if count < least or abs(count * part - whole) > 1e-9:
        raise InputError(f"{name} is {1e3 * (part if name == 'step' else whole):g} ms; allowed: {allowed}")
    return count
