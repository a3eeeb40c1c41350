"""``klute-sim view``."""

from pathlib import Path

import click


@click.command("view")
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--web", is_flag=True, help="Serve the viewer to a browser on this machine instead of a window.")
def command(run: Path, web: bool) -> None:
    """Open the folder RUN in the rerun viewer, on the loopback address only.

    Needs the optional extra 'rerun' (pip install '.[rerun]' in the project's folder). Sends none of rerun's usage
    statistics and leaves rerun's own settings as they are; with --web, open the address printed here, which is told
    the same.

    \b
    Examples:
      klute-sim view runs/gait-001
      klute-sim view runs/gait-001 --web
    """
    from klute_sim.report.view import open_viewer

    open_viewer(run, web=web)
