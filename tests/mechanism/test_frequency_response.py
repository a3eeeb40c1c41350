"""Measured frequency responses: tables, known lags and dead times, and the comparison with a simulated joint."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

import klute_sim as ks
from klute_sim.errors import InputError
from klute_sim.recording.frequency_response import (
    Correction,
    FrequencyResponse,
    compare_responses,
    fit_correction,
    fit_factor,
    read_frequency_response,
)
from klute_sim.report.joint.response import describe_response

DATA = Path(os.environ.get("KLUTE_SIM_DATA", "/nonexistent")) / "pam_leg_bode" / "OpenLoopBodeData.txt"
FREQUENCY = np.geomspace(0.1, 10.0, 12)
SIMULATED = 30.0 / (1.0 + 2j * np.pi * FREQUENCY * 0.1)
ROWS = "frequency [Hz],gain [{}],phase [deg]\n0.5,20,-10\n1,21,-30\n4,6,-160\n"


@pytest.mark.parametrize(("gain", "lag", "dead_time"), [(0.8, 0.025, 0.034), (1.0, 0.0, 0.0), (2.0, 0.2, -0.04)])
def test_known_factor_lag_and_dead_time_are_recovered(gain: float, lag: float, dead_time: float) -> None:
    truth = Correction(gain, lag, dead_time, 0.0, 0.0)
    measured = FrequencyResponse(FREQUENCY, truth.compute_response(FREQUENCY) * SIMULATED, "1")
    fit = fit_correction(measured, SIMULATED)
    assert fit[:3] == pytest.approx(truth[:3], abs=1e-4)
    assert (fit.gain_error_db, fit.phase_error_deg) == pytest.approx((0.0, 0.0), abs=0.01)
    factor = fit_factor(measured, SIMULATED)
    assert (factor.lag, factor.dead_time) == (0.0, 0.0)
    assert factor.gain_error_db >= fit.gain_error_db - 1e-9
    assert factor.phase_error_deg >= fit.phase_error_deg - 1e-9


def test_lag_halves_the_power_at_its_corner_and_dead_time_turns_the_phase_only() -> None:
    corner = 1.0 / (2.0 * np.pi * 0.1)
    (lagged,) = Correction(1.0, 0.1, 0.0, 0.0, 0.0).compute_response(np.array([corner]))
    assert abs(lagged) == pytest.approx(np.sqrt(0.5))
    assert np.degrees(np.angle(lagged)) == pytest.approx(-45.0)
    (late,) = Correction(1.0, 0.0, 0.1, 0.0, 0.0).compute_response(np.array([1.0]))
    assert late == pytest.approx(np.exp(-1j * np.radians(36.0)))


def test_advice_is_a_lag_of_the_supply_only_where_the_simulation_is_early() -> None:
    late, early = (
        Correction(1.0, 0.02, dead_time, 0.0, 0.0).compute_response(FREQUENCY) * SIMULATED
        for dead_time in (0.03, -0.03)
    )
    for response, phrase in ((late, "20 ms and 30 ms of dead time would"), (early, "by 30 ms at best")):
        comparison = compare_responses(FrequencyResponse(FREQUENCY, response, "1"), SIMULATED, np.ones(len(FREQUENCY)))
        assert phrase in describe_response(comparison, "deg")[1]


def test_scale_of_a_gain_without_unit_is_no_error() -> None:
    plain, scaled = (
        compare_responses(FrequencyResponse(FREQUENCY, factor * SIMULATED, "1"), SIMULATED, np.ones(len(FREQUENCY)))
        for factor in (1.0, 0.02)
    )
    assert scaled.factor.gain == pytest.approx(0.02)
    assert scaled.factor.gain_error_db == pytest.approx(plain.factor.gain_error_db, abs=1e-9)
    assert "has a scale of 0.02 deg/bar" in describe_response(scaled, "deg")[0]


@pytest.mark.parametrize(("unit", "gain"), [("1", 20.0), ("deg/bar", 20.0), ("dB", 10.0)])
def test_tables_are_read_in_their_units(unit: str, gain: float, tmp_path: Path) -> None:
    (tmp_path / "bode.csv").write_text(ROWS.format(unit))
    response = read_frequency_response(tmp_path / "bode.csv")
    assert abs(response.response[0]) == pytest.approx(gain)
    assert np.degrees(np.angle(response.response)) == pytest.approx([-10.0, -30.0, -160.0])
    assert response.gain_unit == ("1" if unit == "dB" else unit)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0.1,0.8,-2\n0.2,0.8,-3\n", "no column 'frequency .Hz.'.*the first line names"),
        (ROWS.format("N"), "no column 'gain .1.'"),
        (ROWS.format("1").replace("-30", "x"), "row 3 of 'phase .deg.' is 'x'; allowed: a finite number"),
        (ROWS.format("1").replace("4,6", "0.7,6"), "allowed: increasing"),
        (ROWS.format("1").replace("4,6", "400,6"), "0.01 to 50 Hz"),
        (ROWS.format("1").replace("21", "-21"), "a gain is -21; allowed: above 0"),
        (ROWS.format("1").rsplit("\n", 2)[0] + "\n", "has 2 rows; allowed: 3 to 500"),
    ],
)
def test_bad_tables_are_one_sentence(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "bode.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        read_frequency_response(tmp_path / "bode.csv")


def test_own_response_of_the_joint_needs_no_correction(tmp_path: Path) -> None:
    options = {"mean_pressure_bar": 2.0, "difference_bar": 0.3, "time_step": 2e-3}
    frequency = np.array([1.0, 2.0, 4.0])
    own = FrequencyResponse(frequency, np.ones(3, dtype=np.complex128), "deg/bar")
    first = ks.simulate_joint(test="sines", response=own, **options)  # type: ignore[arg-type]
    response = first.result.compute_frequency_response()[0]
    rows = [f"{f},{abs(r)},{np.degrees(np.angle(r))}" for f, r in zip(frequency, response, strict=True)]
    (tmp_path / "own.csv").write_text("\n".join(["frequency [Hz],gain [deg/bar],phase [deg]", *rows]) + "\n")
    run = ks.simulate_joint(test="sines", response=tmp_path / "own.csv", **options)  # type: ignore[arg-type]
    assert run.comparison is not None
    assert run.comparison.factor.gain == pytest.approx(1.0, abs=1e-6)
    assert run.comparison.factor.phase_error_deg == pytest.approx(0.0, abs=1e-4)
    folder = run.save(tmp_path / "run")
    assert len((folder / "response.csv").read_text().splitlines()) == 4
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["response"]["correction"]["gain"] == pytest.approx(1.0, abs=0.01)
    assert "is 1 times the simulated one" in str(run)


def test_comparisons_that_make_no_sense_are_refused() -> None:
    response = FrequencyResponse(FREQUENCY, SIMULATED, "mm/bar")
    with pytest.raises(InputError, match="with the test 'sines', not with 'steps'"):
        ks.simulate_joint(response=response)
    with pytest.raises(InputError, match=r"the joint 'joint' moves in deg; allowed: gain .1. or gain .deg/bar."):
        ks.simulate_joint(test="sines", response=response)


@pytest.mark.slow
@pytest.mark.skipif(not DATA.exists(), reason="KLUTE_SIM_DATA does not hold this measurement")
def test_measured_leg_is_no_heavy_lever(tmp_path: Path) -> None:
    (tmp_path / "bode.csv").write_text("frequency [Hz],gain [1],phase [deg]\n" + DATA.read_text())
    run = ks.simulate_joint(test="sines", response=tmp_path / "bode.csv", difference_bar=0.3, time_step=2e-3)
    assert run.comparison is not None
    factor, correction = run.comparison.factor, run.comparison.correction
    assert (factor.gain_error_db, factor.phase_error_deg) == pytest.approx((8.66, 38.7), rel=0.05)
    assert correction.dead_time < 0.0
    assert correction.gain_error_db > 8.0  # neither a lag nor a dead time removes a resonance
    assert len(run.table) == 30
