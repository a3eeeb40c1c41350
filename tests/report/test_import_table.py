"""Tables of an import: entries that files share are merged, and names are not broken."""

import io
from typing import Any

from rich.console import Console

from klute_sim.report.mocap import table as mocap_table

MARKERS = "R THIGH  1, R THIGH 2, R THIGH 3, R HEEL, R TOE 1, R TOE 2"


def make_entry(file: str, **other: Any) -> dict[str, Any]:
    common = {"channel": "knee centre", "side": "right", "file": file, "column": MARKERS, "unit": "m"}
    return {**common, "sign": 1, "zero": 0.0, "reason": "two clusters (Ehrig et al. 2006), 6.7 mm rms", **other}


def make_result(**more: Any) -> dict[str, Any]:
    return {"files": [{"file": "a.c3d"}, {"file": "b.c3d"}], **more}


def render(table: Any, width: int = 80) -> str:
    out = io.StringIO()
    Console(file=out, width=width).print(table)
    return out.getvalue()


def test_sentences_of_several_files_are_merged_with_the_range_of_their_numbers() -> None:
    sentences = [
        "a.c3d: plate 1 reads -5.0 N with nobody on it",
        "a.c3d: plate 2 reads 4.0 N with nobody on it",
        "The mass given, 60 kg, contradicts",
        "b.c3d: plate 1 reads -5.9 N with nobody on it",
    ]
    assert mocap_table.collect_sentences(make_result(warnings=sentences), "warnings") == [
        "a.c3d, b.c3d: plate 1 reads -5.9 to -5.0 N with nobody on it",
        "a.c3d: plate 2 reads 4.0 N with nobody on it",
        "The mass given, 60 kg, contradicts",
    ]


def test_sentences_of_one_file_are_not_merged() -> None:
    sentences = [
        "a.c3d: nothing tells whose foot is on plate 1 at 0.30 s",
        "a.c3d: nothing tells whose foot is on plate 1 at 0.90 s",
    ]
    assert mocap_table.collect_sentences(make_result(warnings=sentences), "warnings") == sentences


def test_equal_rows_are_merged_and_trivial_columns_are_omitted() -> None:
    entries = [make_entry("a.c3d"), make_entry("b.c3d", reason="two clusters (Ehrig et al. 2006), 5.7 mm rms")]
    text = render(mocap_table.build_channels_table(make_result(channels=entries), all_files=False))
    assert text.count("knee centre") == 1
    assert "5.7 to 6.7 mm" in " ".join(text.split())
    assert "R THIGH 1\u20133" in text
    assert mocap_table.collapse_ranges("C7, T10, S 01, S 02, Fz1, Fz2, Fz3") == "C7, T10, S 01, S 02, Fz1\u20133"
    assert "sign" not in text
    assert "zero" not in text
    inverted = render(
        mocap_table.build_channels_table(
            make_result(channels=[*entries, make_entry("a.c3d", channel="x", sign=-1)]), all_files=False
        )
    )
    assert "sign" in inverted
    assert render(mocap_table.build_channels_table(make_result(channels=entries), all_files=True)).count("knee") == 2


def test_names_are_not_broken_at_80_columns() -> None:
    names = ["pressure_command_of_the_valve", "muscle_length_encoder"]
    entries = [
        make_entry("a.csv", channel="pressure_command", side="prosthesis", column=name, sign=-1, zero=1.5)
        for name in names
    ]
    text = render(mocap_table.build_channels_table(make_result(channels=entries), all_files=False))
    assert all(name in text for name in (*names, "pressure_command "))
    assert max(map(len, text.splitlines())) <= 80
    trial = {
        "sources": ["a_long_name_of_a_trial.c3d", "a_log.csv"],
        "group": "condition_1",
        "strides": 4,
        "stride_time_s": 1.1,
    }
    trial |= {"peak_command_bar": 3.0, "measured": ["ankle_angle", "muscle_length"]}
    text = render(mocap_table.build_trials_table({"trials": [trial, trial]}))
    assert all(name in text for name in ("a_long_name_of_a_trial.c3d", "condition_1", "muscle_length", "4", "1.100"))
    other = {**trial, "sources": ["ground_reaction.mot"], "measured": ["ankle_angle"]}
    mixed = render(mocap_table.build_trials_table({"trials": [{**trial, "sources": ["ground_reaction.mot"]}, other]}))
    assert all(name in mixed for name in ("ground_reaction.mot", "muscle_length", "ankle_angle,"))
