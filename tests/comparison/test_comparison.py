"""Recordings compared: what is read, matched, left out and said."""

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from klute_sim.comparison import results, runs
from klute_sim.comparison.comparison import Comparison, ComparisonOptions, compare
from klute_sim.comparison.curve import average_repeats, summarize_curve
from klute_sim.comparison.runs import ComparedRun
from klute_sim.errors import InputError
from klute_sim.recording import csv, parquet
from klute_sim.recording.recording import Recording

PER_STRIDE = 50


def walk(
    strides: int = 4, *, bump: float = 0.0, scatter: float = 0.2, seed: int = 1, rig: str | None = None, **more: str
) -> Recording:
    """Strides of a wave with a ``bump`` [deg] from 60 to 70 %; ``more`` channels are copies in the units given."""
    rng = np.random.default_rng(seed)
    count = PER_STRIDE * strides
    phase = np.tile(np.arange(PER_STRIDE) * 100.0 / PER_STRIDE, strides)
    angle = np.sin(0.02 * np.pi * phase) + scatter * np.repeat(rng.normal(size=strides), PER_STRIDE)
    angle += np.where((phase >= 60.0) & (phase <= 70.0), bump, 0.0)
    columns = [("time [s]", np.arange(count) / PER_STRIDE), ("gait_phase [%]", phase), ("ankle_angle [deg]", angle)]
    columns += [(f"{name} [{unit}]", angle) for name, unit in more.items()]
    options = {"mass_kg": 75.0, "speed_m_per_s": 1.2}
    return Recording.from_columns(columns, {"rig": rig, "options": options, "device": {"name": "d"}} if rig else None)


def run(label: str, *parts: Recording, names: tuple[str, ...] = ("one", "two", "three")) -> ComparedRun:
    return ComparedRun(label, Path(label), dict(zip(names[: len(parts)], parts, strict=True)))


def with_reference(recording: Recording, sd: float | None = 0.5) -> Recording:
    columns = {**recording.channels, "reference_ankle_angle": np.sin(0.02 * np.pi * recording["gait_phase"])}
    units = {**recording.units, "reference_ankle_angle": "deg"}
    if sd is not None:
        columns["reference_ankle_angle_sd"], units["reference_ankle_angle_sd"] = np.full(len(recording), sd), "deg"
    return Recording(columns, units, recording.provenance)


def only(found: Comparison, channel: str = "ankle_angle", label: str = "b") -> results.Difference:
    (part,) = found.parts
    return part.differences[channel][label]


def test_a_bump_in_every_stride_is_found_at_its_phase() -> None:
    found = compare([run("a", walk(8)), run("b", walk(8, bump=3.0, seed=2))])
    assert found.domain == "phase"
    d = only(found)
    assert d.band == "means"
    (region,) = d.regions
    # Between its samples, which are 2 % apart, the bump has slopes.
    assert 58.0 < region.begin <= 60.0
    assert 70.0 <= region.end < 72.0
    assert d.max_position is not None
    assert 60.0 <= d.max_position <= 70.0


def test_the_first_stride_of_a_simulated_walk_is_left_out_unless_it_is_the_only_one() -> None:
    def repeats(rig: str | None, strides: int, skip: int | None = None) -> int:
        found = compare(
            [run("a", walk(strides, rig=rig)), run("b", walk(strides, rig=rig))], ComparisonOptions(skip_strides=skip)
        )
        return found.parts[0].series[0].n_repeats

    assert repeats("gait", 4) == 3
    assert repeats("gait", 1) == 1
    assert repeats(None, 4) == 4
    assert repeats("gait", 4, skip=0) == 4
    assert repeats(None, 4, skip=3) == 1
    with pytest.raises(InputError, match="recording a has 4 strides and --skip 4 leaves none"):
        repeats(None, 4, skip=4)


