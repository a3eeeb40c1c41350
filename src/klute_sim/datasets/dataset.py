"""A dataset: a folder of measured trials, read and checked."""

import hashlib
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from pathlib import Path, PurePath
from typing import NamedTuple

from klute_sim.datasets import checks, declarations, mechanism_checks
from klute_sim.datasets import format as file_format
from klute_sim.datasets.channels import TIME_COLUMN, ChannelSource, RigName, resolve_channel
from klute_sim.datasets.column_mapping import ColumnMapping, parse_mapping
from klute_sim.datasets.format import DatasetFile, TrialEntry
from klute_sim.datasets.initial_state import check_initial_state, parse_initial_state
from klute_sim.datasets.load_bandwidth import describe_filtered_loads
from klute_sim.datasets.mechanism import (
    DatasetMechanism,
    check_model_numbers,
    load_dataset_mechanism,
    select_shared,
)
from klute_sim.datasets.missing_rows import add_gap_findings
from klute_sim.datasets.muscle_diameter import scale_muscle
from klute_sim.datasets.remarks import collect_file_remarks, describe_accepted, describe_scope
from klute_sim.datasets.split import Split, SplitEntry, assign_uses, split_trials
from klute_sim.datasets.trial import InitialState, SensorLimits, Trial, TrialChannels, read_trial
from klute_sim.device import device as device_files
from klute_sim.device.device import Device
from klute_sim.errors import InputError
from klute_sim.files.limits import DATASET
from klute_sim.files.lines import check_duration
from klute_sim.files.reading import MissingFileError, read_bytes
from klute_sim.plausibility.finding import Finding, require_accepted

DATASET_FILE_NAME = "dataset.toml"


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Dataset:
    """Measured trials of one device on one rig."""

    folder: Path
    """Folder of the dataset."""
    rig: RigName
    """Rig that all trials were recorded on."""
    device: Device
    """Nominal device; a trial may change its values."""
    uncertainties: Mapping[str, float]
    """``section.key`` of the device, or name of a number of the mechanism -> standard deviation in the key's unit."""
    trials: tuple[Trial, ...]
    """Trials in the order of the file."""
    digest: str
    """SHA-256 over ``dataset.toml``, the device file and every trial file."""
    remarks: tuple[str, ...]
    """Remarks about the files for the user, one sentence each."""
    accepted: tuple[Finding, ...] = ()
    """Implausible properties of the trials that the user accepts."""
    tolerance: Mapping[str, float] = field(default_factory=dict)
    """Measured channel -> misfit [SI] below which a difference does not matter to the user."""
    mechanism: DatasetMechanism | None = None
    """Model and devices; None unless the rig is an MJCF model."""

    @property
    def channel_source(self) -> ChannelSource:
        """Where the channels of the trials follow from."""
        return _get_channel_source(self.rig, self.mechanism)

    @property
    def nominal_numbers(self) -> dict[str, float]:
        """Uncertain numbers that are not those of the dataset's device: name -> nominal value."""
        known = {} if self.mechanism is None else self.mechanism.collect_nominal_numbers()
        return {name: known[name] for name in self.uncertainties if name in known}

    @property
    def model_values(self) -> Mapping[str, float]:
        """All numbers of the model of the mechanism: name -> nominal value; empty on another rig."""
        return {} if self.mechanism is None else self.mechanism.model_values

    def __repr__(self) -> str:
        """Return folder, rig, device and number of trials on one line."""
        return (
            f"Dataset('{self.folder}', rig='{self.rig}', device='{self.device.name}', {len(self.trials)} trials in "
            f"{len({trial.group for trial in self.trials})} groups)"
        )

    def _repr_html_(self) -> str:
        """Return a table of the trials for notebooks."""
        headings = ("trial", "group", "use", "duration [s]", "measured channels")
        rows = [
            (
                trial.name,
                trial.group,
                trial.use or "",
                f"{max(float(series.time[-1] - series.time[0]) for series in trial.prescribed.values()):.3g}",
                ", ".join(trial.measured),
            )
            for trial in self.trials
        ]
        head = "".join(f"<th>{escape(heading)}</th>" for heading in headings)
        body = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows)
        return f"<p><code>{escape(repr(self))}</code></p><table><tr>{head}</tr>{body}</table>"


