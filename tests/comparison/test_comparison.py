"""Comparison of recordings: reading, matching, exclusions and remarks."""

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from klute_sim.comparison import results, runs
from klute_sim.comparison.comparison import Comparison, ComparisonOptions, compare
from klute_sim.comparison.curve import average_repeats, summarize_curve
from klute_sim.comparison.difference import Difference
from klute_sim.comparison.runs import ComparedRun
from klute_sim.errors import InputError
from klute_sim.recording import csv, parquet
from klute_sim.recording.recording import Recording

PER_STRIDE = 50


def make_gait(
    strides: int = 4, *, bump: float = 0.0, scatter: float = 0.2, seed: int = 1, rig: str | None = None, **more: str
) -> Recording:
    """Return strides of a wave with a ``bump`` [deg] from 60 to 70 %, copied into the channels ``more``."""
    rng = np.random.default_rng(seed)
    count = PER_STRIDE * strides
    phase = np.tile(np.arange(PER_STRIDE) * 100.0 / PER_STRIDE, strides)
    angle = np.sin(0.02 * np.pi * phase) + scatter * np.repeat(rng.normal(size=strides), PER_STRIDE)
    angle += np.where((phase >= 60.0) & (phase <= 70.0), bump, 0.0)
    columns = [("time [s]", np.arange(count) / PER_STRIDE), ("gait_phase [%]", phase), ("ankle_angle [deg]", angle)]
    columns += [(f"{name} [{unit}]", angle) for name, unit in more.items()]
    options = {"mass_kg": 75.0, "speed_m_per_s": 1.2}
    return Recording.from_columns(columns, {"rig": rig, "options": options, "device": {"name": "d"}} if rig else None)


def make_run(label: str, *parts: Recording, names: tuple[str, ...] = ("one", "two", "three")) -> ComparedRun:
    return ComparedRun(label, Path(label), dict(zip(names[: len(parts)], parts, strict=True)))


def add_reference(recording: Recording, sd: float | None = 0.5) -> Recording:
    columns = {**recording.channels, "reference_ankle_angle": np.sin(0.02 * np.pi * recording["gait_phase"])}
    units = {**recording.units, "reference_ankle_angle": "deg"}
    if sd is not None:
        columns["reference_ankle_angle_sd"], units["reference_ankle_angle_sd"] = np.full(len(recording), sd), "deg"
    return Recording(columns, units, recording.provenance)


def get_difference(comparison: Comparison, channel: str = "ankle_angle", label: str = "b") -> Difference:
    (part,) = comparison.parts
    return part.differences[channel][label]


def test_bump_is_localized_at_its_phase() -> None:
    comparison = compare([make_run("a", make_gait(8)), make_run("b", make_gait(8, bump=3.0, seed=2))])
    assert comparison.domain == "phase"
    d = get_difference(comparison)
    assert d.band == "means"
    (region,) = d.regions
    # Linear interpolation between samples, which are 2 % apart, widens the bump.
    assert 58.0 < region.begin <= 60.0
    assert 70.0 <= region.end < 72.0
    assert d.max_position is not None
    assert 60.0 <= d.max_position <= 70.0


def test_first_stride_of_simulated_gait_is_skipped_unless_single() -> None:
    def repeats(rig: str | None, strides: int, skip: int | None = None) -> int:
        comparison = compare(
            [make_run("a", make_gait(strides, rig=rig)), make_run("b", make_gait(strides, rig=rig))],
            ComparisonOptions(skip_strides=skip),
        )
        return comparison.parts[0].series[0].n_repeats

    assert repeats("gait", 4) == 3
    assert repeats("gait", 1) == 1
    assert repeats(None, 4) == 4
    assert repeats("gait", 4, skip=0) == 4
    assert repeats(None, 4, skip=3) == 1
    with pytest.raises(InputError, match="recording a has 4 strides and --skip 4 leaves none"):
        repeats(None, 4, skip=4)


