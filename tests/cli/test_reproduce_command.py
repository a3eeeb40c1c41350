"""``klute-sim reproduce`` and ``klute-sim assumptions``, from the command line to the files."""

import json
from pathlib import Path

import pytest

from tests.command_line import run

VERDICTS = {"agrees", "contradicts-source", "source-contradicts-itself", "not-printed"}


def test_the_dissertation_is_written_as_a_page_with_pictures(tmp_path: Path) -> None:
    numbers = tmp_path / "numbers.toml"
    numbers.write_text('"table-4.1.bore" = 20.0\n', "utf-8")
    done = run("reproduce", "--out", "found", "--published", "numbers.toml", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    items = json.loads(done.stdout)
    assert len(items) >= 60
    assert all({"item", "quantity", "unit", "published", "computed", "verdict", "note"} <= set(item) for item in items)
    assert {item["verdict"] for item in items} == VERDICTS
    assert next(item for item in items if item["item"] == "table-4.1.bore")["verdict"] == "agrees"
    assert json.loads((tmp_path / "found" / "items.json").read_text("utf-8")) == items
    page = (tmp_path / "found" / "report.html").read_text("utf-8")
    assert all(f'id="{item["item"]}"' in page for item in items)
    assert "How far is the model from the measurements at 5 bar?" in page
    pictures = sorted(file.name for file in (tmp_path / "found").glob("fig-*.png"))
    assert "fig-3.9.png" in pictures
    assert page.count("data:image/png;base64,") == len(pictures) >= 22
    assert "<script" not in page
    assert "http:" not in page


@pytest.mark.long
def test_the_table_begins_with_what_was_measured(tmp_path: Path) -> None:
    done = run("reproduce", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    first = done.stdout.splitlines()[0].strip()
    assert first == "Measured at 5 bar, and the model"
    assert "734" in done.stdout
    assert (tmp_path / "runs" / "reproduce-001" / "report.html").is_file()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("reproduce", "--device", "klute-3-4"), "has no damper"),
        (("reproduce", "--published", "none.toml"), "none.toml cannot be read"),
        (("assumptions", "klute"), "no device 'klute'"),
        (("reproduce", "--missing", "--json"), "no other option goes with it"),
    ],
)
def test_bad_input_is_one_sentence(tmp_path: Path, arguments: tuple[str, ...], says: str) -> None:
    done = run(*arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert says in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "runs").exists()


def test_missing_numbers_are_listed_to_fill_in(tmp_path: Path) -> None:
    done = run("reproduce", "--missing", cwd=tmp_path)
    assert done.returncode == 0
    assert (
        '# "table-8.1.p5-v100" =   # pressure while shortening: net work of the device per cycle at 5 bar, 100 mm/s [J]'
        in done.stdout
    )
    assert not (tmp_path / "runs").exists()


def test_assumptions_say_why_and_what_they_change(tmp_path: Path) -> None:
    done = run("assumptions", "klute-3-4-pair", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    rows = {row["key"]: row for row in json.loads(done.stdout)["klute-3-4-pair"]}
    assert "Table 4.1 is missing" in rows["damper.bore_mm"]["why"]
    assert abs(rows["damper.bore_mm"]["changes"]["force shortening at 300 mm/s"]) > 0.05
    table = run("assumptions", "klute-1-2", cwd=tmp_path).stdout
    assert "room temperature" in table.replace("\n", " ")
    text = run("device", "klute-1-2", "--toml", cwd=tmp_path).stdout
    (tmp_path / "plain.toml").write_text(text[: text.index("[sources]")], "utf-8")
    assert "no number is marked as assumed" in run("assumptions", "plain.toml", cwd=tmp_path).stdout


@pytest.mark.long
def test_a_walk_is_tried_with_every_assumption_if_asked(tmp_path: Path) -> None:
    text = run("device", "klute-1-1-4-pair", "--toml", cwd=tmp_path).stdout
    kept = [line for line in text.splitlines() if '= "assumed' not in line or "slack_length" in line]
    (tmp_path / "one.toml").write_text("\n".join(kept) + "\n", "utf-8")
    done = run("assumptions", "one.toml", "--gait", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    (row,) = next(iter(json.loads(done.stdout).values()))
    assert row["key"] == "tendon.slack_length_mm"
    assert "walking: peak net moment" in row["changes"]
