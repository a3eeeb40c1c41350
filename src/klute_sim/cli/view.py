"""``klute-sim view``."""

from pathlib import Path

import click

from klute_sim.cli import common
from klute_sim.cli.common import NonEmptyPath


@click.command("view")
@click.argument("path", type=click.Path(path_type=Path))
@click.option("--web", is_flag=True, help="Serve the viewer to a browser on this machine instead of opening a window.")
@click.option(
    "--picture",
    type=NonEmptyPath(),
    default=None,
    metavar="FILE.png|FOLDER",
    help="Draw the initial window of the viewer to FILE.png, or each of its views to a PNG file in FOLDER. This needs "
    "no screen, graphics card or viewer.",
)
@click.option(
    "--at",
    type=common.NumberWithUnit(),
    default=None,
    metavar="POSITION",
    help="With --picture: position of the cursor on the timeline, for gait [% of the gait cycle], otherwise [s] or the "
    "number of a step.  [default: the middle of what is shown]",
)
@click.option(
    "--video",
    type=NonEmptyPath(),
    default=None,
    metavar="FILE",
    help="Write a gait, walk or bench run as a video (.gif, .webp or .mp4), drawn by MuJoCo without a screen.",
)
@click.option("--camera", default=None, help="With --video: side, corner or prosthesis_close.  [default: side]")
@click.option(
    "--size",
    type=(click.IntRange(1), click.IntRange(1)),
    default=None,
    metavar="WIDTH HEIGHT",
    help="With --video: its size [pixels].  [default: 640 480]",
)
def command(
    path: Path,
    web: bool,
    picture: Path | None,
    at: float | None,
    video: Path | None,
    camera: str | None,
    size: tuple[int, int] | None,
) -> None:
    """Open results in the rerun viewer, with a layout for their kind.

    PATH is the folder of a gait run, a walk, a bench run, a comparison, a diagnosis, a sweep, a tuning or a training,
    or an .rrd file. If the recording is missing, it is created from the other files of the folder.

    --picture writes PNG files, drawn from the recording in the layout of the viewer. They are not screenshots, and 3-D
    scenes are drawn from the side. --video plays gait and walks in real time, and up to eight trials of a bench run
    one after the other, each for at most 10 s. It needs the extra 'rendering' instead, and an .mp4 the extra 'video'
    too.

    The viewer listens on the loopback address only and sends no usage statistics; the settings of rerun stay as they
    are. With --web, open the printed address in a browser. Needs the optional extra 'rerun' (pip install '.[rerun]' in
    the project folder).

    \b
    Examples:
      klute-sim view runs/gait-001
      klute-sim view runs/diagnose-001 --web
      klute-sim view runs/gait-001 --picture gait.png --at 50
      klute-sim view runs/sweep-001 --picture pictures
      klute-sim view runs/gait-001 --video gait.mp4
    """
    from klute_sim.errors import InputError

    chosen = [name for name, value in {"--web": web, "--picture": picture, "--video": video}.items() if value]
    if len(chosen) > 1:
        raise InputError(f"{' and '.join(chosen)} exclude each other")
    if at is not None and picture is None:
        raise InputError("--at sets the cursor of a picture: add --picture")
    if (camera is not None or size is not None) and video is None:
        raise InputError("--camera and --size are those of a video: add --video")
    if video is not None:
        _write_video(path, video, camera or "side", size or (640, 480))
    elif picture is not None:
        _draw_pictures(path, picture, at)
    else:
        from klute_sim.viewer.window import open_viewer

        open_viewer(path, web=web)


def _draw_pictures(path: Path, picture: Path, at: float | None) -> None:
    from klute_sim.cli.console import write_text
    from klute_sim.viewer.folders import ensure_recording
    from klute_sim.viewer.picture.picture import save_pictures

    with ensure_recording(path) as rrd_path:
        for file in save_pictures(rrd_path, picture, at):
            write_text(f"{file}\n")


def _write_video(path: Path, video: Path, camera: str, size: tuple[int, int]) -> None:
    from klute_sim.cli.console import progress_bar, write_text
    from klute_sim.viewer.video import save_video

    with progress_bar("drawing") as progress:
        save_video(path, video, camera=camera, size=size, progress=progress)
    write_text(f"{video}\n")