def test_runs_of_one_label_are_repeats_of_each_other() -> None:
    found = compare([run("a", walk(3)), run("a", walk(5, seed=3)), run("b", walk(2))])
    assert [(s.label, s.n_repeats) for s in found.parts[0].series] == [("a", 8), ("b", 2)]
    (pooled,) = found.remarks
    assert pooled.startswith("The 8 strides of 'a' from 2 recordings count as independent repeats")
    over_time = compare(
        [run("a", walk(3)), run("a", walk(5, seed=3)), run("b", walk(2))], ComparisonOptions(domain="time")
    )
    assert [(s.label, s.n_repeats) for s in over_time.parts[0].series] == [("a", 2), ("b", 1)]
    assert only(over_time).band == "prediction"


def test_to_chooses_what_the_others_are_compared_with() -> None:
    runs_ = [run("a", walk()), run("b", walk(bump=3.0)), run("c", walk(bump=1.0))]
    there, back = compare(runs_), compare(runs_, ComparisonOptions(baseline="b"))
    assert [series.label for series in back.parts[0].series] == ["b", "a", "c"]
    assert only(there, label="b").bias == -only(back, label="a").bias  # type: ignore[operator]
    with pytest.raises(InputError, match="no series is called 'd'; allowed: a, b, c"):
        compare(runs_, ComparisonOptions(baseline="d"))


def test_the_human_reference_is_a_series_with_its_own_band() -> None:
    found = compare([run("a", with_reference(walk(scatter=0.0)))], ComparisonOptions(include_reference=True))
    assert [(s.label, s.n_repeats, s.is_reference) for s in found.parts[0].series] == [
        ("a", 4, False),
        ("human", 0, True),
    ]
    d = only(found, label="human")
    assert d.band == "reference"
    assert d.rms == pytest.approx(0.0, abs=1e-12)
    assert d.half_width == pytest.approx(1.96 * 0.5, rel=1e-3)
    against = compare([run("a", walk(bump=1.0)), run("b", walk())], ComparisonOptions())
    assert only(against).rms_sd == pytest.approx(only(against).rms / _sd_of(against, "a"))  # type: ignore[operator]
    both = [run("a", with_reference(walk())), run("b", walk(bump=1.0, seed=2))]
    assert only(compare(both, ComparisonOptions(include_reference=True))).rms_sd == pytest.approx(
        only(compare(both)).rms / 0.5  # type: ignore[operator]
    )


def _sd_of(found: Comparison, label: str) -> float:
    (curve,) = [series.curves["ankle_angle"] for series in found.parts[0].series if series.label == label]
    return float(np.sqrt(np.mean(curve.sd**2)))


def test_a_reference_on_a_slope_or_of_another_run_is_told() -> None:
    tilted = with_reference(walk(rig="gait"))
    options = {**tilted.provenance["options"], "slope_deg": 5.0}
    tilted = Recording(
        tilted.channels, tilted.units, {**tilted.provenance, "options": options, "reference": {"name": "x"}}
    )
    found = compare([run("a", tilted), run("b", walk(rig="gait"))], ComparisonOptions(include_reference=True))
    assert any("walks on a slope" in remark for remark in found.remarks)
    assert "The runs have different references: the one shown is that of 'a'." in found.remarks


def test_walkers_of_different_mass_are_told() -> None:
    heavy = walk(rig="gait")
    heavy = Recording(
        heavy.channels, heavy.units, {**heavy.provenance, "options": {"mass_kg": 90.0, "speed_m_per_s": 1.2}}
    )
    found = compare([run("a", walk(rig="gait")), run("b", heavy)])
    assert found.remarks == ("The walkers differ in body mass (75, 90 kg); nothing here is scaled by it.",)


