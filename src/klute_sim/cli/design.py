"""``klute-sim design``."""

import json
import re
import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from klute_sim.cli import common
from klute_sim.cli.nonempty_path import NonEmptyPath
from klute_sim.laws.hill_tables import HILL_CURVES

if TYPE_CHECKING:
    from klute_sim.sizing.choices import DesignChoices
    from klute_sim.sizing.sizing import Design
    from klute_sim.sizing.target import MuscleTarget, WalkerTarget


def _number_option(name: str, metavar: str, help_text: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    unit = re.search(r"\[(?!default)(.+?)\]", help_text)
    return click.option(
        name, type=common.NumberWithUnit(unit[1] if unit else ""), default=None, metavar=metavar, help=help_text
    )


@click.command("design")
@_number_option("--mass", "KG", "Design for a walker of this body mass [kg].")
@click.option(
    "--reference",
    "reference_file",
    type=NonEmptyPath(),
    default=None,
    metavar="FILE",
    help="With --mass: CSV of a gait cycle with the columns of docs/gait.md.  [default: able-bodied adults]",
)
@click.option(
    "--muscle", default=None, metavar="ROW", help=f"Emulate this muscle of Table 2.4: {', '.join(HILL_CURVES)}."
)
@_number_option("--f0", "N", "Isometric force F0 of the muscle [N].")
@_number_option("--l0", "MM", "Length l0 of the muscle: the actuators' resting length [mm].")
@_number_option("--vmax", "MM/S", "Fastest shortening Vmax of the muscle [mm/s].  [default: 300, assumed]")
@_number_option("--a", "A", "a/F0 of Hill's equation (2.4).  [default: 0.28]")
@_number_option("--b", "B", "b/Vmax of Hill's equation (2.4).  [default: 0.28]")
@_number_option("--saturation", "S", "Force while lengthening fast, over F0.  [default: 1.3]")
@_number_option("--pressure", "BAR", "Supply's gauge pressure [bar].  [default: 5]")
@click.option(
    "--actuator", default=None, metavar="NAME", help="klute-1-1-4, klute-3-4 or klute-1-2.  [default: by rule]"
)
@click.option("--count", type=int, default=None, metavar="N", help="Actuators in parallel.  [default: by rule]")
@_number_option("--resting-length", "MM", "Resting length L0 of the actuators [mm].  [default: by rule]")
@_number_option("--bore", "MM", "Bore of the damper [mm].  [default: by (4.2)]")
@_number_option(
    "--cylinder-pressure", "MPA", "Pressure in the damper that sets its bore [MPa].  [default: 4.7, assumed]"
)
@_number_option("--eccentric-speed", "MM/S", "Lengthening the damper is sized at [mm/s].  [default: Vmax/2, assumed]")
@_number_option("--eccentric-force", "N", "Damping at that speed [N].  [default: (saturation - 1) F0]")
@_number_option("--moment-arm", "MM", "With --mass: of the tendon about the ankle [mm].  [default: 48, assumed]")
@_number_option(
    "--tendon-strain", "%", "Stretch at the design force over tendon plus muscle [%].  [default: 4, assumed]"
)
@click.option("--name", default="klute-design", show_default=True, metavar="NAME", help="Name of the device.")
@common.out_option("design", "the design")
@common.json_option("the tables")
def command(out: Path | None, as_json: bool, name: str, **given: Any) -> None:
    """Size actuators, damper and tendon for a muscle or for a walker.

    Chapters 4 to 6 as a tool: actuators of Table 3.1 that are strong enough, the damper's bore (4.2) and its two
    orifices (4.6), the tendon's two springs. Says how muscle-like the result is (2.5), how far its force over
    velocity is from Hill's, what a stride asks of it, and what the assumed numbers change, one at a time; a number
    that is given is none of them, and those that are left out are named.

    Writes device.toml (for klute-sim device and klute-sim gait --device), summary.json, figure.png and, for a walker,
    profile.csv (for klute-sim gait --controller): the tuned profile at the same force per body mass.

    \b
    Examples:
      klute-sim design --mass 75
      klute-sim design --mass 100 --pressure 6 --out heavy
      klute-sim design --muscle bobbert_1986 --l0 264
      klute-sim design --f0 1400 --l0 250 --vmax 300 --a 0.28 --b 0.28
      klute-sim design --actuator klute-3-4 --count 2 --resting-length 250 --eccentric-force 400
    """
    from klute_sim.controllers.pressure import profile_to_csv
    from klute_sim.errors import InputError
    from klute_sim.recording import run_folder
    from klute_sim.sizing.sizing import design_device
    from klute_sim.sizing.target import WalkerTarget

    if not name:
        raise InputError("--name is empty: give the device a name")
    target = _build_target(given)
    with run_folder.create_run_folder("design", out) as (folder, scratch):
        found = design_device(target, _build_choices(given), name)
        if isinstance(target, WalkerTarget) and found.profile:
            _check_fits_shank(found, target)
            (scratch / "profile.csv").write_text(profile_to_csv(found.profile), "utf-8")
        shown = _write(found, folder, scratch, given["reference_file"])
    _report(shown, as_json=as_json)


def _build_target(options: dict[str, Any]) -> "MuscleTarget | WalkerTarget":
    """The muscle or the walker that is asked for; raises InputError for options that do not go together."""
    from klute_sim.errors import InputError
    from klute_sim.gait import reference
    from klute_sim.sizing.target import MuscleTarget, WalkerTarget, load_table_target

    if options["mass"] is not None:
        for option in ("muscle", "f0", "l0"):
            if options[option] is not None:
                raise InputError(f"--{option} does not go with --mass: F0 and length follow from the walker")
    elif options["reference_file"] is not None:
        raise InputError("--reference goes with --mass")
    elif options["moment_arm"] is not None:
        raise InputError("--moment-arm goes with --mass: without a walker no ankle moves the tendon")
    aimless = options["mass"] is None and options["muscle"] is None and options["f0"] is None
    if aimless and (options["actuator"] is None or options["count"] is None):
        raise InputError(
            "nothing to design for: give --mass KG, --muscle ROW or --f0 N, or both --actuator and --count"
        )
    muscle = MuscleTarget() if options["muscle"] is None else load_table_target(options["muscle"])
    shape = {key: options[key] for key in ("a", "b", "saturation") if options[key] is not None}
    sizes = {
        field: factor * options[option]
        for option, field, factor in (
            ("f0", "isometric_force", 1.0),
            ("l0", "resting_length", 1e-3),
            ("vmax", "peak_velocity", 1e-3),
        )
        if options[option] is not None
    }
    muscle = replace(muscle, hill=muscle.hill._replace(**shape), **sizes)
    if options["mass"] is None:
        return muscle
    human = (
        reference.load_default_reference()
        if options["reference_file"] is None
        else reference.load_reference(options["reference_file"])
    )
    return WalkerTarget(mass=options["mass"], reference=human, muscle=muscle)


def _build_choices(options: dict[str, Any]) -> "DesignChoices":
    from klute_sim.sizing.choices import PA_PER_MPA, DesignAssumptions, DesignChoices
    from klute_sim.units import BAR

    def si(names: dict[str, tuple[str, float]]) -> dict[str, Any]:
        return {field: f * options[option] for option, (field, f) in names.items() if options[option] is not None}

    assumed = si(
        {
            "cylinder_pressure": ("cylinder_pressure", PA_PER_MPA),
            "moment_arm": ("moment_arm", 1e-3),
            "tendon_strain": ("tendon_strain", 0.01),
        }
    )
    named = frozenset(
        [*assumed, *(key for key in ("a", "b") if options[key] is not None or options["muscle"] is not None)]
    )
    fixed = si(
        {
            "pressure": ("supply_pressure", BAR),
            "resting_length": ("resting_length", 1e-3),
            "bore": ("bore", 1e-3),
            "eccentric_speed": ("eccentric_speed", 1e-3),
            "eccentric_force": ("eccentric_force", 1.0),
        }
    )
    return DesignChoices(
        actuator=options["actuator"],
        count=options["count"],
        assumptions=DesignAssumptions(**assumed),
        explicit_fields=named,
        **fixed,
    )


def _check_fits_shank(result: "Design", walker: "WalkerTarget") -> None:
    """Raise InputError for a device that the gait rig's leg has no room for."""
    from klute_sim.gait.rig.build import MODEL_STATURE, build_gait_model

    build_gait_model(result.device, mass=walker.mass, stature=MODEL_STATURE, dt=1e-3)


def _write(result: "Design", folder: Path, scratch: Path, reference_file: Path | None) -> dict[str, Any]:
    """Fill ``scratch``; the summary, with what is said beside the tables."""
    from klute_sim.cli.console import progress_bar
    from klute_sim.report.design import figure as design_figure
    from klute_sim.report.design.table import collect_remarks
    from klute_sim.sizing.sensitivity import analyse_sensitivity
    from klute_sim.sizing.summary import build_summary

    with progress_bar("varying the assumptions") as progress:
        effects = analyse_sensitivity(result, progress)
    (scratch / "device.toml").write_bytes(result.device.content)
    design_figure.save_figure(result, scratch / "figure.png")
    files = sorted([*(file.name for file in scratch.iterdir()), "summary.json"])
    shown = {**build_summary(result, effects), "gait": _build_gait_command(result, folder, reference_file)}
    shown = {**shown, "remarks": collect_remarks(shown), "run": str(folder), "files": files}
    (scratch / "summary.json").write_text(_to_json(shown) + "\n", "utf-8")
    return shown


def _build_gait_command(result: "Design", folder: Path, reference_file: Path | None) -> str | None:
    """The command that walks with the design under the profile written with it; None without a walker."""
    from klute_sim.sizing.target import WalkerTarget

    if not isinstance(result.target, WalkerTarget):
        return None
    device, profile = folder / "device.toml", folder / "profile.csv"
    words = ["--device", device, "--controller", profile, "--mass", repr(result.target.mass).removesuffix(".0")]
    reference = [] if reference_file is None else ["--reference", reference_file]
    return shlex.join(["klute-sim", "gait", *map(str, [*words, *reference])])


def _to_json(summary: dict[str, Any]) -> str:
    return json.dumps(summary, indent=2, allow_nan=False)


def _report(summary: dict[str, Any], *, as_json: bool) -> None:
    from klute_sim.cli.console import stdout_console
    from klute_sim.report.design.table import build_tables

    if as_json:
        click.echo(_to_json(summary))
        return
    out = stdout_console()
    for table in build_tables(summary):
        out.print(table)
    for remark in summary["remarks"]:
        out.print(remark, soft_wrap=True)
    out.print(f"Design folder: {summary['run']}  ({', '.join(summary['files'])})", soft_wrap=True)
