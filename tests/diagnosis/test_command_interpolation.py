"""Commands with a zero-order hold (held until the next sample): it is no delay of the device."""

from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from klute_sim.datasets.dataset import load_dataset, split_dataset
from klute_sim.datasets.trial import TimeSeries
from klute_sim.device.device import load_device
from klute_sim.diagnosis import command_interpolation, workflow
from klute_sim.diagnosis.experiments.bench import BenchExperiment, prepare_bench_trial
from klute_sim.diagnosis.experiments.gait import GaitExperiment
from klute_sim.diagnosis.experiments.interpolation import changes_in_steps, shows_updates
from klute_sim.diagnosis.experiments.mechanism import MechanismExperiment
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.noise import misfit
from klute_sim.diagnosis.noise.misfit import Misfit
from klute_sim.diagnosis.noise.repeats import Noise
from tests.diagnosis import synthetic_gait_dataset
from tests.diagnosis.synthetic_dataset import write_dataset
from tests.diagnosis.test_mechanism_diagnosis import SHORT, prepare
from tests.diagnosis.test_trial_quality import make_trial

INTERVAL_S = 0.005


def test_zero_order_hold_changes_at_its_samples() -> None:
    command = np.repeat([1e5, 3e5, 2e5], 40)
    linear = prepare_bench_trial(make_trial(INTERVAL_S, command), "fit")
    hold = linear.zero_order_hold_variant
    assert isinstance(hold, BenchExperiment)
    assert hold.has_zero_order_hold
    assert hold.zero_order_hold_variant is None
    ends = linear.start_time + linear.dt * np.arange(1, len(hold.command) + 1)
    is_after = ends > 40 * INTERVAL_S + 0.5 * linear.dt  # the step ends after the sample with the new value
    assert (hold.command[is_after & (ends < 79 * INTERVAL_S)] == 3e5).all()
    assert (hold.command[~is_after] == 1e5).all()
    assert np.ptp(linear.command[(ends > 39 * INTERVAL_S) & ~is_after]) > 1.8e5  # straight lines begin earlier
    assert hold.coarse_variant.command == pytest.approx(hold.command[1::2])


RNG = np.random.default_rng(0)
SMOOTH = 2e5 + 1e5 * np.sin(np.linspace(0.0, 20.0, 120))


@pytest.mark.parametrize(
    ("command", "expected"),
    [
        pytest.param(SMOOTH.repeat(2), True, id="two samples per update"),
        pytest.param(SMOOTH.repeat(10), True, id="ten samples per update"),
        pytest.param(np.r_[SMOOTH, np.full(60, 1e5), SMOOTH].repeat(4), True, id="a pause"),
        pytest.param(SMOOTH, False, id="a change at each sample"),
        pytest.param(SMOOTH.repeat(2) + RNG.normal(0.0, 100.0, 240), False, id="a measured command"),
        pytest.param(np.round(np.linspace(0.0, 3e5, 4000), -3), False, id="the resolution of a log"),
        pytest.param(RNG.integers(0, 2, 500).repeat(5) * 1e5, False, id="two levels"),
        pytest.param(np.repeat([1e5, 3e5, 2e5, 4e5], 40), False, id="few steps"),
        pytest.param(SMOOTH[RNG.integers(0, 120, 60)].repeat(RNG.integers(2, 60, 60)), False, id="irregular steps"),
        pytest.param(np.full(400, 2e5), False, id="a constant"),
    ],
)
def test_log_shows_the_updates_of_a_controller(command: np.ndarray, expected: bool) -> None:
    assert shows_updates(TimeSeries(INTERVAL_S * np.arange(len(command)), command)) is expected


def test_constant_command_has_no_zero_order_hold() -> None:
    assert prepare_bench_trial(make_trial(INTERVAL_S, np.full(120, 2e5)), "fit").zero_order_hold_variant is None


def test_samples_with_zero_order_hold_count_in_full() -> None:
    """The interpolation with a zero-order hold is known, so that no sample is uncertain because of it."""
    trial = prepare_bench_trial(make_trial(0.05, np.linspace(1e5, 3e5, 120)), "fit")
    hold = trial.zero_order_hold_variant
    assert hold is not None
    assert trial.input_variants
    assert len(hold.input_variants) == len(trial.input_variants) - 1


