"""What an import says in a terminal: what several files share once, and no name cut."""

import io
from typing import Any

from rich.console import Console

from klute_sim.report.mocap import table as mocap_table

MARKERS = "R THIGH  1, R THIGH 2, R THIGH 3, R HEEL, R TOE 1, R TOE 2"


def entry(file: str, **other: Any) -> dict[str, Any]:
    common = {"channel": "knee centre", "side": "right", "file": file, "column": MARKERS, "unit": "m"}
    return {**common, "sign": 1, "zero": 0.0, "why": "two clusters (Ehrig et al. 2006), 6.7 mm rms", **other}


def result(**more: Any) -> dict[str, Any]:
    return {"found": [{"file": "a.c3d"}, {"file": "b.c3d"}], **more}


def shown(table: Any, width: int = 80) -> str:
    out = io.StringIO()
    Console(file=out, width=width).print(table)
    return out.getvalue()


def test_what_is_told_of_several_files_is_said_once_with_its_span() -> None:
    said = [
        "a.c3d: plate 1 reads -5.0 N with nobody on it",
        "a.c3d: plate 2 reads 4.0 N with nobody on it",
        "The mass given, 60 kg, contradicts",
        "b.c3d: plate 1 reads -5.9 N with nobody on it",
    ]
    assert mocap_table.collect_sentences(result(suspicious=said), "suspicious") == [
        "a.c3d, b.c3d: plate 1 reads -5.9 to -5.0 N with nobody on it",
        "a.c3d: plate 2 reads 4.0 N with nobody on it",
        "The mass given, 60 kg, contradicts",
    ]


def test_one_files_own_sentences_stay_apart() -> None:
    said = [
        "a.c3d: nothing tells whose foot is on plate 1 at 0.30 s",
        "a.c3d: nothing tells whose foot is on plate 1 at 0.90 s",
    ]
    assert mocap_table.collect_sentences(result(suspicious=said), "suspicious") == said


def test_rows_that_are_alike_are_one_and_trivial_columns_are_none() -> None:
    entries = [entry("a.c3d"), entry("b.c3d", why="two clusters (Ehrig et al. 2006), 5.7 mm rms")]
    said = shown(mocap_table.build_channels_table(result(mapped=entries), all_files=False))
    assert said.count("knee centre") == 1
    assert "5.7 to 6.7 mm" in " ".join(said.split())
    assert "R THIGH 1\u20133" in said
    assert mocap_table.collapse_ranges("C7, T10, S 01, S 02, Fz1, Fz2, Fz3") == "C7, T10, S 01, S 02, Fz1\u20133"
    assert "sign" not in said
    assert "zero" not in said
    turned = shown(
        mocap_table.build_channels_table(
            result(mapped=[*entries, entry("a.c3d", channel="x", sign=-1)]), all_files=False
        )
    )
    assert "sign" in turned
    assert shown(mocap_table.build_channels_table(result(mapped=entries), all_files=True)).count("knee") == 2


def test_names_are_not_cut_at_80_columns() -> None:
    names = ["pressure_command_of_the_valve", "muscle_length_encoder"]
    entries = [
        entry("a.csv", channel="pressure_command", side="prosthesis", column=name, sign=-1, zero=1.5) for name in names
    ]
    said = shown(mocap_table.build_channels_table(result(mapped=entries), all_files=False))
    assert all(name in said for name in (*names, "pressure_command "))
    assert max(map(len, said.splitlines())) <= 80
    trial = {
        "of": ["a_long_name_of_a_trial.c3d", "a_log.csv"],
        "group": "condition_1",
        "strides": 4,
        "stride_time_s": 1.1,
    }
    trial |= {"command_peak_bar": 3.0, "measured": ["ankle_angle", "muscle_length"]}
    said = shown(mocap_table.build_trials_table({"trials": [trial, trial]}))
    assert all(name in said for name in ("a_long_name_of_a_trial.c3d", "condition_1", "muscle_length", "4", "1.100"))
    other = {**trial, "of": ["ground_reaction.mot"], "measured": ["ankle_angle"]}
    mixed = shown(mocap_table.build_trials_table({"trials": [{**trial, "of": ["ground_reaction.mot"]}, other]}))
    assert all(name in mixed for name in ("ground_reaction.mot", "muscle_length", "ankle_angle,"))
