"""Speed of the simulations as ratios against named alternatives, measured alternately in the same run.

    python3 scripts/env.py python benchmarks/speed.py            # a table
    python3 scripts/env.py python benchmarks/speed.py --json     # machine-readable
    python3 scripts/env.py python benchmarks/speed.py --quick    # a tenth of the repetitions

Machines are shared and noisy, so only ratios are meaningful. Each is the median over rounds in which the two alternate.
CPU seconds are those of the process.
"""

import argparse
import json
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import gymnasium
import mujoco
import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

import klute_sim  # noqa: F401  (registers the environments)
from klute_sim import bench
from klute_sim.controllers.pressure import load_default_profile
from klute_sim.controllers.state_machine import load_default_state_machine
from klute_sim.device.device import DEFAULT_DEVICE, load_device, parse_device
from klute_sim.device.dynamics import DeviceParameters
from klute_sim.device.rollout import simulate_rollouts
from klute_sim.device.schema.document import SECTION_OF_EFFECT
from klute_sim.effects import catalogue
from klute_sim.envs.tasks.joint_task import TENDONS
from klute_sim.gait.body import PROSTHESIS_PREFIX
from klute_sim.gait.rig.learning import prepare_gait_rig
from klute_sim.gait.rig.rig import simulate_gait
from klute_sim.gait.rig.setup import DRIVE_ACTUATORS, GaitOptions, GaitRig, build_gait_rig, reset_gait_rig
from klute_sim.gait.spring_foot import SpringFoot
from klute_sim.mechanism.assembly import prepare_actuator
from klute_sim.plant import callbacks, models
from klute_sim.plant.mjcf.model_file import load_model_file
from klute_sim.provenance import collect_versions
from klute_sim.walker.person.body import load_body
from klute_sim.walker.person.build import Prosthesis, build_walker_model
from klute_sim.walker.reflexes.walker_file import load_walker
from klute_sim.walker.simulation.commands import DeviceCommands
from klute_sim.walker.simulation.simulator import WalkSimulator
from klute_sim.walker.simulation.walk import Walk

DEVICE = load_device(DEFAULT_DEVICE)
VALVE_DEVICE = load_device("klute-1-1-4-pair-valve")
ENVIRONMENT_ID, BENCH_ID = "klute_sim/AnkleGait-v2", "klute_sim/AnkleBench-v0"
WALK_ID, JOINT_ID = "klute_sim/AnkleWalk-v0", "klute_sim/AntagonistJoint-v0"
STEPS_PER_CALL = 20


class SpeedRatio(NamedTuple):
    """One line of the table."""

    what: str
    against: str
    ratio: float
    aim: str
    met: bool


def compile_with_muscle(spec: mujoco.MjSpec, *actuators: str) -> mujoco.MjModel:
    """Return ``spec`` compiled with MuJoCo's built-in muscle in place of each device."""
    for actuator in actuators:
        muscle = spec.actuator(actuator)
        muscle.dyntype = mujoco.mjtDyn.mjDYN_MUSCLE
        muscle.gaintype = mujoco.mjtGain.mjGAIN_MUSCLE
        muscle.biastype = mujoco.mjtBias.mjBIAS_MUSCLE
        muscle.actdim = 1
        muscle.dynprm[:3] = [0.01, 0.04, 0.0]
        shape = [0.75, 1.05, 3000.0, 200.0, 0.5, 1.6, 1.5, 1.3, 1.2]
        muscle.gainprm[:9] = muscle.biasprm[:9] = shape
        muscle.lengthrange = [0.3, 0.4]
    return spec.compile()


