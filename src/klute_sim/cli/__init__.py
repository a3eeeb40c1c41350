"""The command line: click options and calls of the public API.

``main`` is the entry point. Each module defines one command and imports what the command needs when it runs, so that
``--help`` does not load MuJoCo. ``common`` holds shared options, ``console`` the output, ``process`` the exit.
"""

import io
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NoReturn

import click

from klute_sim import __version__
from klute_sim.cli import process
from klute_sim.errors import InputError, KluteSimError, make_printable, suggest

HELP_SECTIONS = {
    "Simulate": {
        "gait": ("klute_sim.cli.gait", "Simulate gait with the prosthesis on the gait rig."),
        "walk": ("klute_sim.cli.walk", "Simulate a person who walks by muscles and reflexes."),
        "bench": (
            "klute_sim.cli.bench",
            "Simulate a tensile test of a device (forces, work, step responses), or a joint (bench joint).",
        ),
        "play": ("klute_sim.cli.play", "Watch and steer a simulation in a window, or write it as a video."),
        "sweep": (
            "klute_sim.cli.sweep",
            "Simulate every combination of devices, controllers, subjects, speeds and slopes.",
        ),
    },
    "Look at results": {
        "view": ("klute_sim.cli.view", "Open results in the rerun viewer, or draw them as pictures."),
        "compare": ("klute_sim.cli.compare", "Compare recordings over gait phase or time."),
        "export": ("klute_sim.cli.export", "Export motion and loads of a run as OpenSim, CSV or Parquet files."),
    },
    "Compare with measured data": {
        "diagnose": ("klute_sim.cli.diagnose", "Identify, from measured data, the effects that a device model lacks."),
        "effects": ("klute_sim.cli.effects", "List the physical effects beyond the base model, or show one."),
        "plan": ("klute_sim.cli.plan", "Plan bench measurements for a diagnosis: commands and files to record."),
        "import": ("klute_sim.cli.import_", "Create a gait reference or a dataset from motion-capture files."),
    },
    "Design and control": {
        "device": ("klute_sim.cli.device", "List the devices, or show the numbers, sources and forces of one."),
        "design": ("klute_sim.cli.design", "Size actuator, damper and tendon for a muscle or a body mass."),
        "tune": ("klute_sim.cli.tune", "Tune a pressure profile, and optionally the device, in simulated gait."),
        "train": ("klute_sim.cli.train", "Train a control policy and compare it with a baseline."),
        "baselines": ("klute_sim.cli.baselines", "Simulate passive feet and standard controllers for comparison."),
        "assess": ("klute_sim.cli.assess", "Assess whether a prosthesis serves a person, and where it falls short."),
    },
    "The dissertation": {
        "reproduce": ("klute_sim.cli.reproduce", "Compare the model with the dissertation's numbers and figures."),
        "assumptions": (
            "klute_sim.cli.assumptions",
            "List the assumed numbers of devices and their influence on the results.",
        ),
    },
}
"""Section of the help -> command -> module that defines it as ``command``, and one line of help."""
COMMANDS = {name: entry for section in HELP_SECTIONS.values() for name, entry in section.items()}
"""Module and line of help by the name of the command."""
JOINT_BENCHES = ("joint", "mass", "knee")
"""Words after ``bench`` that name a mechanism instead of a protocol of the tensile tester."""


@contextmanager
def _accept_broken_pipe() -> Iterator[None]:
    """Exit with code 0 when the reader of our output has seen enough; click would exit with code 1."""
    try:
        yield
    except BrokenPipeError:
        raise click.exceptions.Exit(0) from None


class _LazyGroup(click.Group):
    """A group that imports the module of a command only when that command is needed."""

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
        if args[0] == "bench" and len(args) > 1 and args[1] in JOINT_BENCHES:
            module = __import__("klute_sim.cli.bench_joint", fromlist=["command"])
            return f"bench {args[1]}", module.command, args[2:]
        if ctx.resilient_parsing or args[0] in COMMANDS or args[0].startswith("-"):
            return super().resolve_command(ctx, args)
        hint = suggest(args[0], COMMANDS, "run klute-sim --help for a list of all commands")
        raise InputError(f"there is no command '{args[0]}'; {hint}")

    def make_context(self, *args: Any, **options: Any) -> click.Context:
        with _accept_broken_pipe():  # of --help
            return super().make_context(*args, **options)

    def invoke(self, ctx: click.Context) -> Any:
        with _accept_broken_pipe():
            return super().invoke(ctx)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        width = max(map(len, COMMANDS))
        for title, commands in HELP_SECTIONS.items():
            with formatter.section(title):
                formatter.write_dl([(name.ljust(width), text) for name, (_, text) in commands.items()])


@click.group(cls=_LazyGroup, context_settings={"help_option_names": ["-h", "--help"]}, invoke_without_command=True)
@click.version_option(__version__, prog_name="klute-sim")
@click.pass_context
def group(context: click.Context) -> None:
    """Simulate a powered below-knee prosthesis with Klute's artificial muscle-tendon.

    \b
    Examples:
      klute-sim gait                     simulate gait with the default device
      klute-sim device klute-3-4-pair    show the numbers of a device
      klute-sim view runs/gait-001       open a run in the viewer
      klute-sim gait --help              show options and examples of a command
    """
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line; every user error ends in one sentence on stderr and exit code 2."""
    warnings.showwarning = _show_warning  # type: ignore[assignment]
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without our symbols still shows the numbers
    try:
        with process.raise_on_termination():
            code = group.main(args=arguments, prog_name="klute-sim", standalone_mode=False)
            if sys.stdout is not None:
                sys.stdout.flush()
    except click.ClickException as error:
        process.exit_process(2, error.format_message().replace("\n", " "))
    except KluteSimError as error:
        process.exit_process(2, str(error))
    except (KeyboardInterrupt, click.Abort) as interrupt:
        _exit_interrupted(interrupt.__cause__ or interrupt)  # click raises Abort from the KeyboardInterrupt
    except BrokenPipeError:  # while the rest of the output is flushed
        process.exit_process(0)
    except OSError as error:
        process.exit_process(2, f"a file or the output cannot be read or written: {error.strerror or error}")
    except Exception as error:
        cause = process.find_interrupt(error)
        if cause is not None:
            _exit_interrupted(cause)
        if not process.is_lack_of_memory(error):
            raise
        process.exit_process(2, "not enough memory; use fewer strides, a longer time step or fewer --jobs")
    process.exit_process(code if isinstance(code, int) else 0)


def _exit_interrupted(interrupt: BaseException) -> NoReturn:
    """Exit after ``interrupt``, with its notes, such as where the finished part is kept."""
    for note in getattr(interrupt, "__notes__", ()):
        click.echo(make_printable(note), err=True)
    process.exit_process(process.get_exit_code(interrupt), "interrupted; no file was left half-written")


def _show_warning(message: Warning | str, *_: object) -> None:
    """Print a warning as one sentence, without the line of source code that issued it."""
    click.echo(make_printable(f"klute-sim: {message}"), err=True)