def test_runs_with_equal_labels_are_repeats() -> None:
    comparison = compare(
        [make_run("a", make_gait(3)), make_run("a", make_gait(5, seed=3)), make_run("b", make_gait(2))]
    )
    assert [(s.label, s.n_repeats) for s in comparison.parts[0].series] == [("a", 8), ("b", 2)]
    (pooled,) = comparison.remarks
    assert pooled.startswith("The 8 strides of 'a' from 2 recordings count as independent repeats")
    over_time = compare(
        [make_run("a", make_gait(3)), make_run("a", make_gait(5, seed=3)), make_run("b", make_gait(2))],
        ComparisonOptions(domain="time"),
    )
    assert [(s.label, s.n_repeats) for s in over_time.parts[0].series] == [("a", 2), ("b", 1)]
    assert get_difference(over_time).band == "prediction"


def test_baseline_selects_first_series() -> None:
    compared_runs = [make_run("a", make_gait()), make_run("b", make_gait(bump=3.0)), make_run("c", make_gait(bump=1.0))]
    there, back = compare(compared_runs), compare(compared_runs, ComparisonOptions(baseline="b"))
    assert [series.label for series in back.parts[0].series] == ["b", "a", "c"]
    assert get_difference(there, label="b").bias == -get_difference(back, label="a").bias  # type: ignore[operator]
    with pytest.raises(InputError, match="unknown baseline 'd'; allowed labels: a, b, c"):
        compare(compared_runs, ComparisonOptions(baseline="d"))


def test_human_reference_is_series_with_band() -> None:
    comparison = compare(
        [make_run("a", add_reference(make_gait(scatter=0.0)))], ComparisonOptions(include_reference=True)
    )
    assert [(s.label, s.n_repeats, s.is_reference) for s in comparison.parts[0].series] == [
        ("a", 4, False),
        ("human", 0, True),
    ]
    d = get_difference(comparison, label="human")
    assert d.band == "reference"
    assert d.rms == pytest.approx(0.0, abs=1e-12)
    assert d.half_width == pytest.approx(1.96 * 0.5, rel=1e-3)
    against = compare([make_run("a", make_gait(bump=1.0)), make_run("b", make_gait())], ComparisonOptions())
    assert get_difference(against).rms_sd == pytest.approx(get_difference(against).rms / _compute_rms_sd(against, "a"))  # type: ignore[operator]
    both = [make_run("a", add_reference(make_gait())), make_run("b", make_gait(bump=1.0, seed=2))]
    assert get_difference(compare(both, ComparisonOptions(include_reference=True))).rms_sd == pytest.approx(
        get_difference(compare(both)).rms / 0.5  # type: ignore[operator]
    )


def _compute_rms_sd(comparison: Comparison, label: str) -> float:
    (curve,) = [series.curves["ankle_angle"] for series in comparison.parts[0].series if series.label == label]
    return float(np.sqrt(np.mean(curve.sd**2)))


def test_reference_on_slope_or_of_other_run_is_reported() -> None:
    tilted = add_reference(make_gait(rig="gait"))
    options = {**tilted.provenance["options"], "slope_deg": 5.0}
    tilted = Recording(
        tilted.channels, tilted.units, {**tilted.provenance, "options": options, "reference": {"name": "x"}}
    )
    comparison = compare(
        [make_run("a", tilted), make_run("b", make_gait(rig="gait"))], ComparisonOptions(include_reference=True)
    )
    assert any("gait on a slope" in remark for remark in comparison.remarks)
    assert "The runs have different references; the reference of 'a' is shown." in comparison.remarks


def test_different_body_masses_are_reported() -> None:
    heavy = make_gait(rig="gait")
    heavy = Recording(
        heavy.channels, heavy.units, {**heavy.provenance, "options": {"mass_kg": 90.0, "speed_m_per_s": 1.2}}
    )
    comparison = compare([make_run("a", make_gait(rig="gait")), make_run("b", heavy)])
    assert comparison.remarks == ("The subjects differ in body mass (75, 90 kg); no channel is normalised.",)


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