def step_ankle(model: mujoco.MjModel, max_command: float, n_steps: int) -> None:
    """Simulate ``n_steps`` steps of the ankle on the ground with a command between 0.1 and 0.9 of ``max_command``."""
    data = mujoco.MjData(model)
    for k in range(n_steps // STEPS_PER_CALL):
        data.ctrl[0] = max_command * (0.5 + 0.4 * np.sin(0.1 * k))
        mujoco.mj_step(model, data, STEPS_PER_CALL)


def _run_on_threads(n_threads: int, task: Callable[[], None]) -> None:
    """Run ``task`` once on each of ``n_threads`` threads."""
    if n_threads == 1:
        task()
        return
    with ThreadPoolExecutor(n_threads) as pool:
        for future in [pool.submit(task) for _ in range(n_threads)]:
            future.result()


def measure_wall_time(task: Callable[[], Any]) -> float:
    """Return the wall time of ``task`` [s]."""
    start = time.perf_counter()
    task()
    return time.perf_counter() - start


def measure_cpu_time(task: Callable[[], Any]) -> float:
    """Return the CPU time of ``task`` [s]."""
    start = time.process_time()
    task()
    return time.process_time() - start


def measure_interleaved(n_rounds: int, clock: Callable[..., float], *tasks: Callable[[], Any]) -> list[float]:
    """Return the median over ``n_rounds`` of the time of each task relative to the first task in the same round."""
    for work in tasks:
        work()
    measured = [[clock(work) for work in tasks] for _ in range(n_rounds)]
    return [statistics.median(row[k] / row[0] for row in measured) for k in range(len(tasks))]


def add_all_effects() -> DeviceParameters:
    """Return the device behind a valve with the default form of every compatible effect at typical size."""
    sections = "".join(
        f"[effects.{effect.name}]\n" + "".join(f"{p.key} = {float(p.typical)}\n" for p in effect.forms[0].parameters)
        for effect in catalogue.get_effects().values()
        if effect.kind == "device" and not effect.replaces_switch and effect.name not in SECTION_OF_EFFECT
    )
    return parse_device(VALVE_DEVICE.content + sections.encode(), "with every effect").parameters


def measure_step_ratios(n_rounds: int) -> list[SpeedRatio]:
    """Compare the device with the built-in muscle in the same ankle."""
    device = models.attach_devices(models.load_spec("ankle"), {"muscle_tendon": DEVICE.parameters})
    valve = models.attach_devices(models.load_spec("ankle"), {"muscle_tendon": VALVE_DEVICE.parameters})
    friction = catalogue.pack_effects({("seal_friction", "coulomb"): {"force_n": 15.0}})
    rubbing = DEVICE.parameters._replace(effects=friction)
    single = models.attach_devices(models.load_spec("ankle"), {"muscle_tendon": rubbing})
    everything = models.attach_devices(models.load_spec("ankle"), {"muscle_tendon": add_all_effects()})
    muscle = compile_with_muscle(models.load_spec("ankle"), "muscle_tendon")

    def theirs(count: int, threads: int = 1) -> None:
        _run_on_threads(threads, lambda: step_ankle(muscle, 1.0, count // threads))

    def ours(name: str, count: int, threads: int = 1, model: mujoco.MjModel = device) -> None:
        with callbacks.device_callbacks(name):
            _run_on_threads(threads, lambda: step_ankle(model, 5.0, count // threads))

    # Long enough that to start two threads, and to be given a second core, takes nothing measurable.
    many, few = 40_000, 4_000
    works = [
        lambda: theirs(many),
        lambda: ours("compiled", many),
        lambda: ours("compiled", many, threads=2),
        lambda: theirs(many, threads=2),
        lambda: ours("compiled", many, model=single),
        lambda: ours("compiled", many, model=valve),
        lambda: ours("compiled", many, model=everything),
    ]
    _, one, two, muscles, rubs, behind, whole = measure_interleaved(n_rounds, measure_wall_time, *works)
    _, python = measure_interleaved(n_rounds, measure_wall_time, lambda: theirs(few), lambda: ours("python", few))
    against = "built-in muscle, one thread"
    return [
        SpeedRatio("step of the ankle, compiled backend", against, one, "<= 1.15", one <= 1.15),
        SpeedRatio("same number of steps on two threads", against, two, "<= 0.65", two <= 0.65),
        SpeedRatio("  (built-in muscle on two threads)", against, muscles, "", True),
        SpeedRatio("step of the ankle with one effect", against, rubs, "", True),
        SpeedRatio("step of the ankle with a valve", against, behind, "", True),
        SpeedRatio("  with a valve and every effect", against, whole, "<= 1.6", whole <= 1.6),
        SpeedRatio("step of the ankle, Python backend", against, python, "", True),
    ]


def build_passive_rig() -> GaitRig:
    """Return the gait rig with a passive spring foot in place of the device."""
    return build_gait_rig(DEVICE, GaitOptions(spring_foot=SpringFoot(stiffness=float(np.degrees(6.0)))), 0.01)


def step_passive_rig(rig: GaitRig, n_intervals: int) -> None:
    """Simulate ``n_intervals`` of 10 ms on the planned path with nothing but the drives and mj_step."""
    data = mujoco.MjData(rig.model)
    reset_gait_rig(rig, data, 0.0)
    for k in range(n_intervals):
        data.ctrl[: len(DRIVE_ACTUATORS)] = rig.command_rates[k % rig.commands_per_stride]
        mujoco.mj_step(rig.model, data, 20)


def measure_run_ratios(n_rounds: int) -> list[SpeedRatio]:
    """Compare runs of ``klute-sim gait`` with bare steps of the same rig with a passive foot, per simulated second."""
    passive, profile, strides = build_passive_rig(), load_default_profile(), 5
    learned = prepare_gait_rig(DEVICE, profile, GaitOptions(strides=strides)).options
    _, recorded, whole = measure_interleaved(
        n_rounds,
        measure_cpu_time,
        lambda: step_passive_rig(passive, strides * passive.commands_per_stride),
        lambda: simulate_gait(DEVICE, profile, learned),
        lambda: simulate_gait(DEVICE, profile, GaitOptions(strides=strides)),
    )
    against = "bare mj_step, passive spring foot"
    return [
        SpeedRatio("simulated second of a run on a known path, CPU time", against, recorded, "", True),
        SpeedRatio("  of five strides and the learning before them", against, whole, "", True),
    ]


def measure_gait_ratio(n_rounds: int) -> SpeedRatio:
    """Compare the gait rig with the same rig with the built-in muscle."""
    rig = build_gait_rig(DEVICE, GaitOptions(), 0.01)
    spec = models.load_spec("gait_rig")
    spec.option.timestep = rig.model.opt.timestep
    muscle = compile_with_muscle(spec, PROSTHESIS_PREFIX + "muscle_tendon")
    # The same bodies: the builder scales them to the subject and moves the tendon's origin.
    for name in ("body_mass", "body_inertia", "body_pos", "body_ipos", "geom_pos", "geom_size", "site_pos"):
        getattr(muscle, name)[:] = getattr(rig.model, name)

    def walk(model: mujoco.MjModel, most: float) -> None:
        begun, data = mujoco.MjData(rig.model), mujoco.MjData(model)
        reset_gait_rig(rig, begun, 1e5)
        data.qpos[:], data.qvel[:] = begun.qpos, begun.qvel
        data.act[: len(DRIVE_ACTUATORS)] = begun.act[: len(DRIVE_ACTUATORS)]
        for k in range(3 * rig.commands_per_stride):
            data.ctrl[: len(DRIVE_ACTUATORS)] = rig.command_rates[k % rig.commands_per_stride]
            data.ctrl[-1] = 0.3 * most
            mujoco.mj_step(model, data, 20)

    def ours() -> None:
        with callbacks.device_callbacks("compiled"):
            walk(rig.model, 5.0)

    slower = measure_interleaved(n_rounds, measure_wall_time, lambda: walk(muscle, 1.0), ours)[1]
    return SpeedRatio(
        "gait rig: steps per second", "same rig, built-in muscle", 1 / slower, ">= 0.85", 1 / slower >= 0.85
    )


def measure_environment_ratios(n_rounds: int) -> tuple[list[SpeedRatio], dict[str, float]]:
    """Compare environment steps with Walker2d and with a batch."""
    ours, walker = gymnasium.make(ENVIRONMENT_ID), gymnasium.make("Walker2d-v5")
    hold, noise = np.array([-0.6], dtype=np.float32), np.zeros(6, dtype=np.float32)

    def steps(env: gymnasium.Env[Any, Any], action: Any, count: int) -> None:
        env.reset(seed=0)
        for _ in range(count):
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()

    count = 550
    ratio = measure_interleaved(
        n_rounds, measure_cpu_time, lambda: steps(walker, noise, count), lambda: steps(ours, hold, count)
    )[1]
    each = statistics.median(measure_cpu_time(lambda: steps(ours, hold, count)) for _ in range(n_rounds)) / count
    passive = build_passive_rig()
    over_bare = measure_interleaved(
        n_rounds, measure_cpu_time, lambda: step_passive_rig(passive, count), lambda: steps(ours, hold, count)
    )[1]

    many = 16
    turn = gymnasium.make_vec(ENVIRONMENT_ID, many, "sync")
    batches = [gymnasium.make_vec(ENVIRONMENT_ID, many, "vector_entry_point", n_jobs=n) for n in (1, 2)]

    def vector(env: gymnasium.vector.VectorEnv[Any, Any, Any]) -> None:
        env.reset(seed=0)
        for _ in range(100):
            env.step(np.tile(hold, (many, 1)))

    _, one, two = measure_interleaved(
        n_rounds, measure_wall_time, lambda: vector(turn), lambda: vector(batches[0]), lambda: vector(batches[1])
    )
    benches = [gymnasium.make_vec(BENCH_ID, many, mode) for mode in ("sync", "vector_entry_point")]
    bench_batch = measure_interleaved(
        n_rounds, measure_wall_time, lambda: vector(benches[0]), lambda: vector(benches[1])
    )[1]
    creation = measure_interleaved(
        n_rounds, measure_cpu_time, lambda: gymnasium.make("Walker2d-v5"), lambda: gymnasium.make(ENVIRONMENT_ID)
    )[1]
    rate = 1.0 / each
    found = [
        SpeedRatio("environment: steps per CPU second, thousands", "1", rate / 1e3, ">= 3", rate >= 3000),
        SpeedRatio("environment step, CPU time", "Walker2d-v5 (4 steps of 2 ms; ours 20 of 0.5 ms)", ratio, "", True),
        SpeedRatio("environment steps per CPU second", "bare mj_step, passive spring foot", 1 / over_bare, "", True),
        SpeedRatio("16 environments vectorized, one thread: speed", "one after another", 1 / one, "", True),
        SpeedRatio(
            "16 environments vectorized, two threads: speed", "one after another", 1 / two, ">= 1.7", 1 / two >= 1.7
        ),
        SpeedRatio("  two threads of the vectorized environment: speed", "one thread", one / two, "", True),
        SpeedRatio("16 bench environments vectorized: speed", "one after another", 1 / bench_batch, "", True),
        SpeedRatio("another gymnasium.make, CPU time", "Walker2d-v5", creation, "", True),
    ]
    return found, {"environment_steps_per_cpu_second": rate}


def measure_joint_ratios(n_rounds: int) -> list[SpeedRatio]:
    """Compare a joint with two devices, and its environment, with the same joint with two built-in muscles."""
    count, env = 500, gymnasium.make(JOINT_ID)
    model = env.unwrapped.model  # type: ignore[attr-defined]
    spec = load_model_file("antagonist_joint").make_spec()
    spec.option.timestep = model.opt.timestep
    muscles = compile_with_muscle(spec, *(prepare_actuator(spec, name) for name in TENDONS))
    # The environment fits the origins of the tendons to the devices and stops the tendons at their longest.
    for name in ("site_pos", "tendon_range", "tendon_limited"):
        getattr(muscles, name)[:] = getattr(model, name)

    def move(rig: mujoco.MjModel, max_command: float) -> None:
        env.reset(seed=0)
        begin, data = env.unwrapped.data, mujoco.MjData(rig)  # type: ignore[attr-defined]
        data.qpos[:] = begin.qpos
        if rig is model:
            data.act[:] = begin.act
        for k in range(count):
            swing = 0.3 * np.sin(0.05 * k)
            data.ctrl[:] = max_command * np.array([0.4 + swing, 0.4 - swing])
            mujoco.mj_step(rig, data, STEPS_PER_CALL)

    def ours() -> None:
        with callbacks.device_callbacks("compiled"):
            move(model, 5.0)

    def steps() -> None:
        env.reset(seed=0)
        for k in range(count):
            swing = 0.6 * np.sin(0.05 * k)
            env.step(np.array([-0.2 + swing, -0.2 - swing], dtype=np.float32))

    _, rig, environment = measure_interleaved(n_rounds, measure_cpu_time, lambda: move(muscles, 1.0), ours, steps)
    against = "same joint, two built-in muscles"
    return [
        SpeedRatio("joint with two devices: steps per CPU second", against, 1 / rig, ">= 0.9", 1 / rig >= 0.9),
        SpeedRatio("joint environment: steps per CPU second", f"bare mj_step, {against}", 1 / environment, "", True),
    ]


def measure_walk_ratios(n_rounds: int) -> tuple[list[SpeedRatio], dict[str, float]]:
    """Compare environment steps of a predicted walk with the same walk in compiled code alone, and with a batch."""
    walker, machine, many, per_env = load_walker("machine-1"), load_default_state_machine(), 16, 32
    count, body = many * per_env, load_body()
    model = build_walker_model(body, Prosthesis(device=DEVICE))
    options: dict[str, Any] = {"action": "residual", "walkers": [walker.name]}
    single = gymnasium.make(WALK_ID, **options)
    batch = gymnasium.make_vec(WALK_ID, many, "vector_entry_point", n_jobs=1, **options)

    def alone() -> None:
        with callbacks.device_callbacks("compiled"):
            simulator = WalkSimulator(model, body)
            simulator.reset(walker.reflexes)
            Walk(simulator, DeviceCommands(simulator, machine, 10 * count)).advance(0.01 * count)

    def steps() -> None:
        single.reset(seed=0)
        for _ in range(count):
            single.step(np.zeros(1, dtype=np.float32))

    def vector() -> None:
        batch.reset(seed=0)
        for _ in range(per_env):
            batch.step(np.zeros((many, 1), dtype=np.float32))

    _, one, together = measure_interleaved(n_rounds, measure_cpu_time, alone, steps, vector)
    rates = [count / statistics.median(measure_cpu_time(task) for _ in range(n_rounds)) for task in (steps, vector)]
    against = "the same walk in compiled code alone"
    found = [
        SpeedRatio("walk environment: steps per CPU second, thousands", "1", rates[0] / 1e3, "", True),
        SpeedRatio("  16 vectorized, one thread", "1", rates[1] / 1e3, ">= 5", rates[1] >= 5000),
        SpeedRatio("walk environment: steps per CPU second", against, 1 / one, "", True),
        SpeedRatio("  16 vectorized, one thread", against, 1 / together, "", True),
    ]
    return found, {"walk_environment_steps_per_cpu_second": rates[0], "walk_vector_steps_per_cpu_second": rates[1]}


def measure_rollout_ratios(n_rounds: int) -> list[SpeedRatio]:
    """Compare the device alone with the bench in MuJoCo."""
    count, step = 4000, 5e-4
    time_ = np.arange(count) * step
    rest, slack = DEVICE.parameters.muscle.resting_length, DEVICE.parameters.tendon.slack_length
    length = slack + 0.93 * rest + 0.008 * np.sin(6.0 * np.pi * time_)
    command = np.where(2.0 * time_ % 1.0 < 0.5, 4e5, 1e5)
    spec = models.load_spec("bench")
    spec.option.timestep = step
    model = models.attach_devices(spec, {"muscle_tendon": DEVICE.parameters})
    data = mujoco.MjData(model)

    def bare() -> None:
        with callbacks.device_callbacks("compiled"):
            for k in range(count):
                data.qpos[0], data.ctrl[0] = length[k], command[k] / 1e5
                mujoco.mj_step(model, data)

    alone = lambda: simulate_rollouts(DEVICE.parameters, length, command, step)  # noqa: E731
    _, rig, loop = measure_interleaved(
        n_rounds, measure_wall_time, alone, lambda: bench.simulate_tester(DEVICE, length, command, step), bare
    )
    effects = catalogue.pack_effects({("braid_hysteresis", "coulomb"): {"slope_n_per_bar": 8.0}})
    laden = DEVICE.parameters._replace(effects=effects)
    _, one = measure_interleaved(
        n_rounds, measure_cpu_time, alone, lambda: simulate_rollouts(laden, length, command, step)
    )
    return [
        SpeedRatio("device alone with one effect, CPU time", "device alone without effects", one, "", True),
        SpeedRatio("device alone: speed", "the bench rig in MuJoCo", rig, ">= 20", rig >= 20),
        SpeedRatio("device alone: speed", "a bare loop of mj_step on the bench model", loop, "", True),
    ]


MEMORY_SCRIPT = """
import os, sys
import gymnasium
import klute_sim

def resident():
    pages = int(open("/proc/self/statm").read().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20

base = resident()
{make}
env.reset(seed=0)
env.step(env.action_space.sample())
print(resident() - base)
"""


def measure_memory() -> dict[str, float]:
    """Return the resident memory [MiB] that environments add to a process with Gymnasium and klute-sim (Linux)."""
    if not sys.platform.startswith("linux"):
        return {}
    makes = {
        "one environment, compiled backend": f"env = gymnasium.make({ENVIRONMENT_ID!r})",
        "one environment, Python backend": f"env = gymnasium.make({ENVIRONMENT_ID!r}, backend='python')",
        "Walker2d-v5": "env = gymnasium.make('Walker2d-v5')",
        "vector environment of 16": f"env = gymnasium.make_vec({ENVIRONMENT_ID!r}, 16, 'vector_entry_point')",
        "vector environment of 1024": f"env = gymnasium.make_vec({ENVIRONMENT_ID!r}, 1024, 'vector_entry_point')",
    }
    usage = {}
    for label, make in makes.items():
        command = [sys.executable, "-c", MEMORY_SCRIPT.format(make=make)]
        usage[label] = float(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    return usage


def main() -> None:
    """Measure and print the ratios."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--quick", action="store_true", help="a tenth of the repetitions")
    arguments = parser.parse_args()
    rounds = 3 if arguments.quick else 31
    notes = Console(stderr=True)
    ratios: list[SpeedRatio] = []
    figures: dict[str, float] = {}
    parts: list[Callable[[], Any]] = [
        lambda: measure_step_ratios(rounds),
        lambda: [measure_gait_ratio(max(3, rounds // 2))],
        lambda: measure_run_ratios(max(3, rounds // 3)),
        lambda: measure_environment_ratios(max(3, rounds // 3)),
        lambda: measure_joint_ratios(max(3, rounds // 3)),
        lambda: measure_walk_ratios(max(3, rounds // 3)),
        lambda: measure_rollout_ratios(rounds),
    ]
    for part in track(parts, "measuring", console=notes, transient=True, disable=not notes.is_terminal):
        result = part()
        if isinstance(result, tuple):
            result, more = result
            figures |= more
        ratios += result
    memory_usage = measure_memory()
    if arguments.json:
        print(
            json.dumps(
                {"ratios": [r._asdict() for r in ratios], "memory_mib": memory_usage, **figures, **collect_versions()},
                indent=2,
            )
        )
        return
    out = Console(width=118, highlight=False)
    table = Table("what", "against", "ratio", "aim", "")
    for row in ratios:
        mark = "" if not row.aim else ("met" if row.met else "missed")
        table.add_row(row.what, row.against, f"{row.ratio:.2f}", row.aim, mark)
    out.print(table)
    sizes = Table("memory added", "MiB")
    for label, usage in memory_usage.items():
        sizes.add_row(label, f"{usage:.0f}")
    out.print(sizes)


if __name__ == "__main__":
    main()
