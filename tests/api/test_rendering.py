"""Summaries of results in a terminal and in a notebook."""

import pytest
from rich.table import Table

from klute_sim.api.rendering import Printable, Summary


class Result(Printable):
    """A result of one sentence and one table."""

    def format_summary(self) -> Summary:
        """Yield the sentence and the table."""
        table = Table("trial", title="Work <net>")
        table.add_column("work [J]", justify="right")
        table.add_row("a & b", "+0.21")
        yield "It works [bold]well[/bold] & long."
        yield table


def test_text_is_the_same_in_a_notebook(monkeypatch: pytest.MonkeyPatch) -> None:
    text = str(Result())
    assert "It works [bold]well[/bold] & long." in text
    assert "+0.21" in text
    monkeypatch.setattr("rich.console._is_jupyter", lambda: True)
    assert str(Result()) == text


def test_notebook_shows_sentences_and_tables_escaped() -> None:
    html = Result()._repr_html_()
    assert "<p>It works [bold]well[/bold] &amp; long.</p>" in html
    assert ">Work &lt;net&gt;</caption>" in html
    assert '<th style="text-align: right">work [J]</th>' in html
    assert '<td style="text-align: left">a &amp; b</td><td style="text-align: right">+0.21</td>' in html