def make_measurement(begin: float = 0.2, unit: str = "N", stride: float = 1.25) -> Recording:
    """Return four strides without a gait phase; the load is a half wave over 60 % of each."""
    time = np.arange(0.0, begin + 4.0 * stride + 0.3, 0.01)
    phase = ((time - begin) / stride) % 1.0
    load = np.where((time >= begin) & (phase < 0.6), 800.0 * np.sin(np.pi * phase / 0.6), 0.0)
    angle = 10.0 * np.sin(2.0 * np.pi * phase)
    scale = {"N": 1.0, "kN": 1e-3, "V": 1.0}[unit]
    return Recording.from_columns(
        [("time [s]", time), (f"grf_vertical [{unit}]", scale * load), ("ankle_angle [deg]", angle)]
    )


def test_measured_gait_gets_phase_from_ground_reaction() -> None:
    comparison = compare([make_run("a", make_measurement(unit="kN")), make_run("b", make_measurement(0.5, "N", 1.1))])
    assert comparison.domain == "phase"
    assert [series.n_repeats for series in comparison.parts[0].series] == [4, 4]
    d = get_difference(comparison)
    assert d.rms == pytest.approx(0.0, abs=0.2)
    curve = comparison.parts[0].series[0].curves["ankle_angle"]
    # The load exceeds 20 N shortly after it begins to rise.
    delay = 0.6 / np.pi * np.arcsin(20.0 / 800.0)
    assert curve.mean == pytest.approx(10.0 * np.sin(2.0 * np.pi * (np.linspace(0, 1, 101) + delay)), abs=0.15)
    remarks = [remark for remark in comparison.remarks if "no gait_phase" in remark]
    assert remarks[0] == ("'a' has no gait_phase: its 4 strides start when grf_vertical exceeds 20 N.")
    in_time = compare(
        [make_run("a", make_measurement()), make_run("b", make_measurement(0.5))], ComparisonOptions(domain="time")
    )
    assert in_time.domain == "time"
    assert not any("no gait_phase" in remark for remark in in_time.remarks)


def test_load_without_strides_is_compared_over_time() -> None:
    both = [make_run("a", make_measurement(unit="V")), make_run("b", make_measurement(unit="V"))]
    assert compare(both).domain == "time"
    assert compare([make_run("a", make_measurement()), make_run("b", make_gait())]).domain == "phase"
    with pytest.raises(
        InputError, match=r"neither a column 'gait_phase \[%\]' nor a 'grf_vertical' that shows a stride"
    ):
        compare(both, ComparisonOptions(domain="phase"))


def test_single_recording_has_mean_and_band() -> None:
    comparison = compare(
        [make_run("a", make_gait(5, bump=3.0, force="N", x="m"))], ComparisonOptions(channels=("ankle_angle", "force"))
    )
    assert comparison.is_single
    (part,) = comparison.parts
    assert part.differences == {"ankle_angle": {}, "force": {}}
    (series,) = part.series
    assert series.n_repeats == 5
    curves = results.as_json(comparison)["parts"][0]["channels"][0]["curves"]
    curve = series.curves["ankle_angle"]
    assert curves == [{"series": "a", **summarize_curve(curve, part.axis)._asdict()}]
    assert curves[0]["maximum"] == curve.mean.max()
    assert curves[0]["maximum_at"] == part.axis[curve.mean.argmax()]
    assert curves[0]["minimum"] == curve.mean.min()
    assert curves[0]["sd"] == pytest.approx(np.sqrt(np.mean(curve.sd**2)))
    assert curves[0]["max_sd"] == curve.sd.max()
    rows = results.format_csv(comparison).splitlines()
    assert rows[0] == ",".join(results.SUMMARY_COLUMNS)
    assert rows[1].startswith("one,ankle_angle,deg,a,") or rows[1].startswith(",ankle_angle,deg,a,")
    assert len(rows) == 3
    pooled = compare([make_run("a", make_measurement(unit="V")), make_run("a", make_measurement(unit="V"))])
    assert pooled.parts[0].series[0].n_repeats == 2
    with pytest.raises(InputError, match="unknown channel 'nobody'; allowed: "):
        compare([make_run("a", make_gait())], ComparisonOptions(channels=("nobody",)))


