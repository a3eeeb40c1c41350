"""The report of a diagnosis: its numbers are the diagnosis's own, its names are harmless, every verdict has a page."""

import base64
import re
import sys
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from klute_sim.dataset import dataset
from klute_sim.dataset.split import Split
from klute_sim.dataset.write import write_trial
from klute_sim.device.files import load
from klute_sim.device.rollout import rollout
from klute_sim.device.step import settled
from klute_sim.diagnose.diagnosis import Diagnosis, Options, diagnose
from klute_sim.diagnose.doubt import Rival
from klute_sim.effects import catalogue
from klute_sim.errors import InputError, MissingExtraError
from klute_sim.provenance import versions
from klute_sim.report import diagnosis_figures as pictures
from klute_sim.report import diagnosis_page as page
from klute_sim.report import diagnosis_traces as traces
from klute_sim.report import diagnosis_words as words
from klute_sim.report.workbench import diagnosis as recording
from klute_sim.report.workbench import diagnosis_map
from klute_sim.units import BAR

RATE, TIME, FINE = 200.0, 1.2, 10
SLOPE = 12.0
"""Of the hidden braid hysteresis [N/bar]."""
EVIL = "<script>alert(1)</script>$^$"


def trial(path: Path, group: int, seed: int) -> None:
    """A ramp and a step with hidden hysteresis, seen by a noisy load cell and a noisy gauge."""
    device = load("klute-3-4-pair").parameters
    samples = np.arange(int(RATE * TIME) + 1) / RATE
    grid = np.arange(FINE * (len(samples) - 1) + 1) / (RATE * FINE)
    moved = 0.335 + 0.008 * np.sin(2.0 * np.pi * (1.0 + group) * np.maximum(0.0, samples - 0.2))
    stepped = BAR * np.interp(samples, [0.0, 0.7, 0.8], [2.5 + 0.5 * group, 2.5 + 0.5 * group, 4.0])
    length, command = np.interp(grid, samples, moved), np.interp(grid, samples, stepped)
    effects = catalogue.values({("braid_hysteresis", "coulomb"): {"slope_n_per_bar": SLOPE}})
    hidden = device._replace(effects=effects)
    found = rollout(hidden, length, command, grid[1], start=settled(hidden, length[0], command[0]))
    random, every = np.random.default_rng(seed), slice(None, None, FINE)
    count = len(grid[every])
    columns = {
        "time [s]": grid[every],
        "length [mm]": 1e3 * length[every],
        "pressure_command [bar]": command[every] / BAR,
        "force [N]": found.tension[every] + random.normal(0.0, 3.0, count),
        "pressure [bar]": found.pressure[every] / BAR + random.normal(0.0, 0.01, count),
    }
    write_trial(path, columns)


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    folder = tmp_path_factory.mktemp("bench")
    text = 'format = "klute-sim-dataset/1"\nrig = "bench"\ndevice = "klute-3-4-pair"\n'
    text += '[uncertain]\n"muscle.c10_kpa" = "10 %"\n"tendon.stiffness_1_n_per_mm" = "10 %"\n'
    for group in (0, 1):
        for repeat in (0, 1):
            trial(folder / f"g{group}_{repeat}.csv", group, 10 * group + repeat)
            use = ("fit", "show")[group]
            text += f'[[trial]]\nfiles = ["g{group}_{repeat}.csv"]\ngroup = "g{group}"\nuse = "{use}"\n'
    (folder / "dataset.toml").write_text(text)
    return diagnose(dataset.read(folder), Options(only=("braid_hysteresis", "sensor_offset")))


@pytest.fixture(scope="module")
def plain(found: Diagnosis) -> str:
    return page.render(found, {})


def text_of(html: str) -> str:
    """What a reader sees of ``html``."""
    body = re.sub(r"<style>.*?</style>", "", html, flags=re.DOTALL)
    return " ".join(unescape(re.sub(r"<[^>]*>", " ", body)).split())


def rows_of(html: str, section: str) -> list[list[str]]:
    """Cells of the tables in a section, row by row."""
    part = re.split(r"<h2", html.split(f'<h2 id="{section}"')[1])[0]
    return [
        [text_of(cell) for cell in re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row, flags=re.DOTALL)]
        for row in re.findall(r"<tr[^>]*>(.*?)</tr>", part, flags=re.DOTALL)
    ]


