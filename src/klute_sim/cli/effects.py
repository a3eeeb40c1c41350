"""``klute-sim effects``."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from klute_sim.cli import common
from klute_sim.cli.nonempty_path import NonEmptyPath
from klute_sim.report.effects import text as words

if TYPE_CHECKING:
    from klute_sim.effects.effect import Effect


@click.command("effects")
@click.argument("name", metavar="[NAME]", required=False)
@click.option(
    "--json", "as_json", is_flag=True, help="Print JSON instead of tables: one object, or a list without NAME."
)
@common.CATALOGUE_OPTION
@click.option(
    "--confusable",
    is_flag=True,
    help="Compute which effects look alike in the standard protocols, and the change of the rig that splits them.",
)
@click.option(
    "--device",
    "device_name",
    default=words.SIGNATURE_DEVICE,
    show_default=True,
    metavar="NAME|FILE",
    help="Device of --confusable and of the pictures.",
)
@click.option(
    "--out",
    type=NonEmptyPath(),
    default=None,
    metavar="FOLDER",
    help="New or empty folder for pictures and data: of NAME what it changes, of --confusable who looks like whom.",
)
def command(
    name: str | None,
    as_json: bool,
    catalogue: Path | None,
    confusable: bool,
    device_name: str,
    out: Path | None,
) -> None:
    """List the physical effects that the base model leaves out, or show one.

    Shows each form's equation, where it acts, its parameters (unit, the value without effect, range, typical size,
    source; assumed ones marked), and the lines that put it into a device file.

    \b
    Examples:
      klute-sim effects
      klute-sim effects braid_hysteresis
      klute-sim effects pressure_lag --json
      klute-sim effects warming --catalogue my_effects.py
      klute-sim effects muscle_damping --out signature    pictures of what it changes
      klute-sim effects seal_friction --confusable        what it is easily taken for
      klute-sim effects --confusable --out who-is-who     all of them, as matrix and table
    """
    from klute_sim.effects import catalogue as known
    from klute_sim.errors import InputError

    if catalogue is not None:
        load_catalogue(catalogue)
    if out is not None and name is None and not confusable:
        raise InputError("--out goes with NAME or --confusable")
    chosen = known.find_form(name, None)[0] if name else None
    if confusable:
        _analyze_identifiability(device_name, chosen, out, as_json=as_json)
        return
    if out is not None and chosen is not None:
        _draw_signatures(device_name, chosen, out)
    if name is None:
        shown = [words.describe_effect(effect) for effect in known.get_effects().values()]
        if as_json:
            _print_json(shown)
        else:
            _print_effects(shown)
        return
    one = words.describe_effect(known.find_form(name, None)[0])
    if as_json:
        _print_json(one)
    else:
        _print_effect(one)


def _analyze_identifiability(device_name: str, effect: "Effect | None", out: Path | None, *, as_json: bool) -> None:
    from contextlib import nullcontext

    from klute_sim.cli.console import progress_bar, stdout_console
    from klute_sim.device.device import load_device
    from klute_sim.diagnosis.experiments.base import Simulator
    from klute_sim.diagnosis.planning.identifiability import compute_identifiability, remove_base_effect, to_json_rows
    from klute_sim.recording import run_folder
    from klute_sim.report.effects import figures as effects_figures

    device, bench = load_device(device_name), Simulator()
    if effect is not None:
        device = remove_base_effect(device, effect)
    folder = run_folder.create_run_folder("effects", out) if out is not None else nullcontext((None, None))
    with folder as (place, scratch):
        with progress_bar("simulating") as told:
            found = compute_identifiability(device, bench, told)
        every = to_json_rows(found)
        if scratch is not None:
            (scratch / "confusable.json").write_text(json.dumps(every, indent=2, allow_nan=False) + "\n", "utf-8")
            effects_figures.write_matrices(found, scratch)
    bench.close()
    shown = [row for row in every if effect is None or row["effect"] == effect.name]
    if as_json:
        _print_json(shown)
        return
    _print_identifiability(shown)
    if place is not None:
        stdout_console().print(f"Matrix and table: {place}", soft_wrap=True)


def _print_identifiability(rows: list[dict[str, Any]]) -> None:
    from rich.table import Table

    from klute_sim.cli.console import stdout_console

    table = Table("effect", "typical size over noise", "left after refitting", "looks like", "split by")
    for row in rows:
        name = f"{row['effect']} ({row['form']})" + (f" of {row['channel']}" if row["channel"] else "")
        likes = "\n".join(f"{t['effect']} ({t['cosine']:.2f})" for t in row["alike"])
        likes = likes or f"nothing; closest: {row['closest']} ({row['closest_cosine']:.2f})"
        split = "\n".join(
            f"{t['split_by']} ({t['cosine_then']:.2f})" if t["split_by"] else words.NO_DISTINGUISHING_CHANGE
            for t in row["alike"]
        )
        table.add_row(name, f"{row['size']:.0f}", f"{100.0 * row['kept']:.0f} %", likes, split or "-")
    stdout_console().print(table)


def _draw_signatures(device_name: str, effect: "Effect", out: Path) -> None:
    """A picture of every form of ``effect`` (of an instrument: on the force)."""
    from klute_sim.cli.console import stderr_console
    from klute_sim.device.device import load_device
    from klute_sim.diagnosis.experiments.base import Simulator
    from klute_sim.diagnosis.planning.signatures import simulate_effect_responses
    from klute_sim.recording import run_folder
    from klute_sim.report.effects import figures as effects_figures

    device, bench = load_device(device_name), Simulator()
    with run_folder.create_run_folder("effects", out) as (place, scratch):
        for found in simulate_effect_responses(device, effect, bench):
            effects_figures.save_signature_figure(found, scratch)
    bench.close()
    stderr_console().print(f"Pictures: {place}", soft_wrap=True)


def load_catalogue(path: Path) -> None:
    """Let the effects of the file ``catalogue`` in, and say on stderr that its code is run."""
    from klute_sim.cli.console import stderr_console
    from klute_sim.effects import catalogue as known

    if path.is_file():
        stderr_console().print(f"The code in {path} is run.", soft_wrap=True)
    known.use_catalogue(path)


def _print_json(content: Any) -> None:
    click.echo(json.dumps(content, indent=2, allow_nan=False))


def _print_effects(effects: list[dict[str, Any]]) -> None:
    from rich.table import Table

    from klute_sim.cli.console import stdout_console

    table = Table("effect", "kind", "forms", "what it is")
    for effect in effects:
        forms = ", ".join(form["name"] for form in effect["forms"])
        table.add_row(effect["name"], effect["kind"], forms, effect["sentence"])
    stdout_console().print(table)


def _print_effect(effect: dict[str, Any]) -> None:
    from rich.table import Table

    from klute_sim.cli.console import stdout_console

    out = stdout_console()
    out.print(f"{effect['name']}: {effect['sentence']}", soft_wrap=True)
    out.print(words.describe_kind(effect), soft_wrap=True)
    for number, form in enumerate(effect["forms"]):
        usual = words.format_default_note(number, effect["forms"])
        out.print(f"\nForm {form['name']}{usual}: {form['equation']}", soft_wrap=True)
        out.print(words.describe_hooks(form), soft_wrap=True)
        table = Table(*words.PARAMETER_HEADINGS)
        for row in form["parameters"]:
            table.add_row(*words.format_parameter_cells(row), style="yellow" if row["assumed"] else None)
        out.print(table)
        if form["device_file"]:
            out.print("In a device file:\n")
            click.echo(form["device_file"])  # to be copied as it is
