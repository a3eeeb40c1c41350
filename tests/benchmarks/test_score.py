"""Tests of the score of a verdict, the metrics, the sizes and the follow-up."""

from pathlib import Path

import numpy as np
import pytest
from benchmarks.hidden_effects import (
    catalogue,
    device,
    follow_up,
    generate,
    imperfect,
    inputs,
    metrics,
    out_of_catalogue,
    page,
    plan,
    sizes,
)
from benchmarks.hidden_effects.metrics import DatasetResult
from benchmarks.hidden_effects.score import are_kinds_confused, is_first_right, score_follow_up, score_verdict
from benchmarks.hidden_effects.simulate import Hidden, Noise, simulate_measurements

from klute_sim.datasets.dataset import load_dataset
from klute_sim.errors import InputError

HYSTERESIS = {"name": "braid_hysteresis", "channel": None}
HYSTERESIS_OF_BOTH = tuple({**HYSTERESIS, "tendon": tendon} for tendon in ("flexor", "extensor"))
DAMPING = {"name": "muscle_damping", "channel": None}
GAIN = {"name": "sensor_gain", "channel": "force"}
FRICTION = {"name": "joint_friction", "channel": None}
WRONG_TURNS = {"name": "number_error", "number": "muscle.turns_per_m"}
PROPOSED_EXPERIMENT = {"next_experiment": {"separation_chi2": 50.0}}
"""What an `indistinguishable` verdict asks for."""
MASS = {"name": "moving_mass", "form": "rigid", "parameters": {"mass_kg": 2.0}}


ZERO = {"name": "sensor_offset", "channel": "ankle_angle", "parameters": {"offset": 0.3}}


def verdict(kind: str, *effects: dict, alternatives: tuple = (), left: float = 1.0, after: float = 1.0) -> dict:
    gap = {"force": {"refitted": left, "with_effects": after, "noise_floor": 1.0}}
    answer = {"verdict": kind, "effects": list(effects), "alternatives": list(alternatives)}
    return answer | {"gap": gap, "indistinguishable": [["braid_hysteresis", "seal_friction"]], "cpu_s": 10.0}


def truth(effects: tuple = (), instruments: tuple = (), **more: object) -> dict:
    nothing = {"strangers": [], "defect": None, "deleted": False, "size": 2.0, "block": "single"}
    return {**nothing, "effects": list(effects), "instruments": list(instruments), **more}


@pytest.mark.parametrize(
    ("hidden", "found", "outcome"),
    [
        (truth(), verdict("nothing-missing"), "right"),
        (truth(), verdict("identified", HYSTERESIS), "false-alarm"),
        (truth(), verdict("unexplained", HYSTERESIS), "flagged"),
        (truth((HYSTERESIS,)), verdict("identified", HYSTERESIS), "right"),
        (truth((HYSTERESIS,)), verdict("identified", GAIN), "wrong"),
        (truth((HYSTERESIS,)), verdict("identified", {"name": "seal_friction", "channel": None}), "twin"),
        (truth((HYSTERESIS,)), verdict("indistinguishable", GAIN, alternatives=(["braid_hysteresis"],)), "right"),
        (truth((HYSTERESIS,)), verdict("indistinguishable", GAIN, alternatives=(["end_taper"],)), "wrong"),
        (
            truth((HYSTERESIS,)),
            verdict("indistinguishable", GAIN, alternatives=(["braid_hysteresis"], ["end_taper"], ["leak"])),
            "loose",
        ),
        (truth((HYSTERESIS,), size=0.7), verdict("nothing-missing", left=1.02), "missed"),
        (truth((HYSTERESIS,), size=0.5), verdict("nothing-missing", left=1.5), "absorbed"),
        (truth((HYSTERESIS,), size=0.5), verdict("identified", GAIN), "wrong"),
        (truth((HYSTERESIS,), size=0.5), verdict("identified", HYSTERESIS), "right"),
        (truth(numbers=[WRONG_TURNS], size=0.5), verdict("nothing-missing"), "absorbed"),
        (truth(numbers=[WRONG_TURNS], size=0.7), verdict("nothing-missing"), "missed"),
        (truth((HYSTERESIS,)), verdict("unexplained", GAIN), "flagged"),
        (truth((HYSTERESIS,)), verdict("identified", *HYSTERESIS_OF_BOTH), "right"),
        (truth((HYSTERESIS,)), verdict("identified", HYSTERESIS_OF_BOTH[0]), "wrong"),
        (truth(HYSTERESIS_OF_BOTH), verdict("identified", *HYSTERESIS_OF_BOTH), "right"),
        (truth((HYSTERESIS,), deleted=True), verdict("unexplained", GAIN), "flagged"),
        (truth((HYSTERESIS,), deleted=True), verdict("identified", GAIN), "wrong"),
        (truth((HYSTERESIS,), deleted=True), verdict("nothing-missing", left=3.0), "missed"),
        (truth(strangers=[MASS]), verdict("identified", GAIN), "wrong"),
        (truth(strangers=[MASS]), verdict("unexplained"), "flagged"),
        (truth(strangers=[MASS], size=0.001), verdict("nothing-missing"), "absorbed"),
        (truth(strangers=[MASS], size=0.001), verdict("identified", GAIN), "wrong"),
        (truth((HYSTERESIS,), (GAIN,)), verdict("identified", HYSTERESIS), "part"),
        (truth((HYSTERESIS,), (GAIN,), size=0.5), verdict("identified", HYSTERESIS), "absorbed"),
        (truth((HYSTERESIS,), (GAIN,)), verdict("identified", GAIN, HYSTERESIS), "right"),
        (truth((FRICTION,)), verdict("indistinguishable", GAIN, alternatives=(["joint_friction@elbow"],)), "right"),
        (truth(defect="dead_channel"), verdict("insufficient-data"), "right"),
        (truth(defect="dead_channel"), verdict("identified", GAIN), "false-alarm"),
        (truth(law_error={"fraction": 0.03}), verdict("unexplained"), "right"),
        (truth(law_error={"fraction": 0.03}), verdict("insufficient-data"), "flagged"),
    ],
)
def test_verdict_scores(hidden: dict, found: dict, outcome: str) -> None:
    assert score_verdict(hidden, found) == outcome