def load_dataset(
    folder: str | Path,
    device: Device | None = None,
    accept: Collection[str] = (),
    find_in_walks: Callable[[Sequence[Trial], Collection[str]], list[Finding]] = lambda trials, accepted: [],
) -> Dataset:
    """Read and check the dataset in ``folder``.

    ``device`` replaces the one that the dataset names and is of the diameter of the trials: table ``[diameter]`` does
    not change it. ``accept`` holds names of findings about implausible trials that are right nevertheless, in addition
    to those that the dataset accepts. ``find_in_walks`` returns the findings in gait trials that have no others, given
    the names of all accepted ones, as :func:`klute_sim.gait.replay.recording_mistakes.find_recording_mistakes` does.
    Raises InputError with one sentence that says what is wrong, where, and what is allowed.
    """
    folder = Path(folder)
    content = _read_content(folder)
    source = str(folder / DATASET_FILE_NAME)
    file = file_format.parse_dataset_file(content, source)
    size_remarks: list[str] = []
    if device is None:
        device, size_remarks = scale_muscle(_load_device(file.device, folder), file.diameter, source)
    elif file.diameter is not None:
        size_remarks = [
            f"The device '{device.name}' that replaces that of the dataset is not scaled by [diameter]: it must have "
            "the diameter of the muscles in the trials."
        ]
    if file.rig == "bench":
        device_files.check_is_testable(device, f"{source}: ")
    mechanism = load_dataset_mechanism(file, folder, device, source)
    known_values: dict[str, float] = dict(device.spec.collect_values())
    if mechanism is not None:
        known_values |= mechanism.collect_nominal_numbers()
    uncertainties = file_format.compute_standard_deviations(file.uncertain, known_values, source)
    channel_source = _get_channel_source(file.rig, mechanism)
    plans = _plan_trials(file, device, mechanism, channel_source, source)
    assign_uses([plan.split_entry for plan in plans], source)  # rejects an impossible split before large files
    digest = hashlib.sha256(hashlib.sha256(content).digest() + bytes.fromhex(device.digest))
    if mechanism is not None:
        for part_digest in (mechanism.file.digest, *(part.digest for part in mechanism.devices.values())):
            digest.update(bytes.fromhex(part_digest))
    contents: list[TrialChannels] = []
    trials: list[Trial] = []
    for plan in plans:
        files = tuple(folder / name for name in plan.entry.files)
        has_supply = mechanism is not None or device.spec.supply is not None
        channels = read_trial(files, channel_source, plan.mapping, plan.delays, has_supply=has_supply)
        for file_digest in channels.digests:
            digest.update(bytes.fromhex(file_digest))
        trials.append(plan.build_trial(files, channels, source))
        if mechanism is None:
            checks.check_supply(trials[-1], source)
        contents.append(channels)
    unmapped_remarks = _check_unmapped(contents, channel_source)
    accepted_names = {*file.accept, *accept}
    trial_findings = (
        checks.find_implausible(channel_source, trials, contents, accepted_names)
        if mechanism is None
        else mechanism_checks.find_implausible(
            mechanism, trials, [channels.units for channels in contents], source, accepted_names
        )
    )
    trial_findings = add_gap_findings(trial_findings, trials, contents)
    changes = checks.find_implausible_changes(trials, [entry.device for entry in file.trial])
    findings = [*changes, *trial_findings.findings]
    checks.check_accepted(file.accept, findings, channel_source, known_values, f"{source}, accept: ")
    checks.check_accepted(accept, findings, channel_source, known_values)
    accepted = require_accepted(findings, accepted_names)
    questioned = [trial for trial in trials if f"trial '{trial.name}'" in trial_findings.questioned_places]
    entries = [*zip(trials, file.trial, strict=True)]
    fitted = split_trials(trials, source).fit
    fit_entries = [(trial, entry) for trial, entry in entries if trial.name in fitted]
    declarations.check_input_noise([(t, {**file.noise, **entry.noise}) for t, entry in entries], source)
    declarations.check_limits([(t, {**file.limits, **entry.limits}) for t, entry in fit_entries], source)
    tolerance = declarations.compute_tolerances(
        file.tolerance, channel_source, [t for t, _ in fit_entries], f"{source}: [tolerance]"
    )
    for trial in trials:  # after the checks, which name the unit that a long duration seems to be in
        for series in (*trial.prescribed.values(), *trial.measured.values()):
            check_duration(series.time, f"{source}, trial '{trial.name}'")
        if file.rig == "gait":
            checks.check_motion_rate(trial, source)
    if file.rig == "gait":
        walks = [trial for trial in trials if trial not in questioned]
        accepted += require_accepted(find_in_walks(walks, accepted_names), accepted_names)
    return Dataset(
        folder=folder,
        rig=file.rig,
        device=device,
        uncertainties=uncertainties,
        trials=tuple(trials),
        digest=digest.hexdigest(),
        remarks=(
            *size_remarks,
            *collect_file_remarks(trials, [channels.remarks for channels in contents]),
            *unmapped_remarks,
            *mechanism_checks.describe_trials(mechanism, trials),
            *describe_scope(trials, file.rig),
            *describe_filtered_loads(trials),
            *describe_accepted(accepted, file.accept, source, questioned),
        ),
        accepted=accepted,
        tolerance=tolerance,
        mechanism=mechanism,
    )


