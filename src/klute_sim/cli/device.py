"""``klute-sim device``."""

import json
from typing import TYPE_CHECKING, Any

import click

from klute_sim.cli import common

if TYPE_CHECKING:
    from klute_sim.device.device import Device

LENGTH_RATIOS = (0.7, 0.8, 0.9, 0.96, 1.0)
"""Muscle lengths over resting length at which forces are listed: those of the source's check."""
DEFAULT_PRESSURE_BAR = 5.0
"""Gauge pressure [bar] of the force table where none is asked for: the source's highest."""


@click.command("device")
@click.argument("name", metavar="[NAME|FILE]", required=False)
@click.option(
    "--pressure",
    type=common.NumberWithUnit("bar"),
    default=None,
    metavar="BAR",
    help="Gauge pressure of the force table [bar].  [default: 5, or the supply's if that is less]",
)
@click.option("--toml", "as_toml", is_flag=True, help="Print the device file itself, to start your own from.")
@common.json_option("tables")
def command(name: str | None, pressure: float | None, as_toml: bool, as_json: bool) -> None:
    """List the devices that come with the package, or show one.

    Shows every number with its source (assumed ones marked), the isometric force of the muscle in the source's
    three stages (geometric, with bladder, with friction), and published measurements beside the model.

    \b
    Examples:
      klute-sim device
      klute-sim device klute-3-4
      klute-sim device klute-1-1-4-pair --toml > my-device.toml
      klute-sim device my-device.toml --pressure 3 --json
    """
    from klute_sim.device.device import list_presets, load_device
    from klute_sim.errors import InputError

    if as_toml and as_json:
        raise InputError("--toml and --json do not go together")
    if name is None:
        if as_toml or pressure is not None:
            raise InputError(f"{'--toml' if as_toml else '--pressure'} goes with the name of a device")
        presets = [load_device(preset) for preset in list_presets()]
        if as_json:
            click.echo(json.dumps([{"name": d.name, "description": d.spec.description} for d in presets], indent=2))
        else:
            width = max(len(device.name) for device in presets)
            for device in presets:
                click.echo(f"{device.name:{width}}  {device.spec.description}")
        return
    chosen = load_device(name)
    if as_toml:
        click.echo(chosen.content.decode("utf-8-sig"), nl=False)
        return
    shown = describe_device(chosen, pressure)
    if as_json:
        click.echo(json.dumps(shown, indent=2))
    else:
        _print(shown)


def describe_device(device: "Device", pressure_bar: float | None) -> dict[str, Any]:
    """Everything the command shows; raises InputError for a pressure outside of 0 ... the device's supply."""
    from klute_sim.errors import InputError
    from klute_sim.laws import mckibben
    from klute_sim.units import BAR

    muscle, most = device.parameters.muscle, device.parameters.supply.max_pressure / BAR
    pressure_bar = min(DEFAULT_PRESSURE_BAR, most) if pressure_bar is None else pressure_bar
    if not 0.0 <= pressure_bar <= most:
        raise InputError(f"pressure is {pressure_bar:g} bar; the supply of '{device.name}' allows 0 to {most:g} bar")
    pressure = pressure_bar * BAR
    forces = []
    for ratio in LENGTH_RATIOS:
        length = ratio * muscle.resting_length
        geometric = mckibben.gas_force(muscle, pressure, length)
        with_bladder = geometric + mckibben.bladder_force(muscle, length)
        with_friction = with_bladder + mckibben.friction_force(muscle, pressure)
        forces.append(
            {"ratio": ratio, "geometric_n": geometric, "bladder_n": with_bladder, "friction_n": with_friction}
        )
    published = [
        {
            "ratio": p.muscle_ratio,
            "pressure_bar": p.pressure_bar,
            "published_n": p.force_n,
            "model_n": mckibben.force(muscle, p.pressure_bar * BAR, p.muscle_ratio * muscle.resting_length),
            "note": p.note,
        }
        for p in device.spec.published
    ]
    sources = device.spec.sources
    return {
        "name": device.name,
        "description": device.spec.description,
        "numbers": [
            {
                "key": key,
                "value": value,
                "source": sources.get(key),
                "assumed": key in device.spec.collect_assumptions(),
            }
            for key, value in device.spec.collect_values().items()
        ],
        "pressure_bar": pressure_bar,
        "isometric_force": forces,
        "published": published,
    }


def _print(description: dict[str, Any]) -> None:
    from rich.table import Table

    from klute_sim.cli.console import stdout_console

    out = stdout_console()
    out.print(f"{description['name']}: {description['description']}", soft_wrap=True)
    numbers = Table("number", "value", "source")
    for row in description["numbers"]:
        source = row["source"] or "no source given"
        numbers.add_row(row["key"], f"{row['value']:g}", source, style="yellow" if row["assumed"] else None)
    out.print(numbers)
    forces = Table(title=f"Isometric force at {description['pressure_bar']:g} bar [N], model")
    for heading in ("length / resting length", "geometric", "with bladder", "with friction"):
        forces.add_column(heading, justify="right")
    for row in description["isometric_force"]:
        stages = (f"{row[k]:.0f}" for k in ("geometric_n", "bladder_n", "friction_n"))
        forces.add_row(f"{row['ratio']:.2f}", *stages)
    out.print(forces)
    if any(row["friction_n"] < 0.0 for row in description["isometric_force"]):
        out.print(
            "Below zero the bladder outweighs the gas: the muscle would push, and a slack tendon carries none of it."
        )
    for row in description["published"]:
        out.print(
            f"At {row['ratio']:g} of resting length and {row['pressure_bar']:g} bar: model {row['model_n']:.0f} N, "
            f"published {row['published_n']:.0f} N ({row['note']}).",
            soft_wrap=True,
        )
