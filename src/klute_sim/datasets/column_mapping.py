"""``[columns]`` of ``dataset.toml``: how channels follow from the columns of files, for the dataset and for a trial."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

from klute_sim.datasets.channels import (
    TIME_COLUMN,
    ChannelSource,
    get_column_units,
    get_measured_units,
    resolve_channel,
)
from klute_sim.datasets.trial_files.expressions import Expression, parse_expression
from klute_sim.datasets.trial_files.table import Table
from klute_sim.errors import InputError, suggest


@dataclass(frozen=True)
class ColumnMapping:
    """Where the files of one trial have their heading, and expressions for the channels."""

    expressions: Mapping[str, Expression] = field(default_factory=dict)
    """Channel or time -> expression."""
    shared: frozenset[str] = frozenset()
    """Those that the dataset states for all trials."""
    heading_row: int | None = None
    """Line of the heading in text files; None if it is searched for."""

    def select(self, *, is_first: bool) -> dict[str, Expression]:
        """Return the expressions for a file; channels without columns, such as a constant, belong to the first."""
        return {
            channel: expression
            for channel, expression in self.expressions.items()
            if expression.columns or is_first or channel == TIME_COLUMN
        }

    def describe_source(self, name: str, unit: str) -> str:
        """Return the columns that channel ``name`` is read from, and its ``unit``."""
        columns = self.expressions[name].columns if name in self.expressions else (name,)
        return f"{', '.join(columns)} [{unit}]"

    def check_found(self, channels: Collection[str], tables: Sequence[Table], rig: ChannelSource) -> dict[str, str]:
        """Return channel -> reason for the expressions of the dataset that cannot be computed from the ``tables``.

        Only channels that the dataset maps for all trials are returned: a trial need not measure them, or its files
        may have the channel itself, which is then among ``channels``. Raises InputError for others.
        """
        unmapped = {}
        for name, expression in self.expressions.items():
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
    dataset_columns: Mapping[str, str],
    trial_columns: Mapping[str, str],
    rig: ChannelSource,
    source: str,
    trial_source: str,
    heading_row: int | None = None,
) -> ColumnMapping:
    """Return the mapping of a trial from ``[columns]`` of the dataset and ``[trial.columns]``, which replaces it.

    ``source`` and ``trial_source`` name them in errors. Raises InputError for an unknown channel and for an expression
    that cannot be parsed.
    """
    shared = {name: text for name, text in dataset_columns.items() if name not in trial_columns}
    expressions = {
        **{name: _parse(name, text, rig, "[columns]", source) for name, text in shared.items()},
        **{name: _parse(name, text, rig, "[trial.columns]", trial_source) for name, text in trial_columns.items()},
    }
    return ColumnMapping(expressions, frozenset(shared), heading_row)


def _parse(name: str, text: str, rig: ChannelSource, table: str, source: str) -> Expression:
    units = get_column_units(rig)
    if name not in units:
        hint = f"allowed: {', '.join(units)}"
        raise InputError(f"{source}: {table} names the unknown channel '{name}'; {suggest(name, units, hint)}")
    return parse_expression(text, units[name], f"{table} {name}", source)
