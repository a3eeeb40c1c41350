"""Registration of walks: signs, a late plate, noise of the centre of pressure, and no change without an error."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from klute_sim.diagnosis.experiments.registration import (
    REGISTRATION_DEVIATIONS,
    REGISTRATION_WORDS,
    SI_FACTORS,
    MeasuredInputs,
    PlateLoad,
    Registration,
    describe_registration,
    list_corrections,
    make_registration,
)
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import Hypothesis
from klute_sim.diagnosis.fitting.least_squares import fit_hypothesis
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.heteroscedastic import add_noise_scales
from klute_sim.diagnosis.noise.repeats import estimate_noise_from_repeats
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.gait.replay.rollout import ReplayInputs
from tests.diagnosis.synthetic_walk import DEVICE, make_walks

STEP = 1e-3
LOAD = PlateLoad(np.array([0.0, 800.0]), np.array([0.5, 0.51]), np.array([0.1, 0.1]))
ANGLE = np.radians([0.0, 20.0])
FORWARD = np.array([0.0, 60.0])
INPUTS = ReplayInputs(
    shank_angle=ANGLE,
    shank_angular_acceleration=np.zeros(2),
    ankle_acceleration_x=np.zeros(2),
    ankle_acceleration_z=np.zeros(2),
    ground_moment=np.array([0.0, -50.0]),
    axial_force=np.cos(ANGLE) * LOAD.vertical + np.sin(ANGLE) * FORWARD,
    shear_force=np.sin(ANGLE) * LOAD.vertical - np.cos(ANGLE) * FORWARD,
    pressure_command=np.zeros(2),
)
MEASURED = MeasuredInputs(INPUTS, LOAD, STEP)


def test_names_units_and_fields_agree() -> None:
    fields = [name.removeprefix("registration.").rpartition("_")[0] for name in REGISTRATION_WORDS]
    assert fields == list(Registration._fields)
    assert list(REGISTRATION_WORDS) == list(SI_FACTORS)
    assert make_registration([]) == ()
    assert Registration(*make_registration([("registration.plate_delay_ms", 2.0)])) == Registration(plate_delay=2e-3)


def test_moment_follows_the_lever_and_the_height() -> None:
    # A load 10 mm further in front of the ankle dorsiflexes: the moment falls by 8 N.m.
    shifted = MEASURED.correct(Registration(cop_to_ankle=0.01))
    assert shifted.ground_moment - INPUTS.ground_moment == pytest.approx([0.0, -8.0])
    # A forward force at a height of another 10 mm: -0.6 N.m.
    raised = MEASURED.correct(Registration(ankle_height=0.01))
    assert raised.ground_moment - INPUTS.ground_moment == pytest.approx([0.0, -0.6])
    louder = MEASURED.correct(Registration(plate_gain=0.01))
    assert louder.ground_moment == pytest.approx(1.01 * INPUTS.ground_moment)
    assert louder.axial_force == pytest.approx(1.01 * INPUTS.axial_force)
    assert louder.shear_force == pytest.approx(1.01 * INPUTS.shear_force)


def test_corrections_that_matter_are_told() -> None:
    rows = [
        ("registration.cop_to_ankle_mm", -4.97, (-5.2, -4.7)),
        ("registration.ankle_height_mm", 2.1, (-3.0, 7.0)),
        ("registration.plate_gain_pct", -0.03, (-0.1, 0.04)),
        ("tendon.stiffness_1_n_per_mm", 60.0, (59.0, 61.0)),
    ]
    (sentence,) = describe_registration(list_corrections(rows, REGISTRATION_DEVIATIONS))
    assert "the centre of pressure lies 5 [4.7, 5.2] mm further back than measured" in sentence
    assert describe_registration(list_corrections(rows[1:], REGISTRATION_DEVIATIONS)) == []


@pytest.mark.parametrize(("name", "statement"), [("ankle_zero_deg", "smaller"), ("cop_to_ankle_mm", "further forward")])
def test_corrections_say_how_the_truth_differs_from_the_data(name: str, statement: str) -> None:
    """A zero is subtracted from the angle, and a distance is added to the position."""
    (correction,) = list_corrections([(f"registration.{name}", 8.0, (7.0, 9.0))], REGISTRATION_DEVIATIONS)
    assert correction.endswith(statement)


def test_no_error_changes_nothing() -> None:
    unchanged = MEASURED.correct(Registration())
    assert all(np.array_equal(a, b) for a, b in zip(unchanged, INPUTS, strict=True))


@pytest.mark.parametrize("delay", [0.004, -0.0125])
def test_delay_of_the_plate_is_removed(delay: float) -> None:
    """A plate that sees smooth loads late, while the ankle moves, gives the moment about the ankle where it is now."""
    time = STEP * np.arange(800.0)

    def measure(late: float) -> tuple[ReplayInputs, PlateLoad]:
        vertical, forward, cop = (
            level + size * np.sin(rate * (time - late))
            for level, size, rate in ((600.0, 200.0, 9.0), (0.0, 80.0, 11.0), (0.6, 0.1, 7.0))
        )
        angle, x, z = 0.3 * np.sin(5.0 * time), 0.5 + 0.3 * time, 0.1 + 0.05 * np.sin(6.0 * time)
        still = np.zeros_like(time)
        inputs = ReplayInputs(
            shank_angle=angle,
            shank_angular_acceleration=still,
            ankle_acceleration_x=still,
            ankle_acceleration_z=still,
            ground_moment=-z * forward - (cop - x) * vertical,
            axial_force=np.cos(angle) * vertical + np.sin(angle) * forward,
            shear_force=np.sin(angle) * vertical - np.cos(angle) * forward,
            pressure_command=still,
        )
        return inputs, PlateLoad(vertical, x, z)

    corrected = MeasuredInputs(*measure(delay), STEP).correct(Registration(plate_delay=delay))
    right, inside = measure(0.0)[0], slice(20, -20)
    for name in ("ground_moment", "axial_force", "shear_force"):
        expected = getattr(right, name)[inside]
        assert getattr(corrected, name)[inside] == pytest.approx(expected, abs=0.02), name


def prepare_walks(
    simulator: Simulator, cop_noise: float, seed: int, *, is_corrected: bool = True
) -> tuple[WeightedData, Hypothesis]:
    """Return walks with slow noise of the centre of pressure [m] and no error, and the registration to fit."""
    rng, walks = np.random.default_rng(seed), make_walks(amplitudes=(1.0, 0.8, 0.6), seed=seed)
    for index, walk in enumerate(walks):
        noise = gaussian_filter1d(rng.normal(size=len(walk.command)), 20.0)
        shift = cop_noise * noise / noise.std() * walk.load.vertical
        walks[index] = replace(walk, inputs=walk.inputs._replace(ground_moment=walk.inputs.ground_moment - shift))
    experiments, _ = add_noise_scales(walks, walks, simulator)
    if not is_corrected:
        experiments = [replace(e, input_noise_share={}) for e in experiments]
    names = tuple(REGISTRATION_DEVIATIONS.items())
    hypothesis = Hypothesis(DEVICE, (), (), registration=names)
    (residuals,) = WeightedData(simulator, experiments, {}).compute_residuals(hypothesis, [np.zeros(len(names))])
    noise_of_channels = estimate_noise_from_repeats(experiments, residuals)
    return WeightedData(simulator, experiments, noise_of_channels), hypothesis


def test_start_of_a_candidate_is_judged_by_the_prior_of_the_fit() -> None:
    """With noisy inputs, the prior of the gain has another mean than 0; a start that changes nothing gains nothing."""
    data, hypothesis = prepare_walks(Simulator(1), 2e-3, 0)
    assert data.n_noisy_inputs > 100.0
    fit = fit_hypothesis(data, hypothesis)
    start, chi2 = ForwardSelection(data, [], []).find_best_start(fit, hypothesis, [fit.x])
    assert start == pytest.approx(fit.x)
    assert chi2 == pytest.approx(fit.chi2, rel=1e-6)


@pytest.mark.slow
def test_noise_of_the_centre_of_pressure_does_not_lower_the_gain_of_the_plate() -> None:
    """Without the correction, noise in the load dilutes the regression: the gain comes out too small in the mean."""

    def fit_gain(seed: int, *, is_corrected: bool) -> float:
        fit = fit_hypothesis(*prepare_walks(Simulator(1), 3e-3, seed, is_corrected=is_corrected))
        return fit.values[list(REGISTRATION_DEVIATIONS).index("registration.plate_gain_pct")]

    diluted, corrected = (
        np.mean([fit_gain(seed, is_corrected=is_corrected) for seed in range(4)]) for is_corrected in (False, True)
    )
    assert diluted < -0.3
    assert abs(corrected) < 0.35 * abs(diluted)