@pytest.mark.parametrize(("low", "high", "outcome"), [(0.28, 0.32, "right"), (0.31, 0.34, "absorbed")])
def test_fault_that_the_registration_corrects_by_its_size_is_found(low: float, high: float, outcome: str) -> None:
    """An offset of the encoder and an error of the ankle's zero are the same."""
    hidden = truth((), (ZERO,), block="walk", size=0.2)
    found = verdict("nothing-missing", left=1.01) | {
        "numbers": {"registration.ankle_zero_deg": {"value": 0.5 * (low + high), "low": low, "high": high}}
    }
    assert score_verdict(hidden, found) == outcome
    assert is_first_right(hidden, found) == (outcome == "right")
    assert not is_first_right(truth((HYSTERESIS,)), found)


def test_first_effect_and_kind_are_scored_separately() -> None:
    both = truth((HYSTERESIS, DAMPING))
    assert is_first_right(both, verdict("identified", HYSTERESIS))
    assert not is_first_right(
        both, verdict("indistinguishable", GAIN, alternatives=(["braid_hysteresis", "muscle_damping"],))
    )
    assert not is_first_right(both, verdict("identified", GAIN, HYSTERESIS))
    assert not is_first_right(both, verdict("unexplained", HYSTERESIS))
    assert are_kinds_confused(both, verdict("identified", HYSTERESIS, GAIN))
    assert are_kinds_confused(truth((), (GAIN,)), verdict("identified", HYSTERESIS))
    assert are_kinds_confused(truth((), (GAIN,)), verdict("identified", WRONG_TURNS))  # a number of the device
    assert are_kinds_confused(truth(numbers=[WRONG_TURNS]), verdict("identified", GAIN))
    assert not are_kinds_confused(truth((HYSTERESIS,)), verdict("identified", WRONG_TURNS))
    assert not are_kinds_confused(truth(numbers=[WRONG_TURNS]), verdict("identified", HYSTERESIS))
    assert not are_kinds_confused(truth(), verdict("identified", GAIN))  # a false alarm
    assert not are_kinds_confused(
        truth((HYSTERESIS,)), verdict("indistinguishable", GAIN, alternatives=(["braid_hysteresis"],))
    )