def test_channels_of_other_units_and_missing_ones_are_told_and_by_name_refused() -> None:
    runs_ = [run("a", walk(force="N", torque="N*m", left="m")), run("b", walk(force="bar", right="m"))]
    found = compare(runs_)
    assert list(found.parts[0].differences) == ["ankle_angle"]
    assert found.remarks == (
        "Channel 'force' is in 'N' in 'a' and in 'bar' in 'b': not compared.",
        "'a' has channels that 'b' lacks: torque, left.",
        "'b' has channels that 'a' lacks: right.",
    )
    for name, says in {
        "force": "channel 'force' is in 'N' in 'a' and in 'bar' in 'b'; allowed: units of one kind",
        "torque": "channel 'torque' is in 'a' alone",
        "right": "'a' has no channel 'right', and the others are compared with it",
        "nobody": "no channel 'nobody'; there are ankle_angle, force, torque, left, right",
    }.items():
        with pytest.raises(InputError, match=says):
            compare(runs_, ComparisonOptions(channels=(name,)))
    with pytest.raises(
        InputError, match=r"'force' of 'a' is in 'N' in recording a and in 'bar' in recording a; repeats"
    ):
        compare([run("a", walk(force="N")), run("a", walk(force="bar")), run("b", walk())])


def test_a_channel_is_compared_with_those_that_have_it_in_a_unit_of_the_same_kind() -> None:
    found = compare([run("a", walk(force="N")), run("b", walk(force="degC")), run("c", walk(force="N"))])
    assert set(found.parts[0].differences["force"]) == {"c"}
    assert [("force" in series.curves) for series in found.parts[0].series] == [True, False, True]


def test_units_of_one_kind_are_brought_to_the_first_ones() -> None:
    own = with_reference(walk(force="N"))
    scale = {"ankle_angle": np.pi / 180.0, "force": 1e-3, "reference_ankle_angle": np.pi / 180.0}
    scale["reference_ankle_angle_sd"] = scale["reference_ankle_angle"]
    unit = {n: {"deg": "rad", "N": "kN"}[own.units[n]] for n in scale}
    other = Recording({n: s * scale.get(n, 1.0) for n, s in own.channels.items()}, {**own.units, **unit})
    found = compare([run("a", own), run("b", other), run("b", own)], ComparisonOptions(baseline="b"))
    assert found.parts[0].units == {"ankle_angle": "deg", "force": "N"}
    for channel in ("ankle_angle", "force"):
        assert only(found, channel, "a").rms == pytest.approx(0.0, abs=1e-12)
        assert np.abs(found.parts[0].series[0].curves[channel].mean).max() > 0.5
    assert "'force' of 'b' is in 'kN' and was brought to 'N'." in found.remarks
    assert not any("reference" in remark for remark in found.remarks)
    human = compare([run("b", other)], ComparisonOptions(include_reference=True))
    assert human.parts[0].units["ankle_angle"] == "rad"
    assert only(human, label="human").half_width == pytest.approx(
        np.pi
        / 180.0
        * only(compare([run("b", own)], ComparisonOptions(include_reference=True)), label="human").half_width
    )
    mixed = Recording(
        {n: s * scale[n] if n == "ankle_angle" else s for n, s in own.channels.items()},
        {**own.units, "ankle_angle": "rad"},
    )
    assert only(
        compare([run("b", mixed)], ComparisonOptions(include_reference=True)), label="human"
    ).rms == pytest.approx(only(human, label="human").rms)
    warm, cold = (
        Recording.from_columns([("time [s]", np.arange(9.0)), (f"t [{u}]", np.arange(9.0))]) for u in ("degC", "K")
    )
    with pytest.raises(InputError, match="no channel of 'a' is in another series in a unit of the same kind"):
        compare([run("a", warm), run("b", cold)])


def test_a_clock_in_milliseconds_is_one_in_seconds(tmp_path: Path) -> None:
    for name, unit, step in (("a", "s", 0.5), ("b", "ms", 500.0)):
        rows = "".join(f"{step * k},{k}\n" for k in range(9))
        (tmp_path / f"{name}.csv").write_text(f"time [{unit}],force [N]\n{rows}")
    found = compare(runs.read_runs([str(tmp_path / "a.csv"), str(tmp_path / "b.csv")]))
    assert found.parts[0].axis[-1] == 4.0
    assert only(found, "force").rms == 0.0


