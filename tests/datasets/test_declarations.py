"""Noise of inputs, specimens and tolerances that ``dataset.toml`` declares."""

from pathlib import Path

import numpy as np
import pytest

from klute_sim.datasets.dataset import Dataset, load_dataset
from klute_sim.datasets.write import write_trial
from klute_sim.errors import InputError

HEAD = 'format = "klute-sim-dataset/2"\nrig = "bench"\ndevice = "klute-3-4-pair"\n'
TIME = np.arange(15) * 0.01
TRIALS = '[[trial]]\nfiles = ["a.csv"]\nuse = "fit"\n[[trial]]\nfiles = ["b.csv"]\nuse = "test"\n'


def load(folder: Path, text: str) -> Dataset:
    for name, scale in {"a": 10.0, "b": 30.0}.items():
        columns = {"time [s]": TIME, "length [mm]": 340 + TIME, "pressure_command [bar]": 3 + TIME}
        write_trial(folder / f"{name}.csv", columns | {"force [N]": 690.0 + scale * TIME / TIME[-1]})
    (folder / "dataset.toml").write_text(HEAD + text, "utf-8")
    return load_dataset(folder)


def load_error(folder: Path, text: str) -> str:
    with pytest.raises(InputError) as caught:
        load(folder, text)
    sentence = str(caught.value)
    assert str(folder / "dataset.toml") in sentence
    assert "\n" not in sentence
    return sentence


def test_nothing_is_declared_by_default(tmp_path: Path) -> None:
    dataset = load(tmp_path, TRIALS)
    assert dataset.tolerance == {}
    assert [(trial.specimen, trial.input_noise) for trial in dataset.trials] == [("", {}), ("", {})]


@pytest.mark.parametrize(
    ("text", "length"),
    [("0.2 mm", 2e-4), ("200µm", 2e-4), (" 2e-1  mm ", 2e-4), ("+.5 in", 0.0127), ("1. mm", 1e-3)],
)
def test_input_noise_is_in_si_units(tmp_path: Path, text: str, length: float) -> None:
    dataset = load(tmp_path, f'[noise]\nlength = "{text}"\n' + TRIALS)
    assert [trial.input_noise["length"] for trial in dataset.trials] == pytest.approx([length, length])


def test_noise_of_a_trial_replaces_that_of_the_dataset(tmp_path: Path) -> None:
    text = '[noise]\nlength = "0.2 mm"\npressure_command = "20 mbar"\n' + TRIALS + '[trial.noise]\nlength = "1 mm"\n'
    first, second = load(tmp_path, text).trials
    assert first.input_noise == pytest.approx({"length": 2e-4, "pressure_command": 2e3})
    assert second.input_noise == pytest.approx({"length": 1e-3, "pressure_command": 2e3})


def test_percentage_refers_to_the_range_in_the_fit_trials_only(tmp_path: Path) -> None:
    assert load(tmp_path, '[tolerance]\nforce = "2 %"\n' + TRIALS).tolerance == pytest.approx({"force": 0.2})
    both = TRIALS.replace("test", "fit")
    assert load(tmp_path, '[tolerance]\nforce = "2%"\n' + both).tolerance == pytest.approx({"force": 0.6})


def test_tolerance_with_a_unit_is_in_si_units(tmp_path: Path) -> None:
    text = '[tolerance]\nforce = "5 N"\npressure = "50 mbar"\n' + TRIALS
    assert load(tmp_path, text).tolerance == pytest.approx({"force": 5.0, "pressure": 5e3})


def test_trials_have_the_specimens_that_they_name(tmp_path: Path) -> None:
    text = TRIALS.replace('"fit"', '"fit"\nspecimen = "A"').replace('"test"', '"test"\nspecimen = "B 2"')
    assert [trial.specimen for trial in load(tmp_path, text).trials] == ["A", "B 2"]


@pytest.mark.parametrize(
    ("text", "limits"),
    [
        ("-9 N to 0.9 kN", (-9.0, 900.0)),
        ("to 900 N", (-np.inf, 900.0)),
        ("-9 N to", (-9.0, np.inf)),
        ("  -9N   to   900N ", (-9.0, 900.0)),
    ],
)
def test_limits_of_sensors_are_in_si_units(tmp_path: Path, text: str, limits: tuple[float, float]) -> None:
    dataset = load(tmp_path, f'[limits]\nforce = "{text}"\npressure = "to 7 bar"\n' + TRIALS)
    assert [trial.limits for trial in dataset.trials] == [{"force": limits}, {"force": limits}]