def test_parameter_of_fault_is_compared_despite_its_name() -> None:
    true = {"name": "sensor_drift", "form": "linear", "channel": "force", "parameters": {"drift_per_s": -10.0}}
    rate = {"value": -11.0, "low": -12.0, "high": -9.0}
    found = {"name": "sensor_drift", "form": "linear", "channel": "force", "parameters": {"rate_per_s": rate}}
    row = DatasetResult("instrument_0", truth((), (true,), block="instrument"), verdict("identified", found), "right")
    (one,) = metrics.iter_parameter_intervals([row])
    assert one.relative_error == pytest.approx(0.1)
    assert one.is_covered


def test_form_that_the_catalogue_gained_later_has_no_parameters_to_compare() -> None:
    numbers = {"natural_rad_per_s": 120.0, "damping_ratio": 0.8}
    true = {"name": "pressure_lag", "form": "second_order", "parameters": numbers}
    found = {**true, "channel": None, "parameters": {"time_constant_s": {}, "damping_ratio": {}}}
    row = DatasetResult("form_0", truth((true,), block="wrong_form"), verdict("identified", found), "right")
    assert list(metrics.iter_parameter_intervals([row])) == []


def test_indistinguishable_follow_up_is_open() -> None:
    both = verdict("indistinguishable", GAIN, alternatives=(["braid_hysteresis"],))
    assert score_follow_up(truth((HYSTERESIS,)), both) == "open"
    assert score_follow_up(truth((HYSTERESIS,)), verdict("identified", HYSTERESIS)) == "right"
    assert score_follow_up(truth((HYSTERESIS,)), verdict("identified", GAIN)) == "wrong"


def test_metrics_match_results(tmp_path: Path) -> None:
    slope = {"slope_n_per_bar": 10.0}
    true = {**HYSTERESIS, "form": "coulomb", "parameters": slope}
    reported = {**true, "parameters": {"slope_n_per_bar": {"value": 11.0, "low": 9.0, "high": 12.0}}}
    off = {**true, "parameters": {"slope_n_per_bar": {"value": 14.0, "low": 13.0, "high": 15.0}}}
    rows = [
        DatasetResult("clean_0", truth(block="clean", size=0.0), verdict("nothing-missing"), "right"),
        DatasetResult("clean_1", truth(block="clean", size=0.0), verdict("identified", GAIN), "false-alarm"),
        DatasetResult("single_0", truth((true,)), verdict("identified", reported, left=5.0, after=1.4), "right"),
        DatasetResult("single_1", truth((true,)), verdict("identified", off, left=5.0, after=1.0), "right"),
        DatasetResult("single_2", truth((true,), size=0.7), verdict("nothing-missing"), "absorbed"),
        DatasetResult(
            "twin_0",
            truth((true,), block="twin"),
            verdict("indistinguishable", GAIN, alternatives=(["braid_hysteresis"],)) | PROPOSED_EXPERIMENT,
            "right",
            "right",
        ),
        DatasetResult(
            "twin_1",
            truth((true,), block="twin"),
            verdict("indistinguishable", GAIN, alternatives=(["braid_hysteresis"],)) | PROPOSED_EXPERIMENT,
            "right",
            "open",
        ),
        DatasetResult(
            "twin_2",
            truth((true,), block="twin"),
            verdict("indistinguishable", GAIN, alternatives=(["braid_hysteresis"],))
            | {"next_experiment": {"separation_chi2": 5.0}},
            "right",
            "open",
        ),
        DatasetResult("outside_0", truth(block="outside", strangers=[MASS]), verdict("identified", GAIN), "wrong"),
    ]
    faint = "outside the catalogue at 2 and 0.7 times the noise: a wrong name alone"
    for size, n in ((0.001, 0), (0.7, 1)):  # what the uncertain numbers imitate has neither size
        hidden = truth(block="faint_outside", strangers=[MASS], size=size)
        named = DatasetResult("faint_outside_0", hidden, verdict("identified", GAIN), "wrong")
        assert {one.name: one.n for one in metrics.compute_metrics([named])}[faint] == n
    found = {one.name: one for one in metrics.compute_metrics(rows)}
    alarms = found["false alarms on clean data"]
    assert (alarms.value, alarms.n, alarms.met) == (0.5, 2, False)
    # Wilson (1927) for 1 of 2.
    assert (alarms.low, alarms.high) == pytest.approx((0.0945, 0.9055), abs=1e-4)
    assert found["exact set, singles at least as large as the noise"].n == 2
    assert found["relative error of a parameter, median"].value == pytest.approx(0.25)  # of 0.1 and 0.4
    assert found["95 % intervals that cover the truth"].value == 0.5
    removed = found["misfit above the noise removed on test trials, identified, median"]
    assert removed.value == pytest.approx((0.9 + 1.0) / 2)
    assert found["wrong name, at any size"].value == pytest.approx(1 / 8)
    assert found["wrong name, all blocks of the bench"].value == pytest.approx(2 / 9)  # that outside the catalogue, too
    assert metrics.tabulate_coverage(rows) == {"single": (1, 2)}
    assert found["outside the catalogue: flagged, or nothing left to flag"].value == 0.0
    assert found["indistinguishable sets contain the truth"].value == 1.0
    decided = found["resolved by the proposed measurement or experiment"]
    assert (decided.value, decided.n) == (0.5, 2)  # of the third the program said that nothing separates it
    assert found["exact set, pairs"].value is None
    text = page.render_page(rows, {}, {"split": "test"})
    assert "| clean_1 |" in text
    assert "| block | datasets | right | false-alarm | absorbed | wrong |" in text
    assert "| single | 3 | 2 |  | 1 |  | 1 of 2 | 10 | 10 |" in text
    assert "| outside_0 | moving_mass |" in text
    assert "| single_2 |" not in text  # absorbed is nobody's fault
    assert "braid_hysteresis, coulomb" in text
    assert "Other methods" not in text
    # Another method is held against this one on what both were given.
    others = {"plain_bic": [rows[0]._replace(outcome="false-alarm"), rows[2]]}
    beside = page.render_page(rows, others, {}).split("## Other methods")[1].split("##")[0]
    summary, by_block = beside.strip().split("\n\n")
    assert [line.split("|")[1].strip() for line in summary.splitlines()[2:]] == ["klute-sim", "plain_bic"]
    lines = [[cell.strip() for cell in line.strip("|").split("|")] for line in by_block.splitlines()]
    reported = {(line[0], line[1]): dict(zip(lines[0], line, strict=True)) for line in lines[2:]}
    block = rows[2].truth["block"]
    assert {key[0] for key in reported} == {rows[0].truth["block"], block}
    assert reported["clean", "klute-sim"]["datasets"] == "1"
    assert reported["clean", "plain_bic"]["false-alarm"] == "1"
    assert reported[block, "klute-sim"] | {"method": ""} == reported[block, "plain_bic"] | {"method": ""}


