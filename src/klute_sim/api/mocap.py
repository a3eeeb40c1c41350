"""Import motion-capture data and export runs: :func:`import_gait`, :func:`import_dataset`, :func:`export_run`."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from klute_sim.api.optional import import_pandas
from klute_sim.api.rendering import Printable, Summary
from klute_sim.errors import InputError
from klute_sim.gait.reference import Reference
from klute_sim.mocap import dataset_import, export, reference_folder, reference_import
from klute_sim.mocap.dataset_import import DatasetOptions, ImportedDataset
from klute_sim.mocap.options import LOAD_CUTOFF_HZ, MOTION_CUTOFF_HZ, ImportOptions
from klute_sim.mocap.parsing import mapping as mapping_file
from klute_sim.mocap.parsing.channel_names import Side
from klute_sim.mocap.parsing.sources import FILE_SUFFIXES
from klute_sim.mocap.reference_import import ImportedReference
from klute_sim.recording.recording import Recording
from klute_sim.recording.run_folder import create_run_folder
from klute_sim.types import ProgressCallback

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

DEFAULT_EXPORT_FORMATS = ("mot", "sto")
"""Formats that :func:`export_run` writes by default."""
FilesLike: TypeAlias = str | Path | Sequence[str | Path]
"""One file, a folder of files, or a sequence of files."""
AnkleZero = Literal["foot-flat", "file"]
"""Zero of the ankle angle: the flat foot in mid-stance, or the zero of the file."""


@dataclass(frozen=True, repr=False)
class GaitImport(Printable):
    """Imported gait: the mean stride as a reference, all strides, and the log of the import."""

    imported: ImportedReference
    """Reference, strides and log."""

    @property
    def reference(self) -> Reference:
        """Reference gait for ``simulate_gait(reference=...)``."""
        from klute_sim.gait.reference import parse_reference

        gait = parse_reference(
            self.imported.to_csv(), "imported gait", self.imported.stride_time, self.imported.options.accept
        )
        return replace(gait, mass=self.imported.mass, stature=self.imported.options.stature)

    @property
    def summary(self) -> dict[str, Any]:
        """Content of import.json."""
        return reference_folder.summarize(self.imported)

    def format_summary(self, *, verbose: bool = False) -> Summary:
        """Yield the mean stride, warnings and missing data, and the origin of every channel."""
        yield _describe_strides(self.imported)
        yield from _format_log(self.summary, verbose=verbose)

    def __repr__(self) -> str:
        """Return one line: strides, side and stride time."""
        imported = self.imported
        n_strides = len(imported.strides[imported.side])
        return f"GaitImport({n_strides} strides, {imported.side}, {imported.stride_time:.3f} s)"

    def plot(self) -> "Figure":
        """Return the figure of the mean stride with the standard deviation between strides."""
        from klute_sim.api.comparison import compare
        from klute_sim.mocap.strides.strides import to_recording

        imported = self.imported
        return compare({imported.side: to_recording(imported.strides[imported.side], imported.side)}).plot()

    def to_pandas(self) -> "pd.DataFrame":
        """Return the columns of reference.csv; raises MissingExtraError without pandas."""
        pandas = import_pandas("GaitImport.to_pandas")
        frame: pd.DataFrame = pandas.DataFrame(self.imported.table)
        return frame

    def save(self, folder: str | Path | None = None) -> Path:
        """Write the files of ``klute-sim import`` into ``folder`` (new or empty; default: ``runs/import-NNN``)."""
        with create_run_folder("import", folder) as (final_folder, scratch):
            self.write_files(scratch)
        return final_folder

    def write_files(self, scratch: Path) -> dict[str, Any]:
        """Write all files into ``scratch``; return the content of import.json."""
        return reference_folder.write_reference(self.imported, scratch)


@dataclass(frozen=True, repr=False)
class DatasetImport(Printable):
    """Imported gait trials with a prosthesis, and the log of the import."""

    imported: ImportedDataset
    """Trials, groups of repeats, and log."""

    def format_summary(self, summary: Mapping[str, Any] | None = None, *, verbose: bool = False) -> Summary:
        """Yield warnings and missing data, the origin of every channel, and the trials.

        ``summary`` is the content of import.json if the dataset was written; it adds the use of the trials.
        """
        from klute_sim.report.mocap.table import build_trials_table

        content = dataset_import.summarize(self.imported) if summary is None else summary
        yield from _format_log(content, verbose=verbose)
        yield build_trials_table(content)
        if "split" in content:
            split = content["split"]
            uses = ", ".join(f"{len(split[use])} for {use}" for use in ("fit", "validation", "test"))
            yield f"Use: {uses}; {split['description']}."

    def __repr__(self) -> str:
        """Return one line: trials, conditions and device."""
        imported = self.imported
        n_conditions = len(set(imported.groups))
        return f"DatasetImport({len(imported.trials)} trials, {n_conditions} conditions, {imported.device.name!r})"

    def save(self, folder: str | Path | None = None) -> Path:
        """Write the dataset into ``folder`` (new or empty; default: ``runs/import-NNN``).

        Returns the folder, which :func:`klute_sim.load_dataset` reads.
        """
        with create_run_folder("import", folder) as (final_folder, scratch):
            self.write_files(scratch)
        return final_folder

    def write_files(self, scratch: Path) -> dict[str, Any]:
        """Write all files into ``scratch``; return the content of import.json."""
        return dataset_import.write_dataset(self.imported, scratch)


def _list_files(files: FilesLike) -> list[str | Path]:
    """Return the files of a sequence, of one path, or of a folder (all files in a supported format, by name)."""
    if not isinstance(files, str | Path):
        return list(files)
    if not Path(files).is_dir():
        return [files]
    paths = sorted(path for path in Path(files).iterdir() if path.suffix.lower() in FILE_SUFFIXES)
    if not paths:
        raise InputError(f"folder {files} has no motion-capture file; allowed suffixes: {', '.join(FILE_SUFFIXES)}")
    return list(paths)


def import_gait(
    files: FilesLike,
    *,
    mass: float | None = None,
    stature: float | None = None,
    side: Side | None = None,
    mapping: str | Path | None = None,
    cutoff: float = MOTION_CUTOFF_HZ,
    load_cutoff: float = LOAD_CUTOFF_HZ,
    stride_time: float | None = None,
    frame_rate: float | None = None,
    use_listed_events: bool = True,
    contact_threshold: float = ImportOptions.contact_threshold,
    ankle_zero: AnkleZero = "foot-flat",
    accept: Collection[str] = (),
    progress: ProgressCallback | None = None,
) -> GaitImport:
    """Import motion-capture files as a gait reference.

    Signs, axes, units and offsets are detected; the log states the reasons, and anything suspicious.

    Args:
        files: Trials in C3D, OpenSim's .mot, .sto and .trc, CSV, Parquet or Visual3D's
            ASCII exports: one file, a folder, or a sequence of files.
            A trial may consist of several files.
        mass: Body mass [kg]. None: estimated from the impulse of the ground reaction.
        stature: Stature [m] for simulations with this reference.
        side: Leg of the reference. None: the one with more strides.
        mapping: Path of a mapping file for columns, markers, axes and clocks.
        cutoff: Low-pass cutoff of angles and markers [Hz]; 0 disables the filter.
        load_cutoff: Low-pass cutoff of ground reactions and moments [Hz]; 0 disables the filter.
        stride_time: Duration [s] of a stride in a table over the gait cycle [%].
        frame_rate: Frame rate [Hz] of Visual3D exports without times.
        use_listed_events: Whether strides are cut at the foot strikes that a C3D file lists. False: at those of the
            load.
        contact_threshold: Vertical ground reaction of a foot on the ground [N].
        ankle_zero: Zero of the ankle angle.
        accept: Names of findings that are right although they look implausible.
        progress: Receives the completed fraction and the current stage.

    Raises InputError for files that are invalid, contradictory or without a complete stride.
    """
    options = ImportOptions(
        mass=mass,
        stature=stature,
        side=side,
        motion_cutoff=cutoff,
        load_cutoff=load_cutoff,
        stride_time=stride_time,
        frame_rate=frame_rate,
        use_listed_events=use_listed_events,
        contact_threshold=contact_threshold,
        ankle_zero=ankle_zero,
        mapping=_read_mapping(mapping),
        accept=frozenset(accept),
    )
    return GaitImport(reference_import.import_reference(_list_files(files), options, progress))


def import_dataset(
    files: FilesLike,
    device: str | Path,
    *,
    uncertainties: Mapping[str, str | float] | None = None,
    trials_per_group: int | None = None,
    mass: float | None = None,
    side: Side | None = None,
    mapping: str | Path | None = None,
    frame_rate: float | None = None,
    contact_threshold: float = ImportOptions.contact_threshold,
    ankle_zero: AnkleZero = "file",
    accept: Collection[str] = (),
    progress: ProgressCallback | None = None,
) -> DatasetImport:
    """Import gait trials with a prosthesis and its log as a dataset for :func:`klute_sim.diagnose`.

    Args:
        files: Trials as for :func:`import_gait`, with the log of the prosthesis. Nothing is filtered.
        device: Prosthesis: name of a preset, or path of a device file.
        uncertainties: ``section.key`` of the device -> standard deviation, such as ``"10 %"``, or a number in the unit
            of the key.
        trials_per_group: Number of consecutive trials that are repeats. None: detected by stride times and pressures.
        mass: Body mass [kg], for loads per body mass.
        side: Side of the prosthesis.
        mapping: Path of a mapping file for columns, markers, axes and clocks.
        frame_rate: Frame rate [Hz] of Visual3D exports without times.
        contact_threshold: Vertical ground reaction of a foot on the ground [N].
        ankle_zero: Zero of the ankle angle.
        accept: Names of findings that are right although they look implausible.
        progress: Receives the completed fraction and the current stage.

    Raises InputError for invalid inputs, and if no trial can be replayed.
    """
    options = ImportOptions(
        mass=mass,
        side=side,
        frame_rate=frame_rate,
        contact_threshold=contact_threshold,
        ankle_zero=ankle_zero,
        mapping=_read_mapping(mapping),
        accept=frozenset(accept),
    )
    dataset_options = DatasetOptions(
        device=str(device), uncertainties=uncertainties or {}, trials_per_group=trials_per_group
    )
    return DatasetImport(dataset_import.import_dataset(_list_files(files), options, dataset_options, progress))


def export_run(
    run: str | Path | Recording,
    folder: str | Path | None = None,
    *,
    formats: Sequence[str] = DEFAULT_EXPORT_FORMATS,
    side: Side = "right",
) -> tuple[Path, list[str]]:
    """Write motion and loads of a gait run for other programs; return the folder and the names of the files.

    Args:
        run: Folder of a gait run or of an imported gait, or the recording of a gait run.
        folder: New or empty folder. None: the next ``runs/export-NNN``.
        formats: ``"mot"``, ``"sto"`` and ``"trc"`` with OpenSim's names, axes and signs; ``"log"`` for the channels
            that the prosthesis would log; ``"csv"`` and ``"parquet"`` for all channels.
        side: Side in the names of the leg.

    Raises InputError for a folder without a gait, and for unknown formats.
    """
    unknown = [name for name in formats if name not in export.FILE_WRITERS]
    if unknown:
        raise InputError(f"unknown format '{unknown[0]}'; allowed: {', '.join(export.FILE_WRITERS)}")
    recording = run if isinstance(run, Recording) else export.read_gait(Path(run))
    with create_run_folder("export", folder) as (final_folder, scratch):
        files = export.write_files(recording, side, tuple(dict.fromkeys(formats)), scratch)
    return final_folder, files


def _read_mapping(path: str | Path | None) -> mapping_file.ImportMapping:
    return mapping_file.read(None if path is None else Path(path))


def _describe_strides(imported: ImportedReference) -> str:
    n_strides = len(imported.strides[imported.side])
    speed = "" if imported.walking_speed is None else f", {imported.walking_speed:.2f} m/s"
    filters = reference_folder.describe_filters(imported)
    return (
        f"{n_strides} stride{'' if n_strides == 1 else 's'} of the {imported.side} leg: "
        f"{imported.stride_time:.3f} s{speed}, toe-off at {imported.toe_off:.1f} %, {imported.mass:.1f} kg. "
        f"Filters: angles {filters['angles']}; loads {filters['loads']}."
    )


def _format_log(content: Mapping[str, Any], *, verbose: bool) -> Summary:
    """Yield warnings, missing and derived quantities, and the tables of files and channels."""
    from klute_sim.report.mocap import table

    for section, title in (("warnings", "Warning"), ("missing", "Missing"), ("derived", "Derived")):
        for sentence in content[section] if verbose else table.collect_sentences(content, section):
            yield f"{title}: {sentence}"
    yield table.build_files_table(content)
    yield table.build_channels_table(content, all_files=verbose)
    if not verbose:
        yield "Channels of every file: --verbose, or import.json"
