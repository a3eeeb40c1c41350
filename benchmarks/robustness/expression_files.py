"""An expression of ``[columns]`` as a file, its mutations, and a second evaluation that its values must agree with.

The file holds one expression for the force. It is read with a table of its own, so every mutation meets the expression.
What the package accepts is evaluated again from Python's syntax tree, which shares neither parser nor arithmetic with
the package's.
"""

import ast
import json
import random
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from klute_sim.datasets import dataset, unit_conversion
from klute_sim.datasets.column_mapping import parse_mapping
from klute_sim.datasets.trial import read_trial
from klute_sim.types import Array

SUFFIX = ".expression"
"""Suffix of the file."""
EXPRESSION = "(0.392 * `Load cell (raw)` - 4.18) * 4.45 + -stroke / (2 + AIN3) - row * 1e-3 [N]"
"""Intact expression."""
N_ROWS = 30
"""Number of rows of the table."""
RELATIVE_TOLERANCE = 1e-12
"""Tolerance of the second evaluation, which adds in the same order."""
TOKENS = (
    *("0", "1", "2.5", ".5", "5.", "1e308", "1e-320", "1e999", "1_0", "0x1f", "007", "1e", "9" * 400, "nan", "inf"),
    *("stroke", "AIN3", "row", "force", "ROW", "Row.x", "data(:,2)", "data(1,:)", "stroke(:,1)", "__import__", "é"),
    *("`Load cell (raw)`", "`stroke [mm]`", "`", "``", "`missing`", "os.system", "lambda: 0", "'x'", '"', "\\", "\n"),
    *("+", "-", "*", "/", "**", "//", "%", "@", "(", ")", "()", "((", "))", ",", ";", "=", ":=", "--", "+-", "#"),
    *("[N]", "[kgf]", "[lbf]", "[mm]", "[bar]", "[]", "[N", "N]", "[[N]]", "[n]", "[N] [N]", "[N*s]", "[kN] "),
)
"""Tokens that replace others."""

