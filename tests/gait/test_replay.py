"""Replay of a gait run: the motion of the shank reproduces the response of the prosthesis."""

from functools import cache

import numpy as np
import pytest

from klute_sim.controllers import pressure
from klute_sim.datasets import channels
from klute_sim.datasets.trial import TimeSeries
from klute_sim.device.device import load_device
from klute_sim.errors import InputError, SimulationError
from klute_sim.gait.replay.foot import build_device_foot
from klute_sim.gait.replay.prescribed import PASS_CUTOFF_HZ, prepare_prescribed_motion
from klute_sim.gait.replay.rollout import ReplayInputs, ReplayResult, simulate_replay
from klute_sim.gait.rig.rig import simulate_gait
from klute_sim.gait.rig.setup import GaitOptions
from klute_sim.recording.recording import Recording
from klute_sim.types import Array

DEVICE = load_device("klute-1-1-4-pair")
FOOT = build_device_foot(DEVICE)
SI_FACTORS = {"deg": np.pi / 180.0, "bar": 1e5, "m": 1.0, "N": 1.0, "N*m": 1.0}
FIELD_OF_CHANNEL = {"ankle_angle": "ankle_angle", "force": "tension", "pressure": "pressure", "muscle_length": "length"}


@cache
def simulate_run(step: float = 5e-4) -> Recording:
    return simulate_gait(DEVICE, pressure.load_default_profile(), GaitOptions(strides=2, dt=step, alignment=0.0))


def to_si(recording: Recording, name: str) -> Array:
    return recording[name] * SI_FACTORS[recording.units[name]]


def extract_inputs(recording: Recording) -> tuple[ReplayInputs, float]:
    """Return the inputs of ``recording`` with the finite differences of its integrator, and its time step."""
    step = float(recording["time"][1])

    def differentiate_twice(values: Array) -> Array:
        inside = (values[2:] - 2.0 * values[1:-1] + values[:-2]) / step**2
        return np.concatenate([inside[:1], inside, inside[-1:]])

    x, z, lean = (to_si(recording, name) for name in ("ankle_x", "ankle_z", "shank_angle"))
    lever = np.nan_to_num(recording["cop_x"] - x)
    ground = -z * recording["grf_forward"] - lever * recording["grf_vertical"]
    command = to_si(recording, "pressure_command")
    return ReplayInputs(
        lean,
        differentiate_twice(lean),
        differentiate_twice(x),
        differentiate_twice(z),
        ground,
        0.0 * x,
        0.0 * x,
        command,
    ), step


def sample_channels(recording: Recording, stride: int) -> dict[str, TimeSeries]:
    clock = recording["time"][::stride]
    return {name: TimeSeries(clock, to_si(recording, name)[::stride]) for name in channels.PRESCRIBED_CHANNELS["gait"]}


def compute_errors(errors: ReplayResult, time: Array, recording: Recording, after: float = 0.5) -> dict[str, Array]:
    late = time > after
    return {
        channel: getattr(errors, field)[late] - np.interp(time[late], recording["time"], to_si(recording, channel))
        for channel, field in {**FIELD_OF_CHANNEL, "ankle_moment": "ankle_moment"}.items()
    }


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values * values)))


def test_replay_reproduces_a_gait_run() -> None:
    """The remaining differences are due to the heel, which yields by 20 mm: its 0.1 kg are rigid in the replay."""
    inputs, step = extract_inputs(simulate_run())
    errors = compute_errors(
        simulate_replay(DEVICE.parameters, FOOT, inputs, step), simulate_run()["time"], simulate_run()
    )
    assert rms(errors["ankle_angle"]) < np.radians(0.04)
    assert np.abs(errors["ankle_angle"]).max() < np.radians(0.2)
    assert rms(errors["force"]) < 1.2
    assert np.abs(errors["force"]).max() < 8.0
    assert rms(errors["muscle_length"]) < 2e-5
    assert np.abs(errors["pressure"]).max() < 1e-6
    assert rms(errors["ankle_moment"]) < 0.15


def test_replay_converges_with_the_time_step() -> None:
    """The error is proportional to the time step, so halving it halves the change."""
    motion = prepare_prescribed_motion(sample_channels(simulate_run(), 2), "a")
    grid = np.arange(motion.start_time, motion.end_time, 1e-3)
    errors = []
    for parts in (1, 2, 4, 20):
        fine = motion.start_time + 1e-3 / parts * np.arange(parts * len(grid))
        result = simulate_replay(
            DEVICE.parameters, FOOT, motion.interpolate(np.minimum(fine, motion.end_time)), 1e-3 / parts
        )
        errors.append(result.ankle_angle[::parts][500:])
    changes = [rms(angles - errors[-1]) for angles in errors[:-1]]
    assert changes[0] < np.radians(0.2)
    assert changes[1] == pytest.approx(0.5 * changes[0], rel=0.2)
    assert changes[2] == pytest.approx(0.5 * changes[1], rel=0.3)


