"""Page of a diagnosis: its numbers are those of the diagnosis, names are escaped, and every verdict has a page."""

import base64
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from klute_sim.diagnosis import verdict as verdict_content
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.rejections import Rejection, list_rejections
from klute_sim.diagnosis.result import ChannelRms, Diagnosis, DiagnosisOptions
from klute_sim.diagnosis.selection.predictive_model import PredictiveModel, PredictiveResult
from klute_sim.diagnosis.transfer_prediction import ChannelPrediction, TransferPrediction
from klute_sim.diagnosis.verdict import verdict_to_dict
from klute_sim.effects import catalogue
from klute_sim.provenance import collect_versions
from klute_sim.report.diagnosis import figures, page
from klute_sim.report.diagnosis import text as words
from klute_sim.report.diagnosis.table import build_added_term_tables, build_gap_table
from klute_sim.units import BAR
from tests.report.synthetic_diagnosis import (
    SLOPE_N_PER_BAR,
    insufficient,
    rows_of,
    text_of,
    with_equivalent_model,
    with_html_attack,
    without_effects,
)


def test_synthetic_dataset_is_identified(diagnosis: Diagnosis) -> None:
    assert diagnosis.verdict == "identified"
    assert [term.effect for term in diagnosis.added_terms] == ["braid_hysteresis"]


def test_instrument_parameters_have_the_unit_of_their_channel(diagnosis: Diagnosis) -> None:
    for effect, expected in [
        ("sensor_offset", ("offset", "bar")),
        ("sensor_drift", ("rate", "bar/s")),
        ("sensor_lag", ("time constant", "s")),
        ("sensor_gain", ("gain", "")),
    ]:
        form = catalogue.get_effects()[effect].forms[0].name
        term = diagnosis.added_terms[0]._replace(effect=effect, form=form, channel="pressure")
        assert diagnosis.base_fit is not None
        (parameter,) = replace(diagnosis.base_fit.hypothesis, terms=(term,)).parameters[
            diagnosis.base_fit.hypothesis.n_prior_parameters :
        ]
        assert words.format_parameter_name(parameter, "pressure") == expected


def test_mass_of_a_model_has_its_unit(diagnosis: Diagnosis) -> None:
    assert diagnosis.final_fit is not None
    parameter = replace(diagnosis.final_fit.hypothesis.parameters[0], name="model.geom.load.mass")
    assert words.format_parameter_name(parameter, None)[1] == "kg"


def test_effect_is_shown_with_equation_and_interval(diagnosis: Diagnosis, html: str) -> None:
    text = text_of(html)
    term, final = diagnosis.added_terms[0], diagnosis.final_fit
    assert final is not None
    for part in (term.effect_definition.description, term.form_definition.equation, words.format_term(term)):
        assert part in text
    index = final.hypothesis.n_prior_parameters
    rows = rows_of(html, "effects")
    value, lower, upper = words.format_interval(final.values[index], *diagnosis.confidence_intervals[index])
    name = "slope slope_n_per_bar"
    assert [name, value, f"{lower} to {upper}", "N/bar", ""] in rows
    assert float(rows[1][1]) == pytest.approx(SLOPE_N_PER_BAR, rel=0.15)
    assert all(p.source in text for p in term.form_definition.parameters if p.source.startswith("assumed"))


def test_gap_table_matches_the_diagnosis(diagnosis: Diagnosis, html: str) -> None:
    rows = {row[0]: row for row in rows_of(html, "gap")}
    for channel, unit, si in (("force", "N", 1.0), ("pressure", "bar", BAR)):
        gap = diagnosis.channel_rms[channel]
        values = [
            words.format_number(v / si, 3) for v in (gap.nominal, gap.refitted, gap.with_effects, gap.noise_floor)
        ]
        assert rows[channel][1:6] == [unit, *values]
    gap = diagnosis.channel_rms["force"]
    removed = 1.0 - max(0.0, gap.with_effects**2 - gap.noise_floor**2) / (gap.refitted**2 - gap.noise_floor**2)
    assert rows["force"][6] == f"{100.0 * removed:.1f} %"
    assert f"{words.format_number(gap.refitted, 3)} N to {words.format_number(gap.with_effects, 3)} N" in text_of(html)


