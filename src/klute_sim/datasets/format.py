"""Format of ``dataset.toml``: its keys and their allowed values."""

import math
import re
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError
from pydantic_core import ErrorDetails, PydanticCustomError

from klute_sim.datasets.channels import RigName
from klute_sim.datasets.mechanism_channels import MAX_CHANNELS
from klute_sim.datasets.trial import Use
from klute_sim.errors import InputError, suggest_from
from klute_sim.files.toml import parse_toml, validation_sentence

FORMAT_NAME = "klute-sim-dataset/2"
FIRST_FORMAT_NAME = "klute-sim-dataset/1"
"""Former format, which is rejected."""

_PERCENT_PATTERN = re.compile(r"(?P<number>[^%]*)%")
_SINGLE_BRACKET_PATTERN = re.compile(rb"^[ \t]*\[[ \t]*trial[ \t]*\]", re.MULTILINE)


def _validate_name(value: Any) -> Any:
    """Reject empty names and names with line ends or other control characters."""
    if isinstance(value, str) and not (value.strip() and value.isprintable()):
        raise PydanticCustomError(
            "name", "{value} is refused; allowed: a name or path on one line", {"value": repr(value)}
        )
    return value


def _validate_number(value: Any) -> Any:
    if isinstance(value, bool) or not isinstance(value, int | float) or _parse_finite(value) is None:
        raise PydanticCustomError(
            "number",
            "{value} is refused; allowed: a finite number in the unit of the key",
            {"value": _shorten(value)},
        )
    return value


def _validate_deviation(value: Any) -> Any:
    number, is_percent = _parse_amount(value)
    if number is None or number <= 0.0:
        raise PydanticCustomError(
            "deviation",
            "{value} is refused; allowed: a standard deviation above 0, in per cent of the device's value ('10 %') or "
            "in the unit of the key (0.5)",
            {"value": _shorten(value)},
        )
    if isinstance(value, str) and not is_percent:
        raise PydanticCustomError(
            "unit",
            '{value} is refused; write "{number} %" for per cent, or {number} without quotes for the unit of the key',
            {"value": repr(value), "number": value.strip()},
        )
    return value


def _parse_amount(value: Any) -> tuple[float | None, bool]:
    """Return the number in ``value``, or None, and whether it is in per cent."""
    percent = _PERCENT_PATTERN.fullmatch(value.strip()) if isinstance(value, str) else None
    return _parse_finite(percent["number"] if percent else value), percent is not None


def _parse_finite(value: Any) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        number = float(value)
    except (ValueError, OverflowError):
        return None
    return number if math.isfinite(number) else None