def axes_of(figure: Any) -> list[Any]:
    return [axis for axis in figure.axes if axis.get_label() != "<colorbar>"]


def test_the_example_is_what_it_should_be(found: Diagnosis) -> None:
    assert found.verdict == "named"
    assert [term.effect for term in found.found] == ["braid_hysteresis"]


def test_units_are_those_of_the_keys() -> None:
    assert words.split_key("stiffness_n_per_mm") == ("stiffness", "N/mm")
    assert words.split_key("damper.orifice_concentric_mm")[1] == "mm"


def test_an_instruments_numbers_are_in_its_channels_unit(found: Diagnosis) -> None:
    for effect, expected in [
        ("sensor_offset", ("offset", "bar")),
        ("sensor_drift", ("rate", "bar/s")),
        ("sensor_lag", ("time constant", "s")),
        ("sensor_gain", ("gain", "")),
    ]:
        term = found.found[0]._replace(effect=effect, form="linear", channel="pressure")
        assert found.base is not None
        (unknown,) = replace(found.base.hypothesis, terms=(term,)).unknowns[found.base.hypothesis.base :]
        assert words.unknown(unknown, "pressure") == expected


@pytest.mark.parametrize(
    ("value", "shown"),
    [(12.0956, "12.1"), (0.010694, "0.01069"), (118.4, "118.4"), (0.0, "0"), (829501.3, "829500"), (2e-7, "2.000e-07")],
)
def test_numbers_keep_four_digits(value: float, shown: str) -> None:
    assert words.number(value) == shown


def test_identifiers_in_sentences_are_spoken() -> None:
    assert words.sentence("braid_hysteresis (maxwell_slip) fits 'muscle_length'") == (
        "Braid hysteresis (Maxwell slip) fits 'muscle length'"
    )
    assert words.sentence("group 'my_sensor_gain_2' gets worse") == "Group 'my_sensor_gain_2' gets worse"


def test_the_effect_is_told_with_its_law_and_interval(found: Diagnosis, plain: str) -> None:
    text = text_of(plain)
    term, final = found.found[0], found.final
    assert final is not None
    for part in (term.entry.sentence, term.law.equation, words.term(term)):
        assert part in text
    place = final.hypothesis.base
    rows = rows_of(plain, "effects")
    value, low, high = words.told_apart(final.values[place], *found.intervals[place])
    name = "slope slope_n_per_bar"
    assert [name, value, f"{low} to {high}", "N/bar", ""] in rows
    assert float(rows[1][1]) == pytest.approx(SLOPE, rel=0.15)
    assert all(p.source in text for p in term.law.parameters if p.source.startswith("assumed"))


def test_the_gap_is_that_of_the_diagnosis(found: Diagnosis, plain: str) -> None:
    rows = {row[0]: row for row in rows_of(plain, "gap")}
    for channel, unit, si in (("force", "N", 1.0), ("pressure", "bar", BAR)):
        gap = found.gap[channel]
        shown = [words.number(v / si, 3) for v in (gap.before, gap.refitted, gap.after, gap.floor)]
        assert rows[channel][1:6] == [unit, *shown]
    gap = found.gap["force"]
    gone = 1.0 - max(0.0, gap.after**2 - gap.floor**2) / (gap.refitted**2 - gap.floor**2)
    assert rows["force"][6] == f"{100.0 * gone:.1f} %"
    assert f"{words.number(gap.refitted, 3)} N to {words.number(gap.after, 3)} N" in text_of(plain)


