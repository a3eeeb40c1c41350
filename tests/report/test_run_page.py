"""``index.html`` of a run folder: complete, escaped, and without anything from elsewhere."""

import re
from html import unescape
from pathlib import Path

from rich.table import Table
from rich.text import Text

from klute_sim.report.run_page import PAGE_FILE, convert_table, write_run_page

PNG = b"\x89PNG picture"


def write_page(folder: Path) -> str:
    """Write the page of a run with two sentences around a table, a picture and files; return it."""
    table = Table("metric", title=Text("means <b>"))
    table.add_column("mean\nvalue", justify="right")
    table.add_row("net work", "+0.21")
    table.add_row("[bold]trial[/bold] & more", Text("-"))
    for name in ("figure.png", "recording.parquet", "my trial.parquet", ".hidden", ".12-34.figure.png"):
        (folder / name).write_bytes(PNG)
    write_run_page(folder, "Gait <with> a device", ["It walks.", table, "Assumed."], {"figure.png": "curves & bands"})
    return (folder / PAGE_FILE).read_text("utf-8")


def test_page_holds_table_picture_and_links(tmp_path: Path) -> None:
    page = write_page(tmp_path)
    text = unescape(re.sub("<[^>]+>", " ", page))
    positions = [text.index(part) for part in ("It walks.", "means <b>", "net work", "+0.21", "Assumed.", "Files")]
    assert positions == sorted(positions)
    assert "<th class=n>mean value</th>" in page
    assert "<td class=n>+0.21</td>" in page
    assert page.count("<img ") == 1
    assert 'alt="curves &amp; bands"' in page
    links = re.findall(r'<a href="([^"]+)">', page)
    assert links == ["figure.png", "my%20trial.parquet", "recording.parquet"]
    assert "all channels, one row for each time step" in text


def test_names_are_escaped_and_nothing_is_loaded(tmp_path: Path) -> None:
    page = write_page(tmp_path)
    assert "<title>Gait &lt;with&gt; a device</title>" in page
    assert "[bold]trial[/bold] &amp; more" in page
    assert "default-src 'none'" in page
    assert "<script" not in page
    assert not re.search(r'(?:src|href)="(?:https?:|/)', page)


def test_page_of_a_second_run_replaces_the_first(tmp_path: Path) -> None:
    assert write_page(tmp_path) == write_page(tmp_path)
    assert not [file for file in tmp_path.iterdir() if file.name.startswith(".") and PAGE_FILE in file.name]


def test_headings_with_line_breaks_are_joined() -> None:
    table = Table("plantar-\nflexion deg", "net\nwork")
    assert convert_table(table).headings == ["plantarflexion deg", "net work"]