def test_rejected_candidate_has_its_tendon(diagnosis: Diagnosis, monkeypatch: pytest.MonkeyPatch) -> None:
    rejected = [Rejection(EffectTerm("leak", "orifice", tendon=tendon), "small") for tendon in (None, "extensor")]
    monkeypatch.setattr(verdict_content, "list_rejections", lambda _: rejected)
    entry = {"name": "leak", "form": "orifice", "channel": None, "number": None, "reason": "small"}
    assert verdict_to_dict(diagnosis)["rejected"] == [entry, {**entry, "tendon": "extensor"}]


def test_terminal_shows_the_gaps_of_the_page(diagnosis: Diagnosis) -> None:
    large = {"force": ChannelRms(nominal=2345.6, refitted=1234.5, with_effects=12.04, noise_floor=3.0)}
    changed = replace(diagnosis, channel_rms=large)
    cells = [next(column.cells) for column in build_gap_table(changed).columns]
    (row,) = [row for row in rows_of(page.render_page(changed, {}), "gap") if row[0] == "force"]
    assert cells == row[:6] == ["force", "N", "2350", "1230", "12", "3"]


def test_page_of_the_current_folder_has_its_name(
    diagnosis: Diagnosis, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "my-bench").mkdir()
    monkeypatch.chdir(tmp_path / "my-bench")
    here = replace(diagnosis, dataset=replace(diagnosis.dataset, folder=Path()))
    assert "Diagnosis of my-bench" in page.render_page(here, {})


def test_page_shows_noise_split_steps_device_and_versions(diagnosis: Diagnosis, html: str) -> None:
    row = {row[0]: row for row in rows_of(html, "noise")}["force"]
    noise = diagnosis.noise["force"]
    assert row[1:5] == [
        "N",
        words.format_number(noise.std, 3),
        f"{100.0 * noise.independent_fraction:.0f} %",
        str(noise.n_samples),
    ]
    assert float(row[5].split()[0]) > 1.0 > float(row[6].split()[0])
    uses = {row[0].split(":")[0]: row[1] for row in rows_of(html, "trials")[1:]}
    assert uses == {"fit": "g0_0 (g0), g0_1 (g0)", "validation": "none", "test": "g1_0 (g1), g1_1 (g1)"}
    assert diagnosis.base_fit is not None
    assert diagnosis.final_fit is not None
    device = {row[0]: row for row in rows_of(html, "device")}["muscle.c10_kpa"]
    before, after = (f"{fit.x[0]:+.2f}" for fit in (diagnosis.base_fit, diagnosis.final_fit))
    assert device[1:5] == ["kPa", "118.4", "11.8", words.format_number(diagnosis.base_fit.values[0])]
    assert [device[5], device[7]] == [before, after]
    for row, value, ends in zip(
        rows_of(html, "device")[1:], diagnosis.final_fit.values, diagnosis.confidence_intervals, strict=False
    ):
        assert [row[6], *row[8].split(" to ")] == list(words.format_interval(value, *ends))
    text = text_of(html)
    assert f"{diagnosis.n_simulations} simulations" in text
    assert all(f"{name} {version}" in text for name, version in collect_versions().items())
    for step in diagnosis.selection_history:
        assert words.format_sentence(step.reason) in text
    bic_drop = diagnosis.selection_history[0].initial_fit.bic(diagnosis.n_independent) - diagnosis.selection_history[
        0
    ].refits[0].bic(diagnosis.n_independent)
    assert ["braid hysteresis (Coulomb)", f"{bic_drop:.1f}"] in [[row[0], row[2]] for row in rows_of(html, "steps")]


def test_page_lists_what_was_not_examined(html: str) -> None:
    limitations = text_of(html.split('<h2 id="limitations"')[1])
    assert "seal friction" in limitations
    assert "braid hysteresis" not in limitations
    assert "not measured: muscle length" in limitations
    assert "no validation trial" in limitations


def test_every_verdict_has_a_page(diagnosis: Diagnosis) -> None:
    unexplained = replace(diagnosis, verdict="unexplained")
    unrepeated = replace(diagnosis, verdict="insufficient-data")
    for variant, sentence in [
        (diagnosis, "The simulated device lacks braid hysteresis (Coulomb)."),
        (
            unexplained,
            "the deviation is not fully explained; braid hysteresis (Coulomb) comes closest, as a proxy",
        ),
        (unrepeated, "braid hysteresis (Coulomb) would explain the deviation."),
        (replace(without_effects(diagnosis), verdict="unexplained"), "no candidate effect explains the deviation."),
        (replace(without_effects(diagnosis), verdict="nothing-missing"), "Nothing is missing"),
        (insufficient(diagnosis), "The data are insufficient to decide whether the simulation lacks an effect."),
    ]:
        html = page.render_page(variant, {})
        answer = text_of(html.split('<div class="answer')[1].split("</div>")[0])
        assert sentence in answer, variant.verdict
        assert f"Verdict: {variant.verdict}" in answer
        assert all(words.format_sentence(reason) in text_of(html) for reason in variant.reasons)
        assert ('id="effects"' in html) == bool(variant.added_terms)
        assert ("(a proxy)" in html) == (variant in (unexplained, unrepeated))
        assert ("Proxies: effects that come closest" in text_of(html)) == (variant in (unexplained, unrepeated))
        assert ('id="gap"' in html) == (variant.final_fit is not None)