def measured(begin: float = 0.2, unit: str = "N", stride: float = 1.25) -> Recording:
    """Four strides without a phase; the load of a foot is a half wave over 60 % of each."""
    time = np.arange(0.0, begin + 4.0 * stride + 0.3, 0.01)
    phase = ((time - begin) / stride) % 1.0
    load = np.where((time >= begin) & (phase < 0.6), 800.0 * np.sin(np.pi * phase / 0.6), 0.0)
    angle = 10.0 * np.sin(2.0 * np.pi * phase)
    scale = {"N": 1.0, "kN": 1e-3, "V": 1.0}[unit]
    return Recording.from_columns(
        [("time [s]", time), (f"grf_vertical [{unit}]", scale * load), ("ankle_angle [deg]", angle)]
    )


def test_a_measured_walk_gets_its_phase_from_the_ground_reaction() -> None:
    found = compare([run("a", measured(unit="kN")), run("b", measured(0.5, "N", 1.1))])
    assert found.domain == "phase"
    assert [series.n_repeats for series in found.parts[0].series] == [4, 4]
    d = only(found)
    assert d.rms == pytest.approx(0.0, abs=0.2)
    curve = found.parts[0].series[0].curves["ankle_angle"]
    # 20 N are passed a little after the load begins to rise.
    late = 0.6 / np.pi * np.arcsin(20.0 / 800.0)
    assert curve.mean == pytest.approx(10.0 * np.sin(2.0 * np.pi * (np.linspace(0, 1, 101) + late)), abs=0.15)
    told = [remark for remark in found.remarks if "no gait_phase" in remark]
    assert told[0] == (
        "'a' has no gait_phase: its 4 strides go from one rise of its grf_vertical above 20 N to the next."
    )
    in_time = compare([run("a", measured()), run("b", measured(0.5))], ComparisonOptions(domain="time"))
    assert in_time.domain == "time"
    assert not any("no gait_phase" in remark for remark in in_time.remarks)


def test_a_load_that_tells_no_strides_is_compared_in_time() -> None:
    both = [run("a", measured(unit="V")), run("b", measured(unit="V"))]
    assert compare(both).domain == "time"
    assert compare([run("a", measured()), run("b", walk())]).domain == "phase"
    with pytest.raises(InputError, match=r"no column 'gait_phase \[%\]', and no 'grf_vertical' that shows a stride"):
        compare(both, ComparisonOptions(domain="phase"))


def test_one_recording_alone_has_its_mean_and_band() -> None:
    found = compare(
        [run("a", walk(5, bump=3.0, force="N", x="m"))], ComparisonOptions(channels=("ankle_angle", "force"))
    )
    assert found.is_single
    (part,) = found.parts
    assert part.differences == {"ankle_angle": {}, "force": {}}
    (series,) = part.series
    assert series.n_repeats == 5
    told = results.as_json(found)["parts"][0]["channels"][0]["curves"]
    curve = series.curves["ankle_angle"]
    assert told == [{"series": "a", **summarize_curve(curve, part.axis)._asdict()}]
    assert told[0]["highest"] == curve.mean.max()
    assert told[0]["highest_at"] == part.axis[curve.mean.argmax()]
    assert told[0]["lowest"] == curve.mean.min()
    assert told[0]["sd"] == pytest.approx(np.sqrt(np.mean(curve.sd**2)))
    assert told[0]["sd_largest"] == curve.sd.max()
    rows = results.format_csv(found).splitlines()
    assert rows[0] == ",".join(results.SUMMARY_COLUMNS)
    assert rows[1].startswith("one,ankle_angle,deg,a,") or rows[1].startswith(",ankle_angle,deg,a,")
    assert len(rows) == 3
    pooled = compare([run("a", measured(unit="V")), run("a", measured(unit="V"))])
    assert pooled.parts[0].series[0].n_repeats == 2
    with pytest.raises(InputError, match="no channel 'nobody'; there are"):
        compare([run("a", walk())], ComparisonOptions(channels=("nobody",)))