def test_limits_of_a_trial_replace_those_of_the_dataset(tmp_path: Path) -> None:
    text = '[limits]\nforce = "to 900 N"\n' + TRIALS + '[trial.limits]\nforce = "to 2 kN"\n'
    assert [trial.limits["force"].high for trial in load(tmp_path, text).trials] == [900.0, 2000.0]


@pytest.mark.parametrize(("text", "seconds"), [("20 ms", 0.02), ("-0.05 s", -0.05), ("0 s", 0.0)])
def test_delay_is_subtracted_from_the_times_of_a_channel(tmp_path: Path, text: str, seconds: float) -> None:
    declared = load(tmp_path, f'[delay]\nforce = "{text}"\n' + TRIALS + '[trial.delay]\nforce = "7 ms"\n').trials
    recorded = load(tmp_path, TRIALS).trials
    for before, after, delay in zip(recorded, declared, (seconds, 0.007), strict=True):
        assert after.measured["force"].time == pytest.approx(before.measured["force"].time - delay)
        assert after.delays == pytest.approx({"force": delay})
        assert after.prescribed["length"].time == pytest.approx(before.prescribed["length"].time)


@pytest.mark.parametrize(("limits", "n_free"), [("to 10 N", 0), ("699.9 N to", 1)])
def test_limits_that_leave_hardly_a_sample_are_refused(tmp_path: Path, limits: str, n_free: int) -> None:
    sentence = load_error(tmp_path, f'[limits]\nforce = "{limits}"\n' + TRIALS)
    assert f"the limits of force, '{limits}', leave {n_free} of the 15 samples in the trials for the fit" in sentence
    assert sentence.endswith("is their unit right?")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[noise]\nlength = 0.2\n", "noise.length = 0.2 is refused; allowed: a table of channel = '0.2 mm'"),
        ("noise = 0.2\n", "noise = 0.2 is refused; allowed: a table of channel = '0.2 mm'"),
        ('[noise]\nlength = "0.2"\n', "[noise] length = '0.2' is not a finite number with a unit; write for example"),
        ('[noise]\nlength = "two mm"\n', "'two mm' is not a finite number with a unit"),
        ('[noise]\nlength = "1e999 mm"\n', "'1e999 mm' is not a finite number with a unit"),
        ('[noise]\nlength = "0.2 N"\n', "length = '0.2 N' has a unit of the wrong kind; allowed: mm, cm, m, in and"),
        ('[noise]\nlength = "1 %"\n', "length = '1 %' has a unit of the wrong kind"),
        ('[noise]\nlength = "0 mm"\n', "length = '0 mm' is refused; allowed: a number above 0"),
        ('[noise]\nlength = "-1 mm"\n', "length = '-1 mm' is refused; allowed: a number above 0"),
        ('[noise]\nlenght = "1 mm"\n', "unknown channel 'lenght'; did you mean 'length'? Allowed: the prescribed"),
        ('[noise]\nforce = "1 N"\n', "names 'force', whose noise is estimated from repeats and residuals; allowed"),
        ("[delay]\nforce = 0.02\n", "delay.force = 0.02 is refused; allowed: a table of channel = '20 ms'"),
        ('[delay]\nforce = "20 mm"\n', "[delay] force = '20 mm' has a unit of the wrong kind; allowed: s, ms, min"),
        ('[delay]\nforce = "2 h"\n', "[delay] force = '2 h' is refused; allowed: up to 3600 s, late or early"),
        ('[delay]\nforec = "2 ms"\n', "[delay] names the unknown channel 'forec'; did you mean 'force'?"),
        ('[limits]\nforce = 5\n', "limits.force = 5 is refused; allowed: a table of channel = '-9 N to 445 N'"),
        ('[limits]\nforce = "5 N"\n', "= '5 N' is refused; write for example '-9 N to 445 N', '-9 N to' or 'to 445 N'"),
        ('[limits]\nforce = "to"\n', "[limits] force = 'to' is refused; write for example"),
        ('[limits]\nforce = "1 N to 2 N to 3 N"\n', "is refused; write for example"),
        ('[limits]\nforce = "5 N to 2 N"\n', "is refused; the second number must be larger than the first"),
        ('[limits]\nforce = "-9 to 2 N"\n', "[limits] force = '-9' is not a finite number with a unit"),
        ('[limits]\nlength = "to 2 mm"\n', "[limits] names the unknown channel 'length'"),
        ('[tolerance]\nforce = 5\n', "tolerance.force = 5 is refused; allowed: a table of channel = '5 N' or '2 %'"),
        ('[tolerance]\nforce = "5 mm"\n', "[tolerance] force = '5 mm' has a unit of the wrong kind"),
        ('[tolerance]\nforce = "5 N %"\n', "force = '5 N %' is refused; write a percentage such as '2 %'"),
        ('[tolerance]\nforce = "-2 %"\n', "force = '-2 %' is refused; allowed: a number above 0"),
        ('[tolerance]\nforce = "200 %"\n', "'200 %' is refused; allowed: up to 100 % of the range of the channel"),
        ('[tolerance]\nlength = "1 mm"\n', "unknown channel 'length'; "),
        ('[tolerance]\npressure = "2 %"\n', "has no range to refer to: the channel is not measured in a fit trial"),
    ],
)  # fmt: skip
def test_invalid_quantities_are_refused(tmp_path: Path, text: str, message: str) -> None:
    assert message in load_error(tmp_path, text + TRIALS)


