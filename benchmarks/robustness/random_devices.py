"""Random devices over the whole range that the schema of a device file allows, its limits included.

The ranges are read from the schema and the catalogue of effects, so a new key or effect is sampled without a change
here. Values lie at a limit, near it, or anywhere between on a linear or logarithmic scale.
"""

import math
import random
from typing import Any, NamedTuple

import annotated_types
from pydantic import BaseModel

from klute_sim.device.device import Device
from klute_sim.device.schema.document import Damper, DeviceSpec, Tendon, parse_device_spec
from klute_sim.device.schema.muscle import MIN_GAS_FRACTION, Muscle
from klute_sim.device.schema.supply import Chamber, Leak, Line, Supply, Tank, Valve
from klute_sim.effects import catalogue
from klute_sim.errors import InputError
from klute_sim.units import BAR

UNBOUNDED = 1e6
"""Limit that stands for a missing one."""
SMALLEST_POSITIVE = 1e-12
"""Smallest value of a range that begins at 0, on the logarithmic scale."""
MAX_STEPS = 40
"""Largest number of time steps of a run."""


class RandomRun(NamedTuple):
    """A device and what it follows."""

    device: Device
    unit_length: list[float]
    """Length of the muscle-tendon unit at each time step [m]."""
    command: list[float]
    """Commanded gauge pressure [Pa] or valve opening [1] at each time step."""
    time_step: float
    """Time step [s]."""


def draw_number(rng: random.Random, lower: float, upper: float) -> float:
    """Return a random number of a range: a limit, or a value on a linear or logarithmic scale."""
    kind = rng.random()
    if kind < 0.12:
        return lower
    if kind < 0.24:
        return upper
    if lower >= 0.0 and kind < 0.62:
        smallest = max(lower, min(SMALLEST_POSITIVE, upper))
        value = math.exp(rng.uniform(math.log(smallest), math.log(upper))) if upper > smallest else upper
        return min(max(value, lower), upper)
    if lower <= 0.0 <= upper and kind < 0.68:
        return 0.0
    return rng.uniform(lower, upper)


def get_limits(section: type[BaseModel], key: str) -> tuple[float, float]:
    """Return the smallest and the largest allowed value of a number of a device file."""
    lower, upper = -UNBOUNDED, UNBOUNDED
    for each in section.model_fields[key].metadata:
        for limit in each if isinstance(each, annotated_types.GroupedMetadata) else (each,):
            if isinstance(limit, annotated_types.Ge):
                lower = float(limit.ge)  # type: ignore[arg-type]
            elif isinstance(limit, annotated_types.Gt):
                lower = math.nextafter(float(limit.gt), math.inf)  # type: ignore[arg-type]
            elif isinstance(limit, annotated_types.Le):
                upper = float(limit.le)  # type: ignore[arg-type]
            elif isinstance(limit, annotated_types.Lt):
                upper = math.nextafter(float(limit.lt), -math.inf)  # type: ignore[arg-type]
    return lower, upper


def draw_section(rng: random.Random, section: type[BaseModel]) -> dict[str, Any]:
    """Return random numbers for all floats of a section."""
    content: dict[str, Any] = {}
    for key, field in section.model_fields.items():
        if field.annotation is float:
            content[key] = draw_number(rng, *get_limits(section, key))
        elif field.annotation is bool:
            content[key] = rng.random() < 0.8
    return content


def _draw_muscle(rng: random.Random) -> dict[str, Any]:
    content = draw_section(rng, Muscle)
    content["count"] = int(draw_number(rng, *get_limits(Muscle, "count")))
    radius, ratio = content["bladder_radius_mm"], content["braid_length_ratio"]
    mismatch = rng.choice([0.0, 0.049, -0.047])
    content["turns_per_m"] = 1e3 * math.sqrt(ratio * ratio - 1.0) / (2.0 * math.pi * radius * (1.0 + mismatch))
    braid_radius = radius * (1.0 + mismatch)
    bore = math.sqrt(max(radius * radius - (0.999 - MIN_GAS_FRACTION) * braid_radius * braid_radius, 0.0))
    content["bladder_thickness_mm"] = draw_number(rng, 0.01, max(0.01, min(0.999 * radius, radius - bore)))
    return content


def _draw_damper(rng: random.Random) -> dict[str, Any]:
    content = draw_section(rng, Damper)
    bore = content["bore_mm"]
    for key in ("orifice_concentric_mm", "orifice_eccentric_mm"):
        content[key] = draw_number(rng, bore / 999.0, bore)
    return content


