"""Comparison of recordings: reading, matching, exclusions and remarks."""

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from klute_sim.comparison import results
from klute_sim.comparison.comparison import Comparison, ComparisonOptions, compare
from klute_sim.comparison.curve import average_repeats, summarize_curve
from klute_sim.errors import InputError
from klute_sim.recording.recording import Recording
from klute_sim.report.comparison.text import explain_numbers
from tests.comparison.gait_recordings import add_reference, get_difference, make_gait, make_run


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


def test_reference_of_one_subject_is_not_called_human() -> None:
    recording = add_reference(make_gait(rig="gait"))
    provenance = {**recording.provenance, "reference": {"name": "me", "sha256": "0"}}
    run = make_run("a", Recording(recording.channels, recording.units, provenance))
    comparison = compare([run], ComparisonOptions(include_reference=True, baseline="subject me"))
    assert [series.label for series in comparison.parts[0].series] == ["subject me", "a"]
    explanations = " ".join(explain_numbers(comparison))
    assert "'subject me' between the strides of this subject" in explanations
    assert "subjects" not in explanations
    with pytest.raises(InputError, match="allowed labels: a, subject me"):
        compare([run], ComparisonOptions(include_reference=True, baseline="human"))


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


def test_reading_of_an_empty_plate_moves_no_heel_strike() -> None:
    measured = make_measurement()
    offset = Recording(
        {**measured.channels, "grf_vertical": measured["grf_vertical"] + 30.0}, measured.units, measured.provenance
    )
    comparison = compare([make_run("a", measured), make_run("b", offset)])
    assert comparison.domain == "phase"
    assert get_difference(comparison).rms == pytest.approx(0.0, abs=1e-9)
    assert get_difference(comparison, "grf_vertical").bias == pytest.approx(30.0)


def test_gait_that_is_compared_over_time_is_remarked() -> None:
    measured = make_measurement()
    down = Recording(
        {**measured.channels, "grf_vertical": -measured["grf_vertical"]}, measured.units, measured.provenance
    )
    comparison = compare([make_run("a", measured), make_run("b", down)])
    assert comparison.domain == "time"
    assert comparison.remarks == (
        "Compared over time, because 'b' has neither gait_phase nor strides: it has a grf_vertical [N] that shows no "
        "stride (up is positive).",
    )
    assert compare([make_run("a", down), make_run("b", down)]).remarks == ()


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
    assert curves["cop_x"].mean[:-1] == pytest.approx(0.1 + 0.012 * np.arange(100))
    assert np.isnan(curves["cop_x"].mean[-1])  # at the next heel strike
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
        (
            ComparisonOptions(include_reference=True),
            "because not all of them have strides of tracked gait: leave out --reference",
        ),
        (ComparisonOptions(skip_strides=1), "--skip requires a comparison over phase"),
    ):
        with pytest.raises(InputError, match=message):
            compare([make_run("a", make_gait()), make_run("b", bench)], options)
    with pytest.raises(InputError, match="recording a has no human reference"):
        compare([make_run("a", make_gait())], ComparisonOptions(include_reference=True))
    with pytest.raises(InputError, match="'human' is the label of the reference"):
        compare([make_run("human", make_gait())], ComparisonOptions(include_reference=True))


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