_TOKEN = re.compile(r"`[^`]*`|\[[^\[\]]*\]|[\w.]+|\s+|.", re.DOTALL)
_COLUMN = re.compile(r"`([^`]+)`|(?<![\w.])([^\W\d]\w*(?:\.[^\W\d]\w*)*)(?![\w.])")
_NUMBER = re.compile(r"(?<![\w.])(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


def write_expression(folder: Path) -> list[Path]:
    """Write the intact expression."""
    file = folder / f"force{SUFFIX}"
    file.write_text(EXPRESSION, "utf-8")
    return [file]


def change_expression(content: bytes, rng: random.Random) -> bytes:
    """Return the expression ``content`` with tokens replaced, added, removed, exchanged, nested or repeated."""
    tokens = _TOKEN.findall(content.decode("utf-8", "replace"))
    for _ in range(rng.choice((1, 1, 2, 3, 8))):
        if not tokens:
            break
        first, second = rng.randrange(len(tokens)), rng.randrange(len(tokens))
        match rng.randrange(7):
            case 0:
                tokens[first] = rng.choice(TOKENS)
            case 1:
                tokens.insert(first, rng.choice(TOKENS))
            case 2:
                del tokens[first]
            case 3:
                tokens[first], tokens[second] = tokens[second], tokens[first]
            case 4:
                tokens.insert(first, tokens[second])
            case 5:
                depth, start, end = rng.choice((1, 2, 16, 17, 300)), min(first, second), max(first, second)
                tokens = [*tokens[:start], *["("] * depth, *tokens[start:end], *[")"] * depth, *tokens[end:]]
            case 6:
                start, end = min(first, second), max(first, second)
                tokens = [*tokens[:end], *tokens[start:end] * rng.choice((1, 3, 50)), *tokens[end:]]
    return "".join(tokens).encode("utf-8", "replace")


def use_expression(paths: Sequence[Path]) -> None:
    """Read a trial with the expression, compare its force with a second evaluation, and load its dataset.

    Raises AssertionError where the values differ, and InputError where the expression is refused.
    """
    text, folder = paths[0].read_bytes().decode("utf-8", "replace"), paths[0].parent
    columns = {"t": np.arange(N_ROWS) * 10.0, "stroke": 340.0 + np.sin(np.arange(N_ROWS))}
    columns |= {"AIN3": 1.7 + 0.01 * np.arange(N_ROWS), "Load cell (raw)": 409.0 + np.arange(N_ROWS) % 3}
    headings = ["t [ms]", "stroke [mm]", "AIN3", "Load cell (raw)"]
    rows = [";".join(f"{value:.17g}" for value in row) for row in zip(*columns.values(), strict=True)]
    (folder / "a.csv").write_text("\n".join([";".join(headings), *rows]) + "\n", "utf-8")
    others = {"time": "t", "length": "stroke", "pressure_command": "1 [bar]"}
    expressions = {channel: [each] for channel, each in {**others, "force": text}.items()}
    mapping = parse_mapping(expressions, {}, "bench", "dataset.toml", "trial 'a'")
    force = read_trial([folder / "a.csv"], "bench", mapping).measured["force"].value
    (expression,) = mapping.expressions["force"]
    if expression.unit is not None:
        _compare(
            force, _evaluate(text[: text.rindex("[")], {**columns, "row": np.arange(float(N_ROWS))}), expression.unit
        )
    lines = [f"{name} = {json.dumps(value)}" for name, value in {**others, "force": text}.items()]
    header = 'format = "klute-sim-dataset/2"\nrig = "bench"\ndevice = "klute-3-4-pair"\n[columns]\n'
    (folder / "dataset.toml").write_text(header + "\n".join(lines) + '\n[[trial]]\nfiles = ["a.csv"]\n', "utf-8")
    dataset.load_dataset(folder)


def _compare(force: Array, expected: Array, unit: str) -> None:
    """Raise AssertionError unless ``force`` [N] is ``expected`` in ``unit``; a value that is not finite is missing."""
    factor = unit_conversion.get_si_factor(unit, "N")
    assert factor is not None, f"unit {unit} of no force was accepted"
    with np.errstate(all="ignore"):
        newtons = np.broadcast_to(expected * factor, force.shape)
        is_known = np.isfinite(newtons) & np.isfinite(force)
        tolerance = RELATIVE_TOLERANCE * np.abs(newtons[is_known]).max(initial=0.0)
        difference = np.abs(force[is_known] - newtons[is_known])
    assert np.array_equal(np.isfinite(force), np.isfinite(newtons)), f"{force} has other gaps than {newtons}"
    assert (difference <= tolerance).all(), f"{force} is not {newtons}"


def _evaluate(text: str, columns: Mapping[str, Array]) -> Array:
    """Return the value of the arithmetic ``text`` from Python's syntax tree."""
    names: list[str] = []

    def replace_column(match: re.Match[str]) -> str:
        names.append(match[1] or match[2])
        return f" column_{len(names) - 1} "

    python = _COLUMN.sub(replace_column, _NUMBER.sub(lambda match: f" {float(match[0])!r} ", text))
    by_heading = {**columns, "stroke [mm]": columns["stroke"], "t [ms]": columns["t"]}
    with np.errstate(all="ignore"):
        return _evaluate_node(ast.parse(" ".join(python.split()), mode="eval").body, names, by_heading)


def _evaluate_node(node: ast.expr, names: Sequence[str], columns: Mapping[str, Array]) -> Array:
    if isinstance(node, ast.Constant):
        return np.array([float(str(node.value))])
    if isinstance(node, ast.Name):
        return _find_column(names[int(node.id.removeprefix("column_"))], columns)
    if isinstance(node, ast.UnaryOp):
        operand = _evaluate_node(node.operand, names, columns)
        return -operand if isinstance(node.op, ast.USub) else operand
    assert isinstance(node, ast.BinOp), f"{ast.dump(node)} was accepted"
    left, right = (_evaluate_node(side, names, columns) for side in (node.left, node.right))
    match node.op:
        case ast.Add():
            return left + right
        case ast.Sub():
            return left - right
        case ast.Mult():
            return left * right
        case ast.Div():
            return left / right
    raise AssertionError(f"{ast.dump(node.op)} was accepted")


def _find_column(name: str, columns: Mapping[str, Array]) -> Array:
    """Return the column ``name``; case matters only where two names differ in nothing else."""
    matches = [heading for heading in columns if heading.strip().casefold() == name.strip().casefold()]
    assert len(matches) == 1, f"column {name} was accepted"
    return columns[matches[0]]
