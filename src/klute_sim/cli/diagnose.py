"""``klute-sim diagnose``."""

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from klute_sim.cli import common, completion
from klute_sim.cli.common import NonEmptyPath
from klute_sim.cli.option_sections import Command, section

if TYPE_CHECKING:
    from klute_sim.api.diagnosis import DiagnosisResult
    from klute_sim.datasets.dataset import Dataset
    from klute_sim.diagnosis.transfer_prediction import TransferPrediction
    from klute_sim.types import ProgressCallback


@click.command("diagnose", cls=Command)
@click.argument("folder", metavar="FOLDER", type=NonEmptyPath())
@section("Input")
@click.option(
    "--example", is_flag=True, help="Write the example dataset into FOLDER unless it is there, and diagnose it."
)
@click.option(
    "--draft",
    is_flag=True,
    help="Write a draft of dataset.toml for the bench recordings in FOLDER, and stop. With --device; by default the "
    "device file in FOLDER.",
)
@common.ACCEPT_OPTION
@click.option(
    "--predict",
    "predicted_folders",
    multiple=True,
    metavar="FOLDER",
    type=NonEmptyPath(),
    help="Predict another dataset with the device that this diagnosis finds, without any fit to it; may be repeated.",
)
@section("Model")
@click.option(
    "--device",
    "device_name",
    shell_complete=completion.complete_device,
    default=None,
    metavar="NAME|FILE",
    help="Device: name of a preset, or a device file.  [default: the device of the dataset]",
)
@common.CATALOGUE_OPTION
@section("Fit")
@click.option(
    "--only",
    multiple=True,
    metavar="EFFECT",
    shell_complete=completion.complete_effect,
    help="Effect or number to test, also on one channel (sensor_gain@force); may be repeated.  [default: all]",
)
@click.option(
    "--exclude",
    multiple=True,
    metavar="EFFECT",
    shell_complete=completion.complete_effect,
    help="Effect or number not to test, also on one channel (sensor_gain@force); may be repeated.  [default: none]",
)
@click.option(
    "--tolerance",
    "tolerances",
    multiple=True,
    metavar="CHANNEL=AMOUNT",
    help='Misfit that does not matter, such as "force=5 N" or "force=2 %" of its range; may be repeated.  [default: '
    "that of the dataset, or none]",
)
@click.option(
    "--seed", type=click.IntRange(0), default=0, metavar="N", help="Random seed for multi-start fits.  [default: 0]"
)
@common.jobs_option("Number of threads; 0: one per core.  [default: 0]")
@section("Output")
@common.out_option("diagnose", "the results")
@click.option(
    "--no-report", is_flag=True, help="Write verdict and device files only, without page, figures and recording."
)
@click.option("--json", "as_json", is_flag=True, help="Print the verdict as one JSON object instead of text.")
def command(
    folder: Path,
    example: bool,
    draft: bool,
    device_name: str | None,
    only: tuple[str, ...],
    exclude: tuple[str, ...],
    tolerances: tuple[str, ...],
    predicted_folders: tuple[Path, ...],
    accept: tuple[str, ...],
    catalogue: Path | None,
    jobs: int,
    seed: int,
    out: Path | None,
    no_report: bool,
    as_json: bool,
) -> None:
    """Identify the effects that measured data show and the device model lacks, and add them to the device.

    FOLDER contains dataset.toml and the files of its trials: CSV, Parquet or MATLAB (docs/datasets.md). The verdict is
    one of: nothing-missing, identified, identified-in-part (the effects are found, but something remains),
    indistinguishable (several sets of effects explain the data), unexplained (no known effect explains the data),
    insufficient-data. Numbers of the device that may be wrong compete with the effects. The exit code is 0 for every
    verdict; 2 means that the input was not valid.

    Writes verdict.json, device.toml (the recommended device), index.html, figures, with --predict predictions.json
    and, with the optional extra 'rerun', a recording.

    \b
    Examples:
      klute-sim diagnose example-dataset --example
      klute-sim diagnose my-recordings --draft --device klute-3-4-pair
      klute-sim diagnose my-dataset
      klute-sim diagnose my-dataset --device runs/diagnose-001/device.toml
      klute-sim diagnose my-dataset --accept force-unit
      klute-sim diagnose my-dataset --tolerance "force=5 N"
      klute-sim diagnose my-dataset --predict other-muscles
      klute-sim diagnose my-dataset --only braid_hysteresis \\
        --only seal_friction --json
      klute-sim diagnose my-dataset --catalogue my_effects.py
    """
    from klute_sim.cli.console import stderr_console

    if draft:
        other_options = (
            example,
            only,
            exclude,
            tolerances,
            predicted_folders,
            accept,
            catalogue,
            jobs,
            seed,
            out,
            no_report,
        )
        _write_draft(folder, device_name, is_alone=not (any(other_options) or as_json))
        return
    if catalogue is not None:
        from klute_sim.cli.effects import load_catalogue

        load_catalogue(catalogue)

    from klute_sim.api.diagnosis import diagnose, load_dataset, write_example_dataset
    from klute_sim.api.rendering import print_summary
    from klute_sim.cli.console import stdout_console
    from klute_sim.datasets.dataset import replace_tolerances
    from klute_sim.diagnosis.transfer import check_predictable
    from klute_sim.recording.run_folder import create_run_folder
    from klute_sim.report.diagnosis.prediction import build_numbers_table, build_prediction_table

    if example:
        write_example_dataset(folder)
    dataset = load_dataset(folder, device_name, accept=accept)
    if tolerances:
        dataset = replace_tolerances(dataset, tolerances)
    predicted = [load_dataset(other, accept=accept) for other in predicted_folders]
    for other in predicted:  # before the diagnosis, which takes long
        check_predictable(dataset, other)
    for remark in (*dataset.remarks, *(remark for other in predicted for remark in other.remarks)):
        stderr_console().print(f"{remark}.", soft_wrap=True)
    with create_run_folder("diagnose", out) as (run_folder, scratch):
        try:
            with _show_status() as progress:
                result = diagnose(dataset, only=only, exclude=exclude, n_jobs=jobs, seed=seed, progress=progress)
        except KeyboardInterrupt:
            stderr_console().print("Finished fits are cached: the same command resumes the diagnosis.", soft_wrap=True)
            raise
        predictions = list(_predict(result, predicted, jobs))
        result.write_files(scratch, predictions, report=not no_report)
    if as_json:
        content = result.to_dict()
        if predictions:
            content["predictions"] = [prediction.to_dict() for prediction in predictions]
        click.echo(json.dumps(content, indent=2, allow_nan=False))
        return
    console = stdout_console()
    print_summary(console, result.format_summary())
    for prediction in predictions:
        console.print(build_prediction_table(prediction))
        for warning in prediction.warnings:
            console.print(warning, soft_wrap=True)
        console.print(build_numbers_table(prediction))
    console.print(f"Results: {run_folder}", soft_wrap=True)


