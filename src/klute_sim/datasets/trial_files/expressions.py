"""Expressions of ``[columns]`` in ``dataset.toml``: a channel from the columns of a file, with its unit at the end.

    expression = sum ["[" unit "]"]
    sum        = product {("+" | "-") product}
    product    = factor {("*" | "/") factor}
    factor     = ["+" | "-"] (number | column | "(" sum ")")
    column     = name | "`" heading "`"

A name consists of letters, digits, ``_`` and ``.``, and may select a part of a matrix: ``data(:,3)``. Expressions are
parsed here and never reach Python's interpreter.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from klute_sim.datasets import unit_conversion
from klute_sim.errors import InputError
from klute_sim.types import Array

MAX_EXPRESSION_LENGTH = 400
"""Largest number of letters of an expression."""
OPERAND_ADVICE = (
    "; write * for a product, square brackets around a unit, and backticks around the name of a column with spaces or "
    "parentheses: `Load cell (N)`"
)
"""What to write where a number or a name is not expected."""
MAX_DEPTH = 16
"""Deepest nesting of parentheses."""
ROW = "row"
"""Name of the number of the row, counted from 0, where no column is called so."""

_TOKEN = re.compile(
    r"""\s*(?:
        (?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?(?![\w.]))
      | `(?P<heading>[^`]+)`
      | (?P<name>[^\W\d]\w*(?:\.[^\W\d]\w*)*(?:\(\s*(?::\s*,\s*\d+|\d+\s*,\s*:)\s*\))?)
      | (?P<operator>[-+*/()])
      | \[(?P<unit>[^\[\]]*)\]\s*$
    )""",
    re.VERBOSE,
)
_OPERATIONS = {"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide}


@dataclass(frozen=True)
class Expression:
    """A parsed expression."""

    text: str
    """Expression as written."""
    label: str
    """Table and channel for error messages, such as ``[columns] force``."""
    columns: tuple[str, ...]
    """Names and headings of the columns in it, each once."""
    unit: str | None
    """Unit of the result; None for a column whose heading has one."""
    _program: tuple[float | str, ...] = field(repr=False)
    """Operands and operators in reverse Polish notation; a column has a backtick before its name."""

    @property
    def only_column(self) -> str | None:
        """Name of the column if the expression consists of nothing else."""
        return self.columns[0] if len(self._program) == 1 and self.columns else None

    def evaluate(self, values: Mapping[str, Array]) -> Array:
        """Return the result for the samples of each column; one without columns has one value."""
        stack: list[Array] = []
        with np.errstate(all="ignore"):
            for item in self._program:
                if isinstance(item, float):
                    stack.append(np.array([item]))
                elif item.startswith("`"):
                    stack.append(values[item[1:]])
                elif item == "negative":
                    stack.append(-stack.pop())
                else:
                    right, left = stack.pop(), stack.pop()
                    stack.append(_OPERATIONS[item](left, right))
        return stack[0]


def parse_expression(text: str, si_unit: str, label: str, source: str) -> Expression:
    """Return the parsed ``text`` of a channel in ``si_unit``; ``source`` and ``label`` begin the sentences of errors.

    Raises InputError, with the position, for anything that is not an expression, and for a missing or wrong unit.
    """
    place = f"{source}: {label}"
    parser = _Parser(text, place)
    program = parser.parse()
    columns = tuple(dict.fromkeys(item[1:] for item in program if isinstance(item, str) and item.startswith("`")))
    expression = Expression(text, label, columns, parser.unit, tuple(program))
    if parser.unit is None and not expression.only_column:
        example = unit_conversion.EXAMPLE_UNITS[si_unit].split(",")[0]
        raise InputError(f"{place} = '{text}' has no unit at its end; write for example '... [{example}]'")
    if parser.unit is not None and unit_conversion.get_si_factor(parser.unit, si_unit) is None:
        raise InputError(f"{place} = '{text}' has {unit_conversion.describe_wrong_unit(parser.unit, si_unit)}")
    return expression


