"""Recordings and paths that a comparison reads: units, labels, and files that it refuses."""

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from klute_sim.comparison import runs
from klute_sim.comparison.comparison import ComparisonOptions, compare
from klute_sim.errors import InputError
from klute_sim.recording import csv, parquet
from klute_sim.recording.recording import Recording
from tests.comparison.gait_recordings import add_reference, get_difference, make_gait, make_run


def test_incomparable_channels_are_reported_and_refused_by_name() -> None:
    compared_runs = [
        make_run("a", make_gait(force="N", torque="N*m", left="m")),
        make_run("b", make_gait(force="bar", right="m")),
    ]
    comparison = compare(compared_runs)
    assert list(comparison.parts[0].differences) == ["ankle_angle"]
    assert comparison.remarks == (
        "Channel 'force' is in 'N' in 'a' and in 'bar' in 'b': not compared.",
        "'a' has channels that 'b' lacks: torque, left.",
        "'b' has channels that 'a' lacks: right.",
    )
    for name, message in {
        "force": "channel 'force' is in 'N' in 'a' and in 'bar' in 'b'; allowed: compatible units",
        "torque": "only 'a' has the channel 'torque'",
        "right": "'a', the baseline of the comparison, has no channel 'right'",
        "nobody": "unknown channel 'nobody'; allowed: ankle_angle, force, torque, left, right",
    }.items():
        with pytest.raises(InputError, match=message):
            compare(compared_runs, ComparisonOptions(channels=(name,)))
    with pytest.raises(
        InputError, match=r"'force' of 'a' is in 'N' in recording a and in 'bar' in recording a; repeats"
    ):
        compare(
            [make_run("a", make_gait(force="N")), make_run("a", make_gait(force="bar")), make_run("b", make_gait())]
        )


def test_channel_is_compared_in_compatible_units_only() -> None:
    comparison = compare(
        [
            make_run("a", make_gait(force="N")),
            make_run("b", make_gait(force="degC")),
            make_run("c", make_gait(force="N")),
        ]
    )
    assert set(comparison.parts[0].differences["force"]) == {"c"}
    assert [("force" in series.curves) for series in comparison.parts[0].series] == [True, False, True]


def test_compatible_units_are_converted_to_the_first() -> None:
    recording = add_reference(make_gait(force="N"))
    scale = {"ankle_angle": np.pi / 180.0, "force": 1e-3, "reference_ankle_angle": np.pi / 180.0}
    scale["reference_ankle_angle_sd"] = scale["reference_ankle_angle"]
    unit = {n: {"deg": "rad", "N": "kN"}[recording.units[n]] for n in scale}
    other = Recording({n: s * scale.get(n, 1.0) for n, s in recording.channels.items()}, {**recording.units, **unit})
    comparison = compare(
        [make_run("a", recording), make_run("b", other), make_run("b", recording)], ComparisonOptions(baseline="b")
    )
    assert comparison.parts[0].units == {"ankle_angle": "deg", "force": "N"}
    for channel in ("ankle_angle", "force"):
        assert get_difference(comparison, channel, "a").rms == pytest.approx(0.0, abs=1e-12)
        assert np.abs(comparison.parts[0].series[0].curves[channel].mean).max() > 0.5
    assert "'force' of 'b' was converted from 'kN' to 'N'." in comparison.remarks
    assert not any("reference" in remark for remark in comparison.remarks)
    human = compare([make_run("b", other)], ComparisonOptions(include_reference=True))
    assert human.parts[0].units["ankle_angle"] == "rad"
    assert get_difference(human, label="human").half_width == pytest.approx(
        np.pi
        / 180.0
        * get_difference(
            compare([make_run("b", recording)], ComparisonOptions(include_reference=True)), label="human"
        ).half_width
    )
    mixed = Recording(
        {n: s * scale[n] if n == "ankle_angle" else s for n, s in recording.channels.items()},
        {**recording.units, "ankle_angle": "rad"},
    )
    assert get_difference(
        compare([make_run("b", mixed)], ComparisonOptions(include_reference=True)), label="human"
    ).rms == pytest.approx(get_difference(human, label="human").rms)
    warm, cold = (
        Recording.from_columns([("time [s]", np.arange(9.0)), (f"t [{u}]", np.arange(9.0))]) for u in ("degC", "K")
    )
    with pytest.raises(InputError, match="'a' has no channel in common with another series in a compatible unit"):
        compare([make_run("a", warm), make_run("b", cold)])


