"""``klute-sim effects`` as a user types it, and the page about effects."""

import json
import math
import re
import subprocess
import sys
from pathlib import Path

import pytest

from klute_sim.device.device import load_device, parse_device
from klute_sim.effects import catalogue
from klute_sim.effects.effect import HOOKS, EffectParameter
from klute_sim.report.effects import text as words
from klute_sim.units import KEY_UNITS
from tests.command_line import run

ROOT = Path(__file__).parents[2]
USERS = ROOT / "tests" / "effects" / "user_effects.py"
PAGE = (ROOT / "docs" / "effects.md").read_text("utf-8")
EFFECTS = catalogue.get_effects()
HEAVY = ("gymnasium", "matplotlib", "mujoco", "numba", "numpy", "pint", "pyarrow", "pydantic", "rich", "scipy")


@pytest.mark.parametrize("name", ["effects", "plan"])
def test_help_has_examples_and_is_fast(name: str) -> None:
    code = (
        "import sys\nfrom klute_sim.cli import main\n"
        f"try: main([{name!r}, '--help'])\n"
        f"finally: print('heavy:', [m for m in {HEAVY!r} if m in sys.modules])\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "Examples:" in done.stdout
    assert "heavy: []" in done.stdout
    assert f"  {name} " in run("--help").stdout


def test_all_effects_are_listed_with_their_forms() -> None:
    table = run("effects").stdout
    listed = json.loads(run("effects", "--json").stdout)
    assert [description["name"] for description in listed] == list(EFFECTS)
    for one in listed:
        effect = EFFECTS[one["name"]]
        row = next(line for line in table.splitlines() if f" {effect.name} " in line)
        assert effect.kind in row
        assert effect.forms[0].name in row
        assert (one["kind"], one["description"], one["acts_in_supply"]) == (
            effect.kind,
            effect.description,
            effect.acts_in_supply,
        )
        assert (one["replaces_switch"] or "") == effect.replaces_switch
        assert [form["name"] for form in one["forms"]] == [form.name for form in effect.forms]
    assert run("effects", "sensor_drift", "--json").stdout.startswith("{")


@pytest.mark.parametrize("name", EFFECTS)
def test_effect_is_shown_with_all_forms(name: str) -> None:
    effect, shown = EFFECTS[name], words.describe_effect(EFFECTS[name])
    json.dumps(shown, allow_nan=False)
    for form, told in zip(effect.forms, shown["forms"], strict=True):
        assert told["equation"] == form.equation
        assert told["hooks"] == list(form.laws)
        for parameter, row in zip(form.parameters, told["parameters"], strict=True):
            assert (row["key"], row["typical"], row["neutral"], row["source"]) == (
                parameter.key,
                parameter.typical,
                parameter.neutral,
                parameter.source,
            )
            assert row["low"] == (parameter.lower if math.isfinite(parameter.lower) else None)
            assert row["high"] == (parameter.upper if math.isfinite(parameter.upper) else None)
            assert row["assumed"] == row["source"].startswith("assumed")


@pytest.mark.parametrize("name", EFFECTS)
def test_device_file_lines_are_valid(name: str) -> None:
    effect, plain = EFFECTS[name], load_device("klute-3-4-pair")
    for form in effect.forms:
        snippet = words.format_device_toml(effect, form)
        if effect.kind in ("instrument", "mechanism"):
            assert snippet is None
            continue
        switch = f"[muscle]\n{effect.replaces_switch} = false" if effect.replaces_switch else "[muscle]"
        text = plain.content.decode().replace("[muscle]", switch)
        device = parse_device(f"{text}\n{snippet}\n".encode(), "with it")
        assert (f"requires {effect.replaces_switch} = false" in str(snippet)) == bool(effect.replaces_switch)
        typical = {parameter.key: parameter.typical for parameter in form.parameters}
        if effect.kind == "body":
            assert device.parameters.effects == plain.parameters.effects
            assert (
                device.spec.collect_values().items() >= {f"effects.{name}.{k}": v for k, v in typical.items()}.items()
            )
            continue
        assert device.parameters.effects == catalogue.pack_effects({(name, form.name): typical})


def test_effect_is_printed_as_text() -> None:
    shown = run("effects", "braid_hysteresis").stdout
    for piece in ("Form coulomb: F += n slope P sign(v)", "Form maxwell_slip (default): ", "N/bar", "0 to 200",
                  "none (shape parameter)", "assumed",
                  "muscle_force: the tension of the muscle", "next_state: the internal state",
                  'form = "maxwell_slip"\nslope_n_per_bar = 8.0\nstiffness_n_per_mm = 40.0\n', "outside the gas supply",
                  ):  # fmt: skip
        assert piece in shown, piece
    offset = run("effects", "sensor_offset").stdout
    assert "never part of a device file" in offset
    assert "[effects." not in offset
    assert "channel's unit" in offset
    delay = run("effects", "pressure_delay").stdout
    assert "in the gas supply; it may add energy" in delay
    assert words.COMMAND_DESCRIPTION in delay


@pytest.mark.parametrize(
    ("effect", "key", "unit"),
    [
        ("muscle_damping", "coefficient_n_s_per_m", "N·s/m"),
        ("laminar_orifice", "transition_speed_mm_per_s", "mm/s"),
        ("tendon_hysteresis", "loss_fraction", "1"),
        ("threshold_pressure", "pressure_bar", "bar"),
        ("sensor_drift", "rate_per_s", "channel's unit/s"),
        ("sensor_lag", "time_constant_s", "s"),
    ],
)
def test_units_match_the_keys(effect: str, key: str, unit: str) -> None:
    parameter = next(p for form in EFFECTS[effect].forms for p in form.parameters if p.key == key)
    assert words.get_parameter_unit(EFFECTS[effect], parameter) == unit


def test_every_hook_has_a_description() -> None:
    assert set(words.HOOK_DESCRIPTIONS) == set(HOOKS)
    unbounded = EffectParameter(key="x_mm", neutral=0.0, lower=0.0, upper=math.inf, typical=1.0, source="assumed")
    assert words.get_parameter_unit(EFFECTS["tendon_slack"], unbounded) == "mm"


@pytest.mark.long
def test_catalogue_file_is_run_and_reported() -> None:
    done = run("effects", "warming", "--json", "--catalogue", str(USERS))
    assert done.returncode == 0, done.stderr
    assert done.stderr == f"Running the code in {USERS}.\n"
    shown = json.loads(done.stdout)
    assert shown["forms"][0]["device_file"] == (
        '[effects.warming]\nform = "first_order"\ngain = 0.02\ntime_constant_s = 1.0'
    )
    listed = json.loads(run("effects", "--json", "--catalogue", str(USERS)).stdout)
    assert [description["name"] for description in listed] == [*EFFECTS, "warming"]
    assert json.loads(run("effects", "warming", "--json", KLUTE_SIM_CATALOGUE=str(USERS)).stdout) == shown


def test_catalogue_file_is_loaded_before_compilation() -> None:
    code = (
        "from pathlib import Path\nfrom klute_sim.cli.effects import load_catalogue\nimport sys\n"
        f"load_catalogue(Path({str(USERS)!r}))\nassert 'klute_sim.device.dynamics' not in sys.modules\n"
        "from klute_sim.device import dynamics\nfrom klute_sim.effects import catalogue\n"
        "assert dynamics.N_EFFECT_VALUES == catalogue.count_values_and_states()[0]\n"
        "assert catalogue.find_slot('warming', 'first_order')\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["nope"], "there is no effect 'nope'; there are: threshold_pressure, end_taper"),
        (["--catalogue", ""], "the path is empty"),
        (["--catalogue", "missing.py"], "catalogue "),
        (["--catalogue", "missing.py"], "does not exist"),
        (["warming"], "there is no effect 'warming'"),
        (["a", "b"], "unexpected extra argument"),
    ],
)
def test_invalid_input_gives_one_sentence(arguments: list[str], says: str, tmp_path: Path) -> None:
    done = run("effects", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert says in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert done.stdout == ""


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("1/0\n", "cannot be run: ZeroDivisionError"),
        ("x = 1\n", "registers no effect"),
        ("import klute_sim\nklute_sim.register_effect(3)\n", "cannot register 3"),
    ],
)
def test_invalid_catalogue_file_gives_one_sentence(text: str, says: str, tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(text)
    done = run("effects", "--catalogue", "mine.py", cwd=tmp_path)
    assert done.returncode == 2
    note, sentence = done.stderr.splitlines()
    assert note == "Running the code in mine.py."
    assert sentence.startswith("klute-sim: catalogue ")
    assert says in sentence


def test_effect_of_the_documentation_is_tested() -> None:
    blocks = re.findall(r"^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    assert USERS.read_text("utf-8") in blocks


def test_documentation_names_every_hook_and_unit() -> None:
    rows = re.findall(r"^\| `(\w+)` \| `[\w, ]+`", PAGE, re.MULTILINE)
    assert rows == list(HOOKS)
    assert all(f"`{end}`" in PAGE for end in KEY_UNITS)


def test_documented_section_equals_the_printed_one() -> None:
    effect = EFFECTS["braid_hysteresis"]
    assert f"```toml\n{words.format_device_toml(effect, effect.forms[0])}\n```" in PAGE


def test_error_in_a_user_law_is_reported_at_once(tmp_path: Path) -> None:
    text = USERS.read_text("utf-8")
    for old, new, message in (
        ("-dt / p.time_constant", "-dtt / p.time_constant", "NameError"),
        ("return force * (1.0 + p.gain * state.warmth)", "return None", "allowed: a float"),
        ("return (decay * state.warmth + (1.0 - decay) * pressure / 1e5,)", "return ()", "a tuple of 1"),
    ):
        assert old in text
        file = tmp_path / f"error_{len(message)}.py"
        file.write_text(text.replace(old, new), "utf-8")
        done = run("effects", "warming", "--catalogue", str(file))
        assert done.returncode == 2
        assert "effect 'warming', form 'first_order': the law at" in done.stderr
        assert message in done.stderr
        assert "Traceback" not in done.stderr