@pytest.mark.parametrize(("frequency", "gain"), [(2.0, 1.0), (16.0, np.sqrt(0.5)), (PASS_CUTOFF_HZ, 0.5)])
def test_cutoff_of_both_passes_is_16_hz(frequency: float, gain: float) -> None:
    samples = sample_channels(simulate_run(), 1)
    time = samples["ankle_z"].time
    samples["ankle_z"] = TimeSeries(time, np.sin(2.0 * np.pi * frequency * time))
    middle = time[(time > 0.5) & (time < 1.5)]
    filtered = prepare_prescribed_motion(samples, "a").ankle_z(middle)
    assert filtered == pytest.approx(gain * np.sin(2.0 * np.pi * frequency * middle), abs=5e-3)


@pytest.mark.parametrize(("stride", "is_noisy"), [(4, False), (10, False), (20, False), (10, True)])
def test_replay_works_with_laboratory_samples(stride: int, is_noisy: bool) -> None:
    """Sampling rates of 500, 200 and 100 Hz, and marker noise of 0.3 mm and 0.1 degrees.

    At foot strike and toe-off the load has spikes that such samples do not contain; their influence decays quickly.
    Near the end of the samples the accelerations are unknown.
    """
    samples = sample_channels(simulate_run(), stride)
    if is_noisy:
        rng = np.random.default_rng(1)
        for name, size in (("ankle_x", 3e-4), ("ankle_z", 3e-4), ("shank_angle", np.radians(0.1))):
            samples[name] = TimeSeries(
                samples[name].time, samples[name].value + rng.normal(0, size, len(samples[name].time))
            )
    motion = prepare_prescribed_motion(samples, "a")
    grid = np.arange(motion.start_time, motion.end_time, 5e-4)
    errors = compute_errors(
        simulate_replay(DEVICE.parameters, FOOT, motion.interpolate(grid), 5e-4), grid, simulate_run()
    )
    time = grid[grid > 0.5]
    is_far = time < motion.end_time - 0.06
    for event in (*motion.find_foot_strikes(), *motion.find_toe_offs()):
        is_far &= (time < event - 0.04) | (time > event + 0.06)
    assert is_far.mean() > 0.7
    assert rms(errors["ankle_angle"][is_far]) < np.radians(0.08 if is_noisy else 0.05)
    assert rms(errors["force"][is_far]) < (7.0 if is_noisy else 2.5)


def test_foot_strikes_and_toe_offs_follow_the_load() -> None:
    motion = prepare_prescribed_motion(sample_channels(simulate_run(), 2), "a")
    second_stride = float(simulate_run()["time"][simulate_run()["stride"] == 2][0])
    assert np.abs(motion.find_foot_strikes() - second_stride).min() < 0.04
    loaded = simulate_run()["grf_vertical"] > 20.0
    assert np.interp(motion.find_foot_strikes(), simulate_run()["time"], loaded).min() == 1.0
    assert np.interp(motion.find_toe_offs(), simulate_run()["time"], loaded).max() == 0.0


def test_backends_are_bit_identical() -> None:
    inputs, step = extract_inputs(simulate_run())
    short = ReplayInputs(*(series[:400] for series in inputs))
    short = short._replace(axial_force=10.0 * short.ground_moment, shear_force=short.ground_moment)
    yielding = {
        "keel_compliance": 1e-3,
        "keel_time_constant": 0.01,
        "keel_friction_angle": 1e-3,
        "socket_compliance": 1e-5,
        "socket_time_constant": 0.01,
        "tilt_compliance": 1e-3,
        "tilt_time_constant": 0.01,
        "tilt_height": 0.3,
        "unknown_load": 3.0,
        "unknown_angle_squared": 1.0,
    }
    device, foot = DEVICE.parameters, FOOT._replace(ankle_friction=1.0, min_angle=-0.05, **yielding)
    plain, compiled = (
        simulate_replay(device, foot, short, step, backend=backend) for backend in ("python", "compiled")
    )
    for python_values, compiled_values in zip(plain, compiled, strict=True):
        assert np.array_equal(python_values, compiled_values)
    assert np.ptp(plain.ankle_angle) > 0.01


def test_invalid_inputs_are_refused() -> None:
    inputs, step = extract_inputs(simulate_run())
    device = DEVICE.parameters
    with pytest.raises(InputError, match=r"dt is 0\.01; allowed: above 0, up to 0\.002 s"):
        simulate_replay(device, FOOT, inputs, 0.01)
    with pytest.raises(InputError, match="do not fit together"):
        simulate_replay(device, FOOT, inputs._replace(shank_angle=inputs.shank_angle[:-1]), step)
    with pytest.raises(InputError, match="must be finite"):
        simulate_replay(device, FOOT, inputs._replace(ground_moment=inputs.ground_moment * np.nan), step)
    with pytest.raises(InputError, match=r"without a tendon .* \[tendon\] section"):
        simulate_replay(load_device("klute-3-4").parameters, FOOT, inputs, step)
    with pytest.raises(SimulationError, match="no finite state"):
        simulate_replay(device, FOOT._replace(inertia=0.0, ankle_damping=0.0), inputs, step)
    samples = sample_channels(simulate_run(), 2)
    samples["grf_vertical"] = TimeSeries(samples["grf_vertical"].time, 0.01 * samples["grf_vertical"].value)
    with pytest.raises(InputError, match="a: 'grf_vertical' is never above 20 N"):
        prepare_prescribed_motion(samples, "a")
