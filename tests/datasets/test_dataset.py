"""Datasets: the file that describes them, device changes, digest, speed, and random damage."""

import random
import tomllib
from pathlib import Path

import numpy as np
import pytest

from klute_sim.datasets.dataset import load_dataset, split_dataset
from klute_sim.datasets.write import write_trial
from klute_sim.device import device as device_files
from klute_sim.device.device import list_presets, load_device
from klute_sim.errors import InputError
from klute_sim.files.toml import format_toml

TEXT = """\
format = "klute-sim-dataset/2"
rig = "bench"
device = "klute-3-4-pair"
[uncertain]
"tendon.stiffness_2_n_per_mm" = "10 %"
"muscle.c10_kpa" = 5.5
"damper.bore_mm" = 0.5
[[trial]]
files = ["a.csv"]
group = "iso"
use = "fit"
[[trial]]
files = ["b.csv", "b_pressure.csv"]
group = "iso"
use = "fit"
[trial.device]
"muscle.resting_length_mm" = 180.0
"muscle.count" = 3
[[trial]]
files = ["c.csv"]
use = "test"
"""
TIME = np.arange(15) * 0.01


def write_dataset(folder: Path, text: str = TEXT) -> Path:
    for name in "abc":
        columns = {"time [s]": TIME, "length [mm]": 340 + TIME, "pressure_command [bar]": 3 + TIME, "force [N]": TIME}
        write_trial(folder / f"{name}.csv", columns)
    write_trial(folder / "b_pressure.csv", {"time [s]": TIME, "pressure [bar]": TIME})
    (folder / "dataset.toml").write_text(text, "utf-8")
    return folder


def test_dataset_has_the_content_of_its_file(tmp_path: Path) -> None:
    dataset = load_dataset(write_dataset(tmp_path))
    assert (dataset.folder, dataset.rig, dataset.device.name) == (tmp_path, "bench", "klute-3-4-pair")
    assert dataset.uncertainties == pytest.approx(
        {"tendon.stiffness_2_n_per_mm": 14.0, "muscle.c10_kpa": 5.5, "damper.bore_mm": 0.5}
    )
    assert [t.name for t in dataset.trials] == ["a", "b+b_pressure", "c"]
    assert [t.group for t in dataset.trials] == ["iso", "iso", "c"]
    assert [t.use for t in dataset.trials] == ["fit", "fit", "test"]
    assert dataset.trials[1].files == (tmp_path / "b.csv", tmp_path / "b_pressure.csv")
    assert set(dataset.trials[1].measured) == {"force", "pressure"}
    assert dataset.remarks == ()
    assert split_dataset(dataset)[:3] == (("a", "b+b_pressure"), (), ("c",))


def test_device_changes_of_a_trial_make_a_valid_device_file(tmp_path: Path) -> None:
    dataset = load_dataset(write_dataset(tmp_path))
    nominal, changed = dataset.trials[0].device, dataset.trials[1].device
    assert nominal is dataset.device
    assert changed.parameters.muscle.resting_length == pytest.approx(0.18)
    assert changed.parameters.muscle.n_actuators == 3
    assert changed.parameters.tendon == nominal.parameters.tendon
    again = device_files.parse_device(changed.content, "x")
    assert again.spec == changed.spec
    assert again.spec.sources["muscle.count"] == f"{tmp_path / 'dataset.toml'}, trial 'b+b_pressure'"
    assert again.spec.sources["muscle.c10_kpa"] == nominal.spec.sources["muscle.c10_kpa"]


@pytest.mark.parametrize("name", list_presets())
def test_writing_a_device_file_preserves_its_content(name: str) -> None:
    keys = tomllib.loads(load_device(name).content.decode())
    assert tomllib.loads(format_toml(keys)) == keys


def test_writing_toml_preserves_any_text() -> None:
    keys = {
        "name": 'é"\\\n\t\x7f\x01\U0001f600',
        "muscle": {"bladder": False, "x": 1e-300, "n": 2},
        "sources": {"a.b": ""},
    }
    assert tomllib.loads(format_toml(keys)) == keys


