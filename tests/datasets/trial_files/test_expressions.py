"""Expressions of ``[columns]``: values, units, limits, and the position of errors."""

from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from klute_sim.datasets.trial_files.expressions import MAX_DEPTH, Expression, parse_expression
from klute_sim.errors import InputError


def parse(text: str) -> Expression:
    return parse_expression(text, "N", "[columns] force", "x")


def evaluate(text: str, **columns: float) -> float:
    values = {name: np.array([value]) for name, value in columns.items()}
    return float(parse(text).evaluate(values)[0])


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("(0.392 * a - 4.18) * 4.45 [N]", (0.392 * 7.0 - 4.18) * 4.45),
        ("a - b - 1 [N]", 7.0 - 3.0 - 1.0),
        ("a / b / 2 [N]", 7.0 / 3.0 / 2.0),
        ("a + b * 2 [N]", 7.0 + 3.0 * 2.0),
        ("-a * b [N]", -21.0),
        ("2 * -(a - b) [N]", -8.0),
        ("1.5e-3*a[kN]", 0.0105),
        (".5 * +a [N]", 3.5),
        ("5 [N]", 5.0),
    ],
)
def test_expressions_follow_the_rules_of_arithmetic(text: str, value: float) -> None:
    assert evaluate(text, a=7.0, b=3.0) == pytest.approx(value, rel=1e-15)


leaves = st.one_of(st.integers(0, 99).map(str), st.sampled_from(["a", "b"]))


def combine(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    chains = st.tuples(inner, st.sampled_from("+-*"), inner).map(" ".join)
    return st.one_of(chains, inner.map("({})".format), inner.map("-({})".format))


sums = st.recursive(leaves, combine, max_leaves=12)


@given(sums)
def test_any_expression_has_the_value_that_python_gives(text: str) -> None:
    values = {"a": 3.0, "b": -0.5}
    expected = eval(text, {}, values)  # written by the strategy above, from numbers and two names
    assert evaluate(f"{text} [N]", **values) == pytest.approx(float(expected), rel=1e-12, abs=1e-9)


@given(st.text(alphabet="ab1.[]()`+-*/: ,N\n\0µ", max_size=40))
def test_any_text_is_parsed_or_refused(text: str) -> None:
    with suppress(InputError):  # and no other exception
        parse(text)


def test_columns_are_names_headings_and_parts_of_matrices() -> None:
    expression = parse("run.force + `Load cell (raw) [V]` * data(:, 3) + data(2,:) - run.force [N]")
    assert expression.columns == ("run.force", "Load cell (raw) [V]", "data(:,3)", "data(2,:)")
    assert expression.unit == "N"
    assert expression.only_column is None


@pytest.mark.parametrize(("text", "unit"), [("stroke", None), ("stroke [kN]", "kN"), ("`Load cell` [ N ]", "N")])
def test_a_column_alone_may_omit_its_unit(text: str, unit: str | None) -> None:
    expression = parse(text)
    assert expression.only_column in ("stroke", "Load cell")
    assert expression.unit == unit


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("Load cell", "backticks around the name of a column with spaces or parentheses: `Load cell (N)`"),
        ("2 raw [N]", "position 3: 'raw' is not expected; write * for a product, square brackets around a unit, and"),
        ("4.45 N", "position 6: 'N' is not expected; write * for a product, square brackets around a unit, and"),
        ("(a [N]", "position 1: '(' is not closed"),
        ("(0.392 a - 4.18) * 4.45 [N]", "position 8: 'a' is not expected; write * for a product, square brackets"),
        ("((a + 1) [N]", "position 1: '(' is not closed"),
        ("a) [N]", "position 2: ')' is not expected"),
        ("a * / b [N]", "position 5: '/' is not expected; a number, a column or '(' is"),
        ("a + [N]", "position 8: a number, a column or '(' is missing"),
        ("", "position 1: a number, a column or '(' is missing"),
        ("a [N] + b", "position 3: '[N] + b' is not understood; allowed: numbers, columns (in backticks if"),
        ("a ^ 2 [N]", "position 3: '^ 2 [N]' is not understood"),
        ("2a [N]", "position 1: '2a [N]' is not understood"),
        ("`a [N]", "position 1: '`a [N]' is not understood"),
        ("__import__('os')", "position 12: ''os')' is not understood"),
        ("1e999 * a [N]", "position 1: '1e999' is too large"),
        ("2 * a", "= '2 * a' has no unit at its end; write for example '... [N]'"),
        ("2 * a [mm]", "has a unit of the wrong kind; allowed: N, kN, kgf, lbf and other units of that kind"),
        ("a [Newton]", "has the unknown unit 'Newton'; did you mean 'N'? Allowed: N, kN, kgf, lbf and other units"),
        ("a [nope]", "has the unknown unit 'nope'; allowed: N, kN, kgf, lbf and other units of that kind"),
        ("a [V]", "has a unit of the wrong kind; allowed: N, kN"),
        ("a []", "has a unit of the wrong kind"),
        ("(" * 17 + "a" + ")" * 17 + " [N]", f"position 17: more than {MAX_DEPTH} parentheses are nested"),
        ("a" * 401, "x: [columns] force has 401 letters; allowed: expressions of up to 400"),
    ],
)
def test_errors_name_the_position_and_what_is_allowed(text: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        parse(text)
    sentence = str(caught.value)
    assert sentence.startswith("x: [columns] force")
    assert message in sentence