def test_time_in_milliseconds_is_converted(tmp_path: Path) -> None:
    for name, unit, step in (("a", "s", 0.5), ("b", "ms", 500.0)):
        rows = "".join(f"{step * k},{k}\n" for k in range(9))
        (tmp_path / f"{name}.csv").write_text(f"time [{unit}],force [N]\n{rows}")
    comparison = compare(runs.read_runs([str(tmp_path / "a.csv"), str(tmp_path / "b.csv")]))
    assert comparison.parts[0].axis[-1] == 4.0
    assert get_difference(comparison, "force").rms == 0.0


def test_files_get_unique_default_labels(tmp_path: Path) -> None:
    for folder in ("x", "y"):
        (tmp_path / folder).mkdir()
        parquet.write_recording(make_gait(), tmp_path / folder / "recording.parquet")
    csv.write(make_gait(), tmp_path / "m=1.csv")
    specs = [str(tmp_path / "x"), str(tmp_path / "y" / "recording.parquet"), f"mine={tmp_path / 'x'}"]
    comparison = runs.read_runs([*specs, str(tmp_path / "m=1.csv"), str(tmp_path / "x"), f"mine={tmp_path / 'y'}"])
    assert [run.label for run in comparison] == ["x", "y", "mine", "m=1", "x (2)", "mine"]
    for run in comparison:
        ((part, recording),) = run.parts.items()
        assert part == run.label
        assert recording["ankle_angle"].tolist() == make_gait()["ankle_angle"].tolist()
        assert recording.units["ankle_angle"] == "deg"


def test_columns_without_unit_are_ignored_and_reported(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text("Frame,time [s],force [N],Note\n1,0.0,2.5,a\n2,0.1,,b\n")
    (run,) = runs.read_runs([str(tmp_path / "m.csv")])
    assert list(run.parts["m"].channels) == ["time", "force"]
    assert np.isnan(run.parts["m"]["force"][1])
    assert run.remarks[0].endswith("are ignored: 'Frame', 'Note'.")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("a,b\n1,2\n", "no column heading has the form"),
        ("force [N],x [m]\n1,2\n", "needs a channel 'time"),
        ("time [mm],force [N]\n1,2\n3,4\n", "time is in 'mm'; allowed: s, ms, min"),
        ("time [s],force [N]\n1,2\n", "has 1 sample; at least 2"),
        ("time [s],force [N]\n", "has 0 samples; at least 2"),
        ("time [s],force [N]\n1,2\n,3\n", "time is missing in row 2"),
        ("time [s],force [N]\n1,2\n2,2\n2,3\n", r"time must increase strictly; it does not at row 3 \(2 s\)"),
        ("time [s],force [N]\n1,x\n2,2\n", "'x' is not a number"),
        ("time [s],force [N],force [N]\n1,2,3\n2,3,4\n", "'force' occurs twice"),
        ("", "is empty"),
        ("PAR1 no parquet", "is not a Parquet file"),
    ],
)
def test_invalid_recording_raises_one_sentence_with_file_name(content: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / "m.csv"
    file.write_text(content)
    with pytest.raises(InputError, match=message) as caught:
        runs.read_runs([str(file)])
    assert str(file) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_invalid_paths_and_labels_are_refused(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    no_time = Recording.from_columns([("time [s]", np.arange(3.0)), ("x [m]", np.arange(3.0))])
    parquet.write_recording(no_time, tmp_path / "r.parquet")
    table = pq.read_table(tmp_path / "r.parquet")
    pq.write_table(table.drop_columns(["time [s]"]), tmp_path / "no_time.parquet")
    for name, provenance in {"odd": b"{", "list": b"[1]", "device": b'{"device": "x"}'}.items():
        pq.write_table(table.replace_schema_metadata({"klute_sim": provenance}), tmp_path / f"{name}.parquet")
    for spec, message in {
        str(tmp_path / "none"): "none does not exist; allowed: a run folder or a recording",
        str(tmp_path / "empty"): "empty is not a run folder",
        f"{'x' * 41}={tmp_path}": "label .* invalid; allowed: 1 to 40 printable",
        f"={tmp_path}": "label .* invalid",
        f"a\nb={tmp_path}": "label .* invalid",
        "a=": "path of the run 'a=' is empty",
        "": "path of the run '' is empty",
        str(tmp_path / "no_time.parquet"): "recording .*no_time.parquet: a recording needs a channel",
        str(tmp_path / "odd.parquet"): "odd.parquet: its provenance is not valid JSON",
        str(tmp_path / "list.parquet"): "list.parquet: its provenance is not a JSON object",
        str(tmp_path / "device.parquet"): "device.parquet: its provenance is invalid",
    }.items():
        with pytest.raises(InputError, match=message):
            runs.read_runs([spec])
