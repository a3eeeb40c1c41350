"""``klute-sim design``."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from klute_sim.cli import common
from klute_sim.cli.option_sections import Command, section
from klute_sim.laws.hill_tables import HILL_CURVES

SI_OPTIONS = {
    "f0": ("isometric_force", 1.0),
    "l0": ("muscle_length", 1e-3),
    "vmax": ("peak_velocity", 1e-3),
    "pressure": ("supply_pressure", 1e5),
    "resting_length": ("resting_length", 1e-3),
    "bore": ("bore", 1e-3),
    "cylinder_pressure": ("cylinder_pressure", 1e6),
    "eccentric_speed": ("eccentric_speed", 1e-3),
    "moment_arm": ("moment_arm", 1e-3),
    "tendon_strain": ("tendon_strain", 0.01),
}
"""Keyword of :func:`klute_sim.api.design.design` and SI value of one unit, by option."""


def _number_option(name: str, metavar: str, help_text: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    unit = re.search(r"\[(?!default)(.+?)\]", help_text)
    return click.option(
        name, type=common.NumberWithUnit(unit[1] if unit else ""), default=None, metavar=metavar, help=help_text
    )


@click.command("design", cls=Command)
@section("Subject")
@common.mass_option("the value in the folder of --reference")
@common.REFERENCE_OPTION
@common.STRIDE_TIME_OPTION
@common.ACCEPT_OPTION
@common.STATURE_OPTION
@common.REJECT_HEIGHT_OPTION
@section("Conditions")
@common.SPEED_OPTION
@common.slope_option()
@section("Muscle")
@click.option(
    "--muscle", default=None, metavar="NAME", help=f"Muscle of Table 2.4 to emulate: {', '.join(HILL_CURVES)}."
)
@_number_option("--f0", "N", "Isometric force F0 of the muscle [N].")
@_number_option("--l0", "MM", "Resting length l0 of the muscle [mm]; the actuators have the same.")
@_number_option("--vmax", "MM/S", "Maximum shortening velocity Vmax of the muscle [mm/s].  [default: 300, assumed]")
@_number_option("--a", "RATIO", "Ratio a/F0 of Hill's equation (2.4) [1].  [default: 0.28]")
@_number_option("--b", "RATIO", "Ratio b/Vmax of Hill's equation (2.4) [1].  [default: 0.28]")
@_number_option("--saturation", "RATIO", "Ratio of saturated eccentric force to F0 [1].  [default: 1.3]")
@section("Actuator")
@click.option(
    "--actuator",
    default=None,
    metavar="NAME",
    help="Actuator of Table 3.1: klute-1-1-4, klute-3-4 or klute-1-2.  [default: by rule]",
)
@click.option("--count", type=int, default=None, metavar="N", help="Number of parallel actuators.  [default: by rule]")
@_number_option("--resting-length", "MM", "Resting length L0 of the actuators [mm].  [default: by rule]")
@_number_option("--pressure", "BAR", "Supply gauge pressure [bar].  [default: 5]")
@section("Damper and tendon")
@_number_option("--bore", "MM", "Bore of the damper [mm].  [default: by equation (4.2)]")
@_number_option(
    "--cylinder-pressure",
    "MPA",
    "Allowed gauge pressure in the damper, which determines its bore [MPa].  [default: 4.7, assumed]",
)
@_number_option(
    "--eccentric-speed", "MM/S", "Lengthening speed of the eccentric design point [mm/s].  [default: Vmax/2, assumed]"
)
@_number_option(
    "--eccentric-force", "N", "Damping force of the eccentric design point [N].  [default: (saturation - 1) F0]"
)
@_number_option(
    "--moment-arm",
    "MM",
    "With --mass or --reference: moment arm of the tendon about the ankle [mm].  [default: 48, assumed]",
)
@_number_option(
    "--tendon-strain",
    "%",
    "Stretch of the tendon at the design force, as a fraction of tendon plus muscle length [%].  [default: 4, assumed]",
)
@section("Output")
@click.option("--name", default="klute-design", show_default=True, metavar="NAME", help="Name of the new device.")
@common.out_option("design", "the design")
@common.json_option("the tables")
def command(out: Path | None, as_json: bool, **options: Any) -> None:
    """Size actuators, damper and tendon for a subject or for a muscle.

    Selects actuators from Table 3.1, and sizes the damper (bore by equation (4.2), two orifices by (4.6)) and the two
    springs of the tendon. Compares the result with the design envelope (2.5) and with Hill's force-velocity curve,
    evaluates the demand of a stride, and varies each assumption separately; the values that you specify are not varied.
    "By rule" means: the fewest actuators that are strong enough, then the least gas.

    Writes device.toml (for klute-sim device and klute-sim gait --device), summary.json, index.html, figure.png and,
    for a subject, profile.csv (for klute-sim gait --controller), the tuned pressure profile scaled to the same
    force per body mass.

    \b
    Examples:
      klute-sim design --mass 75
      klute-sim design --mass 100 --pressure 6 --out heavy
      klute-sim design --reference my-subject
      klute-sim design --muscle bobbert_1986 --l0 264
      klute-sim design --f0 1400 --l0 250 --vmax 300 --a 0.28 --b 0.28
      klute-sim design --actuator klute-3-4 --count 2 --resting-length 250 \\
        --eccentric-force 400
    """
    from klute_sim.api.design import design
    from klute_sim.api.rendering import print_summary
    from klute_sim.cli.console import progress_bar, stdout_console
    from klute_sim.recording.run_folder import create_run_folder

    keywords = {}
    for option, value in options.items():
        keyword, si_factor = SI_OPTIONS.get(option, (option, None))
        keywords[keyword] = value if value is None or si_factor is None else si_factor * value
    with create_run_folder("design", out) as (folder, scratch):
        with progress_bar("sizing") as progress:
            result = design(**keywords, progress=progress)
        summary = result.write_files(scratch, folder)
    if as_json:
        click.echo(json.dumps(summary, indent=2, allow_nan=False))
        return
    console = stdout_console()
    print_summary(console, result.format_summary(summary))
    console.print(f"Design folder: {folder}  ({', '.join(summary['files'])})", soft_wrap=True)