@pytest.mark.parametrize(
    ("text", "subject"),
    [
        ('[noise]\nlength = "500 mm"\n', "the noise of length, '500 mm',"),
        ('[noise]\npressure_command = "20 bar"\n', "the noise of pressure_command, '20 bar',"),
        ('[tolerance]\nforce = "800 N"\n', "[tolerance] force, '800 N',"),
    ],
)
def test_noise_and_tolerance_beyond_the_range_are_refused(tmp_path: Path, text: str, subject: str) -> None:
    sentence = load_error(tmp_path, text + TRIALS)
    assert f"{subject} is larger than the range of the channel; is its unit right?" in sentence


def test_constant_channel_may_be_wrong_by_more_than_its_range(tmp_path: Path) -> None:
    assert load(tmp_path, '[noise]\nlength = "2 mm"\n[tolerance]\nforce = "20 N"\n' + TRIALS).tolerance == {
        "force": 20.0
    }


def test_invalid_noise_of_a_trial_is_refused_with_its_name(tmp_path: Path) -> None:
    sentence = load_error(tmp_path, TRIALS + '[trial.noise]\nlength = "1 bar"\n')
    assert "trial 'b': [trial.noise] length = '1 bar' has a unit of the wrong kind" in sentence


def test_percentage_of_a_constant_channel_is_refused(tmp_path: Path) -> None:
    load(tmp_path, TRIALS)
    columns = {
        "time [s]": TIME,
        "length [mm]": 340 + TIME,
        "pressure_command [bar]": 3 + TIME,
        "force [N]": 690 + 0 * TIME,
    }
    write_trial(tmp_path / "a.csv", columns)
    (tmp_path / "dataset.toml").write_text(HEAD + '[tolerance]\nforce = "2 %"\n' + TRIALS, "utf-8")
    with pytest.raises(InputError, match="the channel is constant in the fit trials; give a number with a unit"):
        load_dataset(tmp_path)


def test_specimen_is_named_on_all_trials_or_none(tmp_path: Path) -> None:
    sentence = load_error(tmp_path, TRIALS.replace('"fit"', '"fit"\nspecimen = "A"'))
    assert "trial 'a' has a specimen and trial 'b' has none; name the specimen of every trial, or of none" in sentence


def test_repeats_of_several_specimens_are_refused(tmp_path: Path) -> None:
    text = TRIALS.replace('"test"', '"fit"\nspecimen = "B"\ngroup = "x"')
    text = text.replace('use = "fit"\n[[', 'use = "fit"\nspecimen = "A"\ngroup = "x"\n[[')
    assert "group 'x' has trials of the specimens 'A' and 'B'; repeats are" in load_error(tmp_path, text)