def test_gait_metrics_are_separate() -> None:
    friction = {"name": "ankle_friction", "form": "coulomb", "parameters": {"moment_n_m": 2.0}}
    reported = {**friction, "channel": None, "parameters": {"moment_n_m": {"value": 2.1, "low": 1.9, "high": 2.3}}}
    bench = [DatasetResult("clean_0", truth(block="clean", size=0.0), verdict("nothing-missing"), "right")]
    walks = [
        DatasetResult("walk_0", truth((friction,), block="walk", size=2.0), verdict("identified", reported), "right"),
        DatasetResult("walk_1", truth((friction,), block="walk", size=0.7), verdict("nothing-missing"), "absorbed"),
        DatasetResult(
            "walk_clean_0", truth(block="walk_clean", size=0.0), verdict("identified", reported), "false-alarm"
        ),
    ]
    plain, found = ({one.name: one for one in metrics.compute_metrics(rows)} for rows in (bench, bench + walks))
    assert {name: found[name] for name in plain} == plain
    assert found["walks: exact set, effect at least as large as the noise"].n == 1
    assert found["walks: false alarms on clean data"].value == 1.0
    assert found["walks: wrong name, at any size"].value == pytest.approx(1 / 3)
    assert found["walks: 95 % intervals that cover the truth"].value == 1.0


@pytest.mark.slow
def test_size_of_a_wrong_number_is_what_the_uncertain_numbers_leave() -> None:
    base = device.load_device()
    bench = inputs.generate_programs(np.random.default_rng(3))[:2]
    sizer = sizes.EffectSizer(base, base, bench, ["force", "pressure"], Noise())

    def measure_size(number: str, change: float) -> float:
        return sizer.measure_size(Hidden(), {number: base[number] * (1.0 + change)})

    assert measure_size("muscle.turns_per_m", 0.0) == pytest.approx(0.0, abs=1e-3)
    assert 0.1 < measure_size("muscle.turns_per_m", 0.02) < 0.7 * measure_size("muscle.turns_per_m", 0.05)
    uncertain = next(iter(catalogue.RELATIVE_UNCERTAINTIES))
    deviation = catalogue.RELATIVE_UNCERTAINTIES[uncertain]
    assert measure_size(uncertain, deviation) < 0.2 * measure_size("muscle.turns_per_m", 0.05)


