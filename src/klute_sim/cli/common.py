"""Parameter types and options that several commands share."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from klute_sim.cli import completion
from klute_sim.cli.option_sections import section
from klute_sim.errors import InputError


class NonEmptyPath(click.Path):
    """A path; the empty string, as from an unset shell variable, is refused instead of naming the current folder."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Return ``value`` as a path."""
        if not str(value):
            self.fail("the path is empty", param, ctx)
        return Path(str(value))


class NumberWithUnit(click.types.FloatParamType):
    """A number; the error for anything else names the unit."""

    def __init__(self, unit: str = "") -> None:
        """Expect a number in ``unit``; an empty string means a pure number."""
        self.unit = unit

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return ``value`` as a number."""
        try:
            return float(value)
        except ValueError:
            hint = f"; write the number alone, in {self.unit}" if self.unit else ""
            self.fail(f"'{value}' is not a number{hint}", param, ctx)


DEFAULT_DEVICE_NAME, DEFAULT_CONTROLLER = "klute-1-1-4-pair", "profile"
"""Device and controller where the user names none."""
Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]

DEVICE_OPTION = click.option(
    "--device",
    "device_name",
    shell_complete=completion.complete_device,
    default=DEFAULT_DEVICE_NAME,
    show_default=True,
    metavar="NAME|FILE",
    help="Device: name of a preset, or a device file.",
)
USER_DEVICES_OPTION = click.option(
    "--device",
    "devices",
    shell_complete=completion.complete_device,
    multiple=True,
    metavar="NAME|FILE",
    help="Your own device: a device file, or the name of a preset; may be repeated.  [default: klute-1-1-4-pair]",
)
USER_CONTROLLERS_OPTION = click.option(
    "--controller",
    "controllers",
    multiple=True,
    metavar="SPEC",
    help="Your own controller, as in 'klute-sim gait'; may be repeated.  [default: profile, if there is a --device]",
)
FOOT_HELP = (
    "Prosthetic foot below the ankle: rigid, dynamic-response-low, dynamic-response-medium, dynamic-response-high or "
    "sach, each also in a shoe, such as sach+shoe (docs/devices.md)"
)
FOOT_OPTION = click.option(
    "--foot", default=None, metavar="NAME", help=f"{FOOT_HELP}.  [default: that of the device, or rigid]"
)
TIME_STEP_OPTION = click.option(
    "--step",
    "step_ms",
    type=NumberWithUnit("ms"),
    default=0.5,
    show_default=True,
    metavar="MS",
    help="Time step [ms].",
)


def _reject_height(context: click.Context, option: click.Parameter, value: str | None) -> None:
    if value is not None:
        raise click.UsageError("there is no option --height; the option for body height is --stature")


REJECT_HEIGHT_OPTION = click.option("--height", hidden=True, expose_value=False, callback=_reject_height)
"""Hidden option that points users who look for ``--height`` to ``--stature``."""
ACCEPT_OPTION = click.option(
    "--accept",
    multiple=True,
    metavar="NAME",
    help="Accept an implausible property of the files that is right: the NAME that the error prints; may be repeated.  "
    "[default: none]",
)
REFERENCE_OPTION = click.option(
    "--reference",
    type=NonEmptyPath(),
    default=None,
    metavar="FILE|FOLDER",
    help="Reference gait: a folder from klute-sim import, or a CSV file (docs/gait.md).  [default: able-bodied adults]",
)
STRIDE_TIME_OPTION = click.option(
    "--stride-time",
    type=NumberWithUnit("s"),
    default=None,
    metavar="S",
    help="Stride time of --reference [s].  [default: the value in its folder, or 1.1]",
)
STATURE_OPTION = click.option(
    "--stature",
    type=NumberWithUnit("m"),
    default=None,
    metavar="M",
    help="Stature [m].  [default: the value in the folder of --reference, or 1.75]",
)
SPEED_OPTION = click.option(
    "--speed",
    type=NumberWithUnit("m/s"),
    default=None,
    metavar="M/S",
    help="Walking speed [m/s]; a faster gait has a shorter stride time.  [default: computed from reference and leg "
    "length]",
)


SPRING_FOOT_OPTION = click.option(
    "--spring-foot",
    type=NumberWithUnit("N·m/deg"),
    default=None,
    metavar="STIFFNESS",
    help="Stiffness [N·m/deg] of a passive foot, which replaces --device; prosthetic feet have 3 to 15.  [default: no "
    "passive foot]",
)


def mass_option(default: str = "the value in the folder of --reference, or 75") -> Decorator:
    """Return ``--mass`` with a description of its default."""
    return click.option(
        "--mass", type=NumberWithUnit("kg"), default=None, metavar="KG", help=f"Body mass [kg].  [default: {default}]"
    )


def slope_option(
    help_text: str = "Ground slope [deg], uphill positive; limb kinematics on slopes are assumed.",
    default: float | None = 0.0,
) -> Decorator:
    """Return ``--slope``; with ``default`` None the command can tell whether the option was given."""
    return click.option(
        "--slope",
        type=NumberWithUnit("degrees"),
        default=default,
        show_default=default is not None,
        metavar="DEG",
        help=help_text,
    )


def subject_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of a subject, its speed and the slope, under the keywords of the public API."""
    options = (
        section("Subject"),
        REFERENCE_OPTION,
        STRIDE_TIME_OPTION,
        ACCEPT_OPTION,
        mass_option(),
        STATURE_OPTION,
        REJECT_HEIGHT_OPTION,
        section("Conditions"),
        SPEED_OPTION,
        slope_option(),
    )
    for option in reversed(options):
        function = option(function)
    return function


