"""``klute-sim diagnose``."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from klute_sim.cli import common
from klute_sim.cli.nonempty_path import NonEmptyPath

if TYPE_CHECKING:
    from klute_sim.diagnosis.workflow import Diagnosis


RECORDING_FILE = "recording.rrd"


@click.command("diagnose")
@click.argument("folder", metavar="FOLDER", type=NonEmptyPath())
@click.option("--example", is_flag=True, help="First write the example dataset that comes along into FOLDER (new).")
@click.option("--device", "device_file", default=None, metavar="NAME|FILE", help="Instead of the dataset's device.")
@click.option("--only", multiple=True, metavar="EFFECT", help="Look for this effect only; may be repeated.")
@click.option("--exclude", multiple=True, metavar="EFFECT", help="Do not look for this effect; may be repeated.")
@common.CATALOGUE_OPTION
@common.jobs_option("Threads.  [default: 0, all cores]")
@click.option(
    "--seed", type=click.IntRange(0), default=0, metavar="N", help="Of where fits are tried again from.  [default: 0]"
)
@common.out_option("diagnose", "the results")
@click.option("--no-report", is_flag=True, help="Write verdict.json and device.toml only: no page, plots, recording.")
@click.option("--json", "as_json", is_flag=True, help="Print the verdict as one JSON object instead of words.")
def command(
    folder: Path,
    example: bool,
    device_file: str | None,
    only: tuple[str, ...],
    exclude: tuple[str, ...],
    catalogue: Path | None,
    jobs: int,
    seed: int,
    out: Path | None,
    no_report: bool,
    as_json: bool,
) -> None:
    """Find what the simulation of a measured dataset lacks: name it, add it, show the gap before and after.

    FOLDER holds dataset.toml and the trials it names. The verdict is one of: nothing-missing, named, ambiguous
    (these cannot be told apart), unexplained (no known effect explains it), insufficient-data. Whichever it is, the
    command ends with exit code 0; 2 means that it could not get that far.

    \b
    Examples:
      klute-sim diagnose example-dataset --example
      klute-sim diagnose my-dataset
      klute-sim diagnose my-dataset --device runs/diagnose-001/device.toml
      klute-sim diagnose my-dataset --only braid_hysteresis --only seal_friction --json
      klute-sim diagnose my-dataset --catalogue my_effects.py
    """
    from klute_sim.cli.console import stderr_console

    if catalogue is not None:
        from klute_sim.effects import catalogue as known

        known.use_catalogue(catalogue)
        stderr_console().print(f"{catalogue} was run for its effects.")

    from klute_sim.datasets import dataset
    from klute_sim.device.device import load_device
    from klute_sim.diagnosis.verdict import verdict_to_dict as verdict_of
    from klute_sim.diagnosis.workflow import DiagnosisOptions, diagnose
    from klute_sim.recording import run_folder

    if example:
        _write_example(folder)
    options = DiagnosisOptions(only=only, exclude=exclude, n_jobs=jobs, seed=seed)
    measured = dataset.load_dataset(folder, load_device(device_file) if device_file is not None else None)
    for remark in measured.remarks:
        stderr_console().print(f"{remark}.", soft_wrap=True)
    with run_folder.create_run_folder("diagnose", out) as (place, scratch):
        try:
            with _show_status() as told:
                found = diagnose(measured, options, told)
        except KeyboardInterrupt:
            stderr_console().print(
                "What has been fitted is kept: the same command goes on where it was.", soft_wrap=True
            )
            raise
        write_results(found, scratch, report=not no_report)
    if as_json:
        click.echo(json.dumps(verdict_of(found), indent=2))
    else:
        _print(found, place)


def _write_example(folder: Path) -> None:
    from importlib import resources

    from klute_sim.errors import InputError
    from klute_sim.recording import run_folder

    content = {f.name: f.read_bytes() for f in (resources.files("klute_sim.datasets") / "example").iterdir()}
    if all((folder / name).is_file() and (folder / name).read_bytes() == own for name, own in content.items()):
        raise InputError(f"the example dataset is in {folder} already: leave out --example")
    with run_folder.create_run_folder("dataset", folder) as (_, scratch):
        for name, own in content.items():
            (scratch / name).write_bytes(own)


@contextmanager
def _show_status() -> "Iterator[Callable[[str], None]]":
    """Says on a terminal what is being done."""
    from klute_sim.cli.console import stderr_console

    if not stderr_console().is_terminal:
        yield lambda sentence: None
        return
    with stderr_console().status("reading") as status:
        yield status.update


def write_results(diagnosis: "Diagnosis", scratch: Path, *, report: bool) -> None:
    """All results of ``found`` into the folder ``scratch``; page, plots and recording with ``report``."""
    from klute_sim.diagnosis.device_file import augment_device
    from klute_sim.diagnosis.verdict import DEVICE_FILE_NAME, verdict_to_dict
    from klute_sim.errors import InputError

    if diagnosis.added_terms and diagnosis.final_fit is not None:
        try:
            device = augment_device(diagnosis.final_fit, diagnosis.dataset.folder.resolve().name)
        except InputError as error:
            diagnosis.reasons.append(f"The device as fitted cannot be one, and no file of it was written: {error}.")
            diagnosis.device_is_representable = False
        else:
            (scratch / DEVICE_FILE_NAME).write_bytes(device.content)
    (scratch / "verdict.json").write_text(json.dumps(verdict_to_dict(diagnosis), indent=2) + "\n", "utf-8")
    if not report:
        return
    from klute_sim.errors import MissingExtraError
    from klute_sim.report.diagnosis import figures as diagnosis_figures
    from klute_sim.report.diagnosis import page as diagnosis_page
    from klute_sim.viewer.layouts import diagnosis as workbench

    recording = ""
    if diagnosis.final_fit is not None:
        diagnosis_figures.save_figures(diagnosis, scratch)
        with suppress(MissingExtraError):  # said where it is needed, by `klute-sim view`
            workbench.write_recording(diagnosis, scratch / RECORDING_FILE)
            recording = RECORDING_FILE
    diagnosis_page.write_page(diagnosis, scratch / "report.html", recording)


def _print(diagnosis: "Diagnosis", folder: "Path") -> None:
    from rich.table import Table

    from klute_sim.cli.console import stdout_console
    from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS
    from klute_sim.diagnosis.selection.sparse_regression import format_formula
    from klute_sim.report.diagnosis import text as words

    out = stdout_console()
    out.print(words.describe_verdict(diagnosis), style="bold", soft_wrap=True)
    for reason in filter(None, [*diagnosis.reasons, words.describe_equation_residuals(diagnosis)]):
        out.print(f"  {reason}", soft_wrap=True)
    if diagnosis.added_terms and diagnosis.final_fit is not None:
        effects = Table("effect", "parameter", "value", "95 % interval", "unit", title="What was added")
        rows: list[Any] = list(
            zip(
                diagnosis.final_fit.hypothesis.parameters,
                diagnosis.final_fit.values,
                diagnosis.confidence_intervals,
                strict=True,
            )
        )
        for number, term in enumerate(diagnosis.final_fit.hypothesis.terms):
            for unknown, value, interval in rows:
                if unknown.term == number:
                    told, low, high = words.format_interval(value, *interval)
                    unit = words.format_parameter_name(unknown, term.channel)[1]
                    effects.add_row(str(term), unknown.key, told, f"{low} to {high}", unit or "-")
        out.print(effects)
        if format_formula(diagnosis.final_fit):
            out.print(f"Data-driven term: {format_formula(diagnosis.final_fit)}", soft_wrap=True)
    if diagnosis.channel_rms:
        on = "trials that no fit saw" if diagnosis.evaluated_on == "show" else "fitted trials: none was kept back"
        gaps = Table(
            "channel", "unit", "nominal", "refitted", "with effects", "repeats differ by", title=f"Gap on {on}"
        )
        for channel, gap in diagnosis.channel_rms.items():
            unit, size = CHANNEL_UNITS[channel]
            shown = [f"{value / size:.3g}" for value in (gap.nominal, gap.refitted, gap.with_effects)]
            floor = "not repeated" if gap.noise_floor is None else f"{gap.noise_floor / size:.3g}"
            gaps.add_row(channel, unit, *shown[:2], shown[2] if diagnosis.added_terms else "-", floor)
        out.print(gaps)
    if diagnosis.next_experiment:
        out.print(f"Next: {diagnosis.next_experiment['sentence']}", soft_wrap=True)
    split = diagnosis.split
    counts = f"{len(split.fit)} fitted, {len(split.validation)} to choose by, {len(split.test)} kept back to show"
    out.print(f"Trials: {counts}; {split.description}.", soft_wrap=True)
    out.print(f"Results: {folder}", soft_wrap=True)