def _predict(result: "DiagnosisResult", datasets: "Sequence[Dataset]", n_jobs: int) -> "Iterator[TransferPrediction]":
    """Yield the prediction of each of ``datasets``; where ``result`` cannot predict one, print the reason instead."""
    from klute_sim.cli.console import stderr_console
    from klute_sim.errors import InputError

    for dataset in datasets:
        try:
            yield result.predict(dataset, n_jobs=n_jobs)
        except InputError as error:
            stderr_console().print(f"no prediction of {dataset.folder}: {error}.", soft_wrap=True)


def _write_draft(folder: Path, device_name: str | None, *, is_alone: bool) -> None:
    """Write the draft of dataset.toml; print what was assumed, and what a first reading of the dataset finds."""
    from klute_sim.api.dataset_draft import draft_dataset
    from klute_sim.api.diagnosis import load_dataset
    from klute_sim.cli.console import stdout_console
    from klute_sim.errors import InputError

    if not is_alone:
        raise InputError("--draft writes dataset.toml and diagnoses nothing; pass no other option than --device")
    written = draft_dataset(folder, device_name)
    console = stdout_console()
    console.print(written.text, markup=False, highlight=False, soft_wrap=True)
    for remark in written.remarks:
        console.print(f"- {remark}", markup=False, highlight=False, soft_wrap=True)
    groups = "1 group" if written.n_groups == 1 else f"{written.n_groups} groups"
    trials = "1 trial" if written.n_trials == 1 else f"{written.n_trials} trials in {groups}"
    console.print(f"Draft: {written.path}, {trials}", soft_wrap=True)
    if not written.is_complete:
        console.print(f"Complete what is to do, then: klute-sim diagnose {folder}", soft_wrap=True)
        return
    try:
        load_dataset(folder)
    except InputError as error:
        console.print(f"It cannot be diagnosed yet: {error}", markup=False, highlight=False, soft_wrap=True)
    else:
        console.print(f"It can be read. Check it, then: klute-sim diagnose {folder}", soft_wrap=True)


@contextmanager
def _show_status() -> "Iterator[ProgressCallback]":
    """Yield a progress callback that shows the current stage on a terminal, or logs it."""
    from klute_sim.cli.console import ProgressLog, stderr_console

    if not stderr_console().is_terminal:
        yield ProgressLog()
        return
    with stderr_console().status("reading") as status:
        yield lambda fraction, stage: status.update(stage)
