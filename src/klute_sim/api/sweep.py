"""Simulate every combination of inputs: :func:`sweep`, :func:`sweep_walks` and :func:`sweep_joint`."""

import glob
import itertools
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from klute_sim.api.inputs import ControllerLike, DeviceLike, get_input_name, stage_progress, to_controller, to_device
from klute_sim.api.sweep_result import SweepResult
from klute_sim.controllers.parse import Controller
from klute_sim.controllers.state_machine import load_default_state_machine
from klute_sim.device.device import DEFAULT_DEVICE, Device
from klute_sim.envs.antagonist_joint import DEFAULT_JOINT_DEVICE
from klute_sim.errors import InputError, suggest
from klute_sim.gait.reference import Reference, load_default_reference, load_reference
from klute_sim.parameter_sweep import cluster
from klute_sim.parameter_sweep.joint_plan import JointSweepPlan
from klute_sim.parameter_sweep.local import LocalRunner
from klute_sim.parameter_sweep.plan import ABLE_BODIED_REFERENCE, SweepPlan
from klute_sim.parameter_sweep.runner import Runner
from klute_sim.parameter_sweep.store import open_store
from klute_sim.parameter_sweep.sweep import run_sweep
from klute_sim.parameter_sweep.table import AnyPlan
from klute_sim.parameter_sweep.walk_plan import NO_PUSH, WalkSweepPlan
from klute_sim.types import ProgressCallback
from klute_sim.walker.person.build import MAX_DT
from klute_sim.walker.reflexes.walker_file import Walker, load_walker


def sweep(
    devices: Sequence[DeviceLike] | DeviceLike = (),
    *,
    controllers: Sequence[ControllerLike] | ControllerLike = (),
    speeds: Sequence[float | None] = (None,),
    slopes: Sequence[float] = (0.0,),
    references: Sequence[str | Path | Reference] | str | Path | Reference = (ABLE_BODIED_REFERENCE,),
    stride_times: Sequence[float | None] = (None,),
    masses: Sequence[float | None] = (None,),
    statures: Sequence[float | None] = (None,),
    spring_feet: Sequence[float] = (),
    feet: Sequence[str] | str = (),
    strides: int = 5,
    time_step: float = 5e-4,
    accept: Collection[str] = (),
    folder: str | Path | None = None,
    n_jobs: int = 0,
    ray_address: str | None = None,
    progress: ProgressCallback | None = None,
) -> SweepResult:
    """Simulate every combination of the listed inputs and return one row of metrics per combination.

    Results are stored in ``folder`` as they finish; an interrupted sweep resumes there.

    Args:
        devices: Devices, presets or paths; empty: the default device, or none if there are only ``spring_feet``.
        controllers: Controllers or specifications; empty: ``"profile"``.
        speeds: Walking speeds [m/s]; None stands for the speed that reference and leg length imply.
        slopes: Ground slopes [deg], uphill positive; limb kinematics on slopes are assumed.
        references: Reference gaits, their paths, or patterns of paths such as ``"subjects/*"``; ``"able-bodied"`` is
            the one that ships with the package.
        stride_times: Stride times of the references [s]; None stands for the time that a reference states, or 1.1.
        masses: Body masses [kg]; None stands for the mass that the reference states, or 75.
        statures: Statures [m]; None stands for the stature that the reference states, or 1.75.
        spring_feet: Stiffnesses of passive feet [N.m/deg], simulated in addition to the devices.
        feet: Prosthetic feet below the ankle, such as ``"sach"`` or ``"sach+shoe"``, that each device gets in turn;
            empty: that of the device.
        strides: Number of strides per case.
        time_step: Time step [s].
        accept: Names of findings about the reference files that are right although they look implausible.
        folder: Folder of the results, new, empty or of the same sweep; None: the next ``runs/sweep-NNN``.
        n_jobs: Number of worker processes; 0: one per core.
        ray_address: Address of a Ray cluster, ``"auto"`` or ``"local"``; None: processes on this machine.
        progress: Receives the completed fraction and the current stage.

    Raises InputError when an input is not usable or the folder holds something else.
    """
    is_only_feet = bool(spring_feet) and not _to_list(devices) and not _to_list(controllers)
    chosen_devices = [] if is_only_feet else _to_list(devices) or [DEFAULT_DEVICE]
    chosen_controllers = [] if is_only_feet else _to_list(controllers) or ["profile"]
    plan = SweepPlan(
        devices=_name_devices(chosen_devices, feet),
        controllers={get_input_name(controller): to_controller(controller) for controller in chosen_controllers},
        references={
            get_input_name(reference): _load_reference(reference, accept)
            for reference in _expand_patterns(_to_list(references))
        },
        stride_times=tuple(stride_times),
        speeds=speeds,
        slopes_deg=slopes,
        masses=masses,
        statures=statures,
        spring_feet=dict.fromkeys(spring_feet, to_device(DEFAULT_DEVICE)),
        strides=strides,
        dt=time_step,
    )
    return _run(plan, folder, n_jobs, ray_address, progress)


