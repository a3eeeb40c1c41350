"""``klute-sim gait``."""

from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from klute_sim.cli import common, recorded_run
from klute_sim.cli.option_sections import Command, section


class AngleOrAuto(click.ParamType[float | None]):
    """An angle [deg], or ``auto``, which becomes None."""

    name = "angle"

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> float | None:
        """Return the angle [deg] or None."""
        if value == "auto":
            return None
        return float(common.NumberWithUnit("degrees").convert(value, param, ctx))


@click.command("gait", cls=Command)
@section("Model")
@common.DEVICE_OPTION
@click.option(
    "--controller",
    "controller_spec",
    default=None,
    metavar="SPEC",
    help="Pressure controller: profile (hand-tuned pressure over gait phase), off (no pressure), constant:BAR, "
    "machine (state machine that uses the sensors of the prosthesis), or a file with a profile (.csv), a state "
    "machine (.toml) or a trained policy (.npz).  [default: profile, or off with --spring-foot]",
)
@common.SPRING_FOOT_OPTION
@common.FOOT_OPTION
@click.option(
    "--align",
    "alignment",
    type=AngleOrAuto(),
    default="auto",
    show_default=True,
    metavar="auto|DEG",
    help="Angle by which the prosthesis is turned against the limb [deg], dorsiflexion positive. auto: that of the "
    "device file; without one, the hanging foot meets the ground as that of the reference does.",
)
@common.subject_options
@section("Simulation")
@click.option(
    "--learning-strides",
    type=click.IntRange(0, 100),
    default=40,
    show_default=True,
    metavar="N",
    help="Largest number of strides in which the rig learns the path of the hip before the run, until the foot carries "
    "the load of the reference; 0: the planned path.",
)
@click.option(
    "--hip-path",
    type=common.NonEmptyPath(),
    default=None,
    metavar="FOLDER",
    help="Gait run whose path of the hip is used again, so that two controllers walk on one path.  [default: learned]",
)
@common.strides_option("Number of strides")
@common.TIME_STEP_OPTION
@recorded_run.backend_option("the device model")
@section("Output")
@common.out_option("gait", "the run")
@recorded_run.CSV_OPTION
@click.option("--per-stride", is_flag=True, help="Also print the last five strides beside each other.")
@common.json_option()
def command(
    device_name: str,
    controller_spec: str | None,
    spring_foot: float | None,
    alignment: float | None,
    learning_strides: int,
    hip_path: Path | None,
    strides: int,
    step_ms: float,
    backend: str,
    out: Path | None,
    with_csv: bool,
    per_stride: bool,
    as_json: bool,
    **subject: Any,
) -> None:
    """Simulate gait with the prosthesis on the gait rig.

    The residual limb follows the motion of the reference. From stride to stride the rig learns the path of the hip with
    which the foot carries the load of the reference; the ground reaction is tracked, not predicted. Only the device,
    its passive parts and the ground move the ankle: ankle angle, net moment, power, work and centre of pressure are
    predictions.

    Writes recording.parquet, summary.json, index.html, figure.png, device.toml (not with --spring-foot) and, with
    the optional extra 'rerun', recording.rrd.

    \b
    Examples:
      klute-sim gait
      klute-sim gait --controller off --strides 3 --per-stride
      klute-sim gait --slope -5 --speed 1.0 --controller machine
      klute-sim gait --spring-foot 6
      klute-sim gait --foot dynamic-response-medium+shoe
      klute-sim gait --reference my-subject --align -4
      klute-sim gait --device my-device.toml --mass 82 --stature 1.80 --speed 1.3
      klute-sim gait --json | python -m json.tool
    """
    from klute_sim.api.gait import simulate_gait

    device_source = click.get_current_context().get_parameter_source("device_name")
    is_device_given = device_source is not ParameterSource.DEFAULT
    recorded_run.simulate_and_write(
        "gait",
        "simulating",
        lambda progress: simulate_gait(
            device_name if is_device_given else None,
            controller=controller_spec,
            strides=strides,
            time_step=1e-3 * step_ms,
            spring_foot=spring_foot,
            alignment=alignment,
            learning_strides=learning_strides,
            hip_path=hip_path,
            backend=backend,
            progress=progress,
            **subject,
        ),
        out=out,
        with_csv=with_csv,
        as_json=as_json,
        format_details=(lambda run: run.format_strides()) if per_stride else None,
    )
