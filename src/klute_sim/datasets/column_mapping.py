"""``[columns]`` of ``dataset.toml``: how channels follow from the columns of files, for the dataset and for a trial."""

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

from klute_sim.datasets.channels import (
    TIME_COLUMN,
    ChannelSource,
    get_column_units,
    get_measured_units,
    resolve_channel,
)
from klute_sim.datasets.trial_files.column_assignment import states_unit
from klute_sim.datasets.trial_files.expressions import ROW, Expression, parse_expression
from klute_sim.datasets.trial_files.table import Table
from klute_sim.errors import InputError, suggest


@dataclass(frozen=True)
class ColumnMapping:
    """Where the files of one trial have their heading, and expressions for the channels."""

    expressions: Mapping[str, Sequence[Expression]] = field(default_factory=dict)
    """Channel -> its expression; time -> its expressions, of which the first applies whose columns a file has."""
    shared: frozenset[str] = frozenset()
    """Those that the dataset states for all trials."""
    heading_row: int | None = None
    """Line of the heading in text files; None if it is searched for."""

    def select(self, *, is_first: bool) -> dict[str, Sequence[Expression]]:
        """Return the expressions for a file; channels without columns, such as a constant, belong to the first.

        The number of the row is no column, and every file may have its time by it.
        """
        return {
            channel: alternatives
            for channel, alternatives in self.expressions.items()
            if {*alternatives[0].columns} - {ROW} or is_first or channel == TIME_COLUMN
        }

    def describe_source(self, name: str, unit: str) -> str:
        """Return the columns that channel ``name`` is read from, and its ``unit``."""
        columns = self.expressions[name][0].columns if name in self.expressions else (name,)
        return f"{', '.join(columns)} [{unit}]"

    def suggest_time(self, headings: Sequence[str], *, has_other_clocks: bool) -> str:
        """Return how to state the time of a file with these ``headings`` beside that of others.

        '' without a column in a unit of time, unless the trial has files with other clocks.
        """
        time_heading = next((heading for heading in headings if states_unit(heading, "s")), "")
        if not time_heading and not has_other_clocks:
            return ""
        texts = [expression.text for expression in self.expressions[TIME_COLUMN]]
        times = [*texts, f"`{time_heading}`" if time_heading else "NAME [s]"]
        return f"; state the time of each kind of file in a list: time = {json.dumps(times, ensure_ascii=False)}"

    def check_expressions(
        self, channels: Collection[str], tables: Sequence[Table], rig: ChannelSource
    ) -> dict[str, str]:
        """Return channel -> reason for the expressions of the dataset that cannot be computed from the ``tables``.

        Only channels that the dataset maps for all trials are returned: a trial need not measure them, or its files
        may have the channel itself, which is then among ``channels``. Raises InputError for others.
        """
        unmapped = {}
        for name, (expression, *_) in self.expressions.items():
            if any(name in table.headings and name not in table.missing for table in tables):
                continue
            reason = next((table.missing[name] for table in tables if name in table.missing), "")
            sources = " + ".join(table.source for table in tables)
            sentence = f"trial {sources}: {expression.label} = '{expression.text}' cannot be computed: {reason}"
            may_be_missing = name in get_measured_units(rig) or resolve_channel(rig, name) in channels
            if name not in self.shared or not may_be_missing:
                raise InputError(sentence)
            unmapped[name] = sentence
        return unmapped


NO_MAPPING = ColumnMapping()
"""All channels have headings ``name [unit]``."""


def parse_mapping(
    dataset_columns: Mapping[str, Sequence[str]],
    trial_columns: Mapping[str, Sequence[str]],
    rig: ChannelSource,
    source: str,
    trial_source: str,
    heading_row: int | None = None,
) -> ColumnMapping:
    """Return the mapping of a trial from ``[columns]`` of the dataset and ``[trial.columns]``, which replaces it.

    Both hold the expressions of each channel; only the time may have several. ``source`` and ``trial_source`` name
    them in errors. Raises InputError for an unknown channel, for several expressions of another, and for an expression
    that cannot be parsed.
    """
    shared = {name: texts for name, texts in dataset_columns.items() if name not in trial_columns}
    expressions = {
        **{name: _parse(name, texts, rig, "[columns]", source) for name, texts in shared.items()},
        **{name: _parse(name, texts, rig, "[trial.columns]", trial_source) for name, texts in trial_columns.items()},
    }
    return ColumnMapping(expressions, frozenset(shared), heading_row)


def _parse(name: str, texts: Sequence[str], rig: ChannelSource, table: str, source: str) -> list[Expression]:
    units = get_column_units(rig)
    if name not in units:
        hint = f"allowed: {', '.join(units)}"
        raise InputError(f"{source}: {table} names the unknown channel '{name}'; {suggest(name, units, hint)}")
    if len(texts) > 1 and name != TIME_COLUMN:
        raise InputError(
            f"{source}: {table} {name} is a list; only '{TIME_COLUMN}' may be one, because each file has its own"
        )
    return [parse_expression(text, units[name], f"{table} {name}", source) for text in texts]
