"""Hidden effects in walks: made by the contact model in shorter steps, diagnosed by replay, held against the truth.

    python benchmarks/hidden_effects/walks.py OUT                          # 40 with something hidden, 40 clean
    python benchmarks/hidden_effects/walks.py OUT --count 6 --clean 2      # fewer of them

What makes the data is another MuJoCo model than what explains them: the whole rig with its contacts, servos and the
heel's spring, in steps of half the length, with effects of the body put into the MJCF here and not by the package. The
device in it is the package's own law, its uncertain numbers drawn anew. Repeats are walks at slightly other speeds.
Datasets are made where they are missing, and results are kept as in ``run.py``; the truth lies beside a dataset.
"""

import argparse
import hashlib
import json
import os
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from rich.console import Console
from rich.progress import track
from run import code as code_of_bench
from run import kept, verdict_of
from score import score

import klute_sim
from klute_sim.control.pressure import tuned
from klute_sim.dataset.override import overridden
from klute_sim.dataset.write import write_trial
from klute_sim.device.files import load, read
from klute_sim.recording.recording import Recording
from klute_sim.rigs.gait.assembly import GaitOptions
from klute_sim.rigs.gait.rig import walk

DEVICE = "klute-1-1-4-pair"
STEP, STRIDES = 2.5e-4, 4
UNCERTAIN = {"muscle.friction_slope_n_per_bar": 0.1, "tendon.stiffness_1_n_per_mm": 0.1, "muscle.c10_kpa": 0.1}
"""Relative standard deviations; the truth is no further off than two of them."""
GROUPS = {"fit_1": 1.2, "fit_2": 1.0, "fit_3": 1.1, "select_1": 1.3, "show_1": 1.15}
"""Group -> speed [m/s]."""
PACE = 0.01
"""Relative standard deviation of a repeat's speed."""
PARTS = {
    "motion": (5e-3, {"shank_angle": 0.1, "ankle_x": 3e-4, "ankle_z": 3e-4, "ankle_angle": 0.1}),
    "load": (
        1e-3,
        {
            **{"grf_vertical": 2.0, "grf_forward": 1.0, "cop_x": 1e-3, "pressure_command": 0.0},
            **{"force": 5.0, "pressure": 0.01, "muscle_length": 5e-5},
        },
    ),
}
"""File -> interval [s], and its channels with their noise, in the units of a recording."""
SIZES = (0.5, 2.5)
"""Of what is hidden, over its typical size, drawn logarithmically."""

Edit = Callable[[mujoco.MjSpec, Mapping[str, float]], None]


def _joint(spec: mujoco.MjSpec) -> mujoco.MjsJoint:
    return spec.joint("prosthesis_ankle")


def _rub(spec: mujoco.MjSpec, own: Mapping[str, float]) -> None:
    joint = _joint(spec)
    joint.frictionloss = own["moment_n_m"]
    joint.solref_friction, joint.solimp_friction = (2.0 * STEP, 1.0), (0.99, 0.9995, 0.001, 0.5, 2.0)


def _damp(spec: mujoco.MjSpec, own: Mapping[str, float]) -> None:
    _joint(spec).damping = np.array([_joint(spec).damping[0] + own["damping_n_m_s"], 0.0, 0.0])


def _stiffen(spec: mujoco.MjSpec, own: Mapping[str, float]) -> None:
    _joint(spec).stiffness = np.array([_joint(spec).stiffness[0] * own["gain"], 0.0, 0.0])


def _shift(spec: mujoco.MjSpec, own: Mapping[str, float]) -> None:
    _joint(spec).springref = _joint(spec).springref - np.radians(own["shift_deg"])


def _bump(spec: mujoco.MjSpec, own: Mapping[str, float]) -> None:
    tendon = spec.add_tendon(name="rubber")
    tendon.wrap_joint("prosthesis_ankle", -1.0)
    tendon.stiffness = np.array([np.degrees(own["stiffness_n_m_per_deg"]), 0.0, 0.0])
    tendon.springlength = np.array([-1e3, np.radians(own["begin_deg"])])


def _lever(spec: mujoco.MjSpec, own: Mapping[str, float]) -> None:
    site = spec.site("prosthesis_achilles_insertion")
    site.pos = own["gain"] * np.asarray(site.pos)


def _load(spec: mujoco.MjSpec, own: Mapping[str, float]) -> None:
    for name in ("prosthesis_foot", "prosthesis_heel"):
        body = spec.body(name)
        body.mass, body.inertia = own["gain"] * body.mass, own["gain"] * np.asarray(body.inertia)


@dataclass(frozen=True)
class Hidden:
    """Something that can be hidden."""

    name: str
    form: str
    typical: Mapping[str, tuple[float, float]]
    """Parameter -> neutral value and typical one; a shape's are the same."""
    edit: Edit | None = None
    """Of the MJCF; None: it is in the device file, or on the channel."""
    channel: str | None = None


