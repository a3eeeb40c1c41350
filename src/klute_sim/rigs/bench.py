"""The bench: a tensile tester that prescribes the unit's whole length and a pressure command.

The device runs as the same MuJoCo actuator as in the ankle, between a load cell and a crosshead.
"""

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from klute_sim.device.files import Device
from klute_sim.device.rollout import earlier
from klute_sim.device.step import dead_time, taut
from klute_sim.errors import InputError
from klute_sim.laws import damper as damper_law
from klute_sim.laws import mckibben
from klute_sim.plant import models, router
from klute_sim.plant.actuator import DeviceActuator
from klute_sim.provenance import versions
from klute_sim.recording.recording import Recording, Samples
from klute_sim.units import BAR

CHANNELS = (
    "force [N]",
    "pressure [bar]",
    "muscle_length [mm]",
    "muscle_force [N]",
    "damper_force [N]",
    "gas_power [W]",
    "friction_power [W]",
    "damper_power [W]",
    "stop_power [W]",
    "effects_power [W]",
    "delivered_power [W]",
    "bladder_energy [J]",
    "tendon_energy [J]",
    "air_mass [kg]",
)


def pull(device: Device, length: Samples, command: Samples, step: float, law: str = "auto") -> Recording:
    """Record ``device`` at prescribed unit ``length`` [m] and pressure ``command`` [Pa], one per ``step`` [s].

    The muscle starts where the tendon is just taut, at the first command. ``law`` is one of
    :data:`klute_sim.device.installation.LAWS`. Raises InputError when the two series differ in length, are not finite,
    or ask for a unit that is shorter than the muscle can get or, with a rigid tie, longer than it rests.
    """
    parameters = device.parameters
    length, command = np.asarray(length, dtype=np.float64), np.asarray(command, dtype=np.float64)
    if length.ndim != 1 or length.shape != command.shape or len(length) < 2:
        raise InputError(f"length and command need equally many samples, got {length.shape} and {command.shape}")
    if not (np.isfinite(length).all() and np.isfinite(command).all()):
        raise InputError("length and command must be finite everywhere")
    if not 0.0 < step <= 0.01:
        raise InputError(f"step is {step:g}; allowed: above 0, up to 0.01 s")
    lock = mckibben.lock_length(parameters.muscle)
    slack, rest = parameters.tendon.slack_length, parameters.muscle.resting_length
    longest = rest if parameters.tendon.rigid else float("inf")
    if length.min() < lock or length.max() - slack > longest:
        raise InputError(
            f"unit length runs from {1e3 * length.min():.1f} to {1e3 * length.max():.1f} mm; allowed for "
            f"'{device.name}': {1e3 * lock:.1f} to {1e3 * (longest + slack):.1f} mm"
        )

    spec = models.spec("bench")
    spec.option.timestep = step
    model = models.equip(spec, {"muscle_tendon": parameters})
    data = mujoco.MjData(model)
    actuator = DeviceActuator(model, "muscle_tendon")
    actuator.set_state(data, taut(parameters, float(length[0]), float(command[0])))
    speed = np.gradient(length, step)
    late, commands = dead_time(parameters) / step, command.tolist()

    samples = np.empty((len(length), len(CHANNELS)))
    with router.installed(law) as in_force:
        for k in range(len(length)):
            data.qpos[0], data.qvel[0] = length[k], speed[k]
            actuator.command(data, earlier(commands, k - late))
            before = actuator.state(data)
            router.step(model, data)
            after, ledger = actuator.ledger(model, data, before)
            tension = actuator.tension(data)
            samples[k] = (
                tension,
                after.pressure / BAR,
                1e3 * after.length,
                mckibben.force(parameters.muscle, after.pressure, after.length),
                damper_law.force(parameters.damper, (after.length - before.length) / step),
                ledger.gas_power,
                ledger.friction_power,
                ledger.damper_power,
                ledger.stop_power,
                ledger.effects_power,
                -tension * speed[k],
                ledger.bladder_energy,
                ledger.tendon_energy,
                ledger.air_mass,
            )
    columns: list[tuple[str, NDArray[np.floating[Any]]]] = [
        ("time [s]", np.arange(len(length)) * step),
        ("length [mm]", 1e3 * length),
        ("pressure_command [bar]", command / BAR),
        *((heading, samples[:, i]) for i, heading in enumerate(CHANNELS)),
    ]
    provenance = {
        "rig": "bench",
        "device": {"name": device.name, "sha256": device.digest},
        "options": {"step_s": step, "law": in_force},
        "versions": versions(),
    }
    return Recording.from_columns(columns, provenance)
