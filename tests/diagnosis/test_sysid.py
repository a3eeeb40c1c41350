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
from klute_sim.datasets.trial import TimeSeries
from klute_sim.device.device import load_device
from klute_sim.device.dynamics import DeviceParameters
from klute_sim.device.equilibrium import compute_equilibrium_state
from klute_sim.diagnosis.experiments import bench as experiments_bench
from klute_sim.diagnosis.experiments.base import Experiment
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.dependent_numbers import replace_values
from klute_sim.diagnosis.fitting.hypothesis import Hypothesis
from klute_sim.diagnosis.fitting.least_squares import fit_hypothesis
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.autocorrelation import Autocorrelation
from klute_sim.diagnosis.noise.repeats import Noise
from klute_sim.plant import callbacks, models
from klute_sim.plant.actuator import DeviceActuator
from klute_sim.units import BAR
from tests.diagnosis import synthetic_dataset as synthetic_dataset

sysid = pytest.importorskip("mujoco.sysid")
if not hasattr(sysid, "optimize"):  # it can be imported without the packages of its extra, but is empty
    pytest.skip("mujoco.sysid is empty without the packages of mujoco[sysid]", allow_module_level=True)

DEVICE = load_device("klute-3-4-pair")
NOMINAL = DEVICE.spec.collect_values()
TRUTH = {"tendon.stiffness_1_n_per_mm": 65.4, "muscle.friction_slope_n_per_bar": 25.1}
RELATIVE_RANGE = 0.5
"""Relative range of a parameter; as a standard deviation, so wide that the prior has no influence."""
INERTIA = 1e12
"""Inertia of the crosshead [kg]: the device displaces it by a nanometre."""


def make_parameters(values: dict[str, float]) -> DeviceParameters:
    return replace_values(DEVICE.spec, values).to_parameters()


def build_driven_bench(dt: float) -> mujoco.MjSpec:
    """Return the bench with the crosshead's acceleration [m/s^2] as control and the load cell as sensor."""
    spec = models.load_spec("bench")
    spec.option.timestep = dt
    spec.joint("crosshead").armature = INERTIA
    actuator = spec.add_actuator(name="drive", target="crosshead", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.gainprm[0] = INERTIA
    sensor_type = {"type": mujoco.mjtSensor.mjSENS_ACTUATORFRC, "objtype": mujoco.mjtObj.mjOBJ_ACTUATOR}
    spec.add_sensor(name="force", objname="muscle_tendon", **sensor_type)
    return spec


def compute_accelerations(path: np.ndarray, dt: float) -> np.ndarray:
    """Return the accelerations that move MuJoCo's semi-implicit Euler steps along ``path`` [m] from rest."""
    result, x, v = np.zeros(len(path)), path[0], 0.0
    for k, target in enumerate(path[1:]):
        result[k] = ((target - x) / dt - v) / dt
        v += dt * result[k]
        x += dt * v
    return result


def make_initial_state(model: mujoco.MjModel, length: float, command: float) -> np.ndarray:
    """Return the state of ``model`` with the device in equilibrium at ``length`` [m] and ``command`` [Pa]."""
    data, actuator = mujoco.MjData(model), DeviceActuator(model, "muscle_tendon")
    actuator.set_state(data, compute_equilibrium_state(actuator.parameters, length, command))
    return np.asarray(sysid.create_initial_state(model, np.array([length]), np.zeros(1), data.act))


def fit_with_sysid(trial: Experiment, optimizer: str) -> dict[str, float]:
    spec, length, command = build_driven_bench(trial.dt), trial.unit_length, trial.command

    def build(values: Any, spec: mujoco.MjSpec) -> mujoco.MjModel:
        device = make_parameters({key: float(values[key].value[0]) for key in TRUTH})
        return models.attach_devices(spec.copy(), {"muscle_tendon": device})

    nominal_model = models.attach_devices(spec.copy(), {"muscle_tendon": DEVICE.parameters})
    controls = np.column_stack([command / BAR, compute_accelerations(length, trial.dt)])
    controls = np.vstack([controls, controls[-1]])  # its rollouts omit the last control
    force = trial.measured["force"]
    measured = sysid.ModelSequences(
        "bench",
        spec,
        trial.name,
        make_initial_state(nominal_model, length[0], command[0]),
        sysid.TimeSeries.from_control_names(trial.dt * np.arange(len(controls)), controls, nominal_model),
        sysid.TimeSeries.from_names(force.time - trial.start_time, -force.value[:, None], nominal_model),
    )
    residual = sysid.build_residual_fn(models_sequences=[measured], build_model=build)
    values = [
        sysid.Parameter(k, NOMINAL[k], (1 - RELATIVE_RANGE) * NOMINAL[k], (1 + RELATIVE_RANGE) * NOMINAL[k])
        for k in TRUTH
    ]
    if callbacks.choose_backend() != "compiled":
        pytest.skip("mujoco.sysid compiles a model for each trial point, which Python callbacks do not allow")
    with callbacks.device_callbacks():
        result, _ = sysid.optimize(
            sysid.ParameterDict({parameter.name: parameter for parameter in values}), residual, optimizer, gtol=1e-14
        )
    return {key: float(result[key].value[0]) for key in TRUTH}


@pytest.mark.parametrize("optimizer", ["mujoco", "scipy"])
def test_mujoco_sysid_fits_the_same_values(tmp_path: Path, optimizer: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        experiments_bench, "COARSE_STEP_FACTOR", 1
    )  # as MuJoCo, without extrapolation to a vanishing time step
    dataset = load_dataset(
        synthetic_dataset.write_dataset(tmp_path, base=make_parameters(TRUTH), groups=("fit_1",), repeats=1)
    )
    (trial,) = prepare_experiments(dataset, split_dataset(dataset))
    # Rounding may put the last sample before or after the end of the rollout, so both fits omit it.
    force = trial.measured["force"]
    trial = replace(trial, measured={"force": TimeSeries(force.time[:-1], force.value[:-1])})
    data = WeightedData(
        Simulator(), [trial], {"force": Noise(synthetic_dataset.NOISE["force"], (Autocorrelation(1e-9, 1.0, 1),))}
    )
    hypothesis = Hypothesis(DEVICE, tuple((key, RELATIVE_RANGE * NOMINAL[key]) for key in TRUTH), ())
    fit = fit_hypothesis(data, hypothesis, fine=True)
    data.simulator.close()
    sysid_values = fit_with_sysid(trial, optimizer)
    for key, value in zip(TRUTH, fit.values, strict=True):
        assert abs(NOMINAL[key] / TRUTH[key] - 1.0) > 0.05  # the nominal value is wrong
        assert value == pytest.approx(TRUTH[key], rel=0.015)
        assert sysid_values[key] == pytest.approx(value, rel=3e-5)