CATALOGUE = (
    Hidden("ankle_friction", "coulomb", {"moment_n_m": (0.0, 2.0)}, _rub),
    Hidden("ankle_friction", "viscous", {"damping_n_m_s": (0.0, 1.0)}, _damp),
    Hidden("return_spring_error", "stiffness", {"gain": (1.0, 1.15)}, _stiffen),
    Hidden("return_spring_error", "rest", {"shift_deg": (0.0, 1.0)}, _shift),
    Hidden("end_stop", "bumper", {"stiffness_n_m_per_deg": (0.0, 4.0), "begin_deg": (6.0, 6.0)}, _bump),
    Hidden("moment_arm_error", "insertion", {"gain": (1.0, 1.05)}, _lever),
    Hidden("inertia_error", "mass", {"gain": (1.0, 1.6)}, _load),
    Hidden("seal_friction", "coulomb", {"force_n": (0.0, 20.0)}),
    Hidden("pressure_lag", "first_order", {"time_constant_s": (0.0, 0.03)}),
    Hidden("braid_hysteresis", "coulomb", {"slope_n_per_bar": (0.0, 8.0)}),
    Hidden("tendon_slack", "dead_length", {"slack_mm": (0.0, 2.0)}),
    Hidden("sensor_offset", "linear", {"offset": (0.0, 1.0)}, channel="ankle_angle"),
    Hidden("sensor_gain", "linear", {"gain": (1.0, 1.05)}, channel="force"),
    Hidden("sensor_lag", "linear", {"time_constant_s": (0.0, 0.01)}, channel="ankle_angle"),
)


def drawn(hidden: Hidden, random: np.random.Generator) -> dict[str, Any]:
    """With numbers of its own."""
    scale = float(np.exp(random.uniform(*np.log(SIZES))))
    own = {key: neutral + scale * (usual - neutral) or usual for key, (neutral, usual) in hidden.typical.items()}
    return {"name": hidden.name, "form": hidden.form, "parameters": own, "channel": hidden.channel}


def plan(count: int, clean: int, seed: int) -> list[dict[str, Any]]:
    """What every dataset is made of."""
    found = []
    for kind, many in (("gait", count), ("gait_clean", clean)):
        for i in range(many):
            random = np.random.default_rng([seed, i, len(kind)])
            what = [drawn(CATALOGUE[i % len(CATALOGUE)], random)] if kind == "gait" else []
            found.append({"name": f"{kind}_{seed}_{i:03d}", "seed": [seed, i, len(kind), 1], "hidden": what})
    return found


def make(folder: Path, truth: Path, seed: list[int], hidden: list[dict[str, Any]]) -> None:
    """Write the dataset and its truth."""
    random = np.random.default_rng(seed)
    nominal = load(DEVICE)
    numbers = nominal.spec.numbers()
    base = {key: numbers[key] * (1.0 + share * np.clip(random.normal(), -2.0, 2.0)) for key, share in UNCERTAIN.items()}
    device = overridden(nominal, base, "the truth")
    edits, faults, text = [], [], device.content.decode()
    for one in hidden:
        known = next(h for h in CATALOGUE if (h.name, h.form, h.channel) == (one["name"], one["form"], one["channel"]))
        if known.edit is not None:
            edits.append(partial(known.edit, own=one["parameters"]))
        elif known.channel is None:
            own = "".join(f"{key} = {value!r}\n" for key, value in one["parameters"].items())
            text += f'\n[effects.{one["name"]}]\nform = "{one["form"]}"\n{own}'
        else:
            faults.append(one)
    device = read(text.encode(), "the truth")

    def edit(spec: mujoco.MjSpec) -> None:
        for each in edits:
            each(spec)

    folder.mkdir(parents=True, exist_ok=True)
    lines = ['format = "klute-sim-dataset/1"', 'rig = "gait"', f'device = "{DEVICE}"', "", "[uncertain]"]
    lines += [f'"{key}" = "{100.0 * share:g} %"' for key, share in UNCERTAIN.items()]
    for group, speed in GROUPS.items():
        profile, share = tuned(), float(random.uniform(0.5, 1.0))
        profile = replace(profile, pressure_bar=tuple(share * bar for bar in profile.pressure_bar))
        for repeat in "ab":
            own = speed * (1.0 + PACE * random.normal())
            walked = walk(device, profile, GaitOptions(speed=own, strides=STRIDES, step=STEP, edit=edit))
            files = [f"{group}_{repeat}_{part}.csv" for part in PARTS]
            for file, (interval, noises) in zip(files, PARTS.values(), strict=True):
                write_trial(folder / file, seen(walked, round(interval / STEP), noises, faults, random))
            lines += ["", "[[trial]]", f"files = {files!r}", f'group = "{group}"', f'use = "{group.split("_")[0]}"']
    (folder / "dataset.toml").write_text("\n".join(lines) + "\n", "utf-8")
    physics = [one for one in hidden if one["channel"] is None]
    truth.write_text(json.dumps({"effects": physics, "instruments": faults, "base": base}, indent=1), "utf-8")


