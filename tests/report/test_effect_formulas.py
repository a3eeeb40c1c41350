"""Equations of the catalogue as formulas: nothing is lost, and sentences stay sentences."""

import re

import pytest

from klute_sim.effects import catalogue
from klute_sim.report.effects.formulas import format_equation

EQUATIONS = sorted({form.equation for effect in catalogue.get_effects().values() for form in effect.forms})
LAYOUT = re.compile(r"\\(?:left|right|mathrm|dfrac|frac|Delta|leq|geq|quad|cdot)|\\[ ,]")
"""Commands of LaTeX that stand for no word of an equation."""


def read_characters(text: str) -> str:
    """Return letters and digits of ``text`` in order."""
    return "".join(re.findall(r"[A-Za-z0-9]", LAYOUT.sub("", text)))


@pytest.mark.parametrize("equation", EQUATIONS)
def test_formula_has_every_symbol_of_the_equation_in_its_order(equation: str) -> None:
    markdown = format_equation(equation)
    assert read_characters(markdown) == read_characters(equation)
    assert "$" in markdown or len(markdown.split()) > 3
    assert all(paragraph.count("{") == paragraph.count("}") for paragraph in markdown.split("\n\n"))


@pytest.mark.parametrize(
    ("equation", "formula"),
    [
        ("F += n c v", r"\Delta F = n\,c\,v"),
        ("F -= n c (v + 1)", r"\Delta F = - n\,c\,(v + 1)"),
        ("p <= p_supply", r"p \leq p_{\mathrm{supply}}"),
        ("a b/c d", r"a\,\dfrac{b}{c}\,d"),
        ("a b / (c d)", r"\dfrac{a\,b}{c\,d}"),
        ("a + b / c", r"a + \dfrac{b}{c}"),
        ("P / 2 bar", r"\dfrac{P}{2\,\mathrm{bar}}"),
        ("M / 100 N·m", r"\dfrac{M}{100\,\mathrm{N{\cdot}m}}"),
        ("(a + b)/(c - d)", r"\dfrac{a + b}{c - d}"),
        ("(a b)^2 (c)", r"(a\,b)^{2}\,(c)"),
        ("e^(2/3)", "e^{2/3}"),
        ("D^-1(x)", r"D^{-1}\,(x)"),
        ("dx/dt", r"\dfrac{\mathrm{d}x}{\mathrm{d}t}"),
        ("rho0 sqrt(T0/T)", r"\rho_{0}\,\sqrt{\dfrac{T_{0}}{T}}"),
        ("s |s| gain", r"s\,|s|\,\mathrm{gain}"),
        ("gain command", r"\mathrm{gain}\ \mathrm{command}"),
        ("x, x^2", r"x,\quad x^{2}"),
    ],
)
def test_clause_becomes_a_formula(equation: str, formula: str) -> None:
    assert format_equation(equation) == f"$$\n{formula}\n$$"


def test_clauses_with_function_words_become_sentences() -> None:
    assert format_equation("z follows y when |y - z| reaches play/2") == (
        r"$z$ follows $y$ when $|y - z|$ reaches $\mathrm{play}/2$"
    )
    assert format_equation("F = c x; within the supply's rate") == ("$$\nF = c\\,x\n$$\n\nwithin the supply's rate")
    assert format_equation("lengthening: r v") == "lengthening:\n\n$$\nr\\,v\n$$"


@pytest.mark.parametrize("equation", ["F += (a", "F += a)", "F -= a + b", "a +", "a # b", "|a", "a = / b", "f(a b"])
def test_equation_that_breaks_the_rules_is_an_error(equation: str) -> None:
    with pytest.raises(ValueError, match=r"\w"):
        format_equation(equation)
