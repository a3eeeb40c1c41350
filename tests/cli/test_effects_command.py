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
USERS = ROOT / "tests" / "effects" / "users.py"
PAGE = (ROOT / "docs" / "effects.md").read_text("utf-8")
EFFECTS = catalogue.get_effects()
HEAVY = ("gymnasium", "matplotlib", "mujoco", "numba", "numpy", "pint", "pyarrow", "pydantic", "rich", "scipy")


@pytest.mark.parametrize("name", ["effects", "measure"])
def test_help_has_examples_and_imports_nothing_heavy(name: str) -> None:
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


def test_all_are_listed_with_their_forms() -> None:
    table = run("effects").stdout
    listed = json.loads(run("effects", "--json").stdout)
    assert [one["name"] for one in listed] == list(EFFECTS)
    for one in listed:
        effect = EFFECTS[one["name"]]
        row = next(line for line in table.splitlines() if f" {effect.name} " in line)
        assert effect.kind in row
        assert effect.forms[0].name in row
        assert (one["kind"], one["sentence"], one["supply"]) == (effect.kind, effect.description, effect.acts_in_supply)
        assert (one["instead_of"] or "") == effect.replaces_switch
        assert [form["name"] for form in one["forms"]] == [form.name for form in effect.forms]
    assert run("effects", "sensor_drift", "--json").stdout.startswith("{")


@pytest.mark.parametrize("name", EFFECTS)
def test_every_form_is_shown_whole(name: str) -> None:
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
def test_the_snippet_is_a_device_files_section_of_typical_size(name: str) -> None:
    effect, plain = EFFECTS[name], load_device("klute-3-4-pair")
    for form in effect.forms:
        snippet = words.format_device_toml(effect, form)
        if effect.kind == "instrument":
            assert snippet is None
            continue
        switch = f"[muscle]\n{effect.replaces_switch} = false" if effect.replaces_switch else "[muscle]"
        text = plain.content.decode().replace("[muscle]", switch)
        device = parse_device(f"{text}\n{snippet}\n".encode(), "with it")
        assert (f"needs {effect.replaces_switch} = false" in str(snippet)) == bool(effect.replaces_switch)
        typical = {parameter.key: parameter.typical for parameter in form.parameters}
        if effect.kind == "body":
            assert device.parameters.effects == plain.parameters.effects
            assert (
                device.spec.collect_values().items() >= {f"effects.{name}.{k}": v for k, v in typical.items()}.items()
            )
            continue
        assert device.parameters.effects == catalogue.pack_effects({(name, form.name): typical})


def test_what_is_printed_of_one() -> None:
    shown = run("effects", "braid_hysteresis").stdout
    for piece in ("Form coulomb (the usual one): F += n slope P sign(v)", "Form maxwell_slip: ", "N/bar", "0 to 60",
                  "none: a shape", "assumed", "muscle_force: the muscle's tension", "remember: its own memory",
                  'form = "maxwell_slip"\nslope_n_per_bar = 8.0\nstiffness_n_per_mm = 40.0\n', "not of its gas supply",
                  ):  # fmt: skip
        assert piece in shown, piece
    offset = run("effects", "sensor_offset").stdout
    assert "never in a device file" in offset
    assert "[effects." not in offset
    assert "channel's unit" in offset
    delay = run("effects", "pressure_delay").stdout
    assert "in its gas supply, which may do work" in delay
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
def test_units_are_those_of_the_keys(effect: str, key: str, unit: str) -> None:
    parameter = next(p for form in EFFECTS[effect].forms for p in form.parameters if p.key == key)
    assert words.get_parameter_unit(EFFECTS[effect], parameter) == unit


def test_every_hook_has_words() -> None:
    assert set(words.HOOK_DESCRIPTIONS) == set(HOOKS)
    unbounded = EffectParameter(key="x_mm", neutral=0.0, lower=0.0, upper=math.inf, typical=1.0, source="assumed")
    assert words.get_parameter_unit(EFFECTS["tendon_slack"], unbounded) == "mm"


@pytest.mark.long
def test_a_file_of_ones_own_is_run_and_said_to_be() -> None:
    done = run("effects", "warming", "--json", "--catalogue", str(USERS))
    assert done.returncode == 0, done.stderr
    assert done.stderr == f"The code in {USERS} is run.\n"
    shown = json.loads(done.stdout)
    assert shown["forms"][0]["device_file"] == (
        '[effects.warming]\nform = "first_order"\ngain = 0.02\ntime_constant_s = 1.0'
    )
    listed = json.loads(run("effects", "--json", "--catalogue", str(USERS)).stdout)
    assert [one["name"] for one in listed] == [*EFFECTS, "warming"]
    assert json.loads(run("effects", "warming", "--json", KLUTE_SIM_CATALOGUE=str(USERS)).stdout) == shown


def test_a_file_of_ones_own_comes_before_the_law() -> None:
    code = (
        "from pathlib import Path\nfrom klute_sim.cli.effects import use\nimport sys\n"
        f"use(Path({str(USERS)!r}))\nassert 'klute_sim.device.dynamics' not in sys.modules\n"
        "from klute_sim.device import step\nfrom klute_sim.effects import catalogue\n"
        "assert step.VALUES == catalogue.sizes()[0]\nassert catalogue.slot('warming', 'first_order')\n"
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
def test_bad_input_is_one_sentence(arguments: list[str], says: str, tmp_path: Path) -> None:
    done = run("effects", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert says in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert done.stdout == ""


@pytest.mark.parametrize(
    ("text", "says"),
    [("1/0\n", "cannot be run: ZeroDivisionError"), ("x = 1\n", "has no EFFECTS"), ("EFFECTS = [3]\n", "holds 3")],
)
def test_a_bad_file_is_one_sentence_after_the_note(text: str, says: str, tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(text)
    done = run("effects", "--catalogue", "mine.py", cwd=tmp_path)
    assert done.returncode == 2
    note, sentence = done.stderr.splitlines()
    assert note == "The code in mine.py is run."
    assert sentence.startswith("klute-sim: catalogue ")
    assert says in sentence


def test_the_pages_own_effect_is_the_one_that_is_tested() -> None:
    blocks = re.findall(r"^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    assert USERS.read_text("utf-8") in blocks


def test_the_page_names_every_hook_and_unit() -> None:
    rows = re.findall(r"^\| `(\w+)` \| `[\w, ]+`", PAGE, re.MULTILINE)
    assert rows == list(HOOKS)
    assert all(f"`{end}`" in PAGE for end in KEY_UNITS)


def test_the_pages_section_is_the_printed_one() -> None:
    effect = EFFECTS["braid_hysteresis"]
    assert f"```toml\n{words.format_device_toml(effect, effect.forms[0])}\n```" in PAGE


def test_a_slip_in_a_law_of_ones_own_is_told_at_once(tmp_path: Path) -> None:
    text = USERS.read_text("utf-8")
    for old, new, said in (
        ("own[1], step", "own[1], stp", "NameError"),
        ("return force * (1.0 + own[0] * memory[0])", "return None", "allowed: a float"),
        ("return (followed(memory[0], pressure / 1e5, own[1], step),)", "return ()", "a tuple of 1"),
    ):
        assert old in text
        file = tmp_path / f"slip_{len(said)}.py"
        file.write_text(text.replace(old, new), "utf-8")
        done = run("effects", "warming", "--catalogue", str(file))
        assert done.returncode == 2
        assert "effect 'warming', form 'first_order': its law at" in done.stderr
        assert said in done.stderr
        assert "Traceback" not in done.stderr
