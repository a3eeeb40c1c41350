"""Diagnose a simulation with measured data: :func:`diagnose` and :func:`plan_measurements`, with their results."""

import json
from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from klute_sim.api.inputs import DeviceLike, to_device
from klute_sim.api.rendering import Printable, Summary
from klute_sim.api.saved_plan import SavedPlan
from klute_sim.datasets import dataset as datasets
from klute_sim.datasets.dataset import Dataset
from klute_sim.device.device import Device
from klute_sim.diagnosis.mechanism_files import build_mechanism_files
from klute_sim.diagnosis.planning import measurement_plan
from klute_sim.diagnosis.result import Diagnosis, DiagnosisOptions, Verdict
from klute_sim.diagnosis.transfer import predict_dataset
from klute_sim.diagnosis.transfer_prediction import TransferPrediction
from klute_sim.diagnosis.verdict import DEVICE_FILE_NAME, verdict_to_dict
from klute_sim.diagnosis.workflow import diagnose as run_diagnosis
from klute_sim.errors import InputError, MissingExtraError
from klute_sim.gait.replay.recording_mistakes import find_recording_mistakes
from klute_sim.plant.mjcf.model_export import write_files
from klute_sim.recording.run_folder import create_run_folder
from klute_sim.types import ProgressCallback

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from klute_sim.bench.protocols.identification import IdentificationProtocol, Program

RECORDING_FILE_NAME = "recording.rrd"
PREDICTIONS_FILE_NAME = "predictions.json"


@dataclass(frozen=True)
class ParameterEstimate:
    """Estimate of one parameter of an effect."""

    value: float
    """Estimate, in the unit of the parameter's key."""
    interval: tuple[float, float]
    """95 % confidence interval."""


@dataclass(frozen=True)
class IdentifiedEffect:
    """Effect that a diagnosis added to the device."""

    name: str
    """Name of the effect in the catalogue."""
    form: str
    """Form of the effect."""
    channel: str | None
    """Channel of an instrument effect; None for other effects."""
    number: str | None
    """Number that is wrong, as in ``verdict.json`` (``section.key`` of the device file); None for effects."""
    parameters: dict[str, ParameterEstimate]
    """Estimate of each parameter, by its key."""
    probability: float | None
    """Probability of the name, calibrated on the hidden-effect benchmark; None without repeats, or if data-driven."""
    tendon: str | None = None
    """Tendon of the only device of a mechanism that has the effect; None where all have it."""
    part: str | None = None
    """Joint or pulley of a mechanism that has the effect; None for other effects."""
    specimen: str | None = None
    """The only specimen whose number is wrong; None where it is wrong for all."""


