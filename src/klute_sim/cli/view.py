"""``klute-sim view``."""

from pathlib import Path

import click

from klute_sim.cli import common
from klute_sim.cli.nonempty_path import NonEmptyPath


@click.command("view")
@click.argument("path", type=click.Path(path_type=Path))
@click.option("--web", is_flag=True, help="Serve the viewer to a browser on this machine instead of a window.")
@click.option(
    "--picture",
    type=NonEmptyPath(),
    default=None,
    metavar="FILE.png|FOLDER",
    help="Draw the window as it opens to FILE.png, or every view to a picture of its own in FOLDER; no screen, no "
    "graphics card and no viewer are needed.",
)
@click.option(
    "--at",
    type=common.NumberWithUnit(),
    default=None,
    metavar="PLACE",
    help="With --picture: where the cursor is on the timeline [s, or its own numbers].  [default: in the middle]",
)
def command(path: Path, web: bool, picture: Path | None, at: float | None) -> None:
    """Open a folder in the rerun viewer, on the loopback address only: the layout is made for what is in it.

    PATH is the folder of a walk (gait), a bench run, a comparison, a diagnosis, a sweep, a tuning or a training, or an
    .rrd file. A recording that the folder lacks is made of its other files.

    A picture is drawn from the recording, in the layout that the viewer would show; it is no screenshot of the viewer,
    and 3-D is seen from the side.

    Needs the optional extra 'rerun' (pip install '.[rerun]' in the project's folder). Sends none of rerun's usage
    statistics and leaves rerun's own settings as they are; with --web, open the address printed here, which is told
    the same.

    \b
    Examples:
      klute-sim view runs/gait-001
      klute-sim view runs/diagnose-001 --web
      klute-sim view runs/gait-001 --picture walk.png --at 0.55
      klute-sim view runs/sweep-001 --picture pictures
    """
    from klute_sim.errors import InputError

    if picture is None:
        if at is not None:
            raise InputError("--at goes with --picture")
        from klute_sim.viewer.window import open_viewer

        open_viewer(path, web=web)
        return
    if web:
        raise InputError("--web and --picture exclude each other")
    from klute_sim.viewer.folders import ensure_recording
    from klute_sim.viewer.picture import picture as drawing

    with ensure_recording(path) as recording:
        for file in drawing.save_pictures(recording, picture, at):
            click.echo(file)