def test_start_time_is_not_compared() -> None:
    comparison = compare([make_run("a", make_gait(start="s")), make_run("b", make_gait(seed=2, start="s"))])
    assert list(comparison.parts[0].differences) == ["ankle_angle"]


def test_unknown_summary_values_are_none() -> None:
    unknown = average_repeats(np.full((2, 3), np.nan))
    assert set(summarize_curve(unknown, np.arange(3.0))) == {None}
    assert summarize_curve(average_repeats(np.array([[1.0, 3.0, 2.0]])), np.arange(3.0)) == (
        1.0,
        0.0,
        3.0,
        1.0,
        None,
        None,
        None,
    )


def test_recordings_without_common_channels_are_refused() -> None:
    one = Recording.from_columns([("time [s]", np.arange(9.0)), ("force [N]", np.arange(9.0))])
    two = Recording.from_columns([("time [s]", np.arange(9.0)), ("pressure [bar]", np.arange(9.0))])
    with pytest.raises(
        InputError, match="'a' has no channel in common with another series in a compatible unit; it has f"
    ):
        compare([make_run("a", one), make_run("b", two)])
    with pytest.raises(InputError, match="'a' has only one recording: there is nothing to compare it with"):
        compare([make_run("a", one)])
    with pytest.raises(InputError, match="'a' has only one stride: there is nothing to compare it with"):
        compare([make_run("a", make_gait(1))])


def test_main_channels_are_compared_unless_all_are_requested() -> None:
    many = {f"x{k}": "m" for k in range(14)}
    compared_runs = [make_run("a", make_gait(force="N", **many)), make_run("b", make_gait(force="N", **many))]
    comparison = compare(compared_runs)
    assert list(comparison.parts[0].differences) == ["ankle_angle", "force"]
    assert "2 of 16 common channels are compared; --channel all selects all." in comparison.remarks
    assert len(compare(compared_runs, ComparisonOptions(channels=("all",))).parts[0].differences) == 16
    assert list(compare(compared_runs, ComparisonOptions(channels=("x3", "force"))).parts[0].differences) == [
        "x3",
        "force",
    ]


def test_accumulating_channels_start_at_heel_strike() -> None:
    def moving(step: float) -> Recording:
        along = np.arange(200) / 50.0
        phase = np.tile(np.arange(50) * 2.0, 4)
        ankle = step * along + 7.0
        columns = [("time [s]", along), ("gait_phase [%]", phase), ("ankle_x [m]", ankle), ("cop_x [m]", ankle + 0.1)]
        return Recording.from_columns(columns)

    comparison = compare([make_run("a", moving(1.2)), make_run("b", moving(1.3))])
    curves = comparison.parts[0].series[0].curves
    assert curves["ankle_x"].mean == pytest.approx(0.012 * np.arange(101))
    assert curves["ankle_x"].sd == pytest.approx(0.0, abs=1e-9)
    assert curves["cop_x"].mean == pytest.approx(0.1 + 0.012 * np.arange(101))
    without = Recording.from_columns(
        [(h, moving(1.2)[h.split()[0]]) for h in ("time [s]", "gait_phase [%]", "cop_x [m]")]
    )
    comparison = compare([make_run("a", moving(1.2)), make_run("b", moving(1.3)), make_run("c", without)])
    assert "'cop_x' of 'c' is excluded: its origin at heel strike, 'ankle_x', is missing." in comparison.remarks
    assert "c" not in comparison.parts[0].differences["cop_x"]