def test_noise_split_steps_device_and_versions_are_there(found: Diagnosis, plain: str) -> None:
    noise = {row[0]: row for row in rows_of(plain, "noise")}["force"]
    own = found.noise["force"]
    assert noise[1:5] == ["N", words.number(own.deviation, 3), f"{100.0 * own.independent:.0f} %", str(own.samples)]
    assert float(noise[5].split()[0]) > 1.0 > float(noise[6].split()[0])
    uses = {row[0].split(":")[0]: row[1] for row in rows_of(plain, "trials")[1:]}
    assert uses == {"fit": "g0_0 (g0), g0_1 (g0)", "select": "none", "show": "g1_0 (g1), g1_1 (g1)"}
    assert found.base is not None
    assert found.final is not None
    device = {row[0]: row for row in rows_of(plain, "device")}["muscle.c10_kpa"]
    before, after = (f"{fit.steps[0]:+.2f}" for fit in (found.base, found.final))
    assert device[1:5] == ["kPa", "118.4", "11.8", words.number(found.base.values[0])]
    assert [device[5], device[7]] == [before, after]
    for row, value, ends in zip(rows_of(plain, "device")[1:], found.final.values, found.intervals, strict=False):
        assert [row[6], *row[8].split(" to ")] == list(words.told_apart(value, *ends))
    text = text_of(plain)
    assert f"{found.rollouts} simulations" in text
    assert all(f"{name} {version}" in text for name, version in versions().items())
    for step in found.steps:
        assert words.sentence(step.why) in text
    fall = found.steps[0].before.criterion(found.effective) - found.steps[0].refits[0].criterion(found.effective)
    assert ["braid hysteresis (Coulomb)", f"{fall:.1f}"] in [[row[0], row[2]] for row in rows_of(plain, "steps")]


def test_what_was_not_looked_at_is_said(plain: str) -> None:
    unseen = text_of(plain.split('<h2 id="unseen"')[1])
    assert "seal friction" in unseen
    assert "braid hysteresis" not in unseen
    assert "not measured: muscle length" in unseen
    assert "no second group" in unseen  # there is one to fit, and none to select by


def clean(found: Diagnosis) -> Diagnosis:
    """``found`` as it would be if no effect had been accepted."""
    assert found.base is not None
    step = replace(found.steps[0], added=None, why="nothing promises enough")
    intervals = found.intervals[: found.base.hypothesis.base]
    return replace(found, final=found.base, found=(), intervals=intervals, steps=[step], reasons=["It fits."])


def rivalled(found: Diagnosis) -> Diagnosis:
    other = next(f for f in found.steps[0].refits if f.hypothesis.terms[-1] != found.found[0])
    return replace(found, verdict="ambiguous", rivals=[Rival(other, found.found[0], 2.25)])


def bare(found: Diagnosis) -> Diagnosis:
    return Diagnosis(
        dataset=found.dataset,
        split=found.split,
        verdict="insufficient-data",
        reasons=["No trial is repeated."],
        experiments=found.experiments,
    )


def test_every_verdict_has_a_page(found: Diagnosis) -> None:
    unexplained = replace(found, verdict="unexplained")
    for one, sentence in [
        (found, "The simulated device lacks braid hysteresis (Coulomb)."),
        (
            unexplained,
            "lacks something that is not fully explained; braid hysteresis (Coulomb) comes closest, as a proxy",
        ),
        (replace(clean(found), verdict="unexplained"), "no effect that was looked for explains it."),
        (replace(clean(found), verdict="nothing-missing"), "Nothing is missing"),
        (bare(found), "These data cannot tell whether the simulation lacks anything."),
    ]:
        html = page.render(one, {})
        answer = text_of(html.split('<div class="answer')[1].split("</div>")[0])
        assert sentence in answer, one.verdict
        assert f"Verdict: {one.verdict}" in answer
        assert all(words.sentence(reason) in text_of(html) for reason in one.reasons)
        assert ('id="effects"' in html) == bool(one.found)
        assert ("(a proxy)" in html) == (one is unexplained)
        assert ('id="gap"' in html) == (one.final is not None)


def test_rivals_are_named_with_their_distance(found: Diagnosis) -> None:
    one = rivalled(found)
    html, rival = page.render(one, {}), words.term(one.rivals[0].fit.hypothesis.terms[-1])
    assert f"{rival} would explain the data as well" in words.verdict(one)
    row = rows_of(html, "rivals")[1]
    assert row[:3] == [rival, "braid hysteresis (Coulomb)", "worse by 2.2"]
    last = one.rivals[0].fit.values[-1]
    assert words.number(last) in row[3]
    assert 'id="rivals"' not in page.render(found, {})


def test_the_next_experiment_is_proposed(found: Diagnosis, plain: str) -> None:
    html = page.render(replace(found, next_experiment={"sentence": "Turn <the rig> over.", "inputs": {}}), {})
    assert "Turn <the rig> over." in text_of(html.split('<div class="answer')[1].split("</div>")[0])
    assert "What to record next" not in plain