def test_where_a_stride_began_is_no_channel() -> None:
    found = compare([run("a", walk(start="s")), run("b", walk(seed=2, start="s"))])
    assert list(found.parts[0].differences) == ["ankle_angle"]


def test_what_is_not_known_of_a_curve_is_none() -> None:
    nothing = average_repeats(np.full((2, 3), np.nan))
    assert set(summarize_curve(nothing, np.arange(3.0))) == {None}
    assert summarize_curve(average_repeats(np.array([[1.0, 3.0, 2.0]])), np.arange(3.0)) == (
        1.0,
        0.0,
        3.0,
        1.0,
        None,
        None,
        None,
    )


def test_nothing_in_common_is_refused() -> None:
    one = Recording.from_columns([("time [s]", np.arange(9.0)), ("force [N]", np.arange(9.0))])
    two = Recording.from_columns([("time [s]", np.arange(9.0)), ("pressure [bar]", np.arange(9.0))])
    with pytest.raises(InputError, match="no channel of 'a' is in another series in a unit of the same kind; it has f"):
        compare([run("a", one), run("b", two)])
    with pytest.raises(InputError, match="nothing to compare 'a' with, and a single recording has no band"):
        compare([run("a", one)])
    with pytest.raises(InputError, match="nothing to compare 'a' with, and a single stride has no band"):
        compare([run("a", walk(1))])


def test_of_many_channels_the_main_ones_are_compared_and_all_on_demand() -> None:
    many = {f"x{k}": "m" for k in range(14)}
    runs_ = [run("a", walk(force="N", **many)), run("b", walk(force="N", **many))]
    found = compare(runs_)
    assert list(found.parts[0].differences) == ["ankle_angle", "force"]
    assert "2 of 16 channels in common are compared; --channel all takes every one." in found.remarks
    assert len(compare(runs_, ComparisonOptions(channels=("all",))).parts[0].differences) == 16
    assert list(compare(runs_, ComparisonOptions(channels=("x3", "force"))).parts[0].differences) == ["x3", "force"]


def test_what_grows_from_stride_to_stride_is_counted_from_heel_strike() -> None:
    def moving(step: float) -> Recording:
        along = np.arange(200) / 50.0
        phase = np.tile(np.arange(50) * 2.0, 4)
        ankle = step * along + 7.0
        columns = [("time [s]", along), ("gait_phase [%]", phase), ("ankle_x [m]", ankle), ("cop_x [m]", ankle + 0.1)]
        return Recording.from_columns(columns)

    found = compare([run("a", moving(1.2)), run("b", moving(1.3))])
    curves = found.parts[0].series[0].curves
    assert curves["ankle_x"].mean == pytest.approx(0.012 * np.arange(101))
    assert curves["ankle_x"].sd == pytest.approx(0.0, abs=1e-9)
    assert curves["cop_x"].mean == pytest.approx(0.1 + 0.012 * np.arange(101))
    without = Recording.from_columns(
        [(h, moving(1.2)[h.split()[0]]) for h in ("time [s]", "gait_phase [%]", "cop_x [m]")]
    )
    found = compare([run("a", moving(1.2)), run("b", moving(1.3)), run("c", without)])
    assert "'cop_x' of 'c' is left out: to count it from heel strike takes 'ankle_x', too." in found.remarks
    assert "c" not in found.parts[0].differences["cop_x"]


def test_strides_that_are_not_whole_are_left_out_and_counted() -> None:
    cut = walk(4).select(slice(10, 190))
    found = compare([run("a", walk(4)), run("b", cut)])
    assert found.parts[0].series[1].n_repeats == 2
    assert found.remarks == ("Strides of 'b' that are not whole are left out: 2 (the first is stride 1, 20 to 98 %).",)
    with pytest.raises(InputError, match="recording b has no whole stride: stride 1 goes from 20 to 98 %"):
        compare([run("a", walk(4)), run("b", walk(1).select(slice(10, 50)))])


