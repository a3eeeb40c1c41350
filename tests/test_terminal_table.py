"""Every table of the terminal has the same style."""

import ast
from pathlib import Path

from rich.console import Console

from klute_sim.terminal_table import create_table

SOURCE = Path(__file__).parents[1] / "src" / "klute_sim"


def render() -> list[str]:
    table = create_table("name", title="results [bold] of 'a'")
    table.add_column("value", justify="right")
    table.add_row("force", "12.5")
    table.add_row("pressure", "3")
    console = Console(width=80)
    with console.capture() as capture:
        console.print(table)
    return [line.rstrip() for line in capture.get().splitlines()]


def test_table_has_a_line_below_its_headings_and_no_frame() -> None:
    lines = render()
    assert [line for line in lines if set(line) & set("─━┃│┏+|")] == [" " + "─" * 15]
    assert " pressure      3" in lines


def test_long_names_are_folded_and_not_cut() -> None:
    console = Console(width=12)
    table = create_table("parameter")
    table.add_row("stiffness_n_per_mm")
    with console.capture() as capture:
        console.print(table)
    lines = capture.get().splitlines()
    assert "".join(line.strip() for line in lines if "_" in line) == "stiffness_n_per_mm"


def test_brackets_in_a_title_are_no_markup() -> None:
    assert "[bold]" in "".join(render())


def test_no_module_creates_a_table_in_another_style() -> None:
    styled = []
    for file in sorted(SOURCE.rglob("*.py")):
        text = file.read_text("utf-8")
        if "rich.table" not in text:
            continue
        tree = ast.parse(text)
        imports = any(
            isinstance(node, ast.ImportFrom)
            and node.module == "rich.table"
            and any(alias.name == "Table" for alias in node.names)
            for node in ast.walk(tree)
        )
        calls = [
            node
            for node in ast.walk(tree)
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Table"
        ]
        if imports and calls:
            styled.append(file.name)
    assert styled == ["terminal_table.py"]