def _get_channel_source(rig: RigName, mechanism: DatasetMechanism | None) -> ChannelSource:
    if mechanism is not None:
        return mechanism.channels
    assert rig != "mjcf"
    return rig


class _TrialPlan(NamedTuple):
    """What ``dataset.toml`` says about a trial, checked before its files are read."""

    entry: TrialEntry
    """Table of the trial."""
    split_entry: SplitEntry
    """Name, group and use."""
    device: Device
    """The dataset's device with the changes of the trial."""
    input_noise: Mapping[str, float]
    """Prescribed channel -> standard deviation of its noise [SI]."""
    limits: Mapping[str, SensorLimits]
    """Measured channel -> limits of its sensor [SI]."""
    delays: Mapping[str, float]
    """Channel -> time by which it is late [s]."""
    mapping: ColumnMapping
    """Expressions for its channels."""
    devices: Mapping[str, Device]
    """Tendon -> device with the changes of the trial."""
    model_numbers: Mapping[str, float]
    """Numbers of the model that differ from its file."""
    initial_state: InitialState
    """Stated initial state."""

    def build_trial(self, files: tuple[Path, ...], channels: TrialChannels, source: str) -> Trial:
        """Return the trial with the ``channels`` of its ``files``."""
        name = self.split_entry.name
        place = f"{source}, trial '{name}'"
        check_initial_state(self.initial_state, channels.measured, place)
        return Trial(
            name=name,
            group=self.split_entry.group,
            use=self.split_entry.use,
            device=self.device,
            files=files,
            prescribed=channels.prescribed,
            measured=channels.measured,
            trusted=declarations.check_trusted(self.entry.trusted, channels.measured, place),
            specimen=self.entry.specimen or "",
            input_noise=self.input_noise,
            limits={channel: limits for channel, limits in self.limits.items() if channel in channels.measured},
            delays=self.delays,
            devices=self.devices,
            model_numbers=self.model_numbers,
            initial_state=self.initial_state,
        )


def _plan_trials(
    file: DatasetFile, device: Device, mechanism: DatasetMechanism | None, channels: ChannelSource, source: str
) -> list[_TrialPlan]:
    names = _name_trials(file, source)
    _check_groups(file, names, source)
    entries = [SplitEntry(name, entry.group or name, entry.use) for name, entry in zip(names, file.trial, strict=True)]
    specimens = [entry.specimen or "" for entry in file.trial]
    declarations.check_specimens([*zip(entries, specimens, strict=True)], source)
    plans = []
    for entry, split_entry in zip(file.trial, entries, strict=True):
        place = f"{source}, trial '{split_entry.name}'"
        noise = {
            **declarations.parse_input_noise(file.noise, channels, f"{source}: [noise]"),
            **declarations.parse_input_noise(entry.noise, channels, f"{place}: [trial.noise]"),
        }
        limits = {
            **declarations.parse_limits(file.limits, channels, f"{source}: [limits]"),
            **declarations.parse_limits(entry.limits, channels, f"{place}: [trial.limits]"),
        }
        delays = {
            **declarations.parse_delays(file.delay, channels, f"{source}: [delay]"),
            **declarations.parse_delays(entry.delay, channels, f"{place}: [trial.delay]"),
        }
        heading_row = entry.heading_row or file.heading_row
        mapping = parse_mapping(file.columns, entry.columns, channels, source, place, heading_row)
        changed_device = device.with_changes(entry.device if mechanism is None else select_shared(entry.device), place)
        devices: dict[str, Device] = {}
        numbers: dict[str, float] = {}
        initial_state = InitialState()
        if mechanism is not None:
            devices = mechanism.change_devices(entry.device, f"{place}: [trial.device]")
            changes = check_model_numbers(entry.numbers, mechanism.model_values, f"{place}: [trial.numbers]")
            numbers = {**mechanism.numbers, **changes}
            initial_state = parse_initial_state(entry.initial, mechanism, f"{place}: [trial.initial]")
        elif entry.numbers or entry.initial:
            key = "numbers" if entry.numbers else "initial"
            raise InputError(f"{place}: [trial.{key}] is for rig = 'mjcf'; remove it, or change the rig")
        plans.append(
            _TrialPlan(
                entry, split_entry, changed_device, noise, limits, delays, mapping, devices, numbers, initial_state
            )
        )
    return plans


