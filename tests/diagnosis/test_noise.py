"""Noise of repeats, misfit, and heteroscedastic noise against known results."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from klute_sim.datasets import dataset as datasets
from klute_sim.datasets.trial import SensorLimits, TimeSeries
from klute_sim.diagnosis.experiments.base import Experiment, SimulationSetup
from klute_sim.diagnosis.experiments.prepare import compute_correlated_deviation, prepare_experiments
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise import repeats as noises
from klute_sim.diagnosis.noise.autocorrelation import Autocorrelation, estimate_correlation_time
from klute_sim.diagnosis.noise.heteroscedastic import add_noise_scales
from klute_sim.diagnosis.noise.misfit import estimate_misfit, is_significant
from klute_sim.diagnosis.noise.repeats import Noise
from tests.diagnosis.synthetic_dataset import make_correlated_noise, make_repeats, write_dataset


def test_noise_estimate_ignores_the_common_part_of_repeats() -> None:
    rng = np.random.default_rng(0)
    common = 40.0 * np.sin(np.arange(4000) / 50)
    residuals = [{"force": common + make_correlated_noise(rng, 4000, 3.0, 0.02)} for _ in range(4)]
    result = noises.estimate_noise_from_repeats(make_repeats([r["force"] for r in residuals]), residuals)["force"]
    assert result.std == pytest.approx(3.0, rel=0.05)
    # An AR(1) process with lag-one autocorrelation r has (1 + r)/(1 - r) samples per independent one.
    r = np.exp(-0.005 / 0.02)
    assert result.correlation_time(0.005) == pytest.approx((1 + r) / (1 - r), rel=0.3)
    assert result.correlation_time(0.0025) == pytest.approx(2.0 * result.correlation_time(0.005))
    assert result.correlation_time(10.0) == 1.0
    assert estimate_correlation_time(rng.normal(size=20_000)) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("clock_offset", [0.0, 0.3, 0.5])
def test_noise_does_not_depend_on_when_repeats_are_sampled(clock_offset: float) -> None:
    """Interpolation between samples would halve the variance of white noise midway."""
    rng = np.random.default_rng(5)
    residuals = [{"force": rng.normal(0.0, 3.0, 20_000)} for _ in range(2)]
    first, second = make_repeats([r["force"] for r in residuals])
    series = second.measured["force"]
    shifted = TimeSeries(series.time + clock_offset * series.sampling_interval, series.value)
    experiments = [first, replace(second, measured={"force": shifted})]
    assert noises.estimate_noise_from_repeats(experiments, residuals)["force"].std == pytest.approx(3.0, rel=0.02)


def test_samples_in_a_gap_of_another_repeat_are_not_compared() -> None:
    values = np.random.default_rng(6).normal(0.0, 3.0, (2, 1000))
    first, second = make_repeats(list(values))
    series = second.measured["force"]
    is_retained = (series.time < 1.0) | (series.time > 1.5)
    gapped = TimeSeries(series.time[is_retained], series.value[is_retained])
    experiments = [first, replace(second, measured={"force": gapped})]
    (aligned,) = noises.align_repeats(experiments, [{"force": values[0]}, {"force": gapped.value}], "force")
    interval = series.sampling_interval
    assert not np.any((aligned.time > 1.0 + interval) & (aligned.time < 1.5 - interval))
    assert len(aligned.time) == pytest.approx(is_retained.sum(), abs=2)


def test_short_repeat_does_not_discard_the_others() -> None:
    """Its cable came off after ten samples; the others still show the noise."""
    values = np.random.default_rng(6).normal(0.0, 3.0, (3, 1000))
    experiments = make_repeats(list(values))
    series = experiments[2].measured["force"]
    experiments[2] = replace(experiments[2], measured={"force": TimeSeries(series.time[:10], series.value[:10])})
    residuals = [{"force": e.measured["force"].value} for e in experiments]
    (aligned,) = noises.align_repeats(experiments, residuals, "force")
    assert aligned.trials == ("g0", "g1")
    assert noises.estimate_noise_from_repeats(experiments, residuals)["force"].std == pytest.approx(3.0, rel=0.1)
    assert list(noises.align_repeats(experiments[1:], residuals[1:], "force")) == []
    assert list(noises.align_repeats(experiments, residuals, "force", min_repeats=3)) == []


def test_slack_repeats_are_not_free_of_noise() -> None:
    """All but five of their samples are at the limit of the load cell, where every residual is 0."""
    limits = {"force": SensorLimits(0.0, np.inf)}
    rng = np.random.default_rng(8)
    pulling, slack = rng.normal(0.0, 1.0, (2, 1000)), np.zeros((2, 1000))
    slack[:, :5] = rng.normal(0.0, 1.0, (2, 5))
    experiments = [
        replace(e, limits=limits) for e in (*make_repeats(list(pulling)), *make_repeats(list(slack), "slack"))
    ]
    residuals = [{"force": row} for row in (*pulling, *slack)]
    assert noises.estimate_noise_from_repeats(experiments, residuals)["force"].std == pytest.approx(1.0, rel=0.1)
    assert noises.find_inconsistent_repeats(experiments, residuals) == {}


@pytest.mark.parametrize("misfit", [0.0, 1.0, 10.0])
def test_misfit_is_no_noise_where_one_repeat_is_noisier(misfit: float) -> None:
    rng = np.random.default_rng(2)
    shared = misfit * np.sin(np.arange(8000) / 40)
    scales = (1.0, 1.0, 3.0)
    rows = [shared + rng.normal(0.0, scale, 8000) for scale in scales]
    experiments = [
        replace(e, noise_scale={"force": np.full(8000, scale)})
        for e, scale in zip(make_repeats(rows), scales, strict=True)
    ]
    residuals = [{"force": row} for row in rows]
    noise = noises.estimate_noise_from_repeats(experiments, residuals)["force"]
    assert noise.std == pytest.approx(1.0, rel=0.03)
    assert noise.correlation_time(0.005) == pytest.approx(1.0, abs=0.2)
    (aligned,) = noises.align_repeats(experiments, residuals, "force")
    np.testing.assert_allclose(aligned.deviations.std(axis=1), 1.0, rtol=0.05)


def test_noise_does_not_depend_on_the_order_of_fast_and_slow_repeats() -> None:
    rng = np.random.default_rng(7)
    slow, fast = (make_correlated_noise(rng, count, 3.0, 0.02) for count in (2000, 10_000))
    first, second = make_repeats([slow])[0], make_repeats([fast])[0]
    series = second.measured["force"]
    second = replace(second, name="fast", measured={"force": TimeSeries(0.2 * series.time, series.value)})
    estimates = [
        noises.estimate_noise_from_repeats([a for a, _ in order], [{"force": row} for _, row in order])["force"]
        for order in (((first, slow), (second, fast)), ((second, fast), (first, slow)))
    ]
    assert estimates[0] == estimates[1]
    assert estimates[0].autocorrelations[0].sampling_interval == pytest.approx(0.005)


def test_sampling_rate_does_not_change_the_effective_number_of_samples() -> None:
    """Equal noise, sampled ten times as fast in one group, carries no more information there."""
    rng = np.random.default_rng(3)
    slow = make_repeats([make_correlated_noise(rng, 4000, 3.0, 0.02) for _ in range(2)], "slow")
    fine = [make_correlated_noise(rng, 40_000, 3.0, 0.2) for _ in range(2)]  # 0.02 s after the time is scaled by 0.1
    fast = [
        replace(e, measured={"force": TimeSeries(0.1 * series.time, series.value)})
        for e in make_repeats(fine, "fast")
        for series in e.measured.values()
    ]
    all_experiments = [*slow, *fast]
    result = noises.estimate_noise_from_repeats(
        all_experiments, [{"force": e.measured["force"].value} for e in all_experiments]
    )
    fitted_data = WeightedData(Simulator(1), all_experiments, result)
    slow_only, fast_only = (fitted_data.with_experiments(part).n_effective for part in (slow, fast))
    assert fast_only == pytest.approx(slow_only, rel=0.3)
    assert result["force"].independent_fraction == pytest.approx(fitted_data.n_effective / 88_000.0)
    white = make_repeats([rng.normal(0.0, 3.0, 4000) for _ in range(2)], "white")
    white_noise = noises.estimate_noise_from_repeats(white, [{"force": e.measured["force"].value} for e in white])
    assert WeightedData(Simulator(1), white, white_noise).n_effective == pytest.approx(8000.0, rel=0.05)


@pytest.mark.parametrize("size", [0.0, 1.0, 10.0])
def test_misfit_is_the_residual_common_to_repeats(size: float) -> None:
    rng = np.random.default_rng(1)
    result = []
    for _ in range(40):
        shared = size * np.sin(np.arange(800) / 20)
        residuals = [{"force": shared + make_correlated_noise(rng, 800, 3.0, 0.02)} for _ in range(2)]
        noise = {"force": Noise(3.0, (Autocorrelation(0.005, 8.0, 1600),))}
        result.append(estimate_misfit(make_repeats([r["force"] for r in residuals]), residuals, noise)["force"])
    mean_significance = np.mean([m.significance for m in result])
    if size == 0.0:
        assert abs(mean_significance) < 0.5
        assert np.std([m.significance for m in result]) == pytest.approx(1.0, abs=0.4)
        assert not any(is_significant(m) for m in result)
    else:
        assert np.mean([m.rms**2 for m in result]) == pytest.approx(size * size / 2, rel=0.5 if size < 2 else 0.1)
    assert all(is_significant(m) for m in result) == (size == 10.0)


def test_heteroscedastic_noise_is_not_mistaken_for_misfit() -> None:
    rng = np.random.default_rng(5)
    time = np.arange(900)
    scale = 1.0 + 6.0 * np.exp(-(((time - 360) / 40) ** 2)) + 6.0 * np.exp(-(((time - 540) / 30) ** 2))
    result = []
    for _ in range(100):
        rows = {group: [make_correlated_noise(rng, 900, 1.0, 0.05) * scale for _ in range(2)] for group in "abc"}
        experiments = [e for group, noise in rows.items() for e in make_repeats(noise, group)]
        residuals = [{"force": row} for noise in rows.values() for row in noise]
        result.append(
            estimate_misfit(experiments, residuals, noises.estimate_noise_from_repeats(experiments, residuals))[
                "force"
            ].significance
        )
    assert np.std(result) < 1.3  # 1.7 with uniform variance
    assert abs(np.mean(result)) < 0.4


def test_noise_scale_follows_the_sensitivity_to_inputs(tmp_path: Path) -> None:
    """Drifting pressure moves a slack muscle more than a taut one."""
    data, rng, simulator = (
        datasets.load_dataset(write_dataset(tmp_path / "d", muscle_length=True)),
        np.random.default_rng(2),
        Simulator(2),
    )
    nominal = prepare_experiments(data, datasets.split_dataset(data))
    setup = SimulationSetup(data.device.parameters)
    synthetic = []
    for e in nominal:
        wander = make_correlated_noise(rng, len(e.command), 2e3, 0.3)
        readings = simulator.simulate([[setup]], [replace(e, command=e.command + wander)])[0][0]["muscle_length"]
        series = e.measured["muscle_length"]
        value = readings + rng.normal(0.0, 5e-6, len(series.time))
        synthetic.append(replace(e, measured={"muscle_length": TimeSeries(series.time, value)}))
    fit_experiments = [e for e in synthetic if e.use == "fit"]
    result, remarks = add_noise_scales(synthetic, fit_experiments, simulator)
    assert remarks == []
    noise = np.concatenate([e.noise_scale["muscle_length"] for e in result if e.use == "fit"])
    assert 1.0 <= np.sqrt(np.mean(noise**2)) < 1.3  # the timing uncertainty comes in addition
    assert noise.max() > 1.5 * noise.min()
    # Divided by its scale, noise is nearly uniform.
    is_quiet, ratio = noise < np.median(noise), []
    for experiments in (fit_experiments, [e for e in result if e.use == "fit"]):
        aligned = noises.align_repeats(experiments, compute_nominal_residuals(experiments, simulator), "muscle_length")
        deviations = np.concatenate(
            [row - group_repeats.residuals.mean(axis=0) for group_repeats in aligned for row in group_repeats.residuals]
        )
        ratio.append(float(np.std(deviations[~is_quiet]) / np.std(deviations[is_quiet])))
    assert ratio[0] > 1.3
    assert abs(np.log(ratio[1])) < 0.5 * np.log(ratio[0])
    assert add_noise_scales(synthetic[:1], synthetic[:1], simulator)[0][0].noise_scale == {}  # no repeats
    simulator.close()


def test_noise_scale_includes_the_timing_uncertainty_of_one_time_step(tmp_path: Path) -> None:
    data, rng, simulator = datasets.load_dataset(write_dataset(tmp_path / "d")), np.random.default_rng(2), Simulator(2)
    nominal = prepare_experiments(data, datasets.split_dataset(data))
    synthetic = []
    for e, row in zip(nominal, compute_nominal_residuals(nominal, simulator), strict=True):
        series = e.measured["pressure"]
        noise = rng.normal(0.0, 1e3, len(series.time))
        synthetic.append(
            replace(e, measured={"pressure": TimeSeries(series.time, series.value - row["pressure"] + noise)})
        )
    (first, *_), _ = add_noise_scales(synthetic, [e for e in synthetic if e.use == "fit"], simulator)
    series = first.measured["pressure"]
    jump = np.abs(np.gradient(series.value, series.time)) > 50e5  # of 100 bar/s
    assert jump.any()
    assert np.median(first.noise_scale["pressure"][jump]) == pytest.approx(
        np.hypot(1.0, 100e5 * first.dt / 1e3), rel=0.1
    )
    assert np.median(first.noise_scale["pressure"][~jump]) < 1.1
    simulator.close()


def compute_nominal_residuals(experiments: list[Experiment], simulator: Simulator) -> list[dict[str, np.ndarray]]:
    """Return the residuals of the nominal device."""
    readings = [simulator.simulate([[SimulationSetup(e.device.parameters)]], [e])[0][0] for e in experiments]
    return [{c: s.value - row[c] for c, s in e.measured.items()} for e, row in zip(experiments, readings, strict=True)]


@pytest.mark.parametrize(("stated", "is_shared"), [("1 kPa", False), ("30 kPa", True)])
def test_stated_input_noise_that_repeats_do_not_show_counts_as_shared(
    stated: str, is_shared: bool, tmp_path: Path
) -> None:
    """Repeats agree to 3 N; a pressure that is off by 0.3 bar changes the force by far more."""
    folder = write_dataset(tmp_path / "d", groups=("fit_1", "validation_1"))
    text = (folder / "dataset.toml").read_text()
    noise = f'[noise]\npressure_command = "{stated}"\n'
    (folder / "dataset.toml").write_text(text.replace("[uncertain]", noise + "[uncertain]"))
    data, simulator = datasets.load_dataset(folder), Simulator(2)
    experiments = prepare_experiments(data, datasets.split_dataset(data))
    scaled, remarks = add_noise_scales(experiments, [e for e in experiments if e.use == "fit"], simulator)
    simulator.close()
    assert [remark.split(" agree better than")[0] for remark in remarks] == ["Repeats of 4 trials"] * is_shared
    scales = np.concatenate([e.input_error_scale["force"] for e in scaled])
    median = float(np.median(scales))
    assert median > 8.0 if is_shared else median == 1.0  # single samples of a steep force may be more sensitive


@pytest.mark.parametrize(("stated", "slow"), [(0.5, 0.0), (1.0, 0.0), (3.0, 8.0**0.5)])
def test_white_noise_of_an_input_is_no_shared_error(stated: float, slow: float) -> None:
    time = np.arange(0.0, 20.0, 0.01)
    motion = 100.0 * np.sin(2.0 * np.pi * time)
    motion[time % 1.0 > 0.6] = np.nan  # a swing has no centre of pressure
    measured = TimeSeries(time, motion + np.random.default_rng(0).normal(0.0, 1.0, len(time)))
    assert compute_correlated_deviation(measured, stated) == pytest.approx(slow, abs=0.3)
    assert compute_correlated_deviation(TimeSeries(time, motion), stated) == pytest.approx(stated, rel=0.01)


def test_stated_input_noise_is_evaluated_at_the_samples_that_are_compared(tmp_path: Path) -> None:
    folder = write_dataset(tmp_path / "d", groups=("fit_1",))
    text = (folder / "dataset.toml").read_text()
    noise = '[noise]\npressure_command = "1 kPa"\n'
    (folder / "dataset.toml").write_text(text.replace("[uncertain]", noise + "[uncertain]"))
    data, simulator = datasets.load_dataset(folder), Simulator(2)
    experiments = [
        replace(e, measured={c: TimeSeries(s.time[::2], s.value[::2]) for c, s in e.measured.items()})
        for e in prepare_experiments(data, datasets.split_dataset(data))
    ]
    scaled, _ = add_noise_scales(experiments, experiments, simulator)
    simulator.close()
    for e in scaled:
        assert all(len(e.input_error_scale[channel]) == len(series.time) for channel, series in e.measured.items())


@pytest.mark.parametrize(
    ("is_still", "noise", "statements"),
    [
        (False, "", ["The inputs of 4 trials are sampled too slowly"]),
        (True, "", []),
        (True, '[noise]\nlength = "1 mm"\n', ["Repeats of 4 trials agree better"]),
    ],
)
def test_slow_inputs_are_stated_only_where_they_matter(
    is_still: bool, noise: str, statements: list[str], tmp_path: Path
) -> None:
    folder = write_dataset(tmp_path / "d", groups=("fit_1", "validation_1"))
    text = (folder / "dataset.toml").read_text()
    (folder / "dataset.toml").write_text(text.replace("[uncertain]", noise + "[uncertain]"))
    for file in folder.glob("*.csv"):
        heading, *rows = file.read_text().splitlines()
        slow = [row.split(",") for row in rows[::4]]  # 50 Hz
        if is_still:
            prescribed = [heading.split(",").index(name) for name in ("length [mm]", "pressure_command [bar]")]
            for column in prescribed:
                for row in slow:
                    row[column] = slow[0][column]
        file.write_text("\n".join([heading, *map(",".join, slow)]) + "\n")
    data, simulator = datasets.load_dataset(folder), Simulator(2)
    experiments = prepare_experiments(data, datasets.split_dataset(data))
    assert all(e.input_variants for e in experiments)
    _, remarks = add_noise_scales(experiments, [e for e in experiments if e.use == "fit"], simulator)
    simulator.close()
    assert len(remarks) == len(statements)
    assert all(remark.startswith(statement) for remark, statement in zip(remarks, statements, strict=True))