@pytest.mark.slow
def test_effects_reach_target_size() -> None:
    """By the definition: what is left after the device's numbers followed, over noise, in the worst channel."""
    base = device.load_device()
    bench = inputs.generate_programs(np.random.default_rng(3))
    scale = sizes.EffectSizer(base, base, bench, ["force", "pressure"], Noise())
    taper = {"name": "end_taper", "form": "cone", "parameters": {"cone_ratio": 1.0}, "wanted": 3.0}
    found = scale.scale_effect(taper)
    assert found["size"] == pytest.approx(3.0, rel=0.1)
    assert "wanted" not in found
    assert scale.measure_size(Hidden(effects=[found])) == pytest.approx(found["size"], rel=0.03)
    plain = device.add_effects(*device.build_neutral_law(base), ())
    change = np.concatenate(
        [
            (
                simulate_measurements(p, plain, Hidden(effects=[found]))["force"]
                - simulate_measurements(p, plain, Hidden())["force"]
            )[:: sizes.DECIMATION_FACTOR]
            for p in bench
            if p.use == "fit"
        ]
    )
    raw = float(np.sqrt(np.mean(change**2))) / Noise().force
    assert raw > 2.0 * found["size"]  # most of an end taper is taken by the other numbers
    gain = {"name": "sensor_gain", "form": "gain", "channel": "pressure", "parameters": {"gain": 0.96}, "wanted": 2.0}
    assert scale.scale_effect(gain)["size"] == pytest.approx(2.0, rel=0.1)


def test_size_search_stops_at_parameter_limits() -> None:
    def steep(scale: float) -> float:  # nothing at first, and then a lot, as where the numbers run to their bounds
        return 0.1 * scale + max(0.0, 5.0 * (scale - 2.0))

    scale, size = sizes._search_scale(steep, 2.0, lambda scale: False)
    assert size == pytest.approx(2.0, rel=0.5)
    assert steep(scale) == size
    assert sizes._search_scale(lambda s: min(s, 3.0), 8.0, lambda s: s >= 3.0) == (8.0, 3.0)
    limit = catalogue.EFFECTS["regulator_error", "gain"]["gain"]
    assert sizes._scale_value(limit, 0.95, 100.0) == pytest.approx(0.73)  # 0.9 of the way from 1 to 0.7


@pytest.mark.parametrize(
    ("key", "scale", "expected"),
    [
        (("seal_friction", "coulomb", "force_n"), 1e6, 180.0),  # of 200
        (("choked_valve", "symmetric", "resistance_s_bar_per_dm3"), 1e-6, catalogue.MIN_VALVE_RESISTANCE),
    ],
)
def test_scaled_effect_keeps_away_from_the_end_of_its_range(
    key: tuple[str, str, str], scale: float, expected: float
) -> None:
    parameter = catalogue.EFFECTS[key[:2]][key[2]]
    assert sizes._scale_value(parameter, parameter.typical, scale) == pytest.approx(expected)


@pytest.mark.slow
def test_out_of_catalogue_effects_change_expected_channels() -> None:
    program = inputs.generate_programs(np.random.default_rng(3))[0]
    program = program._replace(duration=2.0, length=program.length[:2001], command=program.command[:401])
    plain = device.add_effects(*device.build_neutral_law(device.load_device()), ())
    without = simulate_measurements(program, plain, Hidden())

    def change(name: str, form: str, **parameters: float) -> dict[str, np.ndarray]:
        stranger = {"name": name, "form": form, "parameters": parameters}
        shown = simulate_measurements(program, plain, Hidden(strangers=[stranger]))
        return {channel: shown[channel] - without[channel] for channel in shown}

    mass = change("moving_mass", "rigid", mass_kg=2.0)
    acceleration = np.gradient(np.gradient(program.length, 1e-3), 1e-3)
    assert mass["force"] == pytest.approx(2.0 * acceleration)
    assert not mass["pressure"].any()
    talk = change("cross_talk", "pressure", force_n_per_bar=3.0)
    assert talk["force"] == pytest.approx(3.0 * without["pressure"])
    stuck = change("sticking_gauge", "dead_band", width_bar=0.2)
    assert np.abs(stuck["pressure"]).max() == pytest.approx(0.1, abs=1e-6)
    assert not stuck["force"].any()
    assert np.abs(change("crosshead_play", "dead_band", width_mm=1.0)["force"]).max() > 10.0
    creep = change("load_cell_creep", "first_order", share=0.1, time_constant_s=0.5)
    assert creep["force"][0] == pytest.approx(0.1 * without["force"][0])
    assert all(name not in dict(catalogue.EFFECTS) for name in out_of_catalogue.OUT_OF_CATALOGUE_FORMS)