def test_device_path_is_relative_to_the_folder(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_bytes(load_device("klute-1-1-4-pair").content)
    text = TEXT.replace("klute-3-4-pair", "mine.toml").split("[uncertain]")[0] + '[[trial]]\nfiles = ["a.csv"]\n'
    assert load_dataset(write_dataset(tmp_path, text)).device.name == "klute-1-1-4-pair"


def test_digest_depends_on_each_file(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_bytes(load_device("klute-3-4-pair").content)
    write_dataset(tmp_path, TEXT.replace("klute-3-4-pair", "mine.toml"))
    digests = {load_dataset(tmp_path).digest}
    assert load_dataset(tmp_path).digest in digests
    for name in ("dataset.toml", "mine.toml", "a.csv", "b.csv", "b_pressure.csv", "c.csv"):
        with (tmp_path / name).open("a") as file:
            file.write("\n")
        digests.add(load_dataset(tmp_path).digest)
    assert len(digests) == 7


def test_remarks_on_a_shared_file_occur_once(tmp_path: Path) -> None:
    text = (
        TEXT.split("[uncertain]")[0] + '[[trial]]\nfiles = ["a.csv", "x.csv"]\n[[trial]]\nfiles = ["c.csv", "x.csv"]\n'
    )
    write_dataset(tmp_path, text)
    write_trial(tmp_path / "x.csv", {"time [s]": TIME, "pressure [bar]": TIME, "odd [1]": TIME})
    assert load_dataset(tmp_path).remarks == (f"trial file {tmp_path / 'x.csv'}: ignored columns 'odd [1]'",)


def load_error(folder: Path) -> str:
    with pytest.raises(InputError) as caught:
        load_dataset(folder)
    sentence = str(caught.value)
    assert "\n" not in sentence
    return sentence


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("dataset/2", "dataset/3", "format = 'klute-sim-dataset/3' is refused; allowed: 'klute-sim-dataset/2'"),
        ('format = "klute-sim-dataset/2"\n', "", "key 'format' is missing; allowed: 'klute-sim-dataset/2'"),
        ('rig = "bench"', 'rig = "bank"', "rig = 'bank' is refused; allowed: 'bench', 'gait' or 'mjcf'"),
        (
            'rig = "bench"',
            'rigg = "bench"',
            "unknown key 'rigg'; did you mean 'rig'? Allowed here: format, rig, device, diameter, uncertain, ",
        ),
        ('device = "klute-3-4-pair"', "device = 3", "device = 3 is refused; allowed: a preset, or the path"),
        ('device = "klute-3-4-pair"', 'device = " "', "[device] ' ' is refused; allowed: a name or path on one"),
        (
            'device = "klute-3-4-pair"',
            'device = "a\\u0000"',
            "'device' contains the control character U+0000; allowed: printable text",
        ),
        ('device = "klute-3-4-pair"', 'device = "no.toml"', "no.toml': give the path of a device file"),
        ('"10 %"', '"ten %"', "[uncertain.tendon.stiffness_2_n_per_mm] 'ten %' is refused; allowed: a standard"),
        ('"10 %"', '"-10 %"', "'-10 %' is refused; allowed: a standard deviation above 0"),
        ('"10 %"', '"nan %"', "'nan %' is refused"),
        ('"10 %"', '"10"', "'10' is refused; write \"10 %\" for per cent, or 10 without quotes for the unit of"),
        ('"10 %"', '"10 % %"', "'10 % %' is refused"),
        ('"10 %"', "0", "] 0 is refused; allowed: a standard deviation above 0, in per cent"),
        ('"10 %"', "true", "] True is refused; allowed: a standard deviation"),
        ('"10 %"', "[1]", "] [1] is refused; allowed: a standard deviation"),
        ('"10 %"', "1" + "0" * 400, "is an integer of 1329 bits; allowed: up to 63 bits"),
        (
            '"damper.bore_mm"',
            '"damper.boar_mm"',
            "[uncertain] names 'damper.boar_mm', which is not a numeric key of the device",
        ),
        ('"damper.bore_mm"', '"damper.boar_mm"', "did you mean 'damper.bore_mm'"),
        ('"damper.bore_mm" = 0.5', '"muscle.count" = 1', "[uncertain] 'muscle.count' is a count"),
        (
            '"damper.bore_mm" = 0.5',
            '"muscle.bladder" = 1',
            "[uncertain] names 'muscle.bladder', which is not a",
        ),
        ('[uncertain]\n"', 'uncertain = 3\n[sources]\n"', "unknown key 'sources'"),
        (
            'group = "iso"',
            'grupp = "iso"',
            "unknown key 'trial.1.grupp'; did you mean 'group'? Allowed here: files, group, use, device, heading_row",
        ),
        ('group = "iso"', "group = 7", "trial.1.group = 7 is refused; allowed: a name, as text"),
        (
            'use = "test"',
            'use = "test"\ntrusted = ["force", "torque"]',
            "'trusted' names 'torque', which the trial does not measure; allowed: force",
        ),
        (
            'use = "test"',
            'use = "test"\ntrusted = "force"',
            "trial.3.trusted = 'force' is refused; allowed: a list of",
        ),
        ('use = "test"', 'use = "show"', "trial.3.use = 'show' is refused; allowed: 'fit', 'validation' or 'test'"),
        (
            'files = ["a.csv"]',
            "files = []",
            "trial.1.files = [] is refused; allowed: a list of one or more file names",
        ),
        (
            'rig = "bench"',
            'rig = "bench"\nheading_row = 0',
            "heading_row = 0 is refused; allowed: the number of a line, 1",
        ),
        ('group = "iso"', 'group = "iso"\nheading_row = 2', "a.csv has no heading: line 2 must name the columns"),
        (
            'files = ["a.csv"]',
            'files = "a.csv"',
            "trial.1.files = 'a.csv' is refused; allowed: a list of one or",
        ),
        ('files = ["a.csv"]', 'files = [""]', "[trial.1.files.1] '' is refused; allowed: a name or path"),
        ('files = ["a.csv"]', "files = [1]", "trial.1.files.1 = 1 is refused; allowed: a list of one or more file"),
        ('files = ["a.csv"]', "", "key 'trial.1.files' is missing; allowed: a list of one or more file names"),
        ('files = ["a.csv"]', 'files = ["no.csv"]', "no.csv does not exist; give paths relative to the folder"),
        ("[uncertain]", 'accept = ["force-units"]\n[uncertain]', "dataset.toml, accept: there is no finding 'force-un"),
        ('files = ["a.csv"]', 'files = ["."]', "trial 1 names '.', which is a folder; give the paths of files"),
        ('files = ["a.csv"]', 'files = ["/"]', "trial 1 names '/', which is a folder"),
        ('group = "iso"', 'group = "c"', "group = 'c' is the name of a trial without a group, which would become"),
        ('files = ["a.csv"]', 'files = ["./c.parquet"]', "trials 1 and 3 are both 'c'; give each trial its own"),
        (
            'group = "iso"\nuse = "fit"\n[trial',
            'group = "iso"\n[trial',
            "group 'iso' has trials with use = 'fit' and no",
        ),
        (
            "= 180.0",
            "= 10.0",
            "trial 'b+b_pressure': device file klute-3-4-pair: muscle.resting_length_mm = 10.0 is ref",
        ),
        ("= 180.0", "= nan", "'trial.2.device.muscle.resting_length_mm' is nan; allowed: finite numbers"),
        ("= 180.0", "= true", "] True is refused; allowed: a finite number in the unit of the key"),
        ("= 180.0", '= "180"', "] '180' is refused; allowed: a finite number in the unit of the key"),
        ('"muscle.count" = 3', '"muscle.count" = 3.5', "muscle.count = 3.5 is refused"),
        ('"muscle.count"', '"muscle.cuont"', "trial 'b+b_pressure': 'muscle.cuont' is not"),
        ('"muscle.count"', '"sources.x"', "trial 'b+b_pressure': 'sources.x' is not"),
        ("[trial.device]", "device = 3\n[x]", "unknown key 'x'"),
        ("[uncertain]", "[uncertain", "is not valid TOML"),
        (
            '[[trial]]\nfiles = ["a',
            '[trial]\nfiles = ["a',
            "column 8); write [[trial]], with two brackets, for each trial",
        ),
    ],
)
def test_invalid_files_are_refused_with_key_value_and_allowed_values(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    assert old in TEXT
    sentence = load_error(write_dataset(tmp_path, TEXT.replace(old, new, 1)))
    assert message in sentence
    assert str(tmp_path) in sentence


def test_first_format_is_refused_with_the_keys_to_rename(tmp_path: Path) -> None:
    sentence = load_error(write_dataset(tmp_path, TEXT.replace("dataset/2", "dataset/1")))
    assert "has the first format, 'klute-sim-dataset/1'; change it to 'klute-sim-dataset/2'" in sentence
    assert "use = 'select' to 'validation', use = 'show' to 'test', and the key 'checked' to 'trusted'" in sentence


def test_repr_is_short_and_html_lists_the_trials(tmp_path: Path) -> None:
    dataset = load_dataset(write_dataset(tmp_path))
    assert repr(dataset) == f"Dataset('{tmp_path}', rig='bench', device='klute-3-4-pair', 3 trials in 2 groups)"
    assert "<td>b+b_pressure</td><td>iso</td><td>fit</td><td>0.14</td><td>force, pressure</td>" in dataset._repr_html_()
    assert len(repr(dataset.trials[0])) < 5000


def test_file_without_trials_is_refused(tmp_path: Path) -> None:
    head = TEXT.split("[[trial]]")[0]
    assert "key 'trial' is missing; allowed: 1 to 2000 tables [[trial]]" in load_error(write_dataset(tmp_path, head))
    message = "trial = [] is refused; allowed: 1 to 2000 tables [[trial]]"
    assert message in load_error(write_dataset(tmp_path, "trial = []\n" + head))
    assert "trial = 3 is refused" in load_error(write_dataset(tmp_path, "trial = 3\n" + head))
    assert "trial.1 = 3 is refused; allowed: 1 to 2000 tables" in load_error(
        write_dataset(tmp_path, "trial = [3]\n" + head)
    )
    assert "is refused; allowed: a table of" in load_error(
        write_dataset(tmp_path, "uncertain = 3\n" + TEXT.split("[unc")[0])
    )


def test_misnamed_column_is_reported_with_the_missing_channel(tmp_path: Path) -> None:
    write_dataset(tmp_path)
    columns = {"time [s]": TIME, "length [mm]": 340 + TIME, "pressure_command [bar]": 3 + TIME, "kraft [N]": TIME}
    write_trial(tmp_path / "b.csv", columns)
    remark, missing_channel, scope = load_dataset(tmp_path).remarks
    where = f"trial file {tmp_path / 'b.csv'}"
    assert remark == f"{where}: ignored columns 'kraft [N]'"
    assert missing_channel == "trial 'b+b_pressure' has no force, which its repeats have"
    assert scope.endswith("can show the supply only")
    write_dataset(tmp_path)
    write_trial(tmp_path / "b.csv", {**columns, "force [N]": TIME})
    assert load_dataset(tmp_path).remarks == (f"{where}: ignored columns 'kraft [N]'",)


def test_trials_may_differ_in_channels_and_sampling(tmp_path: Path) -> None:
    write_dataset(tmp_path)
    slow = {
        "time [s]": 10 * TIME,
        "length [mm]": 340 + TIME,
        "pressure_command [bar]": 3 + TIME,
        "pressure [bar]": TIME,
    }
    write_trial(tmp_path / "c.csv", slow)
    dataset = load_dataset(tmp_path)
    assert [list(trial.measured) for trial in dataset.trials] == [["force"], ["force", "pressure"], ["pressure"]]
    assert dataset.remarks == ("trial 'c' measures neither force nor muscle_length, and can show the supply only",)


def test_percentage_of_zero_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(
        load_device("klute-3-4-pair").content.decode().replace("engagement_mm = 5.0", "engagement_mm = 0")
    )
    text = TEXT.replace("klute-3-4-pair", "mine.toml").replace("stiffness_2_n_per_mm", "engagement_mm")
    assert "'tendon.engagement_mm' = '10 %', but the device's value is 0; give a standard" in load_error(
        write_dataset(tmp_path, text)
    )


def test_percentage_of_a_negative_value_is_a_positive_deviation(tmp_path: Path) -> None:
    text = TEXT.replace("tendon.stiffness_2_n_per_mm", "muscle.friction_offset_n")
    assert load_dataset(write_dataset(tmp_path, text)).uncertainties["muscle.friction_offset_n"] == pytest.approx(3.82)


def test_folder_without_dataset_is_refused(tmp_path: Path) -> None:
    assert f"folder {tmp_path} is not a dataset: it has no file dataset.toml" in load_error(tmp_path)
    assert f"folder {tmp_path / 'no'} does not exist; give a folder with a file dataset.toml" in load_error(
        tmp_path / "no"
    )
    (tmp_path / "a.CSV").touch()
    assert (
        f"it has no file dataset.toml; 'klute-sim diagnose {tmp_path} --draft' writes one for a.CSV and the other "
        "recordings (docs/datasets.md)" in load_error(tmp_path)
    )
    write_dataset(tmp_path)
    assert "is a file; give the folder with dataset.toml" in load_error(tmp_path / "dataset.toml")
    (tmp_path / "dataset.toml").write_bytes(b"\xff\xfe")
    assert "not a UTF-8 text file" in load_error(tmp_path)
    (tmp_path / "dataset.toml").unlink()
    (tmp_path / "dataset.toml").mkdir()
    assert "cannot be read: Is a directory" in load_error(tmp_path)


def test_remarks_that_files_share_are_one_sentence(tmp_path: Path) -> None:
    write_dataset(tmp_path)
    for path in tmp_path.glob("*.csv"):
        path.write_text(f"a tester\n{path.read_text('utf-8')}", "utf-8")
    remarks = load_dataset(tmp_path).remarks
    shared = [remark for remark in remarks if "line 2 is read as the heading" in remark]
    assert len(shared) == 1
    assert f" and {len([*tmp_path.glob('*.csv')]) - 1} more: line 2" in shared[0]


def test_impossible_split_is_refused_before_files_are_read(tmp_path: Path) -> None:
    write_dataset(tmp_path, TEXT.replace('use = "fit"', 'use = "validation"'))
    (tmp_path / "a.csv").unlink()
    assert "no trial is left to fit" in load_error(tmp_path)


def damage(content: bytes, rng: random.Random) -> bytes:
    content_bytes = bytearray(content)
    for _ in range(rng.choice((1, 1, 3))):
        index = rng.randrange(len(content_bytes))
        byte = rng.choice((rng.randrange(256), *b',;"\n\r\t[]%0-eE\0'))
        removed = rng.choice((0, 1, 1, 9))
        content_bytes[index : index + removed] = bytes([byte]) * rng.choice((0, 1))
    return bytes(content_bytes)


@pytest.mark.parametrize("name", ["a.csv", "dataset.toml"])
def test_random_damage_is_refused_or_harmless(tmp_path: Path, name: str) -> None:
    write_dataset(tmp_path)
    content = (tmp_path / name).read_bytes()
    rng = random.Random(20)
    sentences = []
    for _ in range(100):
        (tmp_path / name).write_bytes(damage(content, rng))
        try:
            load_dataset(tmp_path)
        except InputError as error:
            sentences.append(str(error))
    assert 10 < len(sentences) < 90
    assert not any("\n" in sentence for sentence in sentences)


@pytest.mark.slow
def test_million_rows_are_read_exactly(tmp_path: Path) -> None:
    text = TEXT.split("[uncertain]")[0] + '[[trial]]\nfiles = ["a.csv"]\n'
    write_dataset(tmp_path, text)
    values = np.random.default_rng(1).random(10**6)
    columns = {"time [s]": np.arange(10**6) * 1e-3, "length [mm]": 340 + values, "pressure_command [bar]": values}
    write_trial(tmp_path / "a.csv", columns | {"force [N]": values, "note [1]": values})
    dataset = load_dataset(tmp_path)
    assert np.array_equal(dataset.trials[0].measured["force"].value, values)
