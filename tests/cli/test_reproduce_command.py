"""Tests of ``klute-sim reproduce`` and ``klute-sim assumptions`` from the command line to the files."""

import json
import re
from pathlib import Path

import pytest

from tests.command_line import run

VERDICTS = {"agrees", "contradicts-source", "source-contradicts-itself", "not-printed"}


@pytest.mark.slow
def test_reproduction_writes_page_with_figures(tmp_path: Path) -> None:
    numbers = tmp_path / "numbers.toml"
    numbers.write_text('"table-4.1.bore" = 20.0\n', "utf-8")
    completed = run("reproduce", "--out", "result", "--published", "numbers.toml", "--json", cwd=tmp_path)
    assert completed.returncode == 0, completed.stderr
    content = json.loads(completed.stdout)
    items = content["items"]
    assert len(items) == sum(sum(by_verdict.values()) for by_verdict in content["counts"].values())
    keys = {"item", "quantity", "unit", "published", "computed", "kind", "tolerance", "criterion", "verdict", "note"}
    assert all(keys <= set(item) for item in items)
    assert {item["verdict"] for item in items} == VERDICTS
    assert next(item for item in items if item["item"] == "table-4.1.bore")["verdict"] == "agrees"
    assert json.loads((tmp_path / "result" / "items.json").read_text("utf-8")) == content
    page = (tmp_path / "result" / "index.html").read_text("utf-8")
    assert all(f'id="{item["item"]}"' in page for item in items)
    assert page.index(content["headline"]) < page.index("Independent numbers") < page.index("Tables and figures")
    assert content["other_kinds"] in page
    assert page.count("(read once)") == sum(not item["checked"] for item in items) == 6
    assert "± 7.34 N: 1 % of the reading" in page
    folded = "".join(re.findall(r"<details>.*?</details>", page, re.DOTALL))
    for item in items:
        if item["verdict"] != "agrees":
            assert f'<tr id="{item["item"]}"' not in folded
    n_agreeing = sum(by_verdict["agrees"] for by_verdict in content["counts"].values())
    assert folded.count('<td class="v agrees">') == n_agreeing
    figures = sorted(file.name for file in (tmp_path / "result").glob("fig-*.png"))
    assert "fig-3.9.png" in figures
    assert page.count("data:image/png;base64,") == len(figures) >= 22
    assert "<script" not in page
    assert "http:" not in page


@pytest.mark.long
def test_output_begins_with_independent_numbers(tmp_path: Path) -> None:
    completed = run("reproduce", cwd=tmp_path)
    assert completed.returncode == 0, completed.stderr
    content = json.loads((tmp_path / "runs" / "reproduce-001" / "items.json").read_text("utf-8"))
    assert completed.stdout.splitlines()[0] == content["headline"]
    assert completed.stdout.index("Independent numbers") < completed.stdout.index("Other items that do not agree")
    assert "734" in completed.stdout
    assert (tmp_path / "runs" / "reproduce-001" / "index.html").is_file()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("reproduce", "--device", "klute-3-4"), "has no damper"),
        (("reproduce", "--published", "none.toml"), "none.toml cannot be read"),
        (("assumptions", "klute"), "no device 'klute'"),
        (("reproduce", "--missing", "--json"), "leave out all other options"),
    ],
)
def test_invalid_input_raises_one_sentence(tmp_path: Path, arguments: tuple[str, ...], message: str) -> None:
    completed = run(*arguments, cwd=tmp_path)
    assert completed.returncode == 2
    assert message in completed.stderr
    assert completed.stderr.count("\n") == 1
    assert not (tmp_path / "runs").exists()


def test_missing_numbers_are_printed_as_template(tmp_path: Path) -> None:
    completed = run("reproduce", "--missing", cwd=tmp_path)
    assert completed.returncode == 0
    assert (
        '# "table-8.1.p5-v100" =   # pressure while shortening: net work of the device per cycle at 5 bar, 100 mm/s [J]'
        in completed.stdout
    )
    assert not (tmp_path / "runs").exists()


def test_assumptions_have_reasons_and_changes(tmp_path: Path) -> None:
    completed = run("assumptions", "klute-3-4-pair", "--json", cwd=tmp_path)
    assert completed.returncode == 0, completed.stderr
    rows = {row["key"]: row for row in json.loads(completed.stdout)["klute-3-4-pair"]}
    assert "Table 4.1 is missing" in rows["damper.bore_mm"]["why"]
    assert abs(rows["damper.bore_mm"]["changes"]["force shortening at 300 mm/s"]) > 0.05
    table = run("assumptions", "klute-1-2", cwd=tmp_path).stdout
    assert "room temperature" in table.replace("\n", " ")
    text = run("device", "klute-1-2", "--toml", cwd=tmp_path).stdout
    (tmp_path / "plain.toml").write_text(text[: text.index("[sources]")], "utf-8")
    assert "no number is marked as assumed" in run("assumptions", "plain.toml", cwd=tmp_path).stdout


@pytest.mark.long
def test_gait_option_adds_gait_metrics(tmp_path: Path) -> None:
    text = run("device", "klute-1-1-4-pair", "--toml", cwd=tmp_path).stdout
    lines = [line for line in text.splitlines() if '= "assumed' not in line or "slack_length" in line]
    (tmp_path / "one.toml").write_text("\n".join(lines) + "\n", "utf-8")
    completed = run("assumptions", "one.toml", "--gait", "--json", cwd=tmp_path)
    assert completed.returncode == 0, completed.stderr
    (row,) = next(iter(json.loads(completed.stdout).values()))
    assert row["key"] == "tendon.slack_length_mm"
    assert "gait: peak net moment" in row["changes"]