def _draw_valve(rng: random.Random) -> dict[str, Any]:
    content: dict[str, Any] = {
        key: draw_number(rng, *get_limits(Valve, key))
        for key in ("fill_dm3_per_s_bar", "fill_critical_ratio", "exhaust_dm3_per_s_bar", "exhaust_critical_ratio")
    }
    content["command"] = rng.choice(["pressure", "opening"])
    if content["command"] == "pressure":
        content["gain_per_bar"] = draw_number(rng, *get_limits(Valve, "gain_per_bar"))
    content["drive"] = rng.choice(["proportional", "on-off"])
    if content["drive"] == "on-off":
        content["pwm_period_s"] = draw_number(rng, *get_limits(Valve, "pwm_period_s"))
        content["min_pulse_s"] = draw_number(rng, 0.0, 0.5 * content["pwm_period_s"])
    return content


def _draw_effects(rng: random.Random, spec: DeviceSpec) -> dict[str, dict[str, float | str]]:
    effects: dict[str, dict[str, float | str]] = {}
    probability = rng.choice([0.0, 0.1, 0.3, 0.7, 1.0])
    for effect in catalogue.get_effects().values():
        if effect.kind != "device" or rng.random() >= probability:
            continue
        if spec.model_copy(update={"effects": effects}).find_incompatibility(effect.name):
            continue
        form = rng.choice(effect.forms)
        parameters = {
            each.key: each.typical if rng.random() < 0.2 else draw_number(rng, each.lower, each.upper)
            for each in form.parameters
        }
        effects[effect.name] = {"form": form.name, **parameters}
    return effects


def draw_device(rng: random.Random) -> Device:
    """Return a random device that the schema allows."""
    sections: dict[str, Any] = {"muscle": _draw_muscle(rng), "supply": draw_section(rng, Supply)}
    if rng.random() < 0.6:
        sections["damper"] = _draw_damper(rng)
    if rng.random() < 0.8:
        sections["tendon"] = draw_section(rng, Tendon)
    optional: list[tuple[str, type[BaseModel]]] = [("tank", Tank), ("leak", Leak)]
    if rng.random() < 0.5:
        sections["valve"] = _draw_valve(rng)
        optional += [("line", Line), ("chamber", Chamber)]
    for title, section in optional:
        if rng.random() < 0.55:
            sections[title] = draw_section(rng, section)
    content = {"name": "random", **sections}
    content["effects"] = _draw_effects(rng, parse_device_spec(content, "random device"))
    return Device.from_spec(parse_device_spec(content, "random device"), b"")


def _draw_lengths(rng: random.Random, device: Device, n_steps: int, dt: float) -> list[float]:
    """Return a path of the unit length [m]: held, waves to 10 m/s, ramps and jumps within and beyond the range."""
    muscle, tendon = device.parameters.muscle, device.parameters.tendon
    shortest, longest = muscle.braid_length / math.sqrt(3.0), muscle.resting_length
    stroke = longest - shortest + (0.0 if tendon.is_rigid else rng.choice([0.0, 0.02, 0.2]) * longest)
    low = tendon.slack_length + shortest - 0.05 * longest
    kind, phase = rng.choice(["held", "wave", "ramp", "jumps"]), rng.uniform(0.0, 2.0 * math.pi)
    if kind == "held":
        return [low + rng.random() * stroke] * n_steps
    if kind == "jumps":
        return [low + rng.random() * stroke for _ in range(n_steps)]
    if kind == "ramp":
        start, speed = rng.random() * stroke, rng.choice([-1.0, 1.0]) * rng.choice([0.1, 1.0, 10.0])
        return [low + min(max(start + speed * k * dt, 0.0), stroke) for k in range(n_steps)]
    frequency = rng.choice([1.0, 10.0, 100.0])
    return [low + stroke * (0.5 + 0.5 * math.sin(phase + 2.0 * math.pi * frequency * k * dt)) for k in range(n_steps)]


def _draw_commands(rng: random.Random, device: Device, n_steps: int) -> list[float]:
    """Return commands [Pa] or openings [1], beyond the allowed range, too."""
    supply = device.parameters.supply
    low, high = (-1.5, 1.5) if supply.command_is_opening else (-BAR, 1.2 * supply.max_pressure)
    kind = rng.choice(["held", "switched", "noise"])
    if kind == "noise":
        return [rng.uniform(low, high) for _ in range(n_steps)]
    first, second = (rng.choice([low, 0.0, high, rng.uniform(low, high)]) for _ in range(2))
    half = rng.randint(1, n_steps)
    return [first if kind == "held" or (k // half) % 2 == 0 else second for k in range(n_steps)]


def draw_run(seed: int) -> RandomRun:
    """Return the random run of this ``seed``."""
    rng = random.Random(seed)
    while True:
        try:
            device = draw_device(rng)
            break
        except InputError:  # limits that depend on each other
            continue
    dt = rng.choice([5e-5, 1e-2, math.exp(rng.uniform(math.log(5e-5), math.log(1e-2)))])
    n_steps = rng.randint(8, MAX_STEPS)
    return RandomRun(device, _draw_lengths(rng, device, n_steps, dt), _draw_commands(rng, device, n_steps), dt)