def sweep_walks(
    devices: Sequence[DeviceLike] | DeviceLike = (),
    *,
    controllers: Sequence[ControllerLike] | ControllerLike = (),
    machine: Mapping[str, Sequence[float]] | None = None,
    spring_feet: Sequence[float] = (),
    feet: Sequence[str] | str = (),
    walkers: Sequence[Walker | str | Path] | Walker | str | Path = (),
    slopes: Sequence[float] = (0.0,),
    uneven: Sequence[float] = (0.0,),
    pushes: Sequence[tuple[float, float]] = (NO_PUSH,),
    seconds: float = 20.0,
    seed: int = 0,
    time_step: float = MAX_DT,
    folder: str | Path | None = None,
    n_jobs: int = 0,
    ray_address: str | None = None,
    progress: ProgressCallback | None = None,
) -> SweepResult:
    """Predict the walk of every walker in every combination of the listed inputs, and return one row for each walk.

    A row states whether the walker has adapted to the condition or walks in it *acutely* (column ``acute``). Results
    are stored in ``folder`` as they finish; an interrupted sweep resumes there.

    Args:
        devices: Devices, presets or paths; empty: the default device, or none if there are only ``spring_feet``.
        controllers: Controllers or specifications; empty: ``"machine"``, unless ``machine`` is given.
        machine: Values by number of the default state machine, such as ``{"push_off_bar": [3.4, 4.4]}``: one more
            controller for every combination of the values.
        spring_feet: Stiffnesses of passive feet [N.m/deg], simulated in addition to the devices.
        feet: Prosthetic feet below the ankle, such as ``"sach"``, that each device gets in turn; empty: that of the
            device.
        walkers: Walkers, names of shipped ones, or paths; empty: for each prosthesis the shipped ones that have adapted
            to it with the default state machine, or to the nearest one.
        slopes: Ground slopes [deg], uphill positive.
        uneven: Largest heights of the blocks on the ground [mm].
        pushes: Pushes, each in walks of its own: impulse [N.s], forward positive, and phase of the right leg's stride
            [%]. An impulse of 0 is no push.
        seconds: Duration of a walk [s]; a fall ends it earlier.
        seed: Random seed of the uneven ground.
        time_step: Time step [s], up to 1 ms.
        folder: Folder of the results, new, empty or of the same sweep; None: the next ``runs/sweep-NNN``.
        n_jobs: Number of worker processes; 0: one per core.
        ray_address: Address of a Ray cluster, ``"auto"`` or ``"local"``; None: processes on this machine.
        progress: Receives the completed fraction and the current stage.

    Raises InputError when an input is not usable or the folder holds something else.
    """
    machines = build_machines(machine or {})
    is_only_feet = bool(spring_feet) and not (_to_list(devices) or _to_list(controllers) or machines)
    chosen_controllers = _to_list(controllers) or ([] if machines else ["machine"])
    plan = WalkSweepPlan(
        devices={} if is_only_feet else _name_devices(_to_list(devices) or [DEFAULT_DEVICE], feet),
        controllers={get_input_name(controller): to_controller(controller) for controller in chosen_controllers}
        | machines,
        spring_feet=dict.fromkeys(spring_feet, to_device(DEFAULT_DEVICE)),
        walkers=[walker if isinstance(walker, Walker) else load_walker(walker) for walker in _to_list(walkers)],
        slopes_deg=slopes,
        unevennesses_mm=uneven,
        pushes=pushes,
        seconds=seconds,
        seed=seed,
        dt=time_step,
    )
    return _run(plan, folder, n_jobs, ray_address, progress)


