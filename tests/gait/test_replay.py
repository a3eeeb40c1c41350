"""Replay of a walk: what the prosthesis did is found again from what its shank did."""

from functools import cache

import numpy as np
import pytest

from klute_sim.controllers import pressure
from klute_sim.datasets import channels
from klute_sim.datasets.trial import Series
from klute_sim.device.device import load_device
from klute_sim.errors import InputError, SimulationError
from klute_sim.gait.replay.foot import build_device_foot
from klute_sim.gait.replay.prescribed import prepare_prescribed_motion
from klute_sim.gait.replay.rollout import ReplayInputs, ReplayResult, simulate_replay
from klute_sim.gait.rig.rig import simulate_gait
from klute_sim.gait.rig.setup import GaitOptions
from klute_sim.recording.recording import Array, Recording

DEVICE = load_device("klute-1-1-4-pair")
FOOT = build_device_foot(DEVICE)
SI = {"deg": np.pi / 180.0, "bar": 1e5, "m": 1.0, "N": 1.0, "N*m": 1.0}
SHOWN = {"ankle_angle": "angle", "force": "tension", "pressure": "pressure", "muscle_length": "length"}


@cache
def walked(step: float = 5e-4) -> Recording:
    return simulate_gait(DEVICE, pressure.load_default_profile(), GaitOptions(strides=2, dt=step))


def si(recording: Recording, name: str) -> Array:
    return recording[name] * SI[recording.units[name]]


def exactly(recording: Recording) -> tuple[ReplayInputs, float]:
    """Every step of ``recording``, with the differences that its integrator made."""
    step = float(recording["time"][1])

    def twice(values: Array) -> Array:
        inside = (values[2:] - 2.0 * values[1:-1] + values[:-2]) / step**2
        return np.concatenate([inside[:1], inside, inside[-1:]])

    x, z, lean = (si(recording, name) for name in ("ankle_x", "ankle_z", "shank_angle"))
    lever = np.nan_to_num(recording["cop_x"] - x)
    ground = -z * recording["grf_forward"] - lever * recording["grf_vertical"]
    command = si(recording, "pressure_command")
    return ReplayInputs(lean, twice(lean), twice(x), twice(z), ground, 0.0 * x, 0.0 * x, command), step


def sampled(recording: Recording, every: int) -> dict[str, Series]:
    clock = recording["time"][::every]
    return {name: Series(clock, si(recording, name)[::every]) for name in channels.PRESCRIBED_CHANNELS["gait"]}


def wrong(found: ReplayResult, time: Array, recording: Recording, after: float = 0.5) -> dict[str, Array]:
    late = time > after
    return {
        channel: getattr(found, field)[late] - np.interp(time[late], recording["time"], si(recording, channel))
        for channel, field in {**SHOWN, "ankle_moment": "moment"}.items()
    }


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values * values)))


def test_a_walk_is_found_again_from_its_own_motion_and_load() -> None:
    """At the walk's own step: what is left, 0.005 degrees and 0.2 N rms, is the heel's spring."""
    inputs, step = exactly(walked())
    found = wrong(simulate_replay(DEVICE.parameters, FOOT, inputs, step), walked()["time"], walked())
    assert rms(found["ankle_angle"]) < np.radians(0.008)
    assert np.abs(found["ankle_angle"]).max() < np.radians(0.04)
    assert rms(found["force"]) < 0.4
    assert np.abs(found["force"]).max() < 2.0
    assert rms(found["muscle_length"]) < 5e-6
    assert np.abs(found["pressure"]).max() < 1e-6
    assert rms(found["ankle_moment"]) < 0.05


def test_steps_converge_to_each_other() -> None:
    """The error is proportional to the step, so what half of one changes is half of what a whole one does."""
    ready = prepare_prescribed_motion(sampled(walked(), 2), "a")
    grid = np.arange(ready.start_time, ready.end_time, 1e-3)
    found = []
    for parts in (1, 2, 4, 20):
        fine = ready.start_time + 1e-3 / parts * np.arange(parts * len(grid))
        done = simulate_replay(
            DEVICE.parameters, FOOT, ready.interpolate(np.minimum(fine, ready.end_time)), 1e-3 / parts
        )
        found.append(done.ankle_angle[::parts][500:])
    changes = [rms(each - found[-1]) for each in found[:-1]]
    assert changes[0] < np.radians(0.2)
    assert changes[1] == pytest.approx(0.5 * changes[0], rel=0.2)
    assert changes[2] == pytest.approx(0.5 * changes[1], rel=0.3)


