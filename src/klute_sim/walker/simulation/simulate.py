"""Simulate a walk from the walker to the recording."""

import hashlib
import json
import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from klute_sim.controllers.parse import Controller
from klute_sim.controllers.state_machine import load_default_state_machine
from klute_sim.device.device import check_accepts_pressure
from klute_sim.errors import InputError
from klute_sim.plant import callbacks
from klute_sim.provenance import collect_versions
from klute_sim.recording.recording import Recording
from klute_sim.types import ProgressCallback
from klute_sim.walker.person.body import load_body
from klute_sim.walker.person.build import MAX_DT, Ground, Prosthesis, build_walker_model, get_contact
from klute_sim.walker.reflexes.walker_file import Walker, describe_condition, select_walkers
from klute_sim.walker.simulation.commands import DeviceCommands
from klute_sim.walker.simulation.recording import build_recording
from klute_sim.walker.simulation.simulator import WalkSimulator
from klute_sim.walker.simulation.walk import Push, Walk

MAX_SAMPLES = 200_000
"""Largest number of time steps of a walk; a step takes about 2 kB of memory and 0.5 kB on disk."""
KIND = "predicted (planar reflex model)"
"""What a walk is, beside the tracked gait of the gait rig."""

MAX_STRIDE_DURATION = 2.0
"""Longest duration of a stride [s] (assumed): a push begins within one."""


@dataclass(frozen=True, kw_only=True)
class WalkOptions:
    """Duration, ground and push of a walk; validated when made."""

    seconds: float = 20.0
    """Duration [s]."""
    dt: float = MAX_DT
    """Time step [s]."""
    ground: Ground = field(default_factory=Ground)
    """Ground."""
    push: Push | None = None
    """Push; None: there is none."""

    def __post_init__(self) -> None:
        """Raise InputError when the duration or the time step is out of range, or the walk ends before the push."""
        if not 1e-5 <= self.dt <= MAX_DT:
            raise InputError(f"time step is {1e3 * self.dt:g} ms; allowed: 0.01 to 1 ms")
        limit = MAX_SAMPLES * self.dt
        if not 1.0 <= self.seconds <= limit:
            raise InputError(f"duration is {self.seconds:g}; allowed: 1 to {limit:g} s with this time step")
        if self.push is not None and self.seconds < self.push.after + MAX_STRIDE_DURATION:
            raise InputError(
                f"duration is {self.seconds:g}; a push in the first stride after {self.push.after:g} s needs "
                f"{self.push.after + MAX_STRIDE_DURATION:g} s or more"
            )


def describe_prosthesis(prosthesis: Prosthesis | None, controller: Controller | None) -> dict[str, Any]:
    """Return the condition of a walk as :class:`~klute_sim.walker.reflexes.walker_file.Walker` files state it."""
    if prosthesis is None:
        return describe_condition("none")
    alignment = round(math.degrees(prosthesis.get_alignment()), 6)
    if prosthesis.spring_foot is not None:
        stiffness = round(math.radians(prosthesis.spring_foot.stiffness), 9)
        return describe_condition("spring-foot", alignment_deg=alignment, stiffness_nm_per_deg=stiffness)
    device = prosthesis.device
    # The numbers and not the bytes of the device file: a comment does not change what a person has adapted to.
    numbers = json.dumps(device.spec.collect_values(), sort_keys=True)
    digest = hashlib.sha256(numbers.encode()).hexdigest()
    return describe_condition(
        "device", digest, None if controller is None else controller.describe(), alignment_deg=alignment
    )


def select_adapted_walkers(prosthesis: Prosthesis) -> list[Walker]:
    """Return the shipped walkers that have adapted to ``prosthesis``, or to the nearest one.

    With a device they have adapted to the default state machine, so that all controllers meet the same persons.
    """
    controller = load_default_state_machine() if prosthesis.spring_foot is None else None
    return select_walkers(describe_prosthesis(prosthesis, controller))


def simulate_walk(
    walker: Walker,
    prosthesis: Prosthesis | None = None,
    controller: Controller | None = None,
    options: WalkOptions | None = None,
    progress: ProgressCallback = lambda fraction, stage: None,
    backend: str = "auto",
) -> Recording:
    """Let ``walker`` walk with ``prosthesis`` under ``controller``, and return the recording of every time step.

    The recording ends with a fall; its provenance states whether there was one.

    Raises InputError when the walker belongs to another body or contact, or to the other kind of legs.
    """
    options = options or WalkOptions()
    walker.check_legs(is_intact=prosthesis is None)
    if prosthesis is not None and prosthesis.spring_foot is None:
        check_accepts_pressure(prosthesis.device, "the controller")
    body = load_body()
    model = build_walker_model(body, prosthesis, dt=options.dt, ground=options.ground)
    walker.check_fits(body, get_contact(model))
    n_steps = round(options.seconds / options.dt)
    with callbacks.device_callbacks(backend) as used_backend:
        simulator = WalkSimulator(model, body, slope=options.ground.slope, backend=used_backend)
        has_device = prosthesis is not None and prosthesis.spring_foot is None
        commands = DeviceCommands(simulator, controller if has_device else None, n_steps)
        rows = np.zeros((n_steps, simulator.record_width))
        simulator.reset(walker.reflexes)
        walk = Walk(simulator, commands, () if options.push is None else (options.push,), rows)
        is_walking = walk.advance(options.seconds, lambda fraction: progress(fraction, "walking"))
    condition = describe_prosthesis(prosthesis, controller)
    provenance = {
        "rig": "walk",
        "kind": KIND,
        "walker": {"name": walker.name, "sha256": walker.digest, "condition": dict(walker.condition)},
        "condition": condition,
        "is_acute": condition != dict(walker.condition),
        "has_fallen": not is_walking,
        "prosthesis": _describe(prosthesis),
        "controller": controller.describe() if has_device and controller is not None else None,
        "options": {
            "mass_kg": float(model.body_mass.sum()),
            "stature_m": 1.75,
            "seconds": options.seconds,
            "slope_deg": math.degrees(options.ground.slope),
            "unevenness_mm": 1e3 * options.ground.unevenness,
            "push_n_s": 0.0 if options.push is None else options.push.impulse,
            "push_phase_pct": None if options.push is None else 100.0 * options.push.phase,
            "step_s": options.dt,
            "backend": used_backend,
        },
        "seed": options.ground.seed,
        "versions": collect_versions(),
    }
    return build_recording(simulator, rows[: walk.n_steps], commands.pressures if has_device else None, provenance)


def _describe(prosthesis: Prosthesis | None) -> dict[str, Any] | None:
    if prosthesis is None:
        return None
    device = prosthesis.device
    if prosthesis.spring_foot is not None:
        return {"name": prosthesis.spring_foot.name, "foot": device.spec.describe_foot()}
    return {
        "name": device.name,
        "sha256": device.digest,
        "foot": device.spec.describe_foot(),
        "assumed": device.spec.collect_assumptions(),
        "alignment_deg": math.degrees(prosthesis.get_alignment()),
    }
