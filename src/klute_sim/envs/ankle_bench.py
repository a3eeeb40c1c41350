"""``klute_sim/AnkleBench-v0``: control of the device alone on a tensile tester, for a target force or for efficient
work.
"""

from pathlib import Path

from klute_sim.device.device import DEFAULT_DEVICE, Device
from klute_sim.envs.base.scheduled import ScheduledTaskEnv
from klute_sim.envs.tasks.bench_task import BenchOptions, BenchTask
from klute_sim.envs.tasks.options import resolve_device
from klute_sim.plant import callbacks
from klute_sim.rendering.frames import DEFAULT_CAMERA, RenderOptions


class AnkleBenchEnv(ScheduledTaskEnv):
    """The muscle-tendon unit between a load cell and a crosshead that prescribes its length.

    A smaller problem than gait with the same device: control of force, or of work, through pressure, damper and tendon.

    ## Action space

    ``Box(-1, 1, (1,), float32)``, held for 10 ms: gauge pressure from 0 (-1) to the supply pressure (1), or, for a
    device that takes valve openings, the opening from exhaust (-1) to fill (1). Values outside are clipped; NaN and
    infinity are refused.

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
    for a device that takes valve openings). It is truncated after ``duration`` seconds and terminated when a state is
    not finite.

    ## Versions

    * v0: first version.
    """

    def __init__(
        self,
        *,
        task: str = "force",
        device: Device | str | Path = DEFAULT_DEVICE,
        duration: float = 5.0,
        cycle_duration: float = 1.0,
        time_step: float = 5e-4,
        backend: str = "auto",
        render_mode: str | None = None,
        width: int = 480,
        height: int = 480,
        camera: str = DEFAULT_CAMERA,
    ) -> None:
        """Create the environment of a ``task`` for a ``device`` (preset, path or Device).

        ``duration`` [s] of an episode, ``cycle_duration`` [s] of the task work, ``time_step`` [s]; ``backend`` is auto,
        compiled or python. With the ``render_mode`` human, rgb_array or depth_array it draws, from a ``camera`` of the
        model (side), images of ``width`` and ``height`` [pixels]. Raises InputError when an option is invalid.
        """
        options = BenchOptions(task=task, duration=duration, cycle_duration=cycle_duration, time_step=time_step)
        chosen_backend = callbacks.choose_backend(backend)
        render_options = RenderOptions(render_mode=render_mode, width=width, height=height, camera=camera)
        super().__init__(BenchTask(resolve_device(device), options, 1, chosen_backend), chosen_backend, render_options)
