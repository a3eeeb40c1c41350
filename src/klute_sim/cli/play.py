"""``klute-sim play``."""

import shlex
from pathlib import Path

import click

from klute_sim.cli import common, completion
from klute_sim.cli.common import NonEmptyPath
from klute_sim.cli.option_sections import Command, section


@click.command("play", cls=Command)
@click.argument("scene", default="gait", metavar="[gait|bench|walk]", shell_complete=completion.complete_scene)
@section("Model")
@common.DEVICE_OPTION
@section("Conditions")
@click.option(
    "--pressure",
    "pressure_bar",
    type=common.NumberWithUnit("bar"),
    default=None,
    metavar="BAR",
    help="Pressure on the tester, or what is added to the pressure of the controller in gait and walk [bar].  "
    "[default: half of the supply pressure; 0 in gait and walk]",
)
@click.option(
    "--speed",
    type=common.NumberWithUnit("m/s"),
    default=1.2,
    show_default=True,
    metavar="M/S",
    help="Walking speed on the gait rig [m/s].",
)
@common.slope_option("Ground slope of the gait rig [deg], uphill positive.")
@section("Output")
@click.option("--camera", default="side", show_default=True, help="Camera: side, corner or prosthesis_close.")
@click.option(
    "--video",
    type=NonEmptyPath(),
    default=None,
    metavar="FILE",
    help="Write a video (.gif, .webp or .mp4) instead of opening a window.",
)
@click.option(
    "--seconds",
    type=common.NumberWithUnit("s"),
    default=4.4,
    show_default=True,
    metavar="S",
    help="Duration of the video [s].",
)
@click.option(
    "--size",
    type=(click.IntRange(1), click.IntRange(1)),
    default=(640, 480),
    show_default=True,
    metavar="WIDTH HEIGHT",
    help="Size of the video [pixels].",
)
def command(
    scene: str,
    device_name: str,
    pressure_bar: float | None,
    speed: float,
    slope: float,
    camera: str,
    video: Path | None,
    seconds: float,
    size: tuple[int, int],
) -> None:
    """Watch and steer a simulation in a window, or write it as a video.

    gait is the gait rig with the hand-tuned pressure profile, bench the tester, walk a person who walks by muscles and
    reflexes. In the window, keys change pressure, speed and slope; they are listed there. A muscle is as thick as its
    braid, and the greener the higher its pressure; a tendon turns red under tension.

    Needs the optional extra 'rendering'; an .mp4 the extra 'video' too. A video needs no display. On macOS, the window
    needs mjpython: mjpython -m klute_sim play.

    \b
    Examples:
      klute-sim play
      klute-sim play walk --camera corner
      klute-sim play gait --speed 1.5 --slope 4 --video walk.gif
      klute-sim play bench --pressure 4 --video bench.mp4
    """
    from klute_sim.device.device import load_device
    from klute_sim.play.controls import Controls
    from klute_sim.play.session import PlaySession
    from klute_sim.rendering.graphics_context import find_context_module
    from klute_sim.rendering.video import check_video_path
    from klute_sim.rendering.window import check_window
    from klute_sim.units import BAR

    # What is missing is said before the simulation is built.
    if video is None:
        check_window("klute-sim play", f"write a video instead: {_format_video_command(scene)}")
    else:
        check_video_path(video)
        find_context_module("klute-sim play --video")
    device = load_device(device_name)
    max_pressure = device.parameters.supply.max_pressure / BAR
    if pressure_bar is None:
        pressure_bar = 0.5 * max_pressure if scene == "bench" else 0.0
    controls = Controls(
        scene=scene, max_pressure_bar=max_pressure, pressure_bar=pressure_bar, speed=speed, slope_deg=slope
    )
    session = PlaySession(device, controls)
    if video is None:
        from klute_sim.play.window_loop import play_in_window

        play_in_window(session, camera)
        return
    from klute_sim.cli.console import progress_bar, write_text
    from klute_sim.play.recording import record_video

    with progress_bar("drawing") as progress:
        record_video(session, video, seconds=seconds, camera=camera, size=size, progress=progress)
    write_text(f"{video}\n")


def _format_video_command(scene: str) -> str:
    """Return the command of the user as one that writes a video."""
    context = click.get_current_context()
    words = ["klute-sim", "play"]
    for parameter in context.command.params:
        name = parameter.name or ""
        if common.is_given(context, name):
            value = context.params[name]
            values = value if isinstance(value, tuple) else (value,)
            option = [parameter.opts[0]] if isinstance(parameter, click.Option) else []
            words += [*option, *(f"{v:g}" if isinstance(v, float) else str(v) for v in values)]
    return shlex.join([*words, "--video", f"{scene}.gif"])