@dataclass(frozen=True, repr=False)
class DiagnosisResult(Printable):
    """Result of :func:`diagnose`: the verdict, the added effects, and the device with these effects."""

    diagnosis: Diagnosis
    """Full result of the workflow: fits, noise, residuals and every step of the selection."""

    @property
    def verdict(self) -> Verdict:
        """Verdict: nothing-missing, identified, identified-in-part, indistinguishable, unexplained or
        insufficient-data."""
        return self.diagnosis.verdict

    @property
    def reasons(self) -> list[str]:
        """Sentences that explain the verdict."""
        return list(self.diagnosis.reasons)

    @property
    def effects(self) -> list[IdentifiedEffect]:
        """Added effects with their parameters."""
        return [
            IdentifiedEffect(
                name=entry["name"],
                form=entry["form"],
                channel=entry["channel"],
                number=entry.get("number"),
                parameters={
                    key: ParameterEstimate(float(estimate["value"]), (float(estimate["low"]), float(estimate["high"])))
                    for key, estimate in entry["parameters"].items()
                },
                probability=entry.get("probability"),
                tendon=entry.get("tendon"),
                part=entry.get("part"),
                specimen=entry.get("specimen"),
            )
            for entry in self.to_dict()["effects"]
        ]

    @property
    def device(self) -> Device:
        """Recommended device: with its refitted numbers, and with the added effects unless test trials refute them.

        It is the nominal device where the data were insufficient for a fit.
        """
        return self.diagnosis.fitted_device or self.diagnosis.dataset.device

    def predict(self, dataset: Dataset | str | Path, *, n_jobs: int = 0) -> TransferPrediction:
        """Return how well the device that was found predicts another ``dataset`` (or the folder of one).

        The other dataset declares its own device: its geometry. Fitted numbers keep their relative change, effects are
        added as found. ``n_jobs`` is the number of threads; 0: all cores. Raises InputError when nothing was fitted or
        the dataset does not suit.
        """
        other = dataset if isinstance(dataset, Dataset) else load_dataset(dataset)
        return predict_dataset(self.diagnosis, other, n_jobs)

    def to_dict(self) -> dict[str, Any]:
        """Return the content of verdict.json."""
        return verdict_to_dict(self.diagnosis)

    def format_summary(self) -> Summary:
        """Yield the verdict, its reasons, and tables of the added effects and of the residuals."""
        from klute_sim.report.diagnosis.table import iterate_summary

        return iterate_summary(self.diagnosis)

    def __repr__(self) -> str:
        """Return one line: verdict and added effects."""
        effects = ", ".join(str(term) for term in self.diagnosis.added_terms)
        return f"DiagnosisResult({self.verdict!r}{f', {effects}' if effects else ''})"

    def plot(self) -> "Figure":
        """Return the figure of the residuals of each channel before and after.

        Raises InputError when the data were insufficient and nothing was fitted.
        """
        if not self.diagnosis.channel_rms:
            raise InputError("the diagnosis fitted nothing, so it has no figure; see the reasons of the result")
        from klute_sim.report.diagnosis.figures import build_gap_figure

        return build_gap_figure(self.diagnosis)

    def save(
        self,
        folder: str | Path | None = None,
        predictions: Sequence[TransferPrediction] = (),
        *,
        report: bool = True,
    ) -> Path:
        """Write the files of ``klute-sim diagnose`` into ``folder``; return the folder.

        ``folder`` is new or empty; by default it is the next ``runs/diagnose-NNN``. ``predictions`` are results of
        :meth:`predict`, which the page shows as well. Without ``report``, only verdict.json, predictions.json and
        device.toml are written.
        """
        with create_run_folder("diagnose", folder) as (final_folder, scratch):
            self.write_files(scratch, predictions, report=report)
        return final_folder

    def write_files(self, folder: Path, predictions: Sequence[TransferPrediction] = (), *, report: bool = True) -> None:
        """Write all files into the existing ``folder``; see :meth:`save`."""
        diagnosis = self.diagnosis
        if diagnosis.fitted_device is not None:
            (folder / DEVICE_FILE_NAME).write_bytes(diagnosis.fitted_device.content)
        write_files(build_mechanism_files(diagnosis), folder)
        (folder / "verdict.json").write_text(
            json.dumps(verdict_to_dict(diagnosis, predictions), indent=2, allow_nan=False) + "\n", "utf-8"
        )
        if predictions:
            rows = [prediction.to_dict() for prediction in predictions]
            (folder / PREDICTIONS_FILE_NAME).write_text(json.dumps(rows, indent=2, allow_nan=False) + "\n", "utf-8")
        if not report:
            return
        from klute_sim.report.diagnosis.figures import save_figures
        from klute_sim.report.diagnosis.page import write_page
        from klute_sim.report.diagnosis.prediction import save_prediction_figures
        from klute_sim.viewer.layouts.diagnosis import write_recording

        if diagnosis.final_fit is not None:
            save_figures(diagnosis, folder)
            with suppress(MissingExtraError):  # `klute-sim view` reports the missing extra
                write_recording(diagnosis, folder / RECORDING_FILE_NAME)
        save_prediction_figures(predictions, folder)
        write_page(diagnosis, folder, predictions)


def load_dataset(folder: str | Path, device: DeviceLike | None = None, *, accept: Collection[str] = ()) -> Dataset:
    """Read and check the dataset in ``folder``, which holds dataset.toml and its trials.

    ``device`` (an object, the name of a preset or a path) replaces the device of the dataset. ``accept`` holds names of
    findings about implausible trials that are right nevertheless, as the error names them.

    Raises InputError when a file cannot be read or is not valid, or a trial is implausible.
    """
    replaced = None if device is None else to_device(device)
    return datasets.load_dataset(folder, replaced, accept, find_recording_mistakes)


def write_example_dataset(folder: str | Path) -> None:
    """Write the example dataset into ``folder``, unless the folder holds it already.

    Raises InputError when the folder holds something else.
    """
    content = _read_example()
    if all((Path(folder) / name).is_file() and (Path(folder) / name).read_bytes() == c for name, c in content.items()):
        return
    with create_run_folder("dataset", folder) as (_, scratch):
        for name, file_content in content.items():
            (scratch / name).write_bytes(file_content)


def load_example_dataset(folder: str | Path) -> Dataset:
    """Return the example dataset, written into ``folder`` unless the folder holds it already.

    Raises InputError when the folder holds something else.
    """
    write_example_dataset(folder)
    return load_dataset(folder)


def _read_example() -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in (resources.files("klute_sim.datasets") / "example").iterdir()}


