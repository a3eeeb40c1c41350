"""Equations of the catalogue, which are lines of text, as Markdown with formulas in LaTeX.

An equation has clauses, such as ``F += n k u, du/dx = 1 - u sign(dx)/r, r = slope P / k``. Factors stand side by side;
a slash without spaces divides the factors beside it, one with spaces all factors up to the next sum. A clause with a
word of :data:`FUNCTION_WORDS` is a sentence with formulas in it; any other is a formula on a line of its own.
"""

import re
from collections.abc import Sequence
from itertools import groupby, pairwise
from typing import NamedTuple

FUNCTION_WORDS = {
    *("acts", "and", "as", "at", "between", "by", "each", "follows", "in", "is", "most"),
    *("not", "of", "or", "over", "the", "times", "to", "up", "when", "while", "within"),
}
"""Words that make a clause a sentence."""
GREEK_LETTERS = {"beta", "eta", "gamma", "lambda", "nu", "phi", "pi", "rho", "tau", "zeta"}
OPERATORS = {"exp", "int", "log", "max", "min", "sum", "tanh"}
"""Names that LaTeX sets upright or as a sign; a sum has an index."""
RELATIONS = {"=": "=", "<=": r"\leq", ">=": r"\geq", "+=": "=", "-=": "= -"}
"""Relation -> LaTeX; the left side of ``F += x`` becomes the change of F."""
OPERATION_SIGNS = {"+", "-", "/", "/ ", "^", *RELATIONS}
"""Signs that make the word beside them a quantity."""
TOKEN = re.compile(
    r"(?P<space>\s*)(?:(?P<quantity>\d+(?:\.\d+)? (?:bar|deg|mm/s|mm|kN|N·m)\b)|(?P<number>\d+(?:\.\d+)?)"
    r"|(?P<word>[a-z]+'s)|(?P<name>[A-Za-z]+\d*(?:_[A-Za-z0-9]+)?'?)|(?P<symbol>/ |[+\-<>]=|[=+\-/^()|,;:]))"
)


class Token(NamedTuple):
    """Part of an equation."""

    kind: str
    """Name of its group in :data:`TOKEN`."""
    text: str
    follows_space: bool


def format_equation(equation: str) -> str:
    """Return ``equation`` as paragraphs of Markdown: formulas between double dollar signs, and sentences.

    Raises ValueError for an equation that does not follow the rules of this module.
    """
    paragraphs = []
    for is_entry, group in groupby(_split_clauses(_split_tokens(equation)), _is_list_entry):
        clauses = list(group)
        if is_entry:
            paragraphs.append(_format_block(*clauses))
        else:
            paragraphs += [(_format_sentence if _is_sentence(clause) else _format_block)(clause) for clause in clauses]
    return "\n\n".join(paragraphs)


def _format_block(*clauses: Sequence[Token]) -> str:
    """Return the formulas of ``clauses`` beside each other, on a line of their own."""
    formulas = r",\quad ".join(_Parser(clause).format() for clause in clauses)
    return f"$$\n{formulas}\n$$"


def _split_tokens(equation: str) -> list[Token]:
    tokens, position = [], 0
    while position < len(equation):
        match = TOKEN.match(equation, position)
        if match is None:
            raise ValueError(f"no formula can be read at '{equation[position:]}' in '{equation}'")
        tokens.append(Token(str(match.lastgroup), match[match.lastgroup or 0], bool(match["space"])))
        position = match.end()
    return tokens


def _split_clauses(tokens: Sequence[Token]) -> list[list[Token]]:
    """Return the clauses without the commas and semicolons between them; a colon stays at the end of its clause."""
    clauses: list[list[Token]] = [[]]
    depth = 0
    for token in tokens:
        depth += (token.text == "(") - (token.text == ")")
        if depth == 0 and token.text in (",", ";", ":"):
            clauses[-1] += [token] if token.text == ":" else []
            clauses.append([])
        else:
            clauses[-1].append(token)
    return clauses


def _is_sentence(clause: Sequence[Token]) -> bool:
    return clause[-1].text == ":" or any(token.text in FUNCTION_WORDS for token in clause)


def _is_list_entry(clause: Sequence[Token]) -> bool:
    return not _is_sentence(clause) and not any(token.text in RELATIONS for token in clause)


def _format_sentence(clause: Sequence[Token]) -> str:
    """Return the words as they are, and what stands between them as formulas in the line."""
    padded = [Token("symbol", "", True), *clause, Token("symbol", "", True)]
    is_math = [_is_math(*padded[k - 1 : k + 2]) for k in range(1, len(clause) + 1)]
    parts = []
    for math, group in groupby(zip(is_math, clause, strict=True), lambda pair: pair[0]):
        tokens = [token for _, token in group]
        words = " ".join(token.text for token in tokens)
        parts.append(f"${_Parser(tokens, in_line=True).format()}$" if math else words)
    return " ".join(parts).replace(" :", ":")


def _is_math(before: Token, token: Token, after: Token) -> bool:
    """Return whether ``token`` belongs to a formula: all but words, and words with an operator beside them."""
    if token.text == ":":
        return False
    if token.kind not in ("name", "word") or len(token.text) == 1 or not token.text.isalpha():
        return token.kind != "word"
    if token.text in GREEK_LETTERS | OPERATORS or _is_differential(token.text):
        return True
    is_call = after.text == "(" and not after.follows_space
    return is_call or any(beside.text in OPERATION_SIGNS for beside in (before, after))


def _is_differential(name: str) -> bool:
    return len(name) > 1 and name[0] == "d" and (len(name) == 2 or re.sub(r"_.*", "", name[1:]) in GREEK_LETTERS)