def test_a_fit_that_did_not_converge_or_stands_at_a_bound_is_confessed(found: Diagnosis, plain: str) -> None:
    assert found.final is not None
    steps = found.final.steps.copy()
    steps[0] = 3.0
    doubtful = replace(found, final=replace(found.final, converged=False, steps=steps))
    html = page.render(doubtful, {})
    assert "with what was found did not converge" in html
    assert "did not converge" not in plain
    assert rows_of(html, "device")[1][-1] == "in the end at the end of what is allowed"
    assert rows_of(plain, "device")[1][-1] == ""


def test_fitted_trials_are_not_sold_as_kept_back(found: Diagnosis) -> None:
    fitted = replace(found, shown_on="fit")
    assert "none was kept back" in words.improvement(fitted)
    assert "none was kept back to show" in page.render(fitted, {})
    trials = traces.simulated(fitted)
    assert [one.experiment.name for one in trials] == ["g0_0", "g0_1"]
    assert "it was fitted" in pictures.overlay(fitted, trials[0]).get_suptitle()
    assert "fitted" in pictures.gaps(fitted).get_suptitle()


def evil(found: Diagnosis) -> Diagnosis:
    """``found`` with a name that attacks everywhere a name comes from the data."""
    data = found.dataset
    trials = tuple(replace(t, name=f"{EVIL}{k}", group=EVIL, device=data.device) for k, t in enumerate(data.trials))
    uncertain = dict(data.uncertain)
    return replace(
        found,
        dataset=replace(data, trials=trials, folder=Path(EVIL), remarks=(f"file {EVIL} is odd",), uncertain=uncertain),
        split=Split((trials[0].name, trials[1].name), (), (trials[2].name, trials[3].name), f"drawn: {EVIL}"),
        reasons=[EVIL],
        experiments=[replace(e, name=t.name, group=EVIL) for e, t in zip(found.experiments, trials, strict=True)],
        steps=[replace(step, gains={EVIL: 0.1}, why=EVIL) for step in found.steps],
    )


@pytest.fixture(scope="module")
def attacked(found: Diagnosis, tmp_path_factory: pytest.TempPathFactory) -> str:
    file = tmp_path_factory.mktemp("page") / "page.html"
    page.write(evil(found), file)
    return file.read_text("utf-8")


def test_names_from_the_data_are_harmless(attacked: str) -> None:
    assert "<script" not in attacked
    for section in ("trials", "steps"):
        assert "&lt;script&gt;" in attacked.split(f'<h2 id="{section}"')[1].split("<h2")[0]
    assert text_of(attacked).count("<script>") >= 8


def test_the_page_carries_its_pictures_and_nothing_from_elsewhere(attacked: str) -> None:
    images = re.findall(r'<img src="data:image/png;base64,([^"]+)"', attacked)
    assert len(images) == 4
    assert all(base64.b64decode(image).startswith(b"\x89PNG") for image in images)
    assert attacked.count("src=") == 4
    assert "http:" not in attacked
    assert "https:" not in attacked


def test_all_pictures_are_saved(found: Diagnosis, tmp_path: Path) -> None:
    paths = pictures.save_all(found, tmp_path / "new" / "folder")
    assert [path.name for path in paths] == ["before_after.png", "gap.png", "ranking.png", "where.png"]
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in paths)
    assert pictures.save_all(bare(found), tmp_path / "none") == []


def test_the_overlay_shows_the_channels_in_their_units(found: Diagnosis) -> None:
    one = traces.simulated(found)[0]
    assert one.experiment.name == "g1_0"
    figure = pictures.overlay(found, one)
    axes = axes_of(figure)
    assert [axis.get_ylabel().replace("\n", " ") for axis in axes] == [
        "force [N]",
        "measured - simulated [N]",
        "pressure [bar]",
        "measured - simulated [bar]",
    ]
    assert axes[-1].get_xlabel().endswith("[s]")
    assert "g1_0" in figure.get_suptitle()
    lines = {line.get_label(): line for line in axes[2].get_lines()}
    measured = one.experiment.measured["pressure"]
    assert lines["measured"].get_ydata() == pytest.approx(measured.value / BAR)
    assert lines["measured"].get_xdata() == pytest.approx(measured.time - one.experiment.begin)
    before, after = (np.std(line.get_ydata()) for line in axes[1].get_lines()[:2])
    assert before == pytest.approx(np.std(one.experiment.measured["force"].value - one.before["force"]))
    assert before > 2.0 * after
    assert {line.get_label() for line in axes_of(pictures.overlay(clean(found), one))[0].get_lines()} == {
        "measured",
        "simulated",
    }


