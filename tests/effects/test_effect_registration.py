"""Effects in device files, and effects of the user's own."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from klute_sim.effects import catalogue
from klute_sim.effects.effect import Effect, EffectForm, EffectParameter
from klute_sim.errors import InputError
from tests.effects.devices import load_with_effects


@pytest.mark.parametrize(
    ("sections", "message"),
    [
        ({"braid": {"slope_n_per_bar": 1.0}}, "no effect 'braid'; there are: threshold_pressure, "),
        (
            {"end_taper": {"form": "cube", "factor": 1.0}},
            "'end_taper' has no form 'cube'; it has: cone, strain, length",
        ),
        ({"end_taper": {}}, r"\[effects.end_taper\] key 'cone_ratio' is missing"),
        ({"end_taper": {"cone_ratio": -1.0}}, r"cone_ratio = -1.0 is refused; allowed: 0 to 5"),
        ({"end_taper": {"cone_ratio": 1.0, "tip": 2.0}}, "unknown key 'tip'; allowed here: form, cone_ratio"),
        ({"end_taper": {"cone_ratio": "long"}}, "cone_ratio = 'long' is refused"),
        ({"sensor_gain": {"gain": 1.1}}, "'sensor_gain' is an effect of instruments"),
    ],
)
def test_invalid_effect_section_is_refused(sections: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        load_with_effects(sections)


def test_device_file_activates_effects() -> None:
    device = load_with_effects({"muscle_damping": {"form": "pressure", "coefficient_n_s_per_m": 55.0}})
    slot = catalogue.find_slot("muscle_damping", "pressure")
    assert device.parameters.effects[0] == device.parameters.effects[slot.switch_index] == 1.0
    assert device.parameters.effects[slot.switch_index + 1] == 55.0
    assert device.spec.collect_values()["effects.muscle_damping.coefficient_n_s_per_m"] == 55.0
    assert "effects.muscle_damping.coefficient_n_s_per_m" in device.spec.list_unsourced_keys()


def test_catalogue_parameters_are_consistent() -> None:
    for effect in catalogue.get_effects().values():
        assert effect.description.endswith(".")
        for form in effect.forms:
            assert form.equation
            for p in form.parameters:
                assert p.lower <= p.typical <= p.upper
                assert (
                    p.lower > 0.0 if p.neutral is None else p.lower <= p.neutral <= p.upper
                )  # shapes are fitted as logs
                assert p.source


HERE = Path(__file__).parent


def run_in_new_process(code: str, **variables: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, **variables}
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, env=environment)


USER_SCRIPT = (
    "import numpy as np; from klute_sim.device.device import load_device, parse_device\n"
    "from klute_sim.device.rollout import simulate_rollouts; from klute_sim import bench\n"
    "plain = load_device('klute-3-4-pair')\n"
    "text = plain.content + b'[effects.warming]\\ngain = 0.05\\ntime_constant_s = 0.2\\n'\n"
    "device = parse_device(text, 'mine')\n"
    "length, command = np.full(2000, 0.345), np.full(2000, 3e5)\n"
    "traces = [simulate_rollouts(d.parameters, length, command, 5e-4, backend=backend) for d in (device, plain)"
    " for backend in ('compiled', 'python')]\n"
    "assert all(np.array_equal(a, b) for a, b in zip(traces[0], traces[1]))\n"
    "gain = traces[0].tension[-1] / traces[2].tension[-1]\n"
    "records = [bench.simulate_tester(device, length, command, 5e-4, backend=backend)"
    " for backend in ('compiled', 'python')]\n"
    "assert np.array_equal(records[0]['force'], records[1]['force'])\n"
    "reached = simulate_rollouts(device.parameters, 1e-3 * records[0]['length'], command, 5e-4)\n"
    "assert abs(records[0]['force'][-1] / reached.tension[-1] - 1) < 1e-9\n"
    "print(round(gain, 2))"
)


@pytest.mark.long
def test_catalogue_file_runs_in_both_backends() -> None:
    path = HERE / "user_effects.py"
    assert len(path.read_text("utf-8").splitlines()) < 40
    process = run_in_new_process(USER_SCRIPT, KLUTE_SIM_CATALOGUE=str(path))
    assert process.returncode == 0, process.stderr
    assert 1.05 < float(process.stdout) < 1.16


@pytest.mark.long
def test_effect_registered_in_a_script_runs_in_both_backends(tmp_path: Path) -> None:
    """A user's law may allocate, which the laws of the package must not."""
    script, law = tmp_path / "script.py", (HERE / "user_effects.py").read_text("utf-8")
    result = "force * (1.0 + p.gain * state.warmth)"
    assert result in law
    law = law.replace(result, "force * np.array([1.0, p.gain * state.warmth]).sum()")
    script.write_text("import numpy as np\n" + law + USER_SCRIPT, "utf-8")
    process = subprocess.run([sys.executable, script], capture_output=True, text=True, check=False)
    assert process.returncode == 0, process.stderr
    assert 1.05 < float(process.stdout) < 1.16


def make_effect(**changes: object) -> Effect:
    parameter = EffectParameter(key="gain", neutral=0.0, lower=0.0, upper=1.0, typical=0.5, source="assumed")
    form = {"name": "default", "equation": "F (1 + gain)", "parameters": (parameter,)}
    form |= {"laws": {"damper_force": lambda p, state, force, velocity: force * (1.0 + p.gain)}}
    return Effect(name="mine", description="Mine.", kind="device", forms=(EffectForm(**(form | changes)),))


@pytest.mark.parametrize(
    ("effect", "message"),
    [
        (3, "cannot register 3; allowed: klute_sim.Effect"),
        (catalogue.BUILT_IN_EFFECTS[0], "'threshold_pressure': an effect of that name exists"),
        (make_effect(laws={"force": len}), "unknown hook 'force'; allowed: acting_pressure, "),
        (make_effect(states=("warmth",)), "internal states need a law at 'next_state'"),
        (make_effect(parameters=()), "the first parameter must have a neutral value"),
        (make_effect(laws={"damper_force": lambda p, state, force, velocity: p.slope}), "fails: AttributeError"),
        (make_effect(laws={"damper_force": lambda p, state, force, velocity: "1"}), "returns '1'; allowed: a float"),
        (make_effect(), "after the first device is loaded"),
    ],
)
def test_invalid_registration_is_refused(effect: object, message: str) -> None:
    catalogue.get_effects.cache_clear() if "device" not in message else catalogue.get_effects()
    try:
        with pytest.raises(InputError, match=re.escape(message)):
            catalogue.register_effect(effect)
    finally:
        catalogue.get_effects()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "does not exist"),
        ("x = ", "cannot be run: SyntaxError"),
        ("x = 1", "registers no effect"),
        (
            "import klute_sim as ks\nfrom klute_sim.effects.families.muscle.end_taper import END_TAPER\n"
            "ks.register_effect(END_TAPER)",
            "cannot register effect 'end_taper': an effect of that name exists",
        ),
    ],
)
def test_invalid_catalogue_file_is_refused(content: str | None, message: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    if content is not None:
        path.write_text(content, "utf-8")
    process = run_in_new_process("import klute_sim.device.dynamics", KLUTE_SIM_CATALOGUE=str(path))
    assert message in process.stderr.splitlines()[-1]