def test_noisy_variants_have_the_zero_order_hold(tmp_path: Path) -> None:
    """Else the interpolation between samples would count as noise of the command."""
    folder = write_dataset(tmp_path / "data", groups=("fit_1",), repeats=1, seconds=1.0)
    text = (folder / "dataset.toml").read_text()
    (folder / "dataset.toml").write_text(
        text.replace("[uncertain]", '[noise]\npressure_command = "2 kPa"\n[uncertain]')
    )
    data = load_dataset(folder)
    hold = prepare_experiments(data, split_dataset(data))[0].zero_order_hold_variant
    assert hold is not None
    (variant,) = hold.noisy_variants
    np.testing.assert_allclose(variant.command - hold.command, 2e3, atol=1.0)


def test_every_command_of_a_joint_has_a_zero_order_hold(tmp_path: Path) -> None:
    experiments, _ = prepare(tmp_path / "data", **SHORT)
    linear = experiments[0]
    hold = linear.zero_order_hold_variant
    assert isinstance(linear, MechanismExperiment)
    assert isinstance(hold, MechanismExperiment)
    assert hold.zero_order_hold_variant is None
    assert hold.input_variants == ()
    commands = [name for name in hold.inputs if name.startswith("pressure_command")]
    assert len(commands) == 2
    assert hold.command is hold.inputs[commands[0]]
    for name in commands:
        assert not np.array_equal(hold.inputs[name], linear.inputs[name])
        assert set(np.round(hold.inputs[name])) <= {round(v) for v in linear.inputs[name]}  # values of samples only


def make_outcome(
    names: str, *, bic: float = 0.0, verdict: str = "identified", is_imperfect: bool = False, shift_gain: float = 0.0
) -> Any:
    """Return the stand-in of an outcome that names effects; its trial has a variant with a zero-order hold."""
    terms = tuple(SimpleNamespace(effect=name) for name in names.split())
    hold = SimpleNamespace(use="fit", measured=True)
    return SimpleNamespace(
        experiments=[SimpleNamespace(zero_order_hold_variant=hold, has_stepped_command=True, use="fit", measured=True)],
        data=SimpleNamespace(with_experiments=lambda experiments: None, noise={}),
        base_fit=SimpleNamespace(chi2=1.0, hypothesis=None, x=None),
        search=SimpleNamespace(bic_threshold=6.0),
        selected=SimpleNamespace(
            verdict=verdict,
            prediction=object() if is_imperfect else None,
            final_fit=SimpleNamespace(hypothesis=None, x=None),
        ),
        terms=terms,
        n_time_shifts=sum(term.effect in command_interpolation.TIME_SHIFTS for term in terms),
        compute_bic=lambda data: bic,
        compute_shift_gain=lambda: shift_gain,
    )


def replace_computations(monkeypatch: pytest.MonkeyPatch, *, chi2: float, has_repeats: bool = True) -> None:
    """Replace what needs trials, which the stand-ins of outcomes lack; the residual of a fit is the rms of its misfit.

    ``chi2`` is that of a zero-order hold.
    """
    monkeypatch.setattr(command_interpolation, "has_repeats", lambda experiments: has_repeats)
    monkeypatch.setattr(command_interpolation, "_compute_chi2", lambda data, fit: chi2)
    monkeypatch.setattr(command_interpolation, "_copy_weights", lambda data, weighted: data)
    monkeypatch.setattr(command_interpolation, "_fit_gauges_and_supply", lambda prepared: prepared)

    def estimate(experiments: Any, rms: float, noise: Mapping[str, Noise]) -> dict[str, Misfit]:
        return {channel: Misfit(rms, 9.0, 400.0) for channel in noise} if has_repeats else {}

    monkeypatch.setattr(misfit, "estimate_misfit", estimate)


def select_interpolation(linear: Any, hold: Any) -> tuple[Any, list[str]]:
    return command_interpolation.select_command_interpolation(
        linear, lambda trials: hold, lambda prepared: hold, lambda fraction, stage: None
    )


