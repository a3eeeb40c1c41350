"""``klute-sim effects``."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from klute_sim.cli import common
from klute_sim.cli.given_path import GivenPath
from klute_sim.report import effects_words as words

if TYPE_CHECKING:
    from klute_sim.effects.effect import Effect


@click.command("effects")
@click.argument("name", metavar="[NAME]", required=False)
@click.option(
    "--json", "as_json", is_flag=True, help="Print JSON instead of tables: one object, or a list without NAME."
)
@common.CATALOGUE
@click.option(
    "--confusable",
    is_flag=True,
    help="Compute which effects look alike in the standard protocols, and the change of the rig that splits them.",
)
@click.option(
    "--device",
    "device_name",
    default=words.DEVICE,
    show_default=True,
    metavar="NAME|FILE",
    help="Device of --confusable and of the pictures.",
)
@click.option(
    "--out",
    type=GivenPath(),
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
        use(catalogue)
    if out is not None and name is None and not confusable:
        raise InputError("--out goes with NAME or --confusable")
    chosen = known.form_of(name, None)[0] if name else None
    if confusable:
        _confusable(device_name, chosen, out, as_json=as_json)
        return
    if out is not None and chosen is not None:
        _signatures(device_name, chosen, out)
    if name is None:
        shown = [words.describe(effect) for effect in known.effects().values()]
        if as_json:
            _json(shown)
        else:
            _print_all(shown)
        return
    one = words.describe(known.form_of(name, None)[0])
    if as_json:
        _json(one)
    else:
        _print_one(one)


def _confusable(device_name: str, chosen: "Effect | None", out: Path | None, *, as_json: bool) -> None:
    from contextlib import nullcontext

    from klute_sim.cli.console import console, progress_bar
    from klute_sim.device.files import load
    from klute_sim.diagnose.confusable import bare, confusions, rows
    from klute_sim.diagnose.experiment import Bench
    from klute_sim.recording import run_folder
    from klute_sim.report import effects_figures

    device, bench = load(device_name), Bench()
    if chosen is not None:
        device = bare(device, chosen)
    folder = run_folder.new("effects", out) if out is not None else nullcontext((None, None))
    with folder as (place, scratch):
        with progress_bar("simulating") as told:
            found = confusions(device, bench, told)
        every = rows(found)
        if scratch is not None:
            (scratch / "confusable.json").write_text(json.dumps(every, indent=2, allow_nan=False) + "\n", "utf-8")
            effects_figures.write_matrices(found, scratch)
    bench.close()
    shown = [row for row in every if chosen is None or row["effect"] == chosen.name]
    if as_json:
        _json(shown)
        return
    _print_confusable(shown)
    if place is not None:
        console().print(f"Matrix and table: {place}", soft_wrap=True)


def _print_confusable(rows: list[dict[str, Any]]) -> None:
    from rich.table import Table

    from klute_sim.cli.console import console

    table = Table("effect", "typical size over noise", "left after refitting", "looks like", "split by")
    for row in rows:
        name = f"{row['effect']} ({row['form']})" + (f" of {row['channel']}" if row["channel"] else "")
        likes = "\n".join(f"{t['effect']} ({t['cosine']:.2f})" for t in row["alike"])
        likes = likes or f"nothing; closest: {row['closest']} ({row['closest_cosine']:.2f})"
        split = "\n".join(
            f"{t['split_by']} ({t['cosine_then']:.2f})" if t["split_by"] else words.NO_SPLIT for t in row["alike"]
        )
        table.add_row(name, f"{row['size']:.0f}", f"{100.0 * row['kept']:.0f} %", likes, split or "-")
    console().print(table)


def _signatures(device_name: str, effect: "Effect", out: Path) -> None:
    """A picture of every form of ``effect`` (of an instrument: on the force)."""
    from klute_sim.cli.console import notes
    from klute_sim.device.files import load
    from klute_sim.diagnose.experiment import Bench
    from klute_sim.diagnose.signature import signatures
    from klute_sim.recording import run_folder
    from klute_sim.report import effects_figures

    device, bench = load(device_name), Bench()
    with run_folder.new("effects", out) as (place, scratch):
        for found in signatures(device, effect, bench):
            effects_figures.draw(found, scratch)
    bench.close()
    notes().print(f"Pictures: {place}", soft_wrap=True)


def use(catalogue: Path) -> None:
    """Let the effects of the file ``catalogue`` in, and say on stderr that its code is run."""
    from klute_sim.cli.console import notes
    from klute_sim.effects import catalogue as known

    if catalogue.is_file():
        notes().print(f"The code in {catalogue} is run.", soft_wrap=True)
    known.use(catalogue)


def _json(shown: Any) -> None:
    click.echo(json.dumps(shown, indent=2, allow_nan=False))


def _print_all(shown: list[dict[str, Any]]) -> None:
    from rich.table import Table

    from klute_sim.cli.console import console

    table = Table("effect", "kind", "forms", "what it is")
    for effect in shown:
        forms = ", ".join(form["name"] for form in effect["forms"])
        table.add_row(effect["name"], effect["kind"], forms, effect["sentence"])
    console().print(table)


def _print_one(shown: dict[str, Any]) -> None:
    from rich.table import Table

    from klute_sim.cli.console import console

    out = console()
    out.print(f"{shown['name']}: {shown['sentence']}", soft_wrap=True)
    out.print(words.kind(shown), soft_wrap=True)
    for number, form in enumerate(shown["forms"]):
        usual = words.usual(number, shown["forms"])
        out.print(f"\nForm {form['name']}{usual}: {form['equation']}", soft_wrap=True)
        out.print(words.acts(form), soft_wrap=True)
        table = Table(*words.PARAMETER_HEAD)
        for row in form["parameters"]:
            table.add_row(*words.cells(row), style="yellow" if row["assumed"] else None)
        out.print(table)
        if form["device_file"]:
            out.print("In a device file:\n")
            click.echo(form["device_file"])  # to be copied as it is