CATALOGUE_OPTION = click.option(
    "--catalogue",
    type=NonEmptyPath(),
    default=None,
    metavar="FILE",
    help="Python file that registers your own effects. Its code is executed: use only files that you trust.  "
    "[default: the file that the variable KLUTE_SIM_CATALOGUE names]",
)


def pair_devices_with_controllers(devices: tuple[str, ...], controllers: tuple[str, ...]) -> list[tuple[str, str]]:
    """Return the n-th device with the n-th controller; one that stands alone belongs to all of the other kind.

    Raises InputError when their numbers do not go together.
    """
    if not devices and not controllers:
        return []
    chosen_devices, chosen_controllers = devices or (DEFAULT_DEVICE_NAME,), controllers or (DEFAULT_CONTROLLER,)
    count = max(len(chosen_devices), len(chosen_controllers))
    if {len(chosen_devices), len(chosen_controllers)} - {1, count}:
        raise InputError(
            f"--device is given {len(devices)} times and --controller {len(controllers)} times; allowed: equal "
            "numbers, or one of them once"
        )
    pairs = [items * (count // len(items)) for items in (chosen_devices, chosen_controllers)]
    return list(dict.fromkeys(zip(*pairs, strict=True)))


def out_option(kind: str, content: str) -> Decorator:
    """Return ``--out`` of a command that writes its folder at once; the default is the next ``runs/KIND-NNN``."""
    text = f"New or empty folder for {content}.  [default: runs/{kind}-NNN]"
    return click.option("--out", type=NonEmptyPath(), default=None, metavar="FOLDER", help=text)


def resumable_out_option(kind: str, content: str) -> Decorator:
    """Return ``--out`` of a command that stores results as they finish and can be resumed."""
    text = (
        f"Folder for {content}. After an interrupt, the same command with this folder resumes.  "
        f"[default: runs/{kind}-NNN]"
    )
    return click.option("--out", type=NonEmptyPath(), default=None, metavar="FOLDER", help=text)


def json_option(replaced_output: str = "the table") -> Decorator:
    """Return ``--json``."""
    return click.option("--json", "as_json", is_flag=True, help=f"Print one JSON object instead of {replaced_output}.")


def strides_option(help_text: str) -> Decorator:
    """Return ``--strides``."""
    return click.option("--strides", type=int, default=5, show_default=True, metavar="N", help=f"{help_text}.")


def check_rig_options(context: click.Context, rig: str, option_rigs: Mapping[str, Sequence[str]]) -> None:
    """Raise InputError when an option is given that ``rig`` does not take.

    ``option_rigs`` maps the names of parameters to the rigs that take them; every rig takes the others.
    """
    for parameter in context.command.params:
        rigs = option_rigs.get(parameter.name or "", (rig,))
        if rig not in rigs and is_given(context, parameter.name or ""):
            raise InputError(f"{parameter.opts[0]} belongs to --rig {' or '.join(rigs)}; leave it out with --rig {rig}")


def is_given(context: click.Context, name: str) -> bool:
    """Return whether the user has given the option of the parameter ``name``."""
    return context.get_parameter_source(name) is ParameterSource.COMMANDLINE


RIG_OPTION = click.option(
    "--rig",
    type=click.Choice(["gait", "walk", "joint"]),
    default="gait",
    show_default=True,
    help="Gait rig, which prescribes the motion of the limb; a predicted walk by muscles and reflexes; or a joint "
    "between two devices under PID control.",
)


class PushType(click.ParamType[tuple[float, float]]):
    """An impulse and a phase, such as ``10@40``."""

    name = "push"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, float]:
        """Return impulse [N*s] and phase [%]."""
        if isinstance(value, tuple):
            return value
        impulse, _, phase = str(value).partition("@")
        try:
            return float(impulse), float(phase or 0.0)
        except ValueError:
            self.fail(
                f"'{value}' is no push; write the impulse in N·s, @, and the phase in %, such as 10@40", param, ctx
            )


PUSHES_OPTION = click.option(
    "--push",
    "pushes",
    type=PushType(),
    multiple=True,
    metavar="NS@PCT",
    help="With --rig walk: push on the hip, as in 'klute-sim walk', in walks of its own; 0@0 is none; may be "
    "repeated.  [default: no push]",
)
WALKERS_OPTION = click.option(
    "--walker",
    "walkers",
    multiple=True,
    metavar="NAME|FILE",
    help="With --rig walk: walker, shipped or a file; may be repeated.  [default: all that have adapted to the "
    "prosthesis with the default state machine]",
)


def pressure_options(prefix: str = "") -> Decorator:
    """Return ``--mean`` and ``--difference`` of a joint's commands; ``prefix`` begins their help."""

    def add(name: str, default: float, help_text: str) -> Decorator:
        text = f"{prefix}{help_text[0].lower() if prefix else help_text[0]}{help_text[1:]}"
        number = NumberWithUnit("bar")
        return click.option(
            f"--{name}", f"{name}_bar", type=number, default=default, show_default=True, metavar="BAR", help=text
        )

    mean = add("mean", 2.5, "Mean pressure [bar].")
    difference = add("difference", 1.0, "Amplitude of the pressure difference [bar].")
    return lambda function: mean(difference(function))


def jobs_option(
    help_text: str = "Number of worker processes; 0: one per core.  [default: 0]", *, default: int | None = 0
) -> Decorator:
    """Return ``--jobs``; with ``default`` None the command can tell whether the option was given."""
    return click.option("--jobs", type=click.IntRange(0, 256), default=default, metavar="N", help=help_text)


def ray_option() -> Callable[[Any], Any]:
    """Return the option for a Ray cluster; ``ray_address`` is None without it."""
    return click.option(
        "--ray",
        "ray_address",
        is_flag=False,
        flag_value="auto",
        default=None,
        metavar="[ADDRESS|local]",
        help="Run on a Ray cluster: the cluster at ADDRESS, a new cluster on this machine (local), or the cluster that "
        "Ray detects (no value).  [default: no cluster]",
    )


def check_ray_options(ray_address: str | None, jobs: int | None) -> None:
    """Raise InputError when both a cluster and a number of jobs are given."""
    if ray_address is not None and jobs is not None:
        raise InputError("--jobs and --ray exclude each other: Ray uses all cores of the cluster")