@pytest.mark.parametrize(("every", "noisy"), [(4, False), (10, False), (20, False), (10, True)])
def test_samples_as_a_laboratory_has_them_are_enough(every: int, noisy: bool) -> None:
    """500, 200 and 100 Hz; markers that are 0.3 mm and 0.1 degrees off.

    Around where the load comes and goes it has spikes that no such samples hold; they are soon forgotten. Near the end
    of the samples, accelerations are not known.
    """
    given = sampled(walked(), every)
    if noisy:
        random = np.random.default_rng(1)
        for name, size in (("ankle_x", 3e-4), ("ankle_z", 3e-4), ("shank_angle", np.radians(0.1))):
            given[name] = Series(given[name].time, given[name].value + random.normal(0, size, len(given[name].time)))
    ready = prepare_prescribed_motion(given, "a")
    grid = np.arange(ready.start_time, ready.end_time, 5e-4)
    found = wrong(simulate_replay(DEVICE.parameters, FOOT, ready.interpolate(grid), 5e-4), grid, walked())
    time = grid[grid > 0.5]
    away = time < ready.end_time - 0.06
    for event in (*ready.find_foot_strikes(), *ready.find_toe_offs()):
        away &= (time < event - 0.04) | (time > event + 0.06)
    assert away.mean() > 0.7
    assert rms(found["ankle_angle"][away]) < np.radians(0.08 if noisy else 0.03)
    assert rms(found["force"][away]) < (7.0 if noisy else 2.0)


def test_strikes_and_lifts_are_the_loads() -> None:
    ready = prepare_prescribed_motion(sampled(walked(), 2), "a")
    stride = float(walked()["time"][walked()["stride"] == 2][0])
    assert np.abs(ready.find_foot_strikes() - stride).min() < 0.04
    loaded = walked()["grf_vertical"] > 20.0
    assert np.interp(ready.find_foot_strikes(), walked()["time"], loaded).min() == 1.0
    assert np.interp(ready.find_toe_offs(), walked()["time"], loaded).max() == 0.0


def test_compiled_and_plain_are_the_same_bits() -> None:
    inputs, step = exactly(walked())
    few = ReplayInputs(*(series[:400] for series in inputs))
    few = few._replace(axial_force=10.0 * few.ground_moment, shear_force=few.ground_moment)
    yielding = {"keel": 1e-3, "keel_time": 0.01, "keel_held": 1e-3, "socket": 1e-5}
    device, foot = DEVICE.parameters, FOOT._replace(ankle_friction=1.0, min_angle=-0.05, **yielding)
    plain, compiled = (simulate_replay(device, foot, few, step, backend=law) for law in ("python", "compiled"))
    for one, other in zip(plain, compiled, strict=True):
        assert np.array_equal(one, other)
    assert np.ptp(plain.ankle_angle) > 0.01


def test_what_cannot_be_replayed_is_said() -> None:
    inputs, step = exactly(walked())
    device = DEVICE.parameters
    with pytest.raises(InputError, match=r"step is 0\.01; allowed: above 0, up to 0\.002 s"):
        simulate_replay(device, FOOT, inputs, 0.01)
    with pytest.raises(InputError, match="do not fit together"):
        simulate_replay(device, FOOT, inputs._replace(shank_angle=inputs.shank_angle[:-1]), step)
    with pytest.raises(InputError, match="must be finite"):
        simulate_replay(device, FOOT, inputs._replace(ground_moment=inputs.ground_moment * np.nan), step)
    with pytest.raises(InputError, match=r"without a tendon .* \[tendon\] section"):
        simulate_replay(load_device("klute-3-4").parameters, FOOT, inputs, step)
    with pytest.raises(SimulationError, match="no finite state"):
        simulate_replay(device, FOOT._replace(inertia=0.0, ankle_damping=0.0), inputs, step)
    slow = sampled(walked(), 60)
    with pytest.raises(InputError, match="a: 'shank_angle' has 33 samples a second; a replay needs 50 or more"):
        prepare_prescribed_motion(slow, "a")
    given = sampled(walked(), 2)
    given["grf_vertical"] = Series(given["grf_vertical"].time, 0.01 * given["grf_vertical"].value)
    with pytest.raises(InputError, match="a: 'grf_vertical' is never above 20 N"):
        prepare_prescribed_motion(given, "a")
