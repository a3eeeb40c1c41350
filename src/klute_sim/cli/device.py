"""``klute-sim device``."""

import json

import click

from klute_sim.cli import common, completion


@click.command("device")
@click.argument("name", metavar="[NAME|FILE]", required=False, shell_complete=completion.complete_device)
@click.option(
    "--pressure",
    type=common.NumberWithUnit("bar"),
    default=None,
    metavar="BAR",
    help="Gauge pressure of the force table [bar].  [default: 5, or the supply pressure if it is lower]",
)
@click.option("--toml", "as_toml", is_flag=True, help="Print the device file, as a template for your own.")
@common.json_option("tables")
def command(name: str | None, pressure: float | None, as_toml: bool, as_json: bool) -> None:
    """List the devices of the package, or show one device (preset or device file).

    Prints every number with its source (assumed numbers are marked), the isometric force of the muscle in the three
    stages of the dissertation (geometric, with bladder, with friction), and published measurements beside the model.

    \b
    Examples:
      klute-sim device
      klute-sim device klute-3-4
      klute-sim device klute-1-1-4-pair --toml > my-device.toml
      klute-sim device my-device.toml --pressure 3 --json
    """
    from klute_sim.cli.console import write_text
    from klute_sim.device.device import load_device
    from klute_sim.errors import InputError

    if as_toml and as_json:
        raise InputError("--toml and --json exclude each other")
    if name is None:
        if as_toml or pressure is not None:
            raise InputError(f"{'--toml' if as_toml else '--pressure'} needs the name of a device")
        _list_presets(as_json=as_json)
        return
    device = load_device(name)
    if as_toml:
        write_text(device.content.decode("utf-8-sig"))
        return

    from klute_sim.api.device import describe_device, format_description
    from klute_sim.api.rendering import print_summary
    from klute_sim.cli.console import stdout_console

    description = describe_device(device, pressure)
    if as_json:
        click.echo(json.dumps(description, indent=2))
    else:
        print_summary(stdout_console(), format_description(description))


def _list_presets(*, as_json: bool) -> None:
    from klute_sim.device.device import list_presets, load_device

    presets = [load_device(name) for name in list_presets()]
    if as_json:
        entries = [{"name": preset.name, "description": preset.spec.description} for preset in presets]
        click.echo(json.dumps(entries, indent=2))
        return
    width = max(len(preset.name) for preset in presets)
    for preset in presets:
        click.echo(f"{preset.name:{width}}  {preset.spec.description}")
