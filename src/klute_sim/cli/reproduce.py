"""``klute-sim reproduce``."""

from pathlib import Path

import click

from klute_sim.cli import common, completion
from klute_sim.cli.common import NonEmptyPath

DEFAULT_DEVICE = "klute-3-4-pair"


@click.command("reproduce")
@click.option(
    "--device",
    shell_complete=completion.complete_device,
    default=DEFAULT_DEVICE,
    show_default=True,
    metavar="NAME|FILE",
    help="Muscle-tendon unit for chapters 4 to 8: preset or device file with damper and tendon.",
)
@click.option(
    "--published",
    "published_file",
    type=NonEmptyPath(),
    default=None,
    metavar="FILE",
    help="TOML file with published numbers that this package lacks; --missing prints a template.",
)
@click.option("--missing", is_flag=True, help="Print the template for --published, and exit.")
@click.option(
    "--items",
    "all_items",
    is_flag=True,
    help="Print all items.  [default: the independent numbers and what does not agree]",
)
@common.out_option("reproduce", "page and figures")
@click.option("--json", "as_json", is_flag=True, help="Print headline, counts and items as JSON instead of the table.")
def command(
    device: str, published_file: Path | None, missing: bool, all_items: bool, out: Path | None, as_json: bool
) -> None:
    """Compare the model with the numbers and figures of Klute's dissertation.

    Each number and statement gets a verdict: agrees, contradicts-source, source-contradicts-itself, or not-printed
    (the page is missing, or the data of the experiment are not printed). The first line counts the independent numbers;
    claims in words, round trips (a constant put into a law and recovered) and inputs of the model are counted apart.

    Writes index.html, every figure with the axes of the source, items.json and device.toml.

    \b
    Examples:
      klute-sim reproduce --out dissertation
      klute-sim reproduce --items
      klute-sim reproduce --missing > numbers.toml    write a template to complete
      klute-sim reproduce --published numbers.toml
      klute-sim reproduce --json | python -m json.tool
    """
    from klute_sim.api.rendering import print_summary
    from klute_sim.api.reproduction import reproduce
    from klute_sim.cli.console import progress_bar, stdout_console
    from klute_sim.errors import InputError
    from klute_sim.recording.run_folder import create_run_folder
    from klute_sim.reproduction import printed

    if missing:
        if published_file or out or as_json or all_items:
            raise InputError("--missing prints a template and exits: leave out all other options")
        click.echo(printed.render_template(), nl=False)
        return
    published = printed.load_supplied_values(published_file) if published_file else None
    with create_run_folder("reproduce", out) as (folder, scratch):
        with progress_bar("computing") as progress:
            result = reproduce(device, published=published, progress=progress)
        with progress_bar("drawing") as progress:
            result.write_files(scratch, progress)
    if as_json:
        click.echo(result.to_json())
        return
    console = stdout_console()
    print_summary(console, result.format_summary(all_items=all_items))
    hint = "" if all_items else " (--items prints them)"
    console.print(f"{len(result.assessments)} items{hint}; notes and figures: {folder}/index.html", soft_wrap=True)