@pytest.mark.slow
def test_follow_up_performs_proposed_experiment(tmp_path: Path) -> None:
    fault = {"name": "sensor_offset", "form": "offset", "channel": "pressure", "parameters": {"offset": 0.5}}
    sealed = generate.make_dataset(tmp_path / "first", 5, instruments=[fault], muscle_length=False)
    words = {change.description: change for change in follow_up.RIG_CHANGES}
    gauge = next(w for w, change in words.items() if "pressure" in change.reference_channels)
    sensor = next(w for w, change in words.items() if "muscle_length" in change.added_channels)
    for change in (None, gauge, sensor):
        asked = {"protocol": "steps", "rig_change": change}
        follow_up.make_follow_up(tmp_path / "first", sealed, asked, tmp_path / "second")
        found = {trial.name: trial for trial in load_dataset(tmp_path / "second").trials}
        new = [found[f"follow_up_{repeat}"] for repeat in "ab"]
        assert {trial.group for trial in new} == {"follow_up"}
        for trial in new:
            pressure, command = trial.measured["pressure"], trial.prescribed["pressure_command"]
            off = float(np.median(pressure.value - np.interp(pressure.time, command.time, command.value))) / 1e5
            assert off == pytest.approx(0.0 if change == gauge else 0.5, abs=0.02)
            assert trial.trusted == ({"pressure"} if change == gauge else set())
            assert ("muscle_length" in trial.measured) == (change == sensor)
    first = (tmp_path / "first" / "fit_1_a.csv").read_text("utf-8")
    assert (tmp_path / "second" / "fit_1_a.csv").read_text("utf-8") == first


@pytest.mark.slow
def test_follow_up_has_the_wrong_number_and_the_imperfect_law(tmp_path: Path) -> None:
    turns = 1.05 * device.load_device()["muscle.turns_per_m"]
    wrong = {"name": "number_error", "number": "muscle.turns_per_m", "parameters": {"muscle.turns_per_m": turns}}
    law_error = imperfect.draw_law_error(np.random.default_rng(1))
    sealed = generate.make_dataset(tmp_path / "first", 5, numbers=[wrong], law_error=law_error)
    asked, forces = {"protocol": "steps", "rig_change": None}, {}
    for omitted in ("", "numbers", "law_error"):
        truth = {key: value for key, value in sealed.items() if key != omitted}
        follow_up.make_follow_up(tmp_path / "first", truth, asked, tmp_path / f"without {omitted}")
        if omitted != "law_error":
            trials = {trial.name: trial for trial in load_dataset(tmp_path / f"without {omitted}").trials}
            forces[omitted] = float(np.mean(trials["follow_up_a"].measured["force"].value))
            assert trials["follow_up_a"].specimen == "A"
        else:  # a trial without a specimen beside others with one
            with pytest.raises(InputError, match="specimen"):
                load_dataset(tmp_path / f"without {omitted}")
    assert forces["numbers"] > 1.03 * forces[""]  # more turns, less force


def test_block_outside_has_deleted_and_out_of_catalogue_effects() -> None:
    specs = plan.plan_datasets("outside", plan.BLOCK_SIZES["outside"], 1)
    deleted = {(e["name"], e["form"]) for spec in specs if spec.get("deleted") for e in spec["effects"]}
    assert len(deleted) >= 25
    assert {spec["strangers"][0]["name"] for spec in specs if "strangers" in spec} == {
        n for n, _ in out_of_catalogue.OUT_OF_CATALOGUE_FORMS
    }
    triples = plan.plan_datasets("triple", 10, 1)
    assert all(len({e["name"] for e in spec["effects"]}) == 3 for spec in triples)
    wanted = {
        e["wanted"] for spec in plan.plan_datasets("single", plan.BLOCK_SIZES["single"], 1) for e in spec["effects"]
    }
    assert wanted == set(plan.TARGET_SIZES)
