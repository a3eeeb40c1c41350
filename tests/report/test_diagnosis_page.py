"""The report of a diagnosis: its numbers are the diagnosis's own, its names are harmless, every verdict has a page."""

import base64
import re
from dataclasses import replace

import pytest

from klute_sim.diagnosis.workflow import Diagnosis
from klute_sim.provenance import collect_versions
from klute_sim.report.diagnosis import page
from klute_sim.report.diagnosis import text as words
from klute_sim.units import BAR
from tests.report.synthetic_diagnosis import SLOPE, bare, clean, evil, rivalled, rows_of, text_of


def test_the_example_is_what_it_should_be(found: Diagnosis) -> None:
    assert found.verdict == "named"
    assert [term.effect for term in found.added_terms] == ["braid_hysteresis"]


def test_an_instruments_numbers_are_in_its_channels_unit(found: Diagnosis) -> None:
    for effect, expected in [
        ("sensor_offset", ("offset", "bar")),
        ("sensor_drift", ("rate", "bar/s")),
        ("sensor_lag", ("time constant", "s")),
        ("sensor_gain", ("gain", "")),
    ]:
        term = found.added_terms[0]._replace(effect=effect, form="linear", channel="pressure")
        assert found.base_fit is not None
        (unknown,) = replace(found.base_fit.hypothesis, terms=(term,)).parameters[
            found.base_fit.hypothesis.n_device_parameters :
        ]
        assert words.format_parameter_name(unknown, "pressure") == expected


def test_the_effect_is_told_with_its_law_and_interval(found: Diagnosis, plain: str) -> None:
    text = text_of(plain)
    term, final = found.added_terms[0], found.final_fit
    assert final is not None
    for part in (term.effect_definition.description, term.form_definition.equation, words.format_term(term)):
        assert part in text
    place = final.hypothesis.n_device_parameters
    rows = rows_of(plain, "effects")
    value, low, high = words.format_interval(final.values[place], *found.confidence_intervals[place])
    name = "slope slope_n_per_bar"
    assert [name, value, f"{low} to {high}", "N/bar", ""] in rows
    assert float(rows[1][1]) == pytest.approx(SLOPE, rel=0.15)
    assert all(p.source in text for p in term.form_definition.parameters if p.source.startswith("assumed"))


def test_the_gap_is_that_of_the_diagnosis(found: Diagnosis, plain: str) -> None:
    rows = {row[0]: row for row in rows_of(plain, "gap")}
    for channel, unit, si in (("force", "N", 1.0), ("pressure", "bar", BAR)):
        gap = found.channel_rms[channel]
        shown = [words.format_number(v / si, 3) for v in (gap.nominal, gap.refitted, gap.with_effects, gap.noise_floor)]
        assert rows[channel][1:6] == [unit, *shown]
    gap = found.channel_rms["force"]
    gone = 1.0 - max(0.0, gap.with_effects**2 - gap.noise_floor**2) / (gap.refitted**2 - gap.noise_floor**2)
    assert rows["force"][6] == f"{100.0 * gone:.1f} %"
    assert f"{words.format_number(gap.refitted, 3)} N to {words.format_number(gap.with_effects, 3)} N" in text_of(plain)


