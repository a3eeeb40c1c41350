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
from klute_sim.cli.given_path import GivenPath
from klute_sim.laws.hill_tables import HILL

if TYPE_CHECKING:
    from klute_sim.design.choices import Choices
    from klute_sim.design.sizing import Design
    from klute_sim.design.target import Target, Walker


def _number(name: str, metavar: str, text: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    unit = re.search(r"\[(?!default)(.+?)\]", text)
    return click.option(name, type=common.Number(unit[1] if unit else ""), default=None, metavar=metavar, help=text)


@click.command("design")
@_number("--mass", "KG", "Design for a walker of this body mass [kg].")
@click.option(
    "--reference",
    "reference_file",
    type=GivenPath(),
    default=None,
    metavar="FILE",
    help="With --mass: CSV of a gait cycle with the columns of docs/gait.md.  [default: able-bodied adults]",
)
@click.option("--muscle", default=None, metavar="ROW", help=f"Emulate this muscle of Table 2.4: {', '.join(HILL)}.")
@_number("--f0", "N", "Isometric force F0 of the muscle [N].")
@_number("--l0", "MM", "Length l0 of the muscle: the actuators' resting length [mm].")
@_number("--vmax", "MM/S", "Fastest shortening Vmax of the muscle [mm/s].  [default: 300, assumed]")
@_number("--a", "A", "a/F0 of Hill's equation (2.4).  [default: 0.28]")
@_number("--b", "B", "b/Vmax of Hill's equation (2.4).  [default: 0.28]")
@_number("--saturation", "S", "Force while lengthening fast, over F0.  [default: 1.3]")
@_number("--pressure", "BAR", "Supply's gauge pressure [bar].  [default: 5]")
@click.option(
    "--actuator", default=None, metavar="NAME", help="klute-1-1-4, klute-3-4 or klute-1-2.  [default: by rule]"
)
@click.option("--count", type=int, default=None, metavar="N", help="Actuators in parallel.  [default: by rule]")
@_number("--resting-length", "MM", "Resting length L0 of the actuators [mm].  [default: by rule]")
@_number("--bore", "MM", "Bore of the damper [mm].  [default: by (4.2)]")
@_number("--cylinder-pressure", "MPA", "Pressure in the damper that sets its bore [MPa].  [default: 4.7, assumed]")
@_number("--eccentric-speed", "MM/S", "Lengthening the damper is sized at [mm/s].  [default: Vmax/2, assumed]")
@_number("--eccentric-force", "N", "Damping at that speed [N].  [default: (saturation - 1) F0]")
@_number("--moment-arm", "MM", "With --mass: of the tendon about the ankle [mm].  [default: 48, assumed]")
@_number("--tendon-strain", "%", "Stretch at the design force over tendon plus muscle [%].  [default: 4, assumed]")
@click.option("--name", default="klute-design", show_default=True, metavar="NAME", help="Name of the device.")
@common.out("design", "the design")
@common.as_json("the tables")
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
    from klute_sim.control.pressure import to_csv
    from klute_sim.design.sizing import design
    from klute_sim.design.target import Walker
    from klute_sim.errors import InputError
    from klute_sim.recording import run_folder

    if not name:
        raise InputError("--name is empty: give the device a name")
    target = _target(given)
    with run_folder.new("design", out) as (folder, scratch):
        found = design(target, _choices(given), name)
        if isinstance(target, Walker) and found.profile:
            _refuse_what_no_shank_takes(found, target)
            (scratch / "profile.csv").write_text(to_csv(found.profile), "utf-8")
        shown = _write(found, folder, scratch, given["reference_file"])
    _report(shown, as_json=as_json)


def _target(given: dict[str, Any]) -> "Target | Walker":
    """The muscle or the walker that is asked for; raises InputError for options that do not go together."""
    from klute_sim.design.target import Target, Walker, from_table
    from klute_sim.errors import InputError
    from klute_sim.rigs.gait import reference

    if given["mass"] is not None:
        for option in ("muscle", "f0", "l0"):
            if given[option] is not None:
                raise InputError(f"--{option} does not go with --mass: F0 and length follow from the walker")
    elif given["reference_file"] is not None:
        raise InputError("--reference goes with --mass")
    elif given["moment_arm"] is not None:
        raise InputError("--moment-arm goes with --mass: without a walker no ankle moves the tendon")
    aimless = given["mass"] is None and given["muscle"] is None and given["f0"] is None
    if aimless and (given["actuator"] is None or given["count"] is None):
        raise InputError(
            "nothing to design for: give --mass KG, --muscle ROW or --f0 N, or both --actuator and --count"
        )
    muscle = Target() if given["muscle"] is None else from_table(given["muscle"])
    shape = {key: given[key] for key in ("a", "b", "saturation") if given[key] is not None}
    sizes = {
        field: factor * given[option]
        for option, field, factor in (
            ("f0", "isometric_force", 1.0),
            ("l0", "resting_length", 1e-3),
            ("vmax", "peak_velocity", 1e-3),
        )
        if given[option] is not None
    }
    muscle = replace(muscle, hill=muscle.hill._replace(**shape), **sizes)
    if given["mass"] is None:
        return muscle
    human = reference.default() if given["reference_file"] is None else reference.load(given["reference_file"])
    return Walker(mass=given["mass"], reference=human, muscle=muscle)


def _choices(given: dict[str, Any]) -> "Choices":
    from klute_sim.design.choices import MPA, Assumptions, Choices
    from klute_sim.units import BAR

    def si(names: dict[str, tuple[str, float]]) -> dict[str, Any]:
        return {field: f * given[option] for option, (field, f) in names.items() if given[option] is not None}

    assumed = si(
        {
            "cylinder_pressure": ("cylinder_pressure", MPA),
            "moment_arm": ("moment_arm", 1e-3),
            "tendon_strain": ("tendon_strain", 0.01),
        }
    )
    named = frozenset([*assumed, *(key for key in ("a", "b") if given[key] is not None or given["muscle"] is not None)])
    fixed = si(
        {
            "pressure": ("supply_pressure", BAR),
            "resting_length": ("resting_length", 1e-3),
            "bore": ("bore", 1e-3),
            "eccentric_speed": ("eccentric_speed", 1e-3),
            "eccentric_force": ("eccentric_force", 1.0),
        }
    )
    return Choices(
        actuator=given["actuator"],
        count=given["count"],
        assumptions=Assumptions(**assumed),
        named=named,
        **fixed,
    )


def _refuse_what_no_shank_takes(found: "Design", walker: "Walker") -> None:
    """Raise InputError for a device that the gait rig's leg has no room for."""
    from klute_sim.rigs.gait.build import MODEL_STATURE, build

    build(found.device, mass=walker.mass, stature=MODEL_STATURE, step=1e-3)


def _write(found: "Design", folder: Path, scratch: Path, reference_file: Path | None) -> dict[str, Any]:
    """Fill ``scratch``; the summary, with what is said beside the tables."""
    from klute_sim.cli.console import progress_bar
    from klute_sim.design.sensitivity import sensitivity
    from klute_sim.design.summary import summary
    from klute_sim.report import design_figure
    from klute_sim.report.design_table import remarks

    with progress_bar("varying the assumptions") as progress:
        effects = sensitivity(found, progress)
    (scratch / "device.toml").write_bytes(found.device.content)
    design_figure.draw(found, scratch / "figure.png")
    files = sorted([*(file.name for file in scratch.iterdir()), "summary.json"])
    shown = {**summary(found, effects), "gait": _gait_command(found, folder, reference_file)}
    shown = {**shown, "remarks": remarks(shown), "run": str(folder), "files": files}
    (scratch / "summary.json").write_text(_json(shown) + "\n", "utf-8")
    return shown


def _gait_command(found: "Design", folder: Path, reference_file: Path | None) -> str | None:
    """The command that walks with the design under the profile written with it; None without a walker."""
    from klute_sim.design.target import Walker

    if not isinstance(found.target, Walker):
        return None
    device, profile = folder / "device.toml", folder / "profile.csv"
    words = ["--device", device, "--controller", profile, "--mass", repr(found.target.mass).removesuffix(".0")]
    reference = [] if reference_file is None else ["--reference", reference_file]
    return shlex.join(["klute-sim", "gait", *map(str, [*words, *reference])])


def _json(shown: dict[str, Any]) -> str:
    return json.dumps(shown, indent=2, allow_nan=False)


def _report(shown: dict[str, Any], *, as_json: bool) -> None:
    from klute_sim.cli.console import console
    from klute_sim.report.design_table import tables

    if as_json:
        click.echo(_json(shown))
        return
    out = console()
    for table in tables(shown):
        out.print(table)
    for remark in shown["remarks"]:
        out.print(remark, soft_wrap=True)
    out.print(f"Design folder: {shown['run']}  ({', '.join(shown['files'])})", soft_wrap=True)
