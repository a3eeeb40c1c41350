"""Describe a device: its numbers with their sources, its isometric forces, and the published measurements."""

from typing import Any

from klute_sim.api.inputs import DeviceLike, to_device
from klute_sim.api.rendering import Summary
from klute_sim.device.device import list_presets, load_device
from klute_sim.device.schema.document import DeviceSpec
from klute_sim.errors import InputError
from klute_sim.laws import mckibben
from klute_sim.terminal_table import abbreviate, create_table
from klute_sim.units import BAR

LENGTH_RATIOS = (0.7, 0.8, 0.9, 0.96, 1.0)
"""Muscle lengths over resting length of the force table: those of the dissertation's check [1]."""
DEFAULT_PRESSURE_BAR = 5.0
"""Default gauge pressure of the force table [bar]: the highest of the dissertation."""


def describe_device(device: DeviceLike, pressure_bar: float | None = None) -> dict[str, Any]:
    """Return the numbers, the isometric forces and the published measurements of ``device`` in JSON types.

    Measurements of the muscle of a preset are left out where a number of the muscle was changed in a copy.

    ``pressure_bar`` is the gauge pressure of the force table [bar]; None: 5, or the supply pressure if it is lower. A
    device without a muscle has no such table.

    Raises InputError for a pressure outside of 0 to the supply pressure, or without a muscle.
    """
    device = to_device(device)
    muscle, supply = device.parameters.muscle, device.parameters.supply.max_pressure / BAR
    if pressure_bar is not None and device.spec.muscle is None:
        raise InputError(f"'{device.name}' has no muscle, so no pressure is needed; leave it out")
    pressure_bar = min(DEFAULT_PRESSURE_BAR, supply) if pressure_bar is None else pressure_bar
    if not 0.0 <= pressure_bar <= supply:
        raise InputError(f"pressure is {pressure_bar:g} bar; the supply of '{device.name}' allows 0 to {supply:g} bar")
    pressure = pressure_bar * BAR
    forces = []
    for ratio in LENGTH_RATIOS if device.spec.muscle is not None else ():
        length = ratio * muscle.resting_length
        geometric = mckibben.gas_force(muscle, pressure, length)
        with_bladder = geometric + mckibben.bladder_force(muscle, length)
        with_friction = with_bladder + mckibben.friction_force(muscle, pressure)
        forces.append(
            {"ratio": ratio, "geometric_n": geometric, "bladder_n": with_bladder, "friction_n": with_friction}
        )
    outdated = device.spec.find_outdated_sources()
    is_other_muscle = any(key.startswith("muscle.") for key in outdated)
    published = [
        {
            "ratio": point.muscle_ratio,
            "pressure_bar": point.pressure_bar,
            "published_n": point.force_n,
            "model_n": mckibben.force(muscle, point.pressure_bar * BAR, point.muscle_ratio * muscle.resting_length),
            "note": point.note,
        }
        for point in ([] if is_other_muscle else device.spec.published)
    ]
    sources, assumptions = device.spec.collect_sources(), device.spec.collect_assumptions()
    return {
        "name": device.name,
        "description": device.spec.description,
        "description_of": _find_described_preset(device.spec),
        "numbers": [
            {
                "key": key,
                "value": value,
                "source": sources.get(key),
                "assumed": key in assumptions,
            }
            for key, value in device.spec.collect_values().items()
        ],
        "n_muscles": device.spec.muscle.count if device.spec.muscle is not None else 0,
        "outdated_sources": [{"key": key, "source_value": value} for key, value in outdated.items()],
        "pressure_bar": pressure_bar,
        "isometric_force": forces,
        "published": published,
    }


def _find_described_preset(spec: DeviceSpec) -> dict[str, Any] | None:
    """Return the preset whose description ``spec`` has although numbers differ, with these; None: there is none."""
    for name in list_presets():
        preset = load_device(name).spec
        if spec.description and spec.description == preset.description:
            numbers, original_numbers = spec.collect_values(), preset.collect_values()
            keys = list(numbers | original_numbers)
            changed = [key for key in keys if numbers.get(key) != original_numbers.get(key)]
            return {"name": name, "changed_numbers": changed} if changed else None
    return None


def format_description(description: dict[str, Any]) -> Summary:
    """Yield the tables and sentences of a device ``description`` (:func:`describe_device`)."""
    yield f"{description['name']}: {description['description']}"
    preset = description["description_of"]
    if preset:
        yield (
            f"This is the description of preset {preset['name']}, but other numbers apply here: "
            f"{abbreviate(preset['changed_numbers'])}. Change it in the file, and the comments above it."
        )
    numbers = create_table("number", "value", "source")
    for row in description["numbers"]:
        source = row["source"] or "no source given"
        is_uncertain = row["assumed"] or row["source"] is None
        numbers.add_row(row["key"], f"{row['value']:g}", source, style="yellow" if is_uncertain else None)
    yield numbers
    if description["outdated_sources"]:
        changed = ", ".join(f"{row['key']} (for {row['source_value']:g})" for row in description["outdated_sources"])
        yield (
            f"The file gives sources of other values, copied from a preset: {changed}. Write there where the numbers "
            "of this device are from, or 'assumed' and why."
        )
    if not description["isometric_force"]:
        return
    muscles = f" of {description['n_muscles']} muscles" if description["n_muscles"] > 1 else ""
    forces = create_table(title=f"Isometric force{muscles} at {description['pressure_bar']:g} bar [N], model")
    for title in ("length / resting length", "geometric", "with bladder", "with friction"):
        forces.add_column(title, justify="right")
    for row in description["isometric_force"]:
        stages = (f"{row[key]:.0f}" for key in ("geometric_n", "bladder_n", "friction_n"))
        forces.add_row(f"{row['ratio']:.2f}", *stages)
    yield forces
    if any(row["friction_n"] < 0.0 for row in description["isometric_force"]):
        yield "A negative force means that the bladder is stronger than the gas: the muscle pushes; tendons are slack."
    for row in description["published"]:
        yield (
            f"At {row['ratio']:g} of resting length and {row['pressure_bar']:g} bar: model {row['model_n']:.0f} N, "
            f"published {row['published_n']:.0f} N ({row['note']})."
        )