def test_noise_split_steps_device_and_versions_are_there(found: Diagnosis, plain: str) -> None:
    noise = {row[0]: row for row in rows_of(plain, "noise")}["force"]
    own = found.noise["force"]
    assert noise[1:5] == [
        "N",
        words.format_number(own.std, 3),
        f"{100.0 * own.independent_fraction:.0f} %",
        str(own.n_samples),
    ]
    assert float(noise[5].split()[0]) > 1.0 > float(noise[6].split()[0])
    uses = {row[0].split(":")[0]: row[1] for row in rows_of(plain, "trials")[1:]}
    assert uses == {"fit": "g0_0 (g0), g0_1 (g0)", "select": "none", "show": "g1_0 (g1), g1_1 (g1)"}
    assert found.base_fit is not None
    assert found.final_fit is not None
    device = {row[0]: row for row in rows_of(plain, "device")}["muscle.c10_kpa"]
    before, after = (f"{fit.x[0]:+.2f}" for fit in (found.base_fit, found.final_fit))
    assert device[1:5] == ["kPa", "118.4", "11.8", words.format_number(found.base_fit.values[0])]
    assert [device[5], device[7]] == [before, after]
    for row, value, ends in zip(
        rows_of(plain, "device")[1:], found.final_fit.values, found.confidence_intervals, strict=False
    ):
        assert [row[6], *row[8].split(" to ")] == list(words.format_interval(value, *ends))
    text = text_of(plain)
    assert f"{found.n_simulations} simulations" in text
    assert all(f"{name} {version}" in text for name, version in collect_versions().items())
    for step in found.selection_history:
        assert words.format_sentence(step.reason) in text
    fall = found.selection_history[0].initial_fit.bic(found.n_independent) - found.selection_history[0].refits[0].bic(
        found.n_independent
    )
    assert ["braid hysteresis (Coulomb)", f"{fall:.1f}"] in [[row[0], row[2]] for row in rows_of(plain, "steps")]


def test_what_was_not_looked_at_is_said(plain: str) -> None:
    unseen = text_of(plain.split('<h2 id="unseen"')[1])
    assert "seal friction" in unseen
    assert "braid hysteresis" not in unseen
    assert "not measured: muscle length" in unseen
    assert "no second group" in unseen  # there is one to fit, and none to select by


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
        html = page.render_page(one, {})
        answer = text_of(html.split('<div class="answer')[1].split("</div>")[0])
        assert sentence in answer, one.verdict
        assert f"Verdict: {one.verdict}" in answer
        assert all(words.format_sentence(reason) in text_of(html) for reason in one.reasons)
        assert ('id="effects"' in html) == bool(one.added_terms)
        assert ("(a proxy)" in html) == (one is unexplained)
        assert ('id="gap"' in html) == (one.final_fit is not None)


def test_rivals_are_named_with_their_distance(found: Diagnosis) -> None:
    one = rivalled(found)
    html, rival = page.render_page(one, {}), words.format_term(one.equivalent_models[0].fit.hypothesis.terms[-1])
    assert f"{rival} would explain the data as well" in words.describe_verdict(one)
    row = rows_of(html, "rivals")[1]
    assert row[:3] == [rival, "braid hysteresis (Coulomb)", "worse by 2.2"]
    last = one.equivalent_models[0].fit.values[-1]
    assert words.format_number(last) in row[3]
    assert 'id="rivals"' not in page.render_page(found, {})


def test_the_next_experiment_is_proposed(found: Diagnosis, plain: str) -> None:
    html = page.render_page(replace(found, next_experiment={"sentence": "Turn <the rig> over.", "inputs": {}}), {})
    assert "Turn <the rig> over." in text_of(html.split('<div class="answer')[1].split("</div>")[0])
    assert "What to record next" not in plain


def test_a_fit_that_did_not_converge_or_stands_at_a_bound_is_confessed(found: Diagnosis, plain: str) -> None:
    assert found.final_fit is not None
    steps = found.final_fit.x.copy()
    steps[0] = 3.0
    doubtful = replace(found, final_fit=replace(found.final_fit, converged=False, x=steps))
    html = page.render_page(doubtful, {})
    assert "with what was found did not converge" in html
    assert "did not converge" not in plain
    assert rows_of(html, "device")[1][-1] == "in the end at the end of what is allowed"
    assert rows_of(plain, "device")[1][-1] == ""


@pytest.fixture(scope="module")
def attacked(found: Diagnosis, tmp_path_factory: pytest.TempPathFactory) -> str:
    file = tmp_path_factory.mktemp("page") / "page.html"
    page.write_page(evil(found), file)
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


def test_the_page_links_to_a_recording_that_is_there(found: Diagnosis, plain: str) -> None:
    assert "rrd" not in plain
    assert '<a href="recording.rrd">' in page.render_page(found, {}, "recording.rrd")