def _shorten(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _make_tuple(value: Any) -> Any:
    """Return one text as a tuple, and a list as one."""
    return (value,) if isinstance(value, str) else tuple(value) if isinstance(value, list) else value


HeadingRow = Annotated[int, Field(ge=1, le=100_000)]
Name = Annotated[str, BeforeValidator(_validate_name)]
Expressions = Annotated[tuple[Name, ...], Field(min_length=1), BeforeValidator(_make_tuple)]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


Numbers = dict[str, Annotated[int | float, BeforeValidator(_validate_number)]]


class DeviceEntry(_Section):
    """One table ``[devices.TENDON]`` of ``dataset.toml``."""

    device: Name | None = None
    """Preset, or path of a device file; by default the device of the dataset."""
    changes: Numbers = {}
    """``section.key`` -> value in the key's unit, where this device differs."""


class DiameterEntry(_Section):
    """Table ``[diameter]`` of ``dataset.toml``: nominal diameters, each with a unit."""

    device: Name
    """Diameter of the muscle that the device file describes."""
    trials: Name
    """Diameter of the muscles of the trials, made in the same way."""


class TrialEntry(_Section):
    """One table ``[[trial]]`` of ``dataset.toml``."""

    files: Annotated[list[Name], Field(min_length=1)]
    """Paths relative to the folder; several files where channels have different time axes."""
    group: Name | None = None
    """Group of repeats; by default a group of its own."""
    use: Use | None = None
    """Use of the group; by default the program splits the groups."""
    device: Numbers = {}
    """``section.key`` -> value in the key's unit, where the device of this trial differs; on a mechanism each device,
    or with ``tendon/section.key`` one."""
    heading_row: HeadingRow | None = None
    """Line of the heading in the text files of this trial."""
    columns: dict[str, Expressions] = {}
    """Channel or time -> expression over the columns of the files, or a list of them; replaces that of the dataset."""
    specimen: Name | None = None
    """Specimen that was tested; by default all trials are of one specimen."""
    noise: dict[str, Name] = {}
    """Prescribed channel that was measured in this trial -> standard deviation of its noise, with a unit."""
    limits: dict[str, Name] = {}
    """Measured channel -> limits of its sensor in this trial, with units."""
    delay: dict[str, Name] = {}
    """Channel -> time by which it is late in this trial, with a unit; negative where it is early."""
    trusted: list[Name] = []
    """Measured channels whose instrument is known to be correct in this trial, such as a calibrated load cell."""
    numbers: Numbers = {}
    """Numbers of the model that differ in this trial, such as a load."""
    initial: dict[str, Name] = {}
    """Position, velocity or pressure at the start of this trial -> value with a unit; on a mechanism."""


class DatasetFile(_Section):
    """Content of ``dataset.toml``."""

    format: Literal["klute-sim-dataset/2"]
    """Format and version."""
    rig: RigName
    """Rig that all trials were recorded on."""
    device: Name
    """Preset, or path of a device file relative to the folder."""
    diameter: DiameterEntry | None = None
    """Nominal diameters, where the trials are of muscles of another diameter than that of the device."""
    uncertain: dict[str, Annotated[float | int | str, BeforeValidator(_validate_deviation)]] = {}
    """``section.key`` -> standard deviation, a number in the key's unit or a percentage."""
    heading_row: HeadingRow | None = None
    """Line of the heading in all text files; by default it is searched for."""
    columns: dict[str, Expressions] = {}
    """Channel -> expression over the columns of the files; time -> one, or a list with one for each kind of file."""
    noise: dict[str, Name] = {}
    """Prescribed channel that was measured -> standard deviation of its noise in all trials, with a unit."""
    limits: dict[str, Name] = {}
    """Measured channel -> limits of its sensor, with units."""
    delay: dict[str, Name] = {}
    """Channel -> time by which it is late in all trials, with a unit; negative where it is early."""
    tolerance: dict[str, Name] = {}
    """Measured channel -> misfit that does not matter, with a unit or in per cent of the channel's range."""
    accept: list[Name] = []
    """Names of findings about implausible trials that are right nevertheless."""
    model: Name | None = None
    """Model of the package, or path of an MJCF file relative to the folder; for ``rig = "mjcf"``."""
    prescribed: Annotated[list[Name], Field(max_length=MAX_CHANNELS)] = []
    """Channels that are prescribed; for ``rig = "mjcf"``."""
    measured: Annotated[list[Name], Field(max_length=MAX_CHANNELS)] = []
    """Channels that are measured; for ``rig = "mjcf"``."""
    devices: dict[str, DeviceEntry] = {}
    """Tendon -> its device; by default every tendon has the device of the dataset."""
    numbers: Numbers = {}
    """Numbers of the model that differ from its file."""
    trial: Annotated[list[TrialEntry], Field(min_length=1, max_length=2000)]
    """Trials."""


_ALLOWED_VALUES: dict[str, str] = {
    "format": f"'{FORMAT_NAME}'",
    "rig": "'bench', 'gait' or 'mjcf'",
    "model": "a model of the package, or the path of an MJCF file, as text",
    "prescribed": "a list of channels, such as 'pressure_command_flexor'",
    "measured": "a list of channels, such as 'angle_joint'",
    "devices": "a table [devices.TENDON] with 'device' (a file or a preset) and 'changes' (\"section.key\" = number)",
    "numbers": 'a table of "model.joint.elbow.damping" = number',
    "trial.numbers": 'a table of "model.geom.load.mass" = number',
    "trial.initial": "text with a unit, as angle_elbow = '30 deg', velocity_elbow = '90 deg/s', pressure_arm = '2 bar'",
    "device": "a preset, or the path of a device file, as text",
    "diameter": "a table with 'device' and 'trials', each a nominal diameter such as '10 mm'",
    "uncertain": "a table of \"section.key\" = '10 %'",
    "accept": "a list of names of findings, such as 'force-unit'",
    "trial": "1 to 2000 tables [[trial]]",
    "trial.files": "a list of one or more file names",
    "trial.group": "a name, as text",
    "trial.use": "'fit', 'validation' or 'test'",
    "heading_row": "the number of a line, 1 to 100000",
    "trial.heading_row": "the number of a line, 1 to 100000",
    "columns": "a table of channel = 'expression [unit]', as text",
    "trial.columns": "a table of channel = 'expression [unit]', as text",
    "noise": "a table of channel = '0.2 mm', a standard deviation with a unit",
    "limits": "a table of channel = '-9 N to 445 N'",
    "trial.limits": "a table of channel = '-9 N to 445 N'",
    "delay": "a table of channel = '20 ms', with a unit",
    "trial.delay": "a table of channel = '20 ms', with a unit",
    "tolerance": "a table of channel = '5 N' or '2 %'",
    "trial.specimen": "a name, as text",
    "trial.noise": "a table of channel = '0.2 mm', a standard deviation with a unit",
    "trial.trusted": "a list of measured channels",
    "trial.device": 'a table of "section.key" = number',
}


def parse_dataset_file(content: bytes, source: str) -> DatasetFile:
    """Return the checked ``content`` of the ``dataset.toml`` at ``source``.

    Raises InputError for a file of the first format and for an unknown, missing or invalid key.
    """
    try:
        keys = parse_toml(content, source)
    except InputError as error:
        if _SINGLE_BRACKET_PATTERN.search(content):
            raise InputError(f"{error}; write [[trial]], with two brackets, for each trial") from None
        raise
    if keys.get("format") == FIRST_FORMAT_NAME:
        raise InputError(
            f"{source} has the first format, '{FIRST_FORMAT_NAME}'; change it to '{FORMAT_NAME}', use = 'select' to "
            "'validation', use = 'show' to 'test', and the key 'checked' to 'trusted'"
        )
    try:
        return DatasetFile.model_validate(keys)
    except ValidationError as error:
        raise InputError(
            f"{source}: {validation_sentence(error, DatasetFile, describe_allowed=_describe_allowed)}"
        ) from None


def _describe_allowed(problem: ErrorDetails) -> str:
    key = ".".join(part for part in problem["loc"] if isinstance(part, str))
    table = key.rpartition(".")[0]
    return _ALLOWED_VALUES.get(key) or _ALLOWED_VALUES.get(table) or _ALLOWED_VALUES["trial"]


def compute_standard_deviations(
    uncertainties: Mapping[str, float | int | str], values: Mapping[str, float], source: str
) -> dict[str, float]:
    """Return ``uncertainties`` as standard deviations in each key's own unit.

    ``values`` are those of the device. Raises InputError for a key that is not a numeric key of the device, for a
    count, and for a percentage of 0.
    """
    deviations = {}
    for key, uncertainty in uncertainties.items():
        check_known_key(key, values, f"{source}: [uncertain]")
        if key.startswith("foot."):
            raise InputError(
                f"{source}: [uncertain] '{key}' is a number of the foot, which is not fitted; allowed: other numbers. "
                "The effects foot_stiffness and foot_hysteresis tell how much more a foot yields"
            )
        if isinstance(values[key], int):
            raise InputError(f"{source}: [uncertain] '{key}' is a count; allowed: measured quantities")
        number, is_percent = _parse_amount(uncertainty)
        deviation = (number or 0.0) * (abs(values[key]) / 100.0 if is_percent else 1.0)
        if deviation == 0.0:
            raise InputError(
                f"{source}: [uncertain] '{key}' = {uncertainty!r}, but the device's value is {values[key]:g}; give a "
                "standard deviation in the unit of the key"
            )
        deviations[key] = deviation
    return deviations


def check_known_key(key: str, values: Mapping[str, float], source: str) -> None:
    """Raise InputError unless ``key`` is one of the device's numeric keys in ``values``."""
    if key not in values:
        owner = "the device or the model" if any(name.startswith("model.") for name in values) else "the device"
        hint = suggest_from(key, values, "docs/datasets.md says how numbers are named")
        raise InputError(f"{source} names '{key}', which is not a numeric key of {owner}; {hint}")