def test_trials_are_matched_by_name() -> None:
    one, two = walk(2), walk(2, bump=3.0)
    found = compare([run("a", one, one, two), run("b", two, one, names=("two", "four"))])
    assert [part.name for part in found.parts] == ["two"]
    assert found.parts[0].differences["ankle_angle"]["b"].max_difference == pytest.approx(3.0)
    assert found.remarks == (
        "Trials of 'a' that not all have are left out: one, three.",
        "Trials of 'b' that not all have are left out: four.",
    )
    alone = compare([run("a", one, names=("x",)), run("b", two, names=("y",))])
    assert [part.name for part in alone.parts] == [""]
    with pytest.raises(InputError, match=r"no trial is in all runs: a has one, two; .*such as a.one\.parquet"):
        compare([run("a", one, two), run("b", one, names=("y",))])


def test_over_phase_needs_a_phase_and_a_reference_needs_strides() -> None:
    bench = Recording.from_columns([("time [s]", np.arange(9.0)), ("ankle_angle [deg]", np.arange(9.0))])
    assert compare([run("a", walk()), run("b", bench)]).domain == "time"
    for options, says in (
        (ComparisonOptions(domain="phase"), "recording b has no column 'gait_phase"),
        (ComparisonOptions(include_reference=True), "--reference is for strides; these are over time"),
        (ComparisonOptions(skip_strides=1), "--skip is for strides; these are over time"),
    ):
        with pytest.raises(InputError, match=says):
            compare([run("a", walk()), run("b", bench)], options)
    with pytest.raises(InputError, match="recording a has no human reference"):
        compare([run("a", walk())], ComparisonOptions(include_reference=True))
    with pytest.raises(InputError, match="'human' is the label of the reference"):
        compare([run("human", walk())], ComparisonOptions(include_reference=True))


def test_files_are_read_with_labels_of_their_own(tmp_path: Path) -> None:
    for folder in ("x", "y"):
        (tmp_path / folder).mkdir()
        parquet.write(walk(), tmp_path / folder / "recording.parquet")
    csv.write(walk(), tmp_path / "m=1.csv")
    words = [str(tmp_path / "x"), str(tmp_path / "y" / "recording.parquet"), f"mine={tmp_path / 'x'}"]
    found = runs.read_runs([*words, str(tmp_path / "m=1.csv"), str(tmp_path / "x"), f"mine={tmp_path / 'y'}"])
    assert [one.label for one in found] == ["x", "y", "mine", "m=1", "x (2)", "mine"]
    for one in found:
        ((part, recording),) = one.parts.items()
        assert part == one.label
        assert recording["ankle_angle"].tolist() == walk()["ankle_angle"].tolist()
        assert recording.units["ankle_angle"] == "deg"


