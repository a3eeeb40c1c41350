"""``klute-sim reproduce``."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from klute_sim.cli import common
from klute_sim.cli.nonempty_path import NonEmptyPath

if TYPE_CHECKING:
    from klute_sim.reproduction.run import Reproduction

DEFAULT_DEVICE = "klute-3-4-pair"


@click.command("reproduce")
@click.option(
    "--device",
    "device_name",
    default=DEFAULT_DEVICE,
    show_default=True,
    metavar="NAME|FILE",
    help="Musculo-tendon unit of chapters 4 to 8: with damper and tendon.",
)
@click.option(
    "--published",
    "published_file",
    type=NonEmptyPath(),
    default=None,
    metavar="FILE",
    help="TOML file with published numbers that our copy lacks; they are compared, too (--missing begins one).",
)
@click.option("--missing", is_flag=True, help="Print the missing numbers as such a file to fill in, and end.")
@click.option("--items", "every", is_flag=True, help="Print every item, not only what does not agree.")
@common.out_option("reproduce", "page and figures")
@click.option("--json", "as_json", is_flag=True, help="Print a list of items instead of the table.")
def command(
    device_name: str, published_file: Path | None, missing: bool, every: bool, out: Path | None, as_json: bool
) -> None:
    """Lay everything that Klute's dissertation prints beside what this package computes.

    Each number and statement gets a verdict: agrees, contradicts-source, source-contradicts-itself, or not-printed
    (the page is missing, or it is about an experiment). Writes report.html, a picture of every figure in the source's
    axes, items.json and device.toml.

    \b
    Examples:
      klute-sim reproduce --out dissertation
      klute-sim reproduce --items
      klute-sim reproduce --missing > numbers.toml     fill it in, then:
      klute-sim reproduce --published numbers.toml
      klute-sim reproduce --json | python -m json.tool
    """
    from klute_sim.cli.console import progress_bar
    from klute_sim.device.device import load_device
    from klute_sim.errors import InputError
    from klute_sim.recording import run_folder
    from klute_sim.report.reproduction import figures as reproduction_figures
    from klute_sim.report.reproduction import page as reproduction_page
    from klute_sim.reproduction import printed
    from klute_sim.reproduction.run import run_reproduction

    if missing:
        if published_file or out or as_json or every:
            raise InputError("--missing prints a file to fill in and ends: no other option goes with it")
        click.echo(printed.render_template(), nl=False)
        return
    device = load_device(device_name)
    supplied = printed.load_supplied_values(published_file) if published_file else {}
    with run_folder.create_run_folder("reproduce", out) as (folder, scratch):
        with progress_bar("computing") as told:
            found = run_reproduction(device, supplied, told)
        with progress_bar("drawing") as told:
            pictures = {}
            for number, path in enumerate(reproduction_figures.save_figures(found.figures, scratch)):
                pictures[found.figures[number].number] = path
                told((number + 1) / len(found.figures))
        reproduction_page.write_page(found, pictures, scratch / "report.html")
        (scratch / "items.json").write_text(_to_json(found) + "\n", "utf-8")
        (scratch / "device.toml").write_bytes(device.content)
    if as_json:
        click.echo(_to_json(found))
    else:
        _print(found, folder, show_all=every)


def _to_json(reproduction: "Reproduction") -> str:
    return json.dumps(reproduction.to_records(), indent=1, allow_nan=False, ensure_ascii=False)


def _print(reproduction: "Reproduction", folder: Path, *, show_all: bool) -> None:
    from rich.table import Table

    from klute_sim.cli.console import stdout_console
    from klute_sim.report.reproduction.page import (
        VERDICT_MEANINGS,
        count_agreeing_inputs,
        count_verdicts,
        format_outcome_cells,
    )

    out = stdout_console()
    told = ("contradicts-source", "source-contradicts-itself")
    shown = [o for o in reproduction.assessments if show_all or (o.verdict in told and not o.item.is_measured)]
    for title, outcomes in (
        ("Measured at 5 bar, and the model", [o for o in reproduction.assessments if o.item.is_measured]),
        ("Every item" if show_all else "What else does not agree", shown),
    ):
        table = Table("table or figure", "what", "unit", "published", "computed", "difference", title=title)
        table.add_column("verdict", no_wrap=True)
        for outcome in outcomes:
            c = format_outcome_cells(outcome)
            table.add_row(
                outcome.item.row_title,
                c["quantity"],
                c["unit"],
                c["published"],
                c["computed"],
                c["difference"],
                c["verdict"],
            )
        out.print(table)
        for outcome in outcomes:
            if outcome.note and outcome.verdict not in ("agrees", "not-printed"):
                out.print(f"{outcome.item.row_title}, {outcome.item.quantity}: {outcome.note}", soft_wrap=True)
    for verdict, count in count_verdicts(reproduction.assessments).items():
        taken = (
            f"; {count_agreeing_inputs(reproduction.assessments)} of them inputs that are taken over as they are"
            if verdict == "agrees"
            else ""
        )
        out.print(f"{count:4d} {verdict}: {VERDICT_MEANINGS[verdict]}{taken}", soft_wrap=True)
    rest = "" if show_all else " (--items prints them)"
    out.print(
        f"{len(reproduction.assessments)} items{rest}; the reasons and all figures: {folder}/report.html",
        soft_wrap=True,
    )