class _Token:
    def __init__(self, match: re.Match[str]) -> None:
        self.kind = match.lastgroup or ""
        self.text = match[self.kind].strip()
        self.position = match.start(self.kind) + 1


class _Parser:
    """Recursive descent over the tokens of an expression, within limits."""

    def __init__(self, text: str, place: str) -> None:
        self.text, self.place = text, place
        self.unit: str | None = None
        self.program: list[float | str] = []
        self.depth = self.index = 0
        self.tokens = self._split()

    def parse(self) -> Sequence[float | str]:
        """Return the program of the whole expression."""
        self._parse_sum()
        if self.index < len(self.tokens):
            raise self._refuse(self.tokens[self.index])
        return self.program

    def _split(self) -> list[_Token]:
        if len(self.text) > MAX_EXPRESSION_LENGTH:
            raise InputError(
                f"{self.place} has {len(self.text)} letters; allowed: expressions of up to {MAX_EXPRESSION_LENGTH}"
            )
        tokens, position = [], 0
        while self.text[position:].strip():
            match = _TOKEN.match(self.text, position)
            if match is None:
                start = position + len(self.text[position:]) - len(self.text[position:].lstrip())
                raise self._error(
                    start + 1,
                    f"'{self.text[start:][:20]}' is not understood; allowed: numbers, columns (in backticks if they "
                    "have other letters than those of names), + - * / ( ) and a unit in square brackets at the end",
                )
            token = _Token(match)
            if token.kind == "unit":
                self.unit = token.text
            else:
                tokens.append(token)
            position = match.end()
        return tokens

    def _parse_sum(self) -> None:
        self._parse_product()
        while operator := self._take("+", "-"):
            self._parse_product()
            self.program.append(operator)

    def _parse_product(self) -> None:
        self._parse_factor()
        while operator := self._take("*", "/"):
            self._parse_factor()
            self.program.append(operator)

    def _parse_factor(self) -> None:
        sign = self._take("+", "-")
        if self.index == len(self.tokens):
            raise self._error(len(self.text) + 1, "a number, a column or '(' is missing")
        token = self.tokens[self.index]
        self.index += 1
        if token.text == "(" and token.kind == "operator":
            self.depth += 1
            if self.depth > MAX_DEPTH:
                raise self._error(token.position, f"more than {MAX_DEPTH} parentheses are nested")
            self._parse_sum()
            self.depth -= 1
            if not self._take(")"):
                # Two operands without an operator end the sum, too.
                is_end = self.index == len(self.tokens)
                raise (
                    self._error(token.position, "'(' is not closed")
                    if is_end
                    else self._refuse(self.tokens[self.index])
                )
        elif token.kind == "operator":
            raise self._error(token.position, f"'{token.text}' is not expected; a number, a column or '(' is")
        else:
            self.program.append(self._read_operand(token))
        if sign == "-":
            self.program.append("negative")

    def _read_operand(self, token: _Token) -> float | str:
        if token.kind != "number":
            name = re.sub(r"\s", "", token.text) if token.kind == "name" else token.text
            return f"`{name}"
        number = float(token.text)
        if not np.isfinite(number):
            raise self._error(token.position, f"'{token.text}' is too large")
        return number

    def _take(self, *operators: str) -> str:
        """Return the next token and go on if it is one of ``operators``, '' otherwise."""
        if self.index < len(self.tokens):
            token = self.tokens[self.index]
            if token.kind == "operator" and token.text in operators:
                self.index += 1
                return token.text
        return ""

    def _refuse(self, token: _Token) -> InputError:
        is_operand = token.kind in ("number", "name", "heading") or token.text == "("
        return self._error(token.position, f"'{token.text}' is not expected{OPERAND_ADVICE if is_operand else ''}")

    def _error(self, position: int, reason: str) -> InputError:
        return InputError(f"{self.place} = '{self.text}', position {position}: {reason}")
