"""MuJoCo's own system identification finds the numbers that the device-only fit finds.

The law and the measured trial are the same; simulator (MuJoCo, the device on an actuator), residuals and optimiser
are those of ``mujoco.sysid``. It can refit numbers, not name effects, so no more than that is held against it. It
drives the actuator's callbacks as they are. Its rollouts prescribe controls and nothing else, so the crosshead gets a
drive and a mass that nothing moves; and it divides every trial by that trial's size, which is another weighting as
soon as there are two: here is one.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from klute_sim.datasets.dataset import load_dataset, split_dataset
from klute_sim.datasets.trial import Series
from klute_sim.device.device import load_device
from klute_sim.device.dynamics import DeviceParameters, compute_equilibrium_state
from klute_sim.diagnosis.experiments import bench as experiments_bench
from klute_sim.diagnosis.experiments.base import Experiment, Simulator
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.fitting.hypothesis import Hypothesis, replace_values
from klute_sim.diagnosis.fitting.least_squares import WeightedData, fit_hypothesis
from klute_sim.diagnosis.noise.repeats import Autocorrelation, Noise
from klute_sim.plant import callbacks, models
from klute_sim.plant.actuator import DeviceActuator
from klute_sim.units import BAR
from tests.diagnosis import synthetic_dataset as made

sysid = pytest.importorskip("mujoco.sysid")
if not hasattr(sysid, "optimize"):  # without the packages of its extra it can be imported, and is empty
    pytest.skip("mujoco.sysid is empty without the packages of mujoco[sysid]", allow_module_level=True)
if (
    callbacks.choose_backend() != "compiled"
):  # Python callbacks let nothing be compiled meanwhile, and sysid compiles for each try
    pytest.skip("mujoco.sysid needs the compiled law", allow_module_level=True)

DEVICE = load_device("klute-3-4-pair")
NOMINAL = DEVICE.spec.collect_values()
TRUTH = {"tendon.stiffness_1_n_per_mm": 65.4, "muscle.friction_slope_n_per_bar": 25.1}
REACH = 0.5
"""How far a number may be off, as a share of it; as a standard deviation, so wide that the prior says nothing."""
INERTIA = 1e12
"""Of the crosshead [kg]: the device pulls it aside by a nanometre."""


def device_with(numbers: dict[str, float]) -> DeviceParameters:
    return replace_values(DEVICE.spec, numbers).to_parameters()


def bench_with_a_drive(step: float) -> mujoco.MjSpec:
    """The bench whose crosshead is driven by a control, its acceleration [m/s2], and whose load cell is a sensor."""
    spec = models.load_spec("bench")
    spec.option.timestep = step
    spec.joint("crosshead").armature = INERTIA
    drive = spec.add_actuator(name="drive", target="crosshead", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    drive.gainprm[0] = INERTIA
    kinds = {"type": mujoco.mjtSensor.mjSENS_ACTUATORFRC, "objtype": mujoco.mjtObj.mjOBJ_ACTUATOR}
    spec.add_sensor(name="force", objname="muscle_tendon", **kinds)
    return spec


def accelerations(way: np.ndarray, step: float) -> np.ndarray:
    """What leads MuJoCo's semi-implicit Euler steps along ``way`` [m], from rest; rounding does not add up."""
    found, x, v = np.zeros(len(way)), way[0], 0.0
    for k, target in enumerate(way[1:]):
        found[k] = ((target - x) / step - v) / step
        v += step * found[k]
        x += step * v
    return found


def at_rest(model: mujoco.MjModel, length: float, command: float) -> np.ndarray:
    """Initial state of a rollout: the device of ``model`` settled at ``length`` [m] under ``command`` [Pa]."""
    data, actuator = mujoco.MjData(model), DeviceActuator(model, "muscle_tendon")
    actuator.set_state(data, compute_equilibrium_state(actuator.parameters, length, command))
    return np.asarray(sysid.create_initial_state(model, np.array([length]), np.zeros(1), data.act))


def refitted_by_sysid(trial: Experiment, optimizer: str) -> dict[str, float]:
    spec, length, command = bench_with_a_drive(trial.dt), trial.unit_length, trial.command

    def build(numbers: Any, spec: mujoco.MjSpec) -> mujoco.MjModel:
        device = device_with({key: float(numbers[key].value[0]) for key in TRUTH})
        return models.attach_devices(spec.copy(), {"muscle_tendon": device})

    plain = models.attach_devices(spec.copy(), {"muscle_tendon": DEVICE.parameters})
    controls = np.column_stack([command / BAR, accelerations(length, trial.dt)])
    controls = np.vstack([controls, controls[-1]])  # its rollouts leave the last one out
    force = trial.measured["force"]
    measured = sysid.ModelSequences(
        "bench",
        spec,
        trial.name,
        at_rest(plain, length[0], command[0]),
        sysid.TimeSeries.from_control_names(trial.dt * np.arange(len(controls)), controls, plain),
        sysid.TimeSeries.from_names(force.time - trial.start_time, -force.value[:, None], plain),
    )
    residual = sysid.build_residual_fn(models_sequences=[measured], build_model=build)
    numbers = [sysid.Parameter(k, NOMINAL[k], (1 - REACH) * NOMINAL[k], (1 + REACH) * NOMINAL[k]) for k in TRUTH]
    with callbacks.device_callbacks():
        found, _ = sysid.optimize(
            sysid.ParameterDict({each.name: each for each in numbers}), residual, optimizer, gtol=1e-14
        )
    return {key: float(found[key].value[0]) for key in TRUTH}


@pytest.mark.parametrize("optimizer", ["mujoco", "scipy"])
def test_it_finds_the_same_numbers_on_mujocos_bench(
    tmp_path: Path, optimizer: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        experiments_bench, "COARSE_STEP_FACTOR", 1
    )  # MuJoCo's steps have the error of their length, so ours may, too
    dataset = load_dataset(made.dataset(tmp_path, base=device_with(TRUTH), groups=("fit_1",), repeats=1))
    (trial,) = prepare_experiments(dataset, split_dataset(dataset))
    # The last sample is at the end of the rollout, which rounding may put before or after it: nobody gets it.
    force = trial.measured["force"]
    trial = replace(trial, measured={"force": Series(force.time[:-1], force.value[:-1])})
    evidence = WeightedData(
        Simulator(), [trial], {"force": Noise(made.NOISE["force"], (Autocorrelation(1e-9, 1.0, 1),))}
    )
    free = Hypothesis(DEVICE, tuple((key, REACH * NOMINAL[key]) for key in TRUTH), ())
    ours = fit_hypothesis(evidence, free, fine=True)
    evidence.simulator.close()
    theirs = refitted_by_sysid(trial, optimizer)
    for key, value in zip(TRUTH, ours.values, strict=True):
        assert abs(NOMINAL[key] / TRUTH[key] - 1.0) > 0.05  # there is something to find
        assert value == pytest.approx(TRUTH[key], rel=0.015)
        assert theirs[key] == pytest.approx(value, rel=3e-5)