def test_simulated_trials_have_the_gap_of_the_diagnosis(found: Diagnosis) -> None:
    for which in ("before", "after"):
        rest = [
            one.experiment.measured["force"].value - getattr(one, which)["force"] for one in traces.simulated(found)
        ]
        gap = found.gap["force"]
        wanted = gap.refitted if which == "before" else gap.after
        assert np.sqrt(np.mean(np.concatenate(rest) ** 2)) == pytest.approx(wanted, rel=1e-9)


def test_gap_bars_are_the_gaps(found: Diagnosis) -> None:
    axes = axes_of(pictures.gaps(found))
    assert [axis.get_title() for axis in axes] == ["force", "pressure"]
    gap = found.gap["pressure"]
    widths = [bar.get_width() for bar in axes[1].patches]
    assert widths == pytest.approx([v / BAR for v in (gap.before, gap.refitted, gap.after, gap.floor)])
    assert "[bar]" in axes[1].get_xlabel()
    labels = [label.get_text() for label in axes[0].get_yticklabels()]
    assert labels == ["nominal device", "refitted", "with effects added", "noise of repeats"]
    assert len(axes_of(pictures.gaps(clean(found)))[0].patches) == 3


def test_the_ranking_has_every_step_with_its_winner_first(found: Diagnosis) -> None:
    figure = pictures.ranking(found)
    axes = axes_of(figure)
    assert len(axes) == len(found.steps)
    names = [label.get_text() for label in axes[0].get_yticklabels()]
    assert names[0] == "braid hysteresis (Coulomb)"
    assert axes[0].get_yticklabels()[0].get_fontweight() == "bold"
    assert len(names) == len(found.steps[0].candidates)
    assert axes[0].get_xscale() == "log"
    bars = pictures.ranked(found, found.steps[0])
    promised = {words.term(c.term): c.gain for c in found.steps[0].candidates}
    assert {bar.name: bar.promised for bar in bars} == promised
    assert [bar.accepted for bar in bars] == [True] + [False] * (len(bars) - 1)
    shown = [text.get_text() for text in axes[0].texts]
    assert shown[0] == f"falls by {bars[0].fall:.0f}"


def test_where_tells_the_misfit_in_units_of_noise(found: Diagnosis) -> None:
    figure = pictures.where(found)
    labels = {axis.get_xlabel() for axis in axes_of(figure)}
    assert labels == {"prescribed length [mm]", "time from the trial's start [s]", "motion of the rig"}
    assert found.base is not None
    own = pictures.seen(found, "force")
    fitted = [e for e in found.experiments if e.use == "fit"]
    rows = zip(fitted, found.base.residuals, strict=True)
    residual = np.concatenate([r["force"] / e.loud["force"] for e, r in rows]) / found.noise["force"].deviation
    assert own.before == pytest.approx(residual)
    assert own.course.min() == pytest.approx(0.327, abs=2e-4)
    assert own.pressure.max() == pytest.approx(4.0 * BAR)
    motion = next(axis for axis in axes_of(figure) if axis.get_xlabel() == "motion of the rig")
    slow = np.sqrt(np.mean(own.before[own.rate < -fitted[0].course.slow] ** 2))
    assert motion.patches[0].get_height() == pytest.approx(slow)
    title = figure.subfigs[0].get_suptitle()
    assert title.startswith(words.spoken(found.where[0].channel))
    assert f"{100.0 * found.where[0].share:.0f} % of all channels' misfit" in title
    nothing = pictures.where(replace(clean(found), verdict="nothing-missing"))
    assert "misfit" not in nothing.subfigs[0].get_suptitle()


def test_bins_hold_the_root_mean_square_where_there_are_samples() -> None:
    place = np.repeat([0.5, 1.5, 2.5], [10, 10, 3])
    residual = np.repeat([2.0, -3.0, 9.0], [10, 10, 3])
    binned = pictures._binned((place,), [np.arange(4.0)], residual)
    assert binned == pytest.approx([2.0, 3.0, np.nan], nan_ok=True)


@pytest.fixture(scope="module")
def chunks(found: Diagnosis, tmp_path_factory: pytest.TempPathFactory) -> Any:
    rr = pytest.importorskip("rerun")
    file = tmp_path_factory.mktemp("rerun") / "r.rrd"
    recording.write(evil(found), file)
    return rr.chunk.RrdReader(file)