def diagnose(
    dataset: Dataset | str | Path,
    *,
    device: DeviceLike | None = None,
    only: Sequence[str] = (),
    exclude: Sequence[str] = (),
    accept: Collection[str] = (),
    n_jobs: int = 0,
    seed: int = 0,
    progress: ProgressCallback | None = None,
) -> DiagnosisResult:
    """Identify the effects that the simulation of ``dataset`` lacks, and return the result.

    Args:
        dataset: Dataset, or the path of its folder.
        device: Device in place of the dataset's, with the path of a folder only. None: the device of the dataset.
        only: Names of the candidate effects. Empty: all of the catalogue.
        exclude: Names of effects that are not candidates.
        accept: Names of findings about implausible trials that are right nevertheless, with the path of a folder only.
        n_jobs: Number of threads. 0: all cores.
        seed: Random seed for multi-start fits.
        progress: Receives the completed fraction and the current stage.

    Raises InputError when the dataset or the name of an effect is not valid.
    """
    if isinstance(dataset, Dataset):
        if device is not None:
            raise InputError("give the device to load_dataset(folder, device), not to diagnose")
        if accept:
            raise InputError("give accept to load_dataset(folder, accept=...), not to diagnose")
        data = dataset
    else:
        data = load_dataset(dataset, device, accept=accept)
    options = DiagnosisOptions(only=tuple(only), exclude=tuple(exclude), n_jobs=n_jobs, seed=seed)
    return DiagnosisResult(run_diagnosis(data, options, progress or (lambda fraction, stage: None)))


@dataclass(frozen=True, repr=False)
class MeasurementPlan(SavedPlan):
    """Plan of measurements on a tensile tester: identification protocols for a device, and instructions."""

    device: Device
    """Device to measure."""
    protocols: "tuple[IdentificationProtocol, ...]"
    """Protocols in the order of recording."""
    programs: "tuple[Program, ...]"
    """Commands of each protocol, with the resolution of the command files."""
    n_repeats: int
    """Number of recordings of each protocol."""
    simulate: bool
    """Whether the plan contains simulated recordings."""

    def to_dict(self) -> dict[str, Any]:
        """Return device and protocols with their files, ready for JSON."""
        rows = zip(self.protocols, self.programs, measurement_plan.assign_uses(self.protocols), strict=True)
        return {
            "device": self.device.name,
            "simulated": self.simulate,
            "protocols": [
                {
                    "name": protocol.name,
                    "description": protocol.describe_for(self.device),
                    "reveals": protocol.list_revealed_effects(self.device),
                    "use": use,
                    "duration_s": float(program.time[-1]),
                    "command": f"{protocol.name}.csv",
                    "recordings": measurement_plan.list_repeat_files(protocol.name, self.n_repeats),
                }
                for protocol, program, use in rows
            ],
        }

    def format_summary(self) -> Summary:
        """Yield the table of the protocols."""
        from klute_sim.terminal_table import create_table

        table = create_table("protocol", "seconds", "use", "description")
        for row in self.to_dict()["protocols"]:
            use = row["use"] or "assigned later"
            table.add_row(row["name"], f"{row['duration_s']:.1f}", use, row["description"])
        yield table
        yield from self._describe_origin()

    def __repr__(self) -> str:
        """Return one line: device, number of protocols and repeats."""
        return f"MeasurementPlan({self.device.name!r}, {len(self.protocols)} protocols, {self.n_repeats} repeats)"

    def _write(self, folder: Path) -> None:
        measurement_plan.write_plan_files(
            self.device, self.protocols, self.programs, self.n_repeats, folder, simulate=self.simulate
        )


def plan_measurements(
    device: DeviceLike,
    *,
    only: Sequence[str] = (),
    n_repeats: int = measurement_plan.MIN_REPEATS,
    simulate: bool = False,
) -> MeasurementPlan:
    """Return a plan of the measurements that a diagnosis of ``device`` needs.

    Args:
        device: Device, name of a preset, or path of a device file.
        only: Names of the identification protocols. Empty: all that reveal something of the device.
        n_repeats: Number of recordings of each protocol; noise is measured from the differences between repeats.
        simulate: Whether to simulate the recordings, with noise, to test the diagnosis.

    Raises InputError when an input is not valid or the device cannot be tested.
    """
    measurement_plan.check_repeats(n_repeats)
    chosen_device = to_device(device)
    measurement_plan.check_has_plan(chosen_device)
    protocols = measurement_plan.select_protocols(only, chosen_device)
    programs = tuple(measurement_plan.round_program(p.build_program(chosen_device)) for p in protocols)
    return MeasurementPlan(chosen_device, tuple(protocols), programs, n_repeats, simulate)