class _Parser:
    """Formula of one clause, read from left to right."""

    def __init__(self, tokens: Sequence[Token], *, in_line: bool = False) -> None:
        self.tokens, self.in_line = [*tokens, Token("end", "", True)], in_line
        self.position, self.bars = 0, 0

    @property
    def token(self) -> Token:
        return self.tokens[self.position]

    def take(self) -> str:
        self.position += 1
        return self.tokens[self.position - 1].text

    def format(self) -> str:
        formula = self.format_relation()
        if self.token.kind != "end":
            raise ValueError(f"'{self.token.text}' stands where a formula ends, after '{formula}'")
        return formula

    def format_relation(self) -> str:
        formula = self.format_sum()
        while self.token.text in RELATIONS:
            relation = self.take()
            change = r"\Delta " if relation in ("+=", "-=") else ""
            side = self.format_quotient() if relation == "-=" else self.format_sum()
            formula = f"{change}{formula} {RELATIONS[relation]} {side}"
        return formula

    def format_sum(self) -> str:
        formula = self.take() if self.token.text == "-" else ""
        formula += self.format_quotient()
        while self.token.text in ("+", "-"):
            formula += f" {self.take()} {self.format_quotient()}"
        return formula

    def format_quotient(self) -> str:
        """Return a product, or one over another where the slash has spaces around it."""
        formula = self.format_product()
        while self.token.text == "/ ":
            self.take()
            formula = self.format_fraction(formula, self.format_product())
        return formula

    def format_product(self) -> str:
        factors: list[tuple[str, bool]] = []
        while self.token.kind in ("quantity", "number", "name") or self.token.text in ("(", "|"):
            if self.token.text == "|" and self.bars:
                break
            is_word = self.token.text.isalpha() and _format_symbol(self.token.text).startswith(r"\mathrm")
            formula = self.format_power()
            while self.token.text == "/":
                self.take()
                formula, is_word = self.format_fraction(formula, self.format_power()), False
            factors.append((formula, is_word))
        if not factors:
            raise ValueError(f"a factor is missing before '{self.token.text}'")
        spaces = [r"\ " if left[1] and right[1] else r"\," for left, right in pairwise(factors)]
        return "".join(formula + space for (formula, _), space in zip(factors, [*spaces, ""], strict=True))

    def format_fraction(self, above: str, below: str) -> str:
        if self.in_line:
            return f"{above}/{below}"
        above, below = (_strip_brackets(part).replace(r"\dfrac", r"\frac") for part in (above, below))
        return rf"\dfrac{{{above}}}{{{below}}}"

    def format_power(self) -> str:
        formula = self.format_primary()
        if self.token.text != "^":
            return formula
        self.take()
        sign = self.take() if self.token.text == "-" else ""
        in_line, self.in_line = self.in_line, True
        exponent = _strip_brackets(self.format_primary())
        self.in_line = in_line
        return f"{formula}^{{{sign}{exponent}}}"

    def format_primary(self) -> str:
        """Return a number, a name with the arguments of its call, or what stands in brackets or bars."""
        token = self.token
        if token.kind not in ("quantity", "number", "name") and token.text not in ("(", "|"):
            raise ValueError(f"a factor is missing before '{token.text}'")
        if token.text == "(":
            return self.format_brackets()
        self.take()
        if token.text == "|":
            self.bars += 1
            formula = self.format_sum()
            self.bars -= 1
            if self.take() != "|":
                raise ValueError(f"a bar is missing after '{formula}'")
            return f"|{formula}|"
        if token.kind == "number":
            return token.text
        if token.kind == "quantity":
            number, unit = token.text.split()
            upright = unit.replace("·", r"{\cdot}")
            return rf"{number}\,\mathrm{{{upright}}}"
        if self.token.text != "(" or self.token.follows_space:
            return _format_name(token.text)
        if token.text == "sqrt":
            return rf"\sqrt{{{_strip_brackets(self.format_brackets())}}}"
        return _format_name(token.text) + self.format_brackets()

    def format_brackets(self) -> str:
        bars, self.bars = self.bars, 0
        self.take()
        arguments = [self.format_relation()]
        while self.token.text == ",":
            self.take()
            arguments.append(self.format_relation())
        if self.take() != ")":
            raise ValueError(f"a bracket is missing after '{arguments[-1]}'")
        self.bars = bars
        content = ", ".join(arguments)
        return rf"\left({content}\right)" if "frac" in content else f"({content})"


def _strip_brackets(formula: str) -> str:
    """Return ``formula`` without brackets around all of it."""
    for opening, closing in ((r"\left(", r"\right)"), ("(", ")")):
        if formula.startswith(opening) and formula.endswith(closing):
            inner = formula[len(opening) : -len(closing)]
            depths = [inner[:k].count("(") - inner[:k].count(")") for k in range(len(inner) + 1)]
            return inner if min(depths) >= 0 else formula
    return formula


def _format_name(name: str) -> str:
    """Return a symbol in italics, with its index, and any other name upright."""
    match = re.fullmatch(r"([A-Za-z]+)(\d*)(?:_([A-Za-z0-9]+))?('?)", name)
    if match is None:
        raise ValueError(f"'{name}' is no name")
    base, number, index, prime = match.groups()
    is_differential = _is_differential(base)
    symbol = r"\mathrm{d}" + _format_symbol(base[1:]) if is_differential else _format_symbol(base)
    index = number or index
    if index and len(index) > 1 and not index.isdigit():
        index = rf"\mathrm{{{index}}}"
    return (f"{symbol.rstrip()}_{{{index}}}" if index else symbol) + prime


def _format_symbol(base: str) -> str:
    if base in GREEK_LETTERS | OPERATORS:
        return f"\\{base} "
    return base if len(base) == 1 else rf"\mathrm{{{base}}}"