def test_the_recording_reads_back_equal(found: Diagnosis, chunks: Any) -> None:
    series: dict[str, Any] = {}
    for chunk in chunks.stream():
        if not chunk.is_static:
            batch = chunk.to_record_batch()
            (name,) = [n for n in batch.schema.names if n.endswith("Scalars:scalars")]
            path = str(chunk.entity_path).lstrip("/")
            assert path not in series, "sent in more than one piece"
            series[path] = np.array(batch.column(name).to_pylist(), dtype=np.float64).ravel()
    trials = traces.simulated(found)
    assert len(series) == 2 * 2 * 5
    for number, one in enumerate(trials, start=1):
        for channel, unit in (("force", 1.0), ("pressure", BAR)):
            here, measured = f"trial_{number}/{channel}", one.experiment.measured[channel].value
            assert np.array_equal(series[f"{here}/signal/measured"], measured / unit)
            for which in ("before", "after"):
                value = getattr(one, which)[channel]
                assert np.array_equal(series[f"{here}/signal/{which}"], value / unit)
                assert np.array_equal(series[f"{here}/residual/{which}"], (measured - value) / unit)


def test_the_recording_has_one_layout(chunks: Any) -> None:
    assert len(list(chunks.blueprints())) == 1


def test_a_recording_needs_rerun(found: Diagnosis, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(MissingExtraError, match=r"pip install '\.\[rerun\]'"):
        recording.write(found, tmp_path / "r.rrd")
    assert not (tmp_path / "r.rrd").exists()


def test_a_recording_needs_trials_that_were_simulated(found: Diagnosis, tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    with pytest.raises(InputError, match="insufficient"):
        recording.write(bare(found), tmp_path / "r.rrd")
    assert not (tmp_path / "r.rrd").exists()


def test_the_page_links_to_a_recording_that_is_there(found: Diagnosis, plain: str) -> None:
    assert "rrd" not in plain
    assert '<a href="recording.rrd">' in page.render(found, {}, "recording.rrd")


def test_the_map_shows_where_the_gap_is_and_that_it_is_gone(found: Diagnosis) -> None:
    shown = traces.simulated(found)
    maps = {channel: dict(own) for channel, own in diagnosis_map.maps(found, shown)}
    before, after = maps["force"]["refitted"], maps["force"]["with effects added"]
    assert before.rows == ("g0_0", "g0_1", "g1_0 *", "g1_1 *")
    assert before.top == after.top
    one, noise = shown[0], found.noise["force"].deviation
    since, left = one.time("force"), one.experiment.measured["force"].value - one.before["force"]
    left = left / one.experiment.loud.get("force", 1.0)
    for k in (5, 20, 31):
        inside = (since >= before.edges[k]) & (since < before.edges[k + 1])
        assert before.values[2, k] == pytest.approx(np.sqrt(np.mean(left[inside] ** 2)) / noise, rel=1e-6)
    assert np.isnan(before.values[:, 0]).all()  # what friction remembers is not compared
    assert np.nanmean(before.values) > 5.0 > 1.5 > np.nanmean(after.values) > 0.5


def test_the_verdict_is_told_with_the_trials_that_no_fit_saw(found: Diagnosis) -> None:
    text = recording.page(found)
    assert text.startswith(f"# {words.verdict(found)}")
    assert "- fitted: g0_0, g0_1" in text
    assert "- shown, never fitted: g1_0, g1_1" in text
    gap = found.gap["force"]
    assert f"| force | N | {gap.before:.4g} | {gap.refitted:.4g} | {gap.after:.4g} | {gap.floor:.4g} |" in text


def test_the_loop_of_a_trial_is_force_over_length(found: Diagnosis) -> None:
    one = traces.simulated(found)[0]
    (chart,) = recording.loops(found, one, 1)
    measured, before, after = chart.curves
    assert np.array_equal(measured.y, one.experiment.measured["force"].value)
    assert np.array_equal(before.y, one.before["force"])
    assert np.array_equal(after.y, one.after["force"])
    moved = 335.0 + 8.0 * np.sin(4.0 * np.pi * np.maximum(0.0, one.time("force") - 0.2))
    assert measured.x == pytest.approx(moved, abs=0.05)