def sweep_joint(
    devices: Sequence[DeviceLike] | DeviceLike = (),
    *,
    gains: Mapping[str, Sequence[float]] | None = None,
    loads: Sequence[float | None] = (None,),
    episodes: int = 8,
    seconds: float = 5.0,
    seed: int = 0,
    time_step: float = 5e-4,
    folder: str | Path | None = None,
    n_jobs: int = 0,
    ray_address: str | None = None,
    progress: ProgressCallback | None = None,
) -> SweepResult:
    """Let a PID controller move the joint of ``klute_sim/AntagonistJoint`` in every combination of the listed inputs.

    A row holds the metrics over the episodes of one combination; all have the same targets. Results are stored in
    ``folder`` as they finish; an interrupted sweep resumes there.

    Args:
        devices: Devices, presets or paths, each on both tendons; empty: ``"klute-3-4-pair"``.
        gains: Values by argument of :class:`klute_sim.envs.joint_pid.PidController`, such as ``{"proportional": [2,
            4]}``.
        loads: Masses at the end of the lever [kg]; None stands for that of the model.
        episodes: Number of episodes of each combination, each with another target.
        seconds: Duration of an episode [s].
        seed: Random seed of the first target; the others follow it.
        time_step: Time step [s], a divisor of 10 ms.
        folder: Folder of the results, new, empty or of the same sweep; None: the next ``runs/sweep-NNN``.
        n_jobs: Number of worker processes; 0: one per core.
        ray_address: Address of a Ray cluster, ``"auto"`` or ``"local"``; None: processes on this machine.
        progress: Receives the completed fraction and the current stage.

    Raises InputError when an input is not usable or the folder holds something else.
    """
    plan = JointSweepPlan(
        devices=_name_devices(_to_list(devices) or [DEFAULT_JOINT_DEVICE], ()),
        gains=gains or {},
        loads_kg=loads,
        episodes=episodes,
        seconds=seconds,
        seed=seed,
        dt=time_step,
    )
    return _run(plan, folder, n_jobs, ray_address, progress)


def build_machines(values: Mapping[str, Sequence[float]]) -> dict[str, Controller]:
    """Return the default state machine with every combination of ``values`` by the name of a number, by label.

    Raises InputError when the machine has no such number, or it is out of range.
    """
    default = load_default_state_machine()
    known = [name for name in default.describe() if name not in ("kind", "interval")]
    for name in values:
        if name not in known:
            listing = f"allowed: {', '.join(known)}"
            raise InputError(f"the state machine has no '{name}'; {suggest(name, known, listing)}")
    machines: dict[str, Controller] = {}
    for numbers in itertools.product(*values.values()) if values else ():
        changes: dict[str, Any] = dict(zip(values, numbers, strict=True))
        label = ", ".join(f"{name} {number:g}" for name, number in changes.items())
        machines[f"machine, {label}"] = replace(default, **changes)
    return machines


def _name_devices(devices: Sequence[DeviceLike], feet: Sequence[str] | str) -> dict[str, Device]:
    return {
        get_input_name(device) + ("" if foot is None else f", {foot}"): to_device(device, foot)
        for device in devices
        for foot in _to_list(feet) or [None]
    }


def _run(
    plan: AnyPlan,
    folder: str | Path | None,
    n_jobs: int,
    ray_address: str | None,
    progress: ProgressCallback | None,
) -> SweepResult:
    with _open_runner(n_jobs, ray_address) as runner:
        store = open_store(folder, plan.describe(), "sweep")
        with store.lock(), explain_interrupt(store.folder):
            rows, n_resumed = run_sweep(plan, store, runner, stage_progress(progress, "simulating"))
    return SweepResult(plan, rows, store.folder, n_resumed)


@contextmanager
def explain_interrupt(folder: Path) -> Iterator[None]:
    """Add to a KeyboardInterrupt a note that finished cases are kept in ``folder``."""
    try:
        yield
    except KeyboardInterrupt as interrupt:
        interrupt.add_note(f"Finished cases are kept: the same command with --out {folder} resumes there.")
        raise


@contextmanager
def _open_runner(n_jobs: int, ray_address: str | None) -> Iterator[Runner]:
    if ray_address is None:
        with LocalRunner(n_jobs) as local_runner:
            yield local_runner.run
        return
    with cluster.connect(ray_address) as ray:
        yield partial(cluster.run_on_cluster, ray=ray)


def _to_list(values: Any) -> list[Any]:
    return list(values) if isinstance(values, Sequence) and not isinstance(values, str) else [values]


def _expand_patterns(references: Sequence[str | Path | Reference]) -> Iterator[str | Path | Reference]:
    """Yield ``references`` with the sorted matches of each pattern in its place.

    Raises InputError when nothing matches.
    """
    for reference in references:
        is_pattern = not isinstance(reference, Reference) and glob.has_magic(str(reference))
        if not is_pattern or Path(str(reference)).exists():
            yield reference
            continue
        matches = sorted(glob.glob(str(reference)))
        if not matches:
            raise InputError(f"reference {reference} matches no file or folder")
        yield from matches


def _load_reference(reference: str | Path | Reference, accept: Collection[str]) -> Reference:
    if isinstance(reference, Reference):
        return reference
    is_default = str(reference) == ABLE_BODIED_REFERENCE
    return load_default_reference() if is_default else load_reference(reference, accept=accept)