def test_a_column_that_is_no_channel_is_left_out_and_told(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text("Frame,time [s],force [N],Note\n1,0.0,2.5,a\n2,0.1,,b\n")
    (one,) = runs.read_runs([str(tmp_path / "m.csv")])
    assert list(one.parts["m"].channels) == ["time", "force"]
    assert np.isnan(one.parts["m"]["force"][1])
    assert one.remarks[0].endswith("left out: 'Frame', 'Note'.")


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("a,b\n1,2\n", "no column is of the form"),
        ("force [N],x [m]\n1,2\n", "needs a channel 'time"),
        ("time [mm],force [N]\n1,2\n3,4\n", "time is in 'mm'; allowed: s, ms, min"),
        ("time [s],force [N]\n1,2\n", "has 1 sample; at least 2"),
        ("time [s],force [N]\n", "has 0 samples; at least 2"),
        ("time [s],force [N]\n1,2\n,3\n", "a time is missing in row 2"),
        ("time [s],force [N]\n1,2\n2,2\n2,3\n", r"time does not rise in row 3 \(2 s\)"),
        ("time [s],force [N]\n1,x\n2,2\n", "'x' is not a number"),
        ("time [s],force [N],force [N]\n1,2,3\n2,3,4\n", "'force' occurs twice"),
        ("", "is empty"),
        ("PAR1 no parquet", "cannot be read"),
    ],
)
def test_what_is_no_recording_is_one_sentence_with_its_name(content: str, says: str, tmp_path: Path) -> None:
    file = tmp_path / "m.csv"
    file.write_text(content)
    with pytest.raises(InputError, match=says) as caught:
        runs.read_runs([str(file)])
    assert str(file) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_paths_and_labels_that_are_none_are_refused(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    no_time = Recording.from_columns([("time [s]", np.arange(3.0)), ("x [m]", np.arange(3.0))])
    parquet.write(no_time, tmp_path / "r.parquet")
    table = pq.read_table(tmp_path / "r.parquet")
    pq.write_table(table.drop_columns(["time [s]"]), tmp_path / "no_time.parquet")
    for name, provenance in {"odd": b"{", "list": b"[1]", "device": b'{"device": "x"}'}.items():
        pq.write_table(table.replace_schema_metadata({"klute_sim": provenance}), tmp_path / f"{name}.parquet")
    for word, says in {
        str(tmp_path / "none"): "no run .*none; allowed: a run folder or a recording",
        str(tmp_path / "empty"): "empty is no run folder",
        f"{'x' * 41}={tmp_path}": "label .* not usable; allowed: 1 to 40 printable",
        f"={tmp_path}": "label .* not usable",
        f"a\nb={tmp_path}": "label .* not usable",
        "a=": "path of the run 'a=' is empty",
        "": "path of the run '' is empty",
        str(tmp_path / "no_time.parquet"): "recording .*no_time.parquet: a recording needs a channel",
        str(tmp_path / "odd.parquet"): "odd.parquet: its provenance is no JSON text",
        str(tmp_path / "list.parquet"): "list.parquet: its provenance is not of a recording",
        str(tmp_path / "device.parquet"): "device.parquet: its provenance is not of a recording",
    }.items():
        with pytest.raises(InputError, match=says):
            runs.read_runs([word])


def test_results_are_json_and_tables_of_the_same_numbers(tmp_path: Path) -> None:
    found = compare(
        [run("a", with_reference(walk())), run("b", walk(bump=3.0, seed=2))], ComparisonOptions(include_reference=True)
    )
    told = json.loads(json.dumps(results.as_json(found), allow_nan=False))
    assert told["format"] == "klute-sim-comparison/1"
    assert [(s["label"], s["repeats"]) for s in told["series"]] == [("a", [4]), ("b", [4]), ("human", [None])]
    (channel,) = told["parts"][0]["channels"]
    rows = [line.split(",") for line in results.format_csv(found).splitlines()]
    assert tuple(rows[0]) == results.DIFFERENCE_COLUMNS
    for row, difference in zip(rows[1:], channel["differences"], strict=True):
        cells = dict(zip(rows[0], row, strict=True))
        assert cells["other"] == difference["series"]
        assert float(cells["rms"]) == difference["rms"]
        assert float(cells["half_begin"]) == difference["half"][0]
        assert cells["sd_of"] == difference["sd_of"] == "human"
    results.write_curves(found, tmp_path / "b.parquet")
    table = pq.read_table(tmp_path / "b.parquet")
    assert table.num_rows == 3 * 101
    assert table.column_names == ["part", "series", "channel", "unit", "gait_phase [%]", "mean", "sd", "count"]
    second = table.slice(101, 101)
    curve = found.parts[0].series[1].curves["ankle_angle"]
    assert set(second["series"].to_pylist()) == {"b"}
    assert second["mean"].to_pylist() == curve.mean.tolist()
    assert second["sd"].to_pylist() == curve.sd.tolist()