def seen(
    walked: Recording,
    every: int,
    noises: Mapping[str, float],
    faults: list[dict[str, Any]],
    random: np.random.Generator,
) -> dict[str, np.ndarray]:
    """Columns of one file, as instruments show them."""
    columns = {"time [s]": walked["time"][::every]}
    for name, noise in noises.items():
        values = walked[name]
        for fault in (one for one in faults if one["channel"] == name):
            values = distorted(values, fault)
        values = values[::every]
        columns[walked.heading(name)] = values + noise * random.normal(0.0, 1.0, len(values))
    return columns


def distorted(values: np.ndarray, fault: Mapping[str, Any]) -> np.ndarray:
    """``values``, one per step, through an instrument with a ``fault``."""
    own = fault["parameters"]
    if fault["name"] == "sensor_lag":
        found, share = np.empty_like(values), STEP / (own["time_constant_s"] + STEP)
        late = values[0]
        for k, value in enumerate(values):
            late += share * (value - late)
            found[k] = late
        return found
    return own.get("gain", 1.0) * values + own.get("offset", 0.0)


def code() -> str:
    """Digest of what decides a verdict: that of the bench, and the replay."""
    folder = Path(klute_sim.__file__).parent / "rigs"
    files = [*sorted((folder / "replay").glob("*.py")), folder / "gait" / "build.py", folder / "gait" / "body.py"]
    return hashlib.sha256(b"".join([code_of_bench().encode(), *(f.read_bytes() for f in files)])).hexdigest()[:12]


def done(out: Path, threads: int, digest: str, spec: Mapping[str, Any]) -> dict[str, Any]:
    """What became of one dataset."""
    folder, truth = out / spec["name"], out / f"{spec['name']}.truth.json"
    if not truth.exists():
        make(folder, truth, spec["seed"], spec["hidden"])
    verdict = kept(out / "results" / f"{spec['name']}_{digest}.json", partial(verdict_of, folder, (), threads))
    sealed = json.loads(truth.read_text("utf-8"))
    errors = [
        abs(there["value"] - one["parameters"][key]) / abs(one["parameters"][key] - neutral)
        for one in (*sealed["effects"], *sealed["instruments"])
        for found in verdict["effects"]
        if (found["name"], found["form"], found["channel"]) == (one["name"], one["form"], one["channel"])
        for key, there in found["parameters"].items()
        if (neutral := _neutral(one, key)) != one["parameters"][key]
    ]
    outcome, size = score(sealed, verdict), max(errors, default=None)
    return {"name": spec["name"], "outcome": outcome, "error": size, "s": verdict["s"], "clean": not spec["hidden"]}


def _neutral(one: Mapping[str, Any], key: str) -> float:
    known = next(h for h in CATALOGUE if (h.name, h.form, h.channel) == (one["name"], one["form"], one["channel"]))
    return known.typical[key][0]


def main() -> None:
    """Make, diagnose, score, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder of datasets and results")
    parser.add_argument("--count", type=int, default=40, help="datasets with something hidden  [default: 40]")
    parser.add_argument("--clean", type=int, default=40, help="datasets with nothing hidden  [default: 40]")
    parser.add_argument("--seed", type=int, default=101, help="[default: 101]")
    parser.add_argument("--at-once", type=int, default=1, metavar="N", help="datasets at once  [default: 1]")
    chosen = parser.parse_args()
    (chosen.out / "results").mkdir(parents=True, exist_ok=True)
    specs, notes = plan(chosen.count, chosen.clean, chosen.seed), Console(stderr=True)
    one = partial(done, chosen.out, max(1, (os.cpu_count() or 1) // chosen.at_once), code())
    with ThreadPoolExecutor(chosen.at_once) as pool:
        rows = list(track(pool.map(one, specs), "diagnosing", len(specs), console=notes))
    for row in rows:
        error = "" if row["error"] is None else f"{100.0 * row['error']:.1f} % off"
        print(f"{row['name']:24} {row['outcome']:12} {row['s']:6.1f} s  {error}")
    hidden, clean = [r for r in rows if not r["clean"]], [r for r in rows if r["clean"]]
    errors = [r["error"] for r in hidden if r["error"] is not None]
    print(f"right: {sum(r['outcome'] == 'right' for r in hidden)} of {len(hidden)}")
    print(f"false alarms on clean walks: {sum(r['outcome'] == 'false-alarm' for r in clean)} of {len(clean)}")
    if errors:
        print(f"error of numbers: median {100.0 * np.median(errors):.1f} %, 90th percentile "
              f"{100.0 * np.percentile(errors, 90):.1f} %")  # fmt: skip
    print(f"time: median {np.median([r['s'] for r in rows]):.0f} s")


if __name__ == "__main__":
    main()
