"""The command line: thin, and quick to say what it can do.

Commands import what they need when they run, so that ``--help`` does not wait for MuJoCo.
"""

import io
import signal
import sys
import warnings
from collections.abc import Sequence

import click

from klute_sim import __version__
from klute_sim.errors import InputError, KluteSimError, suggest

COMMANDS = {
    "gait": ("klute_sim.cli.gait", "Walk the prosthesis on measured human gait."),
    "sweep": ("klute_sim.cli.sweep", "Walk every combination of devices, controllers, speeds, slopes, masses."),
    "bench": ("klute_sim.cli.bench", "Run tests of a tensile tester on a device: forces, work, responses."),
    "reproduce": ("klute_sim.cli.reproduce", "Lay the dissertation's numbers and figures beside ours, item by item."),
    "design": ("klute_sim.cli.design", "Size actuator, damper and tendon for a muscle or a walker."),
    "assumptions": ("klute_sim.cli.assumptions", "List every assumed number, why, and what it changes."),
    "device": ("klute_sim.cli.device", "List devices, or show one: numbers, sources, forces."),
    "diagnose": ("klute_sim.cli.diagnose", "Find what the simulation of measured data lacks."),
    "effects": ("klute_sim.cli.effects", "List physical effects the base model leaves out, or show one."),
    "import": ("klute_sim.cli.import_", "Make a reference of a motion laboratory's files: C3D, OpenSim, CSV, Parquet."),
    "export": ("klute_sim.cli.export", "Write a run's motion and loads as OpenSim, CSV or Parquet files."),
    "measure": ("klute_sim.cli.plan", "Plan bench measurements: commands, files to fill, what to record."),
    "tune": ("klute_sim.cli.tune", "Tune a pressure profile, or device and profile together, on the gait rig."),
    "train": ("klute_sim.cli.train", "Train a policy to walk, and compare it with the hand-tuned profile."),
    "baselines": ("klute_sim.cli.baselines", "Walk what a new controller or device is held against."),
    "compare": ("klute_sim.cli.compare", "Compare recordings over phase or time: how much they differ, and where."),
    "view": ("klute_sim.cli.view", "Open a folder in the rerun viewer, or draw it."),
}
"""Name -> (module that defines it as ``command``, one line of help)."""


class _LazyGroup(click.Group):
    """Imports a command's module only when that command is asked for."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        module = __import__(COMMANDS[cmd_name][0], fromlist=["command"])
        command: click.Command = module.command
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if ctx.resilient_parsing or args[0] in COMMANDS or args[0].startswith("-"):
            return super().resolve_command(ctx, args)
        raise InputError(
            f"there is no command '{args[0]}'; {suggest(args[0], COMMANDS, 'all are in klute-sim --help')}"
        )

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, text) in COMMANDS.items()])


@click.group(cls=_LazyGroup, context_settings={"help_option_names": ["-h", "--help"]}, invoke_without_command=True)
@click.version_option(__version__, prog_name="klute-sim")
@click.pass_context
def group(context: click.Context) -> None:
    """Simulate a powered below-knee prosthesis with Klute's artificial muscle-tendon.

    \b
    Examples:
      klute-sim gait                     five strides of the default prosthesis
      klute-sim device klute-3-4-pair    what a device is made of, and what is assumed
      klute-sim view runs/gait-001       scrub through a run
    """
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point: anything the user can do wrong ends in one sentence on stderr and exit code 2."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # so that what was begun is cleaned up
    warnings.showwarning = _show_warning  # type: ignore[assignment]
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without our symbols still gets the numbers
    try:
        code = group.main(args=arguments, prog_name="klute-sim", standalone_mode=False)
    except click.ClickException as error:
        _exit_with_error(error.format_message().replace("\n", " "), 2)
    except KluteSimError as error:
        _exit_with_error(str(error), 2)
    except (KeyboardInterrupt, click.Abort):
        _exit_with_error("interrupted; no file was left half-written", 130)
    except MemoryError:
        _exit_with_error("there is not enough memory for this; take fewer strides or a longer step", 2)
    except BrokenPipeError:
        sys.stderr.close()  # the reader of our output has gone; Python would complain while closing stdout
        sys.exit(0)
    except OSError as error:
        _exit_with_error(f"a file or the output cannot be read or written: {error.strerror}", 2)
    sys.exit(code if isinstance(code, int) else 0)


def _show_warning(message: Warning | str, *_: object) -> None:
    """A warning as one sentence, without the place in our source that gave it."""
    click.echo(f"klute-sim: {message}", err=True)


def _exit_with_error(message: str, exit_code: int) -> None:
    click.echo(f"klute-sim: {message}", err=True)
    sys.exit(exit_code)
