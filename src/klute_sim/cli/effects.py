"""``klute-sim effects``."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from klute_sim.cli import common, completion
from klute_sim.cli.common import NonEmptyPath
from klute_sim.report.effects import text

if TYPE_CHECKING:
    from klute_sim.effects.effect import Effect


@click.command("effects")
@click.argument("name", metavar="[NAME]", required=False, shell_complete=completion.complete_effect)
@click.option(
    "--json", "as_json", is_flag=True, help="Print JSON instead of tables: one object with NAME, a list without NAME."
)
@common.CATALOGUE_OPTION
@click.option(
    "--confusable",
    is_flag=True,
    help="Compute which effects a bench test cannot distinguish, and which change of the rig distinguishes them.",
)
@click.option(
    "--device",
    "device_name",
    shell_complete=completion.complete_device,
    default=text.SIGNATURE_DEVICE,
    show_default=True,
    metavar="NAME|FILE",
    help="Device for --confusable and for the figures: name of a preset, or a device file.",
)
@click.option(
    "--out",
    type=NonEmptyPath(),
    default=None,
    metavar="FOLDER",
    help="New or empty folder for figures of the responses to NAME, or for the matrices of --confusable.  [default: "
    "write no files]",
)
def command(
    name: str | None,
    as_json: bool,
    catalogue: Path | None,
    confusable: bool,
    device_name: str,
    out: Path | None,
) -> None:
    """List the physical effects beyond the base model, or show the effect NAME.

    For one effect, prints each of its forms: the equation, the quantities on which it acts, the parameters (unit,
    neutral value, range, typical value, source; assumed values are marked), and the lines that add it to a device file.
    Writes files only with --out.

    \b
    Examples:
      klute-sim effects
      klute-sim effects braid_hysteresis
      klute-sim effects pressure_lag --json
      klute-sim effects warming --catalogue my_effects.py
      klute-sim effects muscle_damping --out signature    draw its responses
      klute-sim effects seal_friction --confusable        list similar effects
      klute-sim effects --confusable --out similarity     compare all effects
    """
    from klute_sim.effects import catalogue as known
    from klute_sim.errors import InputError

    if catalogue is not None:
        load_catalogue(catalogue)
    if out is not None and name is None and not confusable:
        raise InputError("--out needs NAME or --confusable")
    effect = known.find_form(name, None)[0] if name else None
    if confusable:
        _analyze_identifiability(device_name, effect, out, as_json=as_json)
        return
    if out is not None and effect is not None:
        _draw_signatures(device_name, effect, out)
    if effect is None:
        descriptions = [text.describe_effect(entry) for entry in known.get_effects().values()]
        if as_json:
            _print_json(descriptions)
        else:
            _print_effects(descriptions)
        return
    description = text.describe_effect(effect)
    if as_json:
        _print_json(description)
    else:
        _print_effect(description)


def _analyze_identifiability(device_name: str, effect: "Effect | None", out: Path | None, *, as_json: bool) -> None:
    from contextlib import nullcontext

    from klute_sim.cli.console import progress_bar, stdout_console
    from klute_sim.device.device import load_device
    from klute_sim.diagnosis.experiments.simulator import Simulator
    from klute_sim.diagnosis.planning.identifiability import compute_identifiability, remove_base_effect, to_json_rows
    from klute_sim.recording import run_folder
    from klute_sim.report.effects import figures as effects_figures

    device, simulator = load_device(device_name), Simulator()
    if effect is not None:
        device = remove_base_effect(device, effect)
    run = run_folder.create_run_folder("effects", out) if out is not None else nullcontext((None, None))
    with run as (folder, scratch):
        with progress_bar("simulating") as progress:
            rigs = compute_identifiability(device, simulator, progress)
        all_rows = to_json_rows(rigs)
        if scratch is not None:
            (scratch / "confusable.json").write_text(json.dumps(all_rows, indent=2, allow_nan=False) + "\n", "utf-8")
            effects_figures.write_matrices(rigs, scratch)
    simulator.close()
    rows = [row for row in all_rows if effect is None or row["effect"] == effect.name]
    if as_json:
        _print_json(rows)
        return
    _print_identifiability(rows)
    if folder is not None:
        stdout_console().print(f"Matrix and table: {folder}", soft_wrap=True)


def _print_identifiability(rows: list[dict[str, Any]]) -> None:
    from klute_sim.cli.console import stdout_console
    from klute_sim.terminal_table import create_table

    table = create_table(
        "effect", "typical size over noise", "after refitting", "indistinguishable from", "separated by"
    )
    for row in rows:
        name = f"{row['effect']} ({row['form']})" + (f" of {row['channel']}" if row["channel"] else "")
        similar = "\n".join(f"{pair['effect']} ({pair['cosine']:.2f})" for pair in row["similar_effects"])
        similar = similar or f"nothing; closest: {row['closest']} ({row['closest_cosine']:.2f})"
        separated_by = "\n".join(
            f"{pair['separated_by']} ({pair['remaining_cosine']:.2f})"
            if pair["separated_by"]
            else text.NO_DISTINGUISHING_CHANGE
            for pair in row["similar_effects"]
        )
        table.add_row(
            name,
            f"{row['signal_to_noise']:.0f}",
            f"{100.0 * row['orthogonal_fraction']:.0f} %",
            similar,
            separated_by or "-",
        )
    stdout_console().print(table)


def _draw_signatures(device_name: str, effect: "Effect", out: Path) -> None:
    """Write a figure of the response to each form of ``effect``; instrument effects act on the force."""
    from klute_sim.cli.console import stderr_console
    from klute_sim.device.device import load_device
    from klute_sim.diagnosis.experiments.simulator import Simulator
    from klute_sim.diagnosis.planning.signatures import simulate_effect_responses
    from klute_sim.recording import run_folder
    from klute_sim.report.effects import figures as effects_figures

    device, simulator = load_device(device_name), Simulator()
    with run_folder.create_run_folder("effects", out) as (folder, scratch):
        for response in simulate_effect_responses(device, effect, simulator):
            effects_figures.save_signature_figure(response, scratch)
    simulator.close()
    stderr_console().print(f"Figures: {folder}", soft_wrap=True)


def load_catalogue(path: Path) -> None:
    """Register the effects of the file at ``path``, and report on stderr that its code runs."""
    from klute_sim.cli.console import stderr_console
    from klute_sim.effects import catalogue as known

    if path.is_file():
        stderr_console().print(f"Running the code in {path}.", soft_wrap=True)
    known.use_catalogue(path)


def _print_json(content: Any) -> None:
    click.echo(json.dumps(content, indent=2, allow_nan=False))


def _print_effects(effects: list[dict[str, Any]]) -> None:
    from klute_sim.cli.console import stdout_console
    from klute_sim.terminal_table import create_table

    table = create_table("effect", "kind", "forms", "description")
    for effect in effects:
        forms = ", ".join(form["name"] for form in effect["forms"])
        table.add_row(effect["name"], effect["kind"], forms, effect["description"])
    stdout_console().print(table)


def _print_effect(effect: dict[str, Any]) -> None:
    from klute_sim.cli.console import stdout_console
    from klute_sim.terminal_table import create_table

    console = stdout_console()
    console.print(f"{effect['name']}: {effect['description']}", soft_wrap=True)
    console.print(text.describe_kind(effect), soft_wrap=True)
    for index, form in enumerate(effect["forms"]):
        default_note = text.format_default_note(index, effect["forms"])
        console.print(f"\nForm {form['name']}{default_note}: {form['equation']}", soft_wrap=True)
        console.print(text.describe_hooks(form), soft_wrap=True)
        table = create_table(*text.PARAMETER_HEADINGS)
        for row in form["parameters"]:
            table.add_row(*text.format_parameter_cells(row), style="yellow" if row["assumed"] else None)
        console.print(table)
        if form["device_file"]:
            console.print("In a device file:\n")
            click.echo(form["device_file"])  # without line breaks, so that it can be copied