def test_equivalent_models_are_listed_with_their_difference(diagnosis: Diagnosis) -> None:
    indistinguishable = with_equivalent_model(diagnosis)
    fit = indistinguishable.equivalent_models[0].fit
    html, name = page.render_page(indistinguishable, {}), words.format_term(fit.hypothesis.terms[-1])
    assert f"{name} would explain the data equally well" in words.describe_verdict(indistinguishable)
    (model,) = indistinguishable.equivalent_models
    term = EffectTerm("unknown_force", "sparse")
    free = model._replace(fit=replace(fit, hypothesis=replace(fit.hypothesis, terms=(term,))))
    unlimited = replace(indistinguishable, options=DiagnosisOptions(), equivalent_models=[model, free])
    sentence = words.describe_verdict(unlimited)
    assert sentence.endswith(
        f"; {name} would explain the data equally well; or an effect is missing that is not in the catalogue, and a "
        "data-driven term represents it."
    )
    chosen = replace(indistinguishable, options=DiagnosisOptions(exclude=("leak",)), equivalent_models=[model, free])
    assert "an effect is missing that is not among the effects that you allowed" in words.describe_verdict(chosen)
    larger = (*indistinguishable.added_terms, EffectTerm("seal_friction", "coulomb"))
    sentence = words.describe_verdict(replace(indistinguishable, added_terms=larger))
    assert sentence.endswith(f"; {name} alone would explain the data equally well.")
    near = [model._replace(reaches_noise=False)]
    sentence = words.describe_verdict(replace(indistinguishable, equivalent_models=near))
    assert sentence.endswith(f"; {name} would explain nearly as much.")
    row = rows_of(html, "equivalent-models")[1]
    assert row[:2] == [name, "BIC higher by 2.2"]
    assert words.format_number(fit.values[-1]) in row[2]
    predictive = model._replace(difference=0.043, criterion="prediction error")
    row = rows_of(page.render_page(replace(diagnosis, equivalent_models=[predictive]), {}), "equivalent-models")[1]
    assert row[1] == "squared error of prediction higher by 4 %"
    assert f"{name} would predict as well." in words.describe_verdict(
        replace(indistinguishable, equivalent_models=[predictive])
    )
    assert 'id="equivalent-models"' not in page.render_page(diagnosis, {})


def test_wrong_number_and_rejected_models_are_shown(diagnosis: Diagnosis) -> None:
    final, base = diagnosis.final_fit, diagnosis.base_fit
    assert final is not None
    assert base is not None
    number = EffectTerm("number_error", "value", number="muscle.bladder_radius_mm")
    wrong = replace(final, hypothesis=replace(final.hypothesis, terms=(number,)))
    models = [
        PredictiveModel(wrong, np.array([0.2, 0.2]), np.tile(final.x, (2, 1))),
        PredictiveModel(final, np.array([0.5, 0.5]), np.tile(final.x, (2, 1)), "it is at its bound"),
        PredictiveModel(base, np.ones(2), np.tile(base.x, (2, 1))),
    ]
    result = PredictiveResult(models[2], models[0], [], models, {number: 1.0}, 0.8, 0.0, "condition", 2)
    corrected = replace(
        diagnosis, verdict="identified-in-part", final_fit=wrong, added_terms=(number,), prediction=result
    )
    html = page.render_page(corrected, {})
    assert rows_of(html, "effects")[0][:3] == ["number", "declared", "fitted"]
    declared = wrong.hypothesis.parameters[-1].initial
    assert rows_of(html, "effects")[1][1] == words.format_number(declared)
    assert verdict_to_dict(corrected)["effects"][0]["declared"] == declared
    (numbers,) = build_added_term_tables(corrected, wrong)
    assert str(numbers.title) == words.NUMBERS_TITLE
    assert [next(iter(column.cells)) for column in numbers.columns[:2]] == [
        "muscle.bladder_radius_mm",
        words.format_number(declared),
    ]
    assert "bladder radius of the muscle" in text_of(html)
    assert "Number: muscle.bladder_radius_mm" in text_of(html)
    assert rows_of(html, "prediction")[1:] == [
        ["bladder radius of the muscle", "20 %", ""],
        ["braid hysteresis (Coulomb)", "50 %", "it is at its bound"],
        ["no added effect", "100 %", ""],
    ]
    reason = "The squared error of prediction changes by -50 %; it is at its bound."
    assert ["braid hysteresis (Coulomb)", reason] in rows_of(html, "rejections")


