"""Terminal summary of a diagnosis: sentences and tables."""

from collections.abc import Iterator

from rich.table import Table

from klute_sim.diagnosis.discrepancy.sparse_regression import format_formula
from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.result import Diagnosis
from klute_sim.report.diagnosis import text
from klute_sim.terminal_table import create_table


def iterate_summary(diagnosis: Diagnosis) -> Iterator[Table | str]:
    """Yield the verdict, its reasons, the added effects, the residuals, the next experiment and the split."""
    yield f"Verdict: {diagnosis.verdict}. {text.describe_verdict(diagnosis)}"
    sentences = [
        text.describe_equation_residuals(diagnosis),
        text.describe_probabilities(diagnosis),
        text.describe_numbers_at_bounds(diagnosis),
    ]
    for reason in filter(None, [*diagnosis.reasons, *sentences]):
        yield f"  {reason}"
    if diagnosis.added_terms and diagnosis.final_fit is not None:
        yield from build_added_term_tables(diagnosis, diagnosis.final_fit)
        formula = format_formula(diagnosis.final_fit)
        if formula:
            yield f"Data-driven term: {formula}"
    if diagnosis.channel_rms:
        yield build_gap_table(diagnosis)
    if diagnosis.next_experiment:
        yield f"Next: {diagnosis.next_experiment['sentence']}"
    for measurement in diagnosis.direct_measurements:
        yield f"Direct measurement: {measurement.to_dict()['sentence']}"
    split = diagnosis.split
    counts = f"{len(split.fit)} fitted, {len(split.validation)} for validation, {len(split.test)} for the test"
    yield f"Trials: {counts}; {split.description}."


def build_added_term_tables(diagnosis: Diagnosis, final_fit: Fit) -> list[Table]:
    """Return the parameters of the added effects and the corrected numbers, with their 95 % confidence intervals.

    Each is a table, where there are any.
    """
    effects = create_table("effect", "parameter", "value", "95 % interval", "unit", title=text.EFFECTS_TITLE)
    numbers = create_table("number", "declared", "fitted", "95 % interval", "unit", title=text.NUMBERS_TITLE)
    rows = list(zip(final_fit.hypothesis.parameters, final_fit.values, diagnosis.confidence_intervals, strict=True))
    for index, term in enumerate(final_fit.hypothesis.terms):
        for parameter, value, interval in rows:
            if parameter.term_index == index:
                value_text, lower, upper = text.format_interval(value, *interval)
                unit = text.format_parameter_name(parameter, term.channel)[1]
                cells = (value_text, f"{lower} to {upper}", unit or "-")
                if term.number:
                    numbers.add_row(str(term), text.format_number(parameter.initial), *cells)
                else:
                    effects.add_row(str(term), parameter.name, *cells)
    return [table for table in (effects, numbers) if table.row_count]


def build_gap_table(diagnosis: Diagnosis) -> Table:
    """Return the root mean square of measured minus simulated values of each channel."""
    trials = "test trials" if diagnosis.evaluated_on == "test" else "fitted trials (no usable test trial)"
    headings = ("channel", "unit", "nominal", "refitted", "with effects", "repeat noise")
    note = text.describe_weights(diagnosis) or None
    table = create_table(*headings, title=f"Measured - simulated (rms) on {trials}", caption=note)
    for channel, rms in diagnosis.channel_rms.items():
        unit, si = CHANNEL_UNITS[channel]
        nominal, refitted, with_effects = (
            text.format_number(v / si, 3) for v in (rms.nominal, rms.refitted, rms.with_effects)
        )
        noise = "no repeats" if rms.noise_floor is None else text.format_number(rms.noise_floor / si, 3)
        table.add_row(channel, unit, nominal, refitted, with_effects if diagnosis.added_terms else "-", noise)
    return table
