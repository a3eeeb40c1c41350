"""The parts of the diagnosis against what is known about them: noise, fits, screening, gates, intervals."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from klute_sim.datasets import dataset as datasets
from klute_sim.datasets.trial import Series
from klute_sim.device.device import load_device, parse_device
from klute_sim.diagnosis.experiments.base import Experiment, SimulationSetup, Simulator
from klute_sim.diagnosis.experiments.bench import BenchExperiment
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.fitting.confidence_intervals import compute_confidence_intervals
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import WeightedData, fit_hypothesis
from klute_sim.diagnosis.noise import repeats as noises
from klute_sim.diagnosis.noise.heteroscedastic import add_noise_scales
from klute_sim.diagnosis.noise.repeats import Autocorrelation, Noise, estimate_correlation_time, estimate_misfit
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection, is_significant, select_shortlist
from klute_sim.diagnosis.selection.screening import check_effect_names, list_candidate_terms, screen_candidates
from klute_sim.diagnosis.workflow import fit_base_device
from klute_sim.effects import catalogue
from klute_sim.errors import InputError
from tests.diagnosis.synthetic_dataset import coloured, dataset


def repeated(values: list[np.ndarray], group: str = "g") -> list[Experiment]:
    """Experiments of which only the measured force matters."""
    device, time = load_device("klute-3-4-pair"), np.arange(len(values[0])) * 0.005
    nothing = np.zeros(3)
    return [
        BenchExperiment(
            f"{group}{k}", group, "fit", device, 0.0, 0.005, nothing, {"force": Series(time, v)}, unit_length=nothing
        )
        for k, v in enumerate(values)
    ]


def test_a_fault_of_an_instrument_is_not_looked_for_where_it_was_checked() -> None:
    plain = repeated([np.zeros(20)])[0]
    hypothesis = Hypothesis(plain.device, (), (("force", 3.0),), (EffectTerm("sensor_gain", "linear", "force"),))
    doubted, sure = hypothesis.build_setups(np.array([1.0]), [plain, replace(plain, trusted=frozenset({"force"}))])
    assert [reading.channel for reading in doubted.sensors] == ["force"]
    assert sure.sensors == ()


def test_noise_is_measured_from_repeats_whatever_they_have_in_common() -> None:
    random = np.random.default_rng(0)
    common = 40.0 * np.sin(np.arange(4000) / 50)
    residuals = [{"force": common + coloured(random, 4000, 3.0, 0.02)} for _ in range(4)]
    found = noises.estimate_noise_from_repeats(repeated([r["force"] for r in residuals]), residuals)["force"]
    assert found.std == pytest.approx(3.0, rel=0.05)
    # An AR(1) process with a lag-one correlation r has (1 + r)/(1 - r) samples per independent one.
    r = np.exp(-0.005 / 0.02)
    assert found.correlation_time(0.005) == pytest.approx((1 + r) / (1 - r), rel=0.3)
    assert found.correlation_time(0.0025) == pytest.approx(2.0 * found.correlation_time(0.005))
    assert found.correlation_time(10.0) == 1.0
    assert estimate_correlation_time(random.normal(size=20_000)) == pytest.approx(1.0, abs=0.1)


def test_trials_logged_at_different_rates_are_weighed_by_how_long_noise_stays_alike() -> None:
    """The same noise, logged ten times as often in one group, tells no more there."""
    random = np.random.default_rng(3)
    slow = repeated([coloured(random, 4000, 3.0, 0.02) for _ in range(2)], "slow")
    fine = [coloured(random, 40_000, 3.0, 0.2) for _ in range(2)]  # 0.02 s, once the clock runs ten times as fast
    fast = [
        replace(e, measured={"force": Series(0.1 * series.time, series.value)})
        for e in repeated(fine, "fast")
        for series in e.measured.values()
    ]
    every = [*slow, *fast]
    found = noises.estimate_noise_from_repeats(every, [{"force": e.measured["force"].value} for e in every])
    evidence = WeightedData(Simulator(1), every, found)
    slow_only, fast_only = (evidence.with_experiments(part).n_effective for part in (slow, fast))
    assert fast_only == pytest.approx(slow_only, rel=0.3)
    assert found["force"].independent_fraction == pytest.approx(evidence.n_effective / 88_000.0)
    white = repeated([random.normal(0.0, 3.0, 4000) for _ in range(2)], "white")
    alone = noises.estimate_noise_from_repeats(white, [{"force": e.measured["force"].value} for e in white])
    assert WeightedData(Simulator(1), white, alone).n_effective == pytest.approx(8000.0, rel=0.05)


@pytest.mark.parametrize("size", [0.0, 1.0, 10.0])
def test_misfit_is_what_repeats_share(size: float) -> None:
    random = np.random.default_rng(1)
    found = []
    for _ in range(40):
        shared = size * np.sin(np.arange(800) / 20)
        residuals = [{"force": shared + coloured(random, 800, 3.0, 0.02)} for _ in range(2)]
        own = {"force": Noise(3.0, (Autocorrelation(0.005, 8.0, 1600),))}
        found.append(estimate_misfit(repeated([r["force"] for r in residuals]), residuals, own)["force"])
    certainty = np.mean([m.significance for m in found])
    if size == 0.0:
        assert abs(certainty) < 0.5
        assert np.std([m.significance for m in found]) == pytest.approx(1.0, abs=0.4)
        assert not any(is_significant(m) for m in found)
    else:
        assert np.mean([m.rms**2 for m in found]) == pytest.approx(size * size / 2, rel=0.5 if size < 2 else 0.1)
    assert all(is_significant(m) for m in found) == (size == 10.0)


def test_loud_stretches_that_look_alike_by_chance_are_no_misfit() -> None:
    random = np.random.default_rng(5)
    time = np.arange(900)
    loud = 1.0 + 6.0 * np.exp(-(((time - 360) / 40) ** 2)) + 6.0 * np.exp(-(((time - 540) / 30) ** 2))
    found = []
    for _ in range(100):
        rows = {group: [coloured(random, 900, 1.0, 0.05) * loud for _ in range(2)] for group in "abc"}
        experiments = [e for group, own in rows.items() for e in repeated(own, group)]
        residuals = [{"force": row} for own in rows.values() for row in own]
        found.append(
            estimate_misfit(experiments, residuals, noises.estimate_noise_from_repeats(experiments, residuals))[
                "force"
            ].significance
        )
    assert np.std(found) < 1.3  # 1.7 with the same variance everywhere
    assert abs(np.mean(found)) < 0.4


def test_noise_is_loud_where_the_device_lets_its_inputs_through(tmp_path: Path) -> None:
    """Pressure that wanders moves a muscle more when it is slack than when it is taut."""
    data, random, bench = (
        datasets.load_dataset(dataset(tmp_path / "d", muscle_length=True)),
        np.random.default_rng(2),
        Simulator(2),
    )
    plain = prepare_experiments(data, datasets.split_dataset(data))
    setting = SimulationSetup(data.device.parameters)
    made = []
    for e in plain:
        wander = coloured(random, len(e.command), 2e3, 0.3)
        moved = bench.simulate([[setting]], [replace(e, command=e.command + wander)])[0][0]["muscle_length"]
        series = e.measured["muscle_length"]
        value = moved + random.normal(0.0, 5e-6, len(series.time))
        made.append(replace(e, measured={"muscle_length": Series(series.time, value)}))
    fitted = [e for e in made if e.use == "fit"]
    found = add_noise_scales(made, fitted, bench)
    own = np.concatenate([e.noise_scale["muscle_length"] for e in found if e.use == "fit"])
    assert 1.0 <= np.sqrt(np.mean(own**2)) < 1.3  # what is not known of moments is beside what repeats show
    assert own.max() > 1.5 * own.min()
    # Divided by its loudness, noise is about as loud in the loud half as in the quiet one.
    quiet, ratio = own < np.median(own), []
    for experiments in (fitted, [e for e in found if e.use == "fit"]):
        stacks = noises.align_repeats(experiments, simulated(experiments, bench), "muscle_length")
        apart = np.concatenate([row - stack.residuals.mean(axis=0) for stack in stacks for row in stack.residuals])
        ratio.append(float(np.std(apart[~quiet]) / np.std(apart[quiet])))
    assert ratio[0] > 1.3
    assert abs(np.log(ratio[1])) < 0.5 * np.log(ratio[0])
    assert add_noise_scales(made[:1], made[:1], bench)[0].noise_scale == {}  # nothing is repeated
    bench.close()


def test_a_moment_of_the_pressure_is_known_no_better_than_a_step(tmp_path: Path) -> None:
    data, random, bench = datasets.load_dataset(dataset(tmp_path / "d")), np.random.default_rng(2), Simulator(2)
    plain = prepare_experiments(data, datasets.split_dataset(data))
    made = []
    for e, row in zip(plain, simulated(plain, bench), strict=True):
        series = e.measured["pressure"]
        noise = random.normal(0.0, 1e3, len(series.time))
        made.append(replace(e, measured={"pressure": Series(series.time, series.value - row["pressure"] + noise)}))
    (one, *_) = add_noise_scales(made, [e for e in made if e.use == "fit"], bench)
    series = one.measured["pressure"]
    jump = np.abs(np.gradient(series.value, series.time)) > 50e5  # of 100 bar/s
    assert jump.any()
    assert np.median(one.noise_scale["pressure"][jump]) == pytest.approx(np.hypot(1.0, 100e5 * one.dt / 1e3), rel=0.1)
    assert np.median(one.noise_scale["pressure"][~jump]) < 1.1
    bench.close()


def simulated(experiments: list[Experiment], bench: Simulator) -> list[dict[str, np.ndarray]]:
    """Residuals of the nominal device."""
    shown = [bench.simulate([[SimulationSetup(e.device.parameters)]], [e])[0][0] for e in experiments]
    return [{c: s.value - row[c] for c, s in e.measured.items()} for e, row in zip(experiments, shown, strict=True)]


@pytest.fixture(scope="module")
def evidence(tmp_path_factory: pytest.TempPathFactory) -> tuple[datasets.Dataset, WeightedData, Simulator]:
    """Data of a device whose tendon is 15 % stiffer than it says, without any effect."""
    nominal = load_device("klute-3-4-pair").parameters
    stiffer = nominal._replace(tendon=nominal.tendon._replace(stiffness_1=1.15 * nominal.tendon.stiffness_1))
    folder = dataset(tmp_path_factory.mktemp("data") / "d", base=stiffer)
    found, bench = datasets.load_dataset(folder), Simulator(2)
    fitted = [e for e in prepare_experiments(found, datasets.split_dataset(found)) if e.use == "fit"]
    return found, fit_base_device(found, fitted, bench)[1], bench


def test_a_fit_finds_an_uncertain_number_again(evidence: tuple) -> None:
    data, on, bench = evidence
    found, _ = fit_base_device(data, on.experiments, bench)
    assert found.converged
    assert found.values[0] == pytest.approx(1.15 * 60.0, rel=0.01)
    assert found.values[1] == pytest.approx(28.0, rel=0.02)
    assert found.chi2 == pytest.approx(on.effective, rel=0.3)
    low, high = compute_confidence_intervals(on, found)[0]
    assert low < 1.15 * 60.0 < high
    assert 0.0005 < (high - low) / 69.0 < 0.02


def test_the_derivatives_are_those_of_the_residuals(evidence: tuple) -> None:
    _, on, _ = evidence
    hypothesis = Hypothesis(load_device("klute-3-4-pair"), (("tendon.stiffness_1_n_per_mm", 6.0),), (("force", 3.0),))
    hypothesis = hypothesis.with_term(EffectTerm("muscle_damping", "viscous"))
    found = fit_hypothesis(on, hypothesis, np.array([1.0, 0.3]), max_nfev=1, fine=True)
    coarse = fit_hypothesis(on, hypothesis, found.x, max_nfev=1)
    for k in range(2):
        apart = []
        for sign in (1.0, -1.0):
            row = found.x.copy()
            row[k] += sign * 1e-3
            vector = on.weighted(on.residuals(hypothesis, [row])[0])
            apart.append(np.concatenate([vector, row[:1]]))
        assert found.jacobian[:, k] == pytest.approx(
            (apart[0] - apart[1]) / 2e-3, abs=0.02 * np.abs(found.jacobian).max()
        )
        off = np.linalg.norm(coarse.jacobian[:, k] - found.jacobian[:, k])
        assert 0.0 < off < 0.25 * np.linalg.norm(found.jacobian[:, k])


NOT_SHOWN = ("bladder", "friction_offset", "leak")
"""What the device has already, and what its regulator makes up for."""


@pytest.mark.parametrize(
    "key",
    [
        (s.effect, s.form.name)
        for s in catalogue.get_device_slots()
        if s.effect in catalogue.get_named_effects() and s.effect not in NOT_SHOWN
    ],
    ids="-".join,
)
def test_screening_puts_the_truth_first(key: tuple[str, str], evidence: tuple, tmp_path: Path) -> None:
    """One simulation each, from a fit that knows nothing of the effect; other forms of it may tie."""
    size = 1.0 if key[0] == "braid_extensibility" else 0.4  # most of it goes into the muscle's uncertain numbers
    slot = catalogue.find_slot(*key)
    hidden = {
        p.key: p.typical if p.neutral is None else p.neutral + size * (p.typical - p.neutral)
        for p in slot.form.parameters
    }
    data = datasets.load_dataset(dataset(tmp_path / "d", {key: hidden}, groups=("fit_1", "fit_2")))
    bench = Simulator(2)
    base, on = fit_base_device(data, prepare_experiments(data, datasets.split_dataset(data)), bench)
    found = screen_candidates(on, base, list_candidate_terms(on, data.device))
    # The base absorbs most of a taper; what is left of it looks like a threshold or a shifted load cell.
    twins = 0.5 if key[0] == "end_taper" else 0.95
    assert key[0] in {c.term.effect for c in found if c.predicted_gain > twins * found[0].predicted_gain}
    assert found[0].predicted_gain > 20.0
    bench.close()


def test_forms_of_a_promising_effect_are_all_tried() -> None:
    data = [("braid_hysteresis", "coulomb"), ("seal_friction", "coulomb")]
    many = [(f"x{k}", "f") for k in range(12)]
    from klute_sim.diagnosis.selection.screening import Candidate

    nothing = np.zeros(1)
    made = [
        Candidate(EffectTerm(*name), 100.0 - k, 1.0, nothing, nothing, 1.0, nothing, nothing)
        for k, name in enumerate([*data, *many, ("braid_hysteresis", "maxwell_slip")])
    ]
    names = [(c.term.effect, c.term.form) for c in select_shortlist(made)]
    assert ("braid_hysteresis", "maxwell_slip") in names
    assert len(names) == 9


def test_candidates_are_those_that_the_device_is_without(evidence: tuple) -> None:
    _, on, _ = evidence
    device = load_device("klute-3-4-pair")
    names = {t.effect for t in list_candidate_terms(on, device)}
    assert "bladder" not in names
    assert {"end_taper", "sensor_gain"} <= names
    assert {t.channel for t in list_candidate_terms(on, device) if t.effect == "sensor_gain"} == {"force", "pressure"}
    assert {t.effect for t in list_candidate_terms(on, device, only=("end_taper",))} == {"end_taper"}
    assert "end_taper" not in {t.effect for t in list_candidate_terms(on, device, exclude=("end_taper",))}
    with pytest.raises(InputError, match="there is no effect 'taper'"):
        check_effect_names(load_device("klute-3-4-pair"), ("taper",), ())
    content = load_device("klute-3-4-pair").content + b"\n[effects.end_taper]\ntip_length_mm = 8.0\n"
    tapering = parse_device(content, "tapering")
    with pytest.raises(InputError, match=r"has effect 'end_taper' already.*effects\.end_taper\."):
        check_effect_names(tapering, ("end_taper",), ())


def test_selection_trials_veto_what_does_not_help_them(evidence: tuple) -> None:
    data, on, bench = evidence
    base, _ = fit_base_device(data, on.experiments, bench)
    spoiled = base.hypothesis.with_term(EffectTerm("sensor_offset", "linear", "force"))
    after = fit_hypothesis(on, spoiled, max_nfev=2)
    search = ForwardSelection(on, [on], [])
    worse = after.x.copy()
    worse[-1] = 20.0
    bad = type(after)(spoiled, worse, after.weighted_residuals, after.jacobian, True, after.residuals)
    gains = search.compute_validation_gains(base, bad)
    assert gains["fit_1"] < -0.5
    assert "explains no more than noise" in search.rejection_reason(base, bad, {"a": 0.5})
    good = type(after)(spoiled, worse, 0.9 * base.weighted_residuals, after.jacobian, True, after.residuals)
    assert "trials that were not fitted get worse: 'fit_1' by" in search.rejection_reason(base, good, gains)
    assert not search.has_misfit(base)  # repeats ask for nothing, so more is asked of an effect
    assert "gain no more than 10 %" in search.rejection_reason(base, good, {"a": 0.08, "b": 0.11})
    assert search.rejection_reason(base, good, {"a": 0.5, "b": -0.01}) == ""
    off = type(base)(
        base.hypothesis, base.x, base.weighted_residuals, base.jacobian, True, shifted(base.residuals, 5.0)
    )
    assert search.has_misfit(off)
    assert search.rejection_reason(off, good, {"a": 0.08, "b": 0.11}) == ""
    assert "gain no more than 5 %" in search.rejection_reason(off, good, {"a": 0.02, "b": 0.07})


def test_a_shape_that_a_later_effect_makes_idle_goes(tmp_path: Path) -> None:
    rubs, off = EffectTerm("seal_friction", "coulomb"), EffectTerm("sensor_offset", "linear", "force")
    folder = dataset(
        tmp_path / "d",
        {("seal_friction", "coulomb"): {"force_n": 20.0}},
        device="klute-1-1-4-pair",
        distort={"force": lambda time, value: value + 10.0},
    )
    found, bench = datasets.load_dataset(folder), Simulator(2)
    fitted = [e for e in prepare_experiments(found, datasets.split_dataset(found)) if e.use == "fit"]
    base, on = fit_base_device(found, fitted, bench)
    search = ForwardSelection(on, [], [])
    shaped = fit_hypothesis(on, base.hypothesis.with_term(EffectTerm("seal_friction", "stribeck")).with_term(off))
    simple = search.simplify(shaped, base)
    assert simple.hypothesis.terms == (rubs, off)
    force = next(v for u, v in zip(simple.hypothesis.parameters, simple.values, strict=True) if u.key == "force_n")
    assert force == pytest.approx(20.0, rel=0.1)
    bench.close()


def test_a_number_that_nothing_holds_has_an_interval() -> None:
    """Its error may be hundreds of steps, and a step of a logarithmic one is a factor e."""
    hypothesis = Hypothesis(load_device("klute-3-4-pair"), (), (), (EffectTerm("seal_friction", "stribeck"),))
    stick = hypothesis.parameters[1]
    assert stick.denormalize(-2000.0) == pytest.approx(stick.lower)
    assert stick.denormalize(2000.0) == pytest.approx(stick.upper)


def test_an_effect_without_any_effect_is_fitted(evidence: tuple) -> None:
    """A regulator that lacks so much that it gives no pressure: a little more or less of that changes nothing."""
    data, on, _ = evidence
    still = [replace(e, command=0.0 * e.command) for e in on.experiments]
    flat = on.on(still)
    hypothesis = Hypothesis(data.device, (), (("force", 3.0),), (EffectTerm("regulator_error", "offset"),))
    found = fit_hypothesis(flat, hypothesis, np.array([-1.0]))
    assert np.isfinite(found.x).all()
    assert found.converged


def test_an_effect_with_a_threshold_is_fitted_from_where_it_shows(tmp_path: Path) -> None:
    """A small tank runs low late, and in one step of its typical size at once: no straight line leads there."""
    effect = {("supply_droop", "tank"): {"inverse_volume_per_l": 0.3}}
    data, bench = datasets.load_dataset(dataset(tmp_path / "d", effect, seconds=4.0)), Simulator(2)
    fitted = [e for e in prepare_experiments(data, datasets.split_dataset(data)) if e.use == "fit"]
    base, on = fit_base_device(data, fitted, bench)
    found = screen_candidates(on, base, [EffectTerm("supply_droop", "tank")])
    (refitted,) = ForwardSelection(on, [], []).refit_candidates(base, found)
    assert refitted.values[-1] == pytest.approx(0.3, rel=0.03)
    bench.close()


def shifted(residuals: list, by: float) -> list:
    return [{channel: values + by * (channel == "force") for channel, values in each.items()} for each in residuals]
