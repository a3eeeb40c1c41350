"""Chapter 8: work loops, with pressure while shortening or while lengthening."""

from collections.abc import Callable

import numpy as np

from klute_sim.device.files import Device
from klute_sim.reproduce.item import Found
from klute_sim.reproduce.picture import Chapter, Line, Picture
from klute_sim.rigs.bench import protocols
from klute_sim.rigs.bench.run import Result, Trial, run

TABLES = {"concentric": ("table-8.1", "8.5", "8.6"), "eccentric": ("table-8.2", "8.7", "8.8")}
"""Activation -> row, number of the figure with loops, and of the one with work."""
HALF = {0.0: "concentric", 50.0: "eccentric"}
"""Where in the cycle the pressure comes on [%] -> activation."""
SHOWN_AT = 100.0
"""Velocity [mm/s] of the loops that are drawn at every pressure; of the others, the highest is."""


def compute(device: Device, told: Callable[[float], None] = lambda share: None) -> Chapter:
    """Everything of chapter 8, of ``device``."""
    result = run(device, protocols.load("workloop"), told=told)
    by: dict[str, dict[tuple[float, float], Trial]] = {name: {} for name in TABLES}
    for trial in result.trials:
        setting = trial.setting
        by[HALF[setting["phase_pct"]]][setting["pressure_bar"], setting["velocity_mm_per_s"]] = trial
    found: dict[str, Found] = {}
    work = {name: {place: trial.readings["work_j"] for place, trial in trials.items()} for name, trials in by.items()}
    for name, (row, _, _) in TABLES.items():
        _table(found, row, work[name])
    least = min(work["concentric"][place] - work["eccentric"][place] for place in work["concentric"])
    found["timing.timing"] = Found(
        least,
        least > 0.0,
        f"While shortening {min(work['concentric'].values()):+.1f} to {max(work['concentric'].values()):+.1f} J, while "
        f"lengthening {min(work['eccentric'].values()):+.1f} to {max(work['eccentric'].values()):+.1f} J.",
    )
    found["figs-8.1-8.4.square"] = _square(result)
    pictures = []
    for name, (_, loops, works) in TABLES.items():
        pictures += [_loops(loops, name, by[name]), _works(works, name, work[name])]
    return Chapter(found, tuple(pictures))


def _table(found: dict[str, Found], row: str, work: dict[tuple[float, float], float]) -> None:
    pressures, velocities = (sorted({place[k] for place in work}) for k in (0, 1))
    for (pressure, velocity), joules in work.items():
        found[f"{row}.p{pressure:g}-v{velocity:g}"] = Found(joules)
    size = np.abs([[work[p, v] for p in pressures] for v in velocities])
    rises = np.diff(size, axis=1) / np.diff(pressures)
    found[f"{row}.grows"] = Found(float(rises.min()), bool((rises > 0.0).all()))
    at_5 = size[:, -1]
    ratio = float(at_5.max() / at_5.min())
    told = ", ".join(f"{work[5.0, v]:+.1f} J at {v:g} mm/s" for v in velocities)
    found[f"{row}.velocity"] = Found(ratio, ratio > 1.05, f"{told}.")


def _square(result: Result) -> Found:
    """Share of the time that the crosshead is on its way from one speed to another."""
    between, whole = 0.0, 0.0
    for trial in result.trials:
        time, length = trial.recording["time"], trial.recording["length_command"]
        speed = np.abs(np.diff(length) / np.diff(time))
        set_speed = trial.setting["velocity_mm_per_s"]
        other = (np.abs(speed - set_speed) > 0.02 * set_speed) & (speed > 0.02 * set_speed)
        between += float(np.diff(time)[other].sum())
        whole += float(time[-1] - time[0])
    share = 100.0 * between / whole
    return Found(share, share < 5.0)


def _loops(number: str, name: str, trials: dict[tuple[float, float], Trial]) -> Picture:
    lines = []
    for (pressure, velocity), trial in sorted(trials.items()):
        if velocity == SHOWN_AT or pressure == max(trials)[0]:
            time, length, force = (trial.recording[c] for c in ("time", "length", "force"))
            last = time >= 0.5 * (time[0] + time[-1])
            usual = velocity == SHOWN_AT
            label = f"{pressure:g} bar" if usual else f"{pressure:g} bar, {velocity:g} mm/s"
            lines.append(Line(label, length[last], force[last], "line" if usual else "dotted"))
    return Picture(
        number,
        f"work loops, {name} activation, {SHOWN_AT:g} mm/s where nothing is said",
        "unit length [mm]",
        "force [N]",
        tuple(lines),
        assumed="stroke, dwell at the ends, damper and tendon",
    )


def _works(number: str, name: str, work: dict[tuple[float, float], float]) -> Picture:
    velocities = sorted({velocity for _, velocity in work})
    pressures = np.array(sorted({pressure for pressure, _ in work}))
    return Picture(
        number,
        f"net work per cycle, {name} activation",
        "pressure [bar]",
        "net work [J]",
        tuple(Line(f"{v:g} mm/s", pressures, np.array([work[p, v] for p in pressures])) for v in velocities),
        assumed="stroke, dwell at the ends, damper and tendon",
    )