def test_incomplete_strides_are_excluded_and_counted() -> None:
    incomplete = make_gait(4).select(slice(10, 190))
    comparison = compare([make_run("a", make_gait(4)), make_run("b", incomplete)])
    assert comparison.parts[0].series[1].n_repeats == 2
    assert comparison.remarks == ("Incomplete strides of 'b' are excluded: 2 (the first is stride 1, 20 to 98 %).",)
    with pytest.raises(InputError, match="recording b has no complete stride: stride 1 goes from 20 to 98 %"):
        compare([make_run("a", make_gait(4)), make_run("b", make_gait(1).select(slice(10, 50)))])


def test_trials_are_matched_by_name() -> None:
    one, two = make_gait(2), make_gait(2, bump=3.0)
    comparison = compare([make_run("a", one, one, two), make_run("b", two, one, names=("two", "four"))])
    assert [part.name for part in comparison.parts] == ["two"]
    assert comparison.parts[0].differences["ankle_angle"]["b"].max_difference == pytest.approx(3.0)
    assert comparison.remarks == (
        "Trials of 'a' that the other runs lack are excluded: one, three.",
        "Trials of 'b' that the other runs lack are excluded: four.",
    )
    single = compare([make_run("a", one, names=("x",)), make_run("b", two, names=("y",))])
    assert [part.name for part in single.parts] == [""]
    with pytest.raises(InputError, match=r"the runs have no trial in common: a has one, two; .*such as a.one\.parquet"):
        compare([make_run("a", one, two), make_run("b", one, names=("y",))])


def test_phase_and_reference_require_strides() -> None:
    bench = Recording.from_columns([("time [s]", np.arange(9.0)), ("ankle_angle [deg]", np.arange(9.0))])
    assert compare([make_run("a", make_gait()), make_run("b", bench)]).domain == "time"
    for options, message in (
        (ComparisonOptions(domain="phase"), "recording b has neither a column 'gait_phase"),
        (ComparisonOptions(include_reference=True), "--reference requires a comparison over phase"),
        (ComparisonOptions(skip_strides=1), "--skip requires a comparison over phase"),
    ):
        with pytest.raises(InputError, match=message):
            compare([make_run("a", make_gait()), make_run("b", bench)], options)
    with pytest.raises(InputError, match="recording a has no human reference"):
        compare([make_run("a", make_gait())], ComparisonOptions(include_reference=True))
    with pytest.raises(InputError, match="'human' is the label of the reference"):
        compare([make_run("human", make_gait())], ComparisonOptions(include_reference=True))


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


def test_json_and_tables_have_equal_numbers(tmp_path: Path) -> None:
    comparison = compare(
        [make_run("a", add_reference(make_gait())), make_run("b", make_gait(bump=3.0, seed=2))],
        ComparisonOptions(include_reference=True),
    )
    summary = json.loads(json.dumps(results.as_json(comparison), allow_nan=False))
    assert summary["format"] == "klute-sim-comparison/2"
    assert [(s["label"], s["repeats"]) for s in summary["series"]] == [("a", [4]), ("b", [4]), ("human", [None])]
    (channel,) = summary["parts"][0]["channels"]
    rows = [line.split(",") for line in results.format_csv(comparison).splitlines()]
    assert tuple(rows[0]) == results.DIFFERENCE_COLUMNS
    for row, difference in zip(rows[1:], channel["differences"], strict=True):
        cells = dict(zip(rows[0], row, strict=True))
        assert cells["other"] == difference["series"]
        assert float(cells["rms"]) == difference["rms"]
        assert float(cells["half_begin"]) == difference["half_interval"][0]
        assert cells["sd_series"] == difference["sd_series"] == "human"
    results.write_curves(comparison, tmp_path / "b.parquet")
    table = pq.read_table(tmp_path / "b.parquet")
    assert table.num_rows == 3 * 101
    assert table.column_names == ["part", "series", "channel", "unit", "gait_phase [%]", "mean", "sd", "count"]
    second = table.slice(101, 101)
    curve = comparison.parts[0].series[1].curves["ankle_angle"]
    assert set(second["series"].to_pylist()) == {"b"}
    assert second["mean"].to_pylist() == curve.mean.tolist()
    assert second["sd"].to_pylist() == curve.sd.tolist()