def _check_unmapped(contents: Sequence[TrialChannels], source: ChannelSource) -> list[str]:
    """Return a remark for each expression of ``[columns]`` that a trial has no columns for.

    Raises InputError where all trials have none: a name in it is misspelt.
    """
    for channel, reason in contents[0].unmapped.items():
        if all(channel in content.unmapped for content in contents):
            raise InputError(reason)
    remarks = []
    for content in contents:
        available_channels = {TIME_COLUMN, *content.prescribed, *content.measured}
        for channel, reason in content.unmapped.items():
            is_available = resolve_channel(source, channel) in available_channels
            end = f"its column '{channel}' is used as it is" if is_available else "the trial is used without it"
            remarks.append(f"{reason}; {end}")
    return remarks


def split_dataset(dataset: Dataset) -> Split:
    """Return the split of ``dataset`` into trials for fit, validation and test; it is always the same."""
    return split_trials(dataset.trials, str(dataset.folder / DATASET_FILE_NAME))


def _read_content(folder: Path) -> bytes:
    try:
        if folder.is_file():
            raise InputError(f"{folder} is a file; give the folder with {DATASET_FILE_NAME}")
        return read_bytes(folder / DATASET_FILE_NAME, DATASET)
    except MissingFileError:
        if not folder.exists():
            raise InputError(f"folder {folder} does not exist; give a folder with a file {DATASET_FILE_NAME}") from None
        files = sorted(file.name for file in folder.glob("*") if file.suffix.lower() in (".csv", ".parquet", ".mat"))
        fix = (
            f"; 'klute-sim diagnose {folder} --draft' writes one for {files[0]} and the other recordings "
            "(docs/datasets.md)"
            if files
            else ""
        )
        raise InputError(f"folder {folder} is not a dataset: it has no file {DATASET_FILE_NAME}{fix}") from None


def _load_device(name: str, folder: Path) -> Device:
    return device_files.load_device(name if name in device_files.list_presets() else folder / name)


def _name_trials(file: DatasetFile, source: str) -> list[str]:
    names: list[str] = []
    for number, entry in enumerate(file.trial, 1):
        for path in entry.files:
            if not PurePath(path).name:
                raise InputError(
                    f"{source}: trial {number} names '{path}', which is a folder; give the paths of files relative to "
                    "the folder of dataset.toml"
                )
        name = "+".join(PurePath(path).with_suffix("").as_posix() for path in entry.files)
        if name in names:
            raise InputError(
                f"{source}: trials {names.index(name) + 1} and {number} are both '{name}'; give each trial its own "
                "files, with names that differ in more than their endings"
            )
        names.append(name)
    return names


def _check_groups(file: DatasetFile, names: Sequence[str], source: str) -> None:
    """Raise InputError where a stated group is that of a trial without one, which has its own name as its group."""
    alone = {name for name, entry in zip(names, file.trial, strict=True) if entry.group is None}
    for name, entry in zip(names, file.trial, strict=True):
        if entry.group in alone:
            raise InputError(
                f"{source}, trial '{name}': group = '{entry.group}' is the name of a trial without a group, which "
                "would become a repeat of this one; rename the group, or state it for that trial as well"
            )


def replace_tolerances(dataset: Dataset, texts: Sequence[str]) -> Dataset:
    """Return ``dataset`` with the tolerances ``texts``, each ``channel=amount`` with a unit or per cent of the range.

    Raises InputError unless each text names a measured channel and a positive amount.
    """
    amounts = {}
    for text in texts:
        channel, separator, amount = text.partition("=")
        if not separator:
            raise InputError(f"the tolerance '{text}' has no '='; write for example 'force=5 N' or 'force=2 %'")
        amounts[channel.strip()] = amount.strip()
    names = split_dataset(dataset).fit
    fit_trials = [trial for trial in dataset.trials if trial.name in names]
    tolerances = declarations.compute_tolerances(amounts, dataset.channel_source, fit_trials, "the tolerance")
    return replace(dataset, tolerance={**dataset.tolerance, **tolerances})