def test_fitted_candidate_that_a_later_step_only_screens_keeps_the_reason_of_its_fit(diagnosis: Diagnosis) -> None:
    first = diagnosis.selection_history[0]
    fitted = [fit.hypothesis.terms[-1] for fit in first.refits]
    other = next(term for term in fitted if term.effect != diagnosis.added_terms[0].effect)
    screened = [candidate for candidate in first.candidates if candidate.term == other]
    later = replace(first, added_term=None, refits=(), candidates=screened, rejections={})
    steps = [replace(first, rejections={}), later, later]
    reasons = {r.term: r.reason for r in list_rejections(replace(diagnosis, selection_history=steps))}
    assert reasons[other].startswith("other candidates fit better: with it, BIC falls by")
    assert reasons[other].count("; after that, the screening predicts") == 1


def test_page_says_what_the_device_file_is_for(diagnosis: Diagnosis) -> None:
    assert "device.toml in this folder holds the refitted numbers and the effects" in text_of(
        page.render_page(diagnosis, {})
    )
    assert words.describe_next_step(insufficient(diagnosis)) == ""


def test_next_experiment_is_recommended(diagnosis: Diagnosis, html: str) -> None:
    proposal = {"sentence": "Turn <the rig> over.", "inputs": {}}
    with_proposal = page.render_page(replace(diagnosis, next_experiment=proposal), {})
    assert "Turn <the rig> over." in text_of(with_proposal.split('<div class="answer')[1].split("</div>")[0])
    assert "Recommended next experiment" not in html


def test_page_warns_of_a_fit_that_did_not_converge_or_is_at_a_bound(diagnosis: Diagnosis, html: str) -> None:
    assert diagnosis.final_fit is not None
    x = diagnosis.final_fit.x.copy()
    x[0] = 3.0
    unreliable = replace(diagnosis, final_fit=replace(diagnosis.final_fit, converged=False, x=x))
    unreliable_html = page.render_page(unreliable, {})
    assert "with the added effects did not converge" in unreliable_html
    assert "did not converge" not in html
    assert rows_of(unreliable_html, "device")[1][-1] == "at a bound in the final fit"
    assert rows_of(html, "device")[1][-1] == ""


@pytest.fixture(scope="module")
def attacked_html(diagnosis: Diagnosis, tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("page")
    attacked = with_html_attack(diagnosis)
    figures.save_figures(attacked, folder)
    (folder / "recording.rrd").touch()
    page.write_page(attacked, folder)
    return (folder / "index.html").read_text("utf-8")


@pytest.mark.slow
def test_names_from_the_data_are_escaped(attacked_html: str) -> None:
    assert "<script" not in attacked_html
    for section in ("trials", "steps"):
        assert "&lt;script&gt;" in attacked_html.split(f'<h2 id="{section}"')[1].split("<h2")[0]
    assert text_of(attacked_html).count("<script>") >= 8


def test_page_embeds_its_figures_and_loads_nothing(attacked_html: str) -> None:
    images = re.findall(r'<img src="data:image/png;base64,([^"]+)"', attacked_html)
    assert len(images) == 4
    assert all(base64.b64decode(image).startswith(b"\x89PNG") for image in images)
    assert attacked_html.count("src=") == 4
    assert "http:" not in attacked_html
    assert "https:" not in attacked_html


def test_page_links_to_its_recording(attacked_html: str, html: str) -> None:
    assert "rrd" not in html
    assert '<a href="recording.rrd">' in attacked_html


def test_verdict_states_the_better_device_for_other_data(diagnosis: Diagnosis) -> None:
    channels = {"force": ChannelPrediction(nominal=2.3, refitted=5.3, with_effects=3.1, measured_range=100.0)}
    prediction = TransferPrediction("other muscles", channels)
    (entry,) = verdict_to_dict(diagnosis, [prediction])["predictions"]
    assert (entry["recommended"], entry["warnings"]) == ("as-declared", prediction.warnings)