@pytest.mark.parametrize(
    ("linear", "hold", "is_hold"),
    [
        pytest.param(make_outcome("leak"), make_outcome("leak", bic=-7.0), True, id="better"),
        pytest.param(make_outcome("leak"), make_outcome("leak", bic=-5.0), False, id="hardly better"),
        pytest.param(make_outcome("leak clock_skew"), make_outcome("leak", bic=5.0), True, id="fewer names"),
        pytest.param(make_outcome("leak clock_skew"), make_outcome("leak", bic=7.0), False, id="fewer names, worse"),
        pytest.param(
            make_outcome("leak clock_skew", shift_gain=90.0), make_outcome("leak", bic=7.0), True, id="most of a shift"
        ),
        pytest.param(
            make_outcome("leak clock_skew", shift_gain=90.0), make_outcome("leak", bic=10.0), False, id="not all of it"
        ),
        pytest.param(make_outcome("leak"), make_outcome("pressure_delay", bic=-90.0), False, id="a shift instead"),
        pytest.param(make_outcome("leak"), make_outcome("leak clock_skew", bic=-90.0), False, id="a further shift"),
        pytest.param(
            make_outcome("leak"), make_outcome("leak", bic=-90.0, verdict="unexplained"), False, id="unexplained"
        ),
        pytest.param(
            make_outcome("leak", is_imperfect=True), make_outcome("hose", bic=-90.0, is_imperfect=True), False,
            id="imperfect law",
        ),
        pytest.param(
            make_outcome("clock_skew", is_imperfect=True), make_outcome("hose", bic=-90.0, is_imperfect=True), True,
            id="imperfect law, no shift",
        ),
        pytest.param(
            make_outcome("leak hose", is_imperfect=True), make_outcome("leak", bic=-90.0, is_imperfect=True), True,
            id="imperfect law, fewer names",
        ),
        pytest.param(
            make_outcome("leak", is_imperfect=True), make_outcome("leak", bic=-90.0), True, id="no imperfect law"
        ),
    ],
)  # fmt: skip
def test_zero_order_hold_is_selected_where_it_explains_the_data_better(
    linear: Any, hold: Any, is_hold: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    replace_computations(monkeypatch, chi2=0.0, has_repeats=False)
    outcome, remarks = select_interpolation(linear, hold)
    assert outcome is (hold if is_hold else linear)
    assert len(remarks) == is_hold


@pytest.mark.parametrize(
    ("linear_misfit", "hold_misfit", "is_hold"),
    [
        pytest.param(0.05e5, 0.0, True, id="the pressure agrees with the zero-order hold only"),
        pytest.param(0.0, 0.0, False, id="with both"),
        pytest.param(0.05e5, 0.05e5, False, id="with neither: the supply lacks something, too"),
    ],
)
def test_pressure_decides_where_the_law_of_the_muscle_is_imperfect(
    linear_misfit: float, hold_misfit: float, is_hold: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No imperfect law of a muscle is in its pressure; a hose was named for the interpolation of the command before."""
    linear, hold = (
        make_outcome(name, verdict=verdict, bic=bic, is_imperfect=True)
        for name, verdict, bic in (("hose", "indistinguishable", 0.0), ("leak", "unexplained", -90.0))
    )
    for outcome, rms in ((linear, linear_misfit), (hold, hold_misfit)):
        outcome.data.experiments, outcome.data.noise = [], {"pressure": None, "force": None}
        outcome.data.compute_residuals = lambda hypothesis, points, rms=rms: [rms]
    replace_computations(monkeypatch, chi2=0.0)
    outcome, remarks = select_interpolation(linear, hold)
    assert outcome is (hold if is_hold else linear)
    assert [remark.endswith("agrees with the zero-order hold only.") for remark in remarks] == [True] * is_hold
    prepared = command_interpolation.prepare_zero_order_hold(linear, lambda trials: hold)
    assert prepared == ((hold, remarks[0]) if is_hold else None)


@pytest.mark.parametrize(("hold_bic", "is_hold"), [(90.0, False), (5.0, True)])
def test_shift_that_explains_all_data_better_outweighs_pressures_that_agree_with_a_zero_order_hold(
    hold_bic: float, is_hold: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    linear, hold = make_outcome("pressure_delay"), make_outcome("leak", bic=hold_bic)
    for outcome, rms in ((linear, 0.05e5), (hold, 0.0)):
        outcome.data.experiments, outcome.data.noise = [], {"pressure": None}
        outcome.data.compute_residuals = lambda hypothesis, points, rms=rms: [rms]
    replace_computations(monkeypatch, chi2=0.0)
    assert select_interpolation(linear, hold)[0] is (hold if is_hold else linear)


@pytest.mark.parametrize(
    ("hold_misfit", "stepped_misfit", "expected"),
    [(0.05e5, 0.0, "stepped"), (0.0, 0.0, "hold"), (0.05e5, 0.05e5, "")],
    ids=["in trials with steps only", "in all trials", "in none"],
)
def test_pressure_decides_which_trials_have_a_zero_order_hold(
    hold_misfit: float, stepped_misfit: float, expected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A program that logs steps and sines at 200 Hz holds the steps until its next sample, and no sine."""
    prepared = prepare_with_misfits(monkeypatch, linear=0.05e5, hold=hold_misfit, stepped=stepped_misfit)
    assert prepared == expected


@pytest.mark.parametrize(
    ("misfits", "expected"),
    [
        ({"linear": 0.03e5, "hold": 0.02e5, "stepped": 0.0}, "stepped"),
        ({"linear": 0.03e5, "hold": 0.0, "stepped": 0.0}, "hold"),
        ({"linear": 0.0, "hold": 0.0, "stepped": 0.0}, ""),
        ({"linear": 0.03e5, "hold": 0.03e5, "stepped": 0.03e5}, ""),
    ],
)
def test_wrong_gauge_does_not_hide_which_interpolation_the_pressure_agrees_with(
    misfits: dict[str, float], expected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A gauge that reads 1 % too much leaves a misfit for every interpolation."""
    left = dict.fromkeys(misfits, 0.05e5)
    assert prepare_with_misfits(monkeypatch, **left, with_gauges=misfits) == expected


def prepare_with_misfits(
    monkeypatch: pytest.MonkeyPatch,
    *,
    linear: float,
    hold: float,
    stepped: float,
    with_gauges: Mapping[str, float] | None = None,
) -> str:
    """Return the interpolation that the misfits [Pa] of a measured pressure decide before the search, '' if none.

    ``with_gauges`` are those with faults of the gauges and delays of the supply; None: the same.
    """
    left = {"linear": linear, "hold": hold, "stepped": stepped}
    outcomes = {name: make_outcome("") for name in left}
    extended = {id(outcome): make_outcome("") for outcome in outcomes.values()}
    for name, outcome in outcomes.items():
        for model, rms in ((outcome, left[name]), (extended[id(outcome)], (with_gauges or left)[name])):
            model.data.experiments, model.data.noise = [], {"pressure": None}
            model.data.compute_residuals = lambda hypothesis, points, rms=rms: [rms]
    step, sine = (
        SimpleNamespace(zero_order_hold_variant=name, has_stepped_command=name == "step", use="fit", measured=True)
        for name in ("step", "sine")
    )
    outcomes["linear"].experiments = [step, sine]
    replace_computations(monkeypatch, chi2=0.0)
    monkeypatch.setattr(command_interpolation, "_fit_gauges_and_supply", lambda prepared: extended[id(prepared)])

    def prepare_trials(trials: list[Any]) -> Any:
        if trials == ["step", "sine"]:
            return outcomes["hold"]
        assert trials == ["step", sine]
        return outcomes["stepped"]

    decided = command_interpolation.prepare_zero_order_hold(outcomes["linear"], prepare_trials)
    if decided is None:
        return ""
    name = next(name for name, outcome in outcomes.items() if outcome is decided[0])
    assert decided[1].startswith("The commands of trials") == (name == "stepped")
    return name


@pytest.mark.parametrize(
    ("command", "expected"),
    [
        pytest.param(np.repeat([1e5, 3e5, 2e5, 4e5], 40), True, id="steps"),
        pytest.param(np.repeat([1e5, 3e5, 2e5], 40) + RNG.normal(0.0, 200.0, 120), True, id="measured steps"),
        pytest.param(SMOOTH, False, id="a sine"),
        pytest.param(np.r_[np.full(40, 1e5), SMOOTH], False, id="a step and a sine"),
        pytest.param(np.repeat([1e5, 3e5], 40) + np.linspace(0.0, 1e5, 80), False, id="a step on a ramp"),
        pytest.param(np.r_[np.full(40, 1e5), 2e5, np.full(40, 3e5)], False, id="a fast ramp"),
    ],
)
def test_stepped_command_is_constant_between_its_steps(command: np.ndarray, expected: bool) -> None:
    assert changes_in_steps(TimeSeries(INTERVAL_S * np.arange(len(command)), command)) is expected


@pytest.mark.parametrize(
    ("linear_left", "hold_left", "hold_names", "is_hold"),
    [
        pytest.param(0.05e5, 0.0, "number_error", True, id="with a zero-order hold, the names explain the pressure"),
        pytest.param(0.05e5, 0.0, "clock_skew", False, id="and a further shift in time"),
        pytest.param(0.0, 0.0, "number_error", False, id="with both"),
        pytest.param(0.05e5, 0.05e5, "number_error", False, id="with neither"),
    ],
)
def test_zero_order_hold_completes_the_names_of_a_pressure(
    linear_left: float, hold_left: float, hold_names: str, is_hold: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A wrong rate of the supply hid the zero-order hold: without it, linear interpolation fits better."""
    linear = make_outcome("leak", verdict="unexplained", is_imperfect=True)
    hold = make_outcome(hold_names, verdict="identified-in-part", bic=-90.0, is_imperfect=True)
    for outcome, rms in ((linear, linear_left), (hold, hold_left)):
        outcome.base_fit.x, outcome.selected.final_fit.x = 0.1e5, rms
        outcome.data.experiments, outcome.data.noise = [], {"pressure": Noise(2.0, ())}
        outcome.data.compute_residuals = lambda hypothesis, points: points
    replace_computations(monkeypatch, chi2=2.0)
    outcome, _ = select_interpolation(linear, hold)
    assert outcome is (hold if is_hold else linear)


@pytest.mark.parametrize(("rms_without_names", "is_hold"), [(0.1e5, True), (0.0, False)])
def test_names_that_disturb_a_pressure_do_not_select_a_zero_order_hold(
    rms_without_names: float, is_hold: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """For a mass that the device lacked, a delay of the supply was a proxy: only a zero-order hold with a late gauge
    then agreed with pressures that linear interpolation explains without any name."""
    linear = make_outcome("clock_skew pressure_delay", verdict="unexplained", is_imperfect=True)
    hold = make_outcome("clock_skew pressure_delay", verdict="identified-in-part", bic=9.0, is_imperfect=True)
    for outcome, without_names, with_names in ((linear, rms_without_names, 0.05e5), (hold, 0.1e5, 0.0)):
        outcome.base_fit.x, outcome.selected.final_fit.x = without_names, with_names
        outcome.data.experiments, outcome.data.noise = [], {"pressure": Noise(2.0, ())}
        outcome.data.compute_residuals = lambda hypothesis, points: points
    replace_computations(monkeypatch, chi2=2.0)
    outcome, _ = select_interpolation(linear, hold)
    assert outcome is (hold if is_hold else linear)


@pytest.mark.parametrize(
    ("linear_rms", "named_rms", "hold_rms", "is_hold"),
    [
        pytest.param(3.0, 1.0, 1.02, True, id="a zero-order hold needs no name"),
        pytest.param(3.0, 0.8, 1.02, False, id="the names explain more"),
        pytest.param(1.0, 1.0, 1.02, False, id="neither interpolation needs a name"),
    ],
)
def test_pressure_without_repeats_decides_by_what_is_left(
    linear_rms: float, named_rms: float, hold_rms: float, is_hold: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without repeats, a sampling interval of delay was named beside a hysteresis."""
    linear = make_outcome("pressure_delay braid_hysteresis", verdict="indistinguishable", is_imperfect=True)
    hold = make_outcome("", verdict="insufficient-data", bic=20.0, is_imperfect=True)
    linear.base_fit.x, linear.selected.final_fit = linear_rms, SimpleNamespace(hypothesis=None, x=named_rms)
    hold.base_fit.x = hold_rms
    for outcome in (linear, hold):
        outcome.data.experiments, outcome.data.noise = [], {"pressure": Noise(2.0, ()), "force": None}
        outcome.data.compute_residuals = lambda hypothesis, points: [
            [{"pressure": np.full(9, 2.0 * rms), "force": np.ones(9)}] for rms in points
        ]
    replace_computations(monkeypatch, chi2=0.0, has_repeats=False)
    outcome, _ = select_interpolation(linear, hold)
    assert outcome is (hold if is_hold else linear)


@pytest.mark.parametrize(("names", "is_tried"), [("supply_droop clock_skew", True), ("supply_droop", False)])
def test_zero_order_hold_is_tried_for_a_shift_that_a_large_effect_hides(
    names: str, is_tried: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    linear, hold = make_outcome(names), make_outcome("supply_droop", bic=-90.0)
    searches: list[Any] = []
    replace_computations(monkeypatch, chi2=2.0)  # more than 1.0 of linear interpolation
    outcome, _ = command_interpolation.select_command_interpolation(
        linear, lambda trials: hold, lambda prepared: searches.append(prepared) or hold, lambda fraction, stage: None
    )
    assert len(searches) == is_tried
    assert outcome is (hold if is_tried else linear)


@pytest.mark.parametrize(
    ("names", "hold_bic", "is_searched"),
    [
        pytest.param("leak", 7.0, False, id="worse"),
        pytest.param("leak", 5.0, True, id="hardly worse"),
        pytest.param("leak clock_skew", 7.0, True, id="a shift, which is another interpolation"),
    ],
)
def test_no_model_is_searched_where_the_names_fit_a_zero_order_hold_worse(
    names: str, hold_bic: float, is_searched: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second search takes as long as the first one."""
    linear, hold = make_outcome(names), make_outcome("leak", bic=-90.0)
    hold.data = SimpleNamespace(noise={})
    linear.compute_bic = lambda data: hold_bic if data is hold.data else 0.0
    replace_computations(monkeypatch, chi2=0.0)
    searches: list[Any] = []
    command_interpolation.select_command_interpolation(
        linear, lambda trials: hold, lambda prepared: searches.append(prepared) or hold, lambda fraction, stage: None
    )
    assert len(searches) == is_searched


@pytest.mark.slow
def test_zero_order_hold_is_no_delay(tmp_path: Path) -> None:
    diagnosis = workflow.diagnose(load_dataset(write_dataset(tmp_path / "d", has_zero_order_hold=True)))
    assert diagnosis.verdict == "nothing-missing"
    assert any("held until their next sample" in reason for reason in diagnosis.reasons)


@pytest.mark.slow
def test_gauge_beside_a_zero_order_hold_is_named(tmp_path: Path) -> None:
    distort = {"pressure": lambda time, value: 1.02 * value}
    folder = write_dataset(tmp_path / "d", has_zero_order_hold=True, distort=distort)
    diagnosis = workflow.diagnose(load_dataset(folder))
    assert "sensor_gain@pressure" in {term.qualified_name for term in diagnosis.added_terms}
    assert any("held until their next sample" in reason for reason in diagnosis.reasons)


@pytest.mark.slow
def test_delay_beside_a_zero_order_hold_is_known_to_one_sampling_interval(tmp_path: Path) -> None:
    hidden = {("pressure_delay", "dead_time"): {"delay_s": 0.02}}
    diagnosis = workflow.diagnose(load_dataset(write_dataset(tmp_path / "d", hidden, has_zero_order_hold=True)))
    assert [term.effect for term in diagnosis.added_terms] == ["pressure_delay"]
    assert diagnosis.final_fit is not None
    assert 0.0198 < diagnosis.final_fit.values[-1] < 0.0202 + INTERVAL_S


@pytest.mark.slow
@pytest.mark.parametrize(("has_zero_order_hold", "factor"), [(True, 4.0), (False, 10.0)])
def test_supply_many_times_as_fast_as_declared_is_named(
    has_zero_order_hold: bool, factor: float, tmp_path: Path
) -> None:
    """While its rate is wrong, linear interpolation explains the steps of a zero-order hold better."""
    nominal = load_device("klute-3-4-pair").parameters
    fast = nominal._replace(supply=nominal.supply._replace(max_pressure_rate=factor * nominal.supply.max_pressure_rate))
    hidden = {("braid_hysteresis", "coulomb"): {"slope_n_per_bar": 6.0}}
    diagnosis = workflow.diagnose(
        load_dataset(write_dataset(tmp_path / "d", hidden, base=fast, has_zero_order_hold=has_zero_order_hold))
    )
    assert diagnosis.verdict in ("identified", "identified-in-part")
    assert {term.number or term.effect for term in diagnosis.added_terms} == {
        "supply.rate_bar_per_s",
        "braid_hysteresis",
    }
    assert any("held until" in reason for reason in diagnosis.reasons) == has_zero_order_hold


@pytest.mark.slow
@pytest.mark.parametrize(("command_interval", "is_visible"), [(0.001, True), (0.01, False)])
def test_command_of_a_walk_has_a_zero_order_hold(command_interval: float, is_visible: bool, tmp_path: Path) -> None:
    """A state machine commands every 10 ms. A log of 100 Hz does not show that it holds them."""
    data = synthetic_gait_dataset.write_dataset(
        tmp_path / "d", has_state_machine=True, command_interval=command_interval
    )
    dataset = load_dataset(data)
    prepared = prepare_experiments(dataset, split_dataset(dataset))[0]
    assert prepared.has_zero_order_hold is is_visible
    hold = prepared if is_visible else prepared.zero_order_hold_variant
    assert isinstance(hold, GaitExperiment)
    assert hold.zero_order_hold_variant is None
    samples = dataset.trials[0].prescribed["pressure_command"].value
    assert set(np.round(hold.command)) <= set(np.round(samples))
    diagnosis = workflow.diagnose(dataset)
    assert diagnosis.verdict == "nothing-missing"
    assert any("held until their next sample" in reason for reason in diagnosis.reasons) is not is_visible
