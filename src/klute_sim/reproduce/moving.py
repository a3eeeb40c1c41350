"""Chapter 3's actuators in motion, on the bench: Figs. 3.7 to 3.9."""

from collections.abc import Callable

import numpy as np

from klute_sim.dataset.override import overridden
from klute_sim.device.files import Device, load
from klute_sim.laws import hill
from klute_sim.laws import hill_tables as tables
from klute_sim.recording.recording import Recording
from klute_sim.reproduce import printed
from klute_sim.reproduce.implied import UNCHANGED
from klute_sim.reproduce.item import Found
from klute_sim.reproduce.picture import Array, Chapter, Line, Picture, Surface
from klute_sim.rigs.bench import protocols
from klute_sim.rigs.bench.run import Result, run

RATIO, PRESSURE = 0.96, 5.0
"""Muscle length over resting length, and gauge pressure [bar], of Fig. 3.9."""
SLOW, FAST = 1.0, 300.0
"""Velocities of the two printed forces [mm/s]."""
VMAX = 300.0
"""Of Fig. 3.9's abscissa [mm/s] (assumed: the fastest test)."""
SEEN = np.linspace(0.87, 0.99, 13)
"""Length ratios of the surfaces (assumed: the source's strokes are lost)."""


def compute(told: Callable[[float], None] = lambda share: None) -> Chapter:
    """Everything of chapter 3 that moves."""
    protocol = protocols.load("isokinetic").model_copy(update={"pressures_bar": [PRESSURE]})
    one = run(load("klute-3-4"), protocol, told=lambda share: told(0.5 * share))
    # The pair was lengthened as fast as it was shortened.
    both_ways = protocol.model_copy(update={"eccentric_mm_per_s": protocol.model_dump()["concentric_mm_per_s"]})
    two = run(pair(), both_ways, told=lambda share: told(0.5 + 0.5 * share))
    force = {t.setting["velocity_mm_per_s"]: t.readings["force_n"] for t in one.trials}
    found = {"fig-3.9.slow": Found(force[SLOW]), "fig-3.9.fast": Found(force[FAST])}
    found["fig-3.9.loss"] = Found(round(100.0 * (force[FAST] / force[SLOW] - 1.0), 2))
    spread = 100.0 * (max(force.values()) - min(force.values())) / force[SLOW]
    depends = float(np.ptp(next(iter(_over_length(one)[2]))))
    found["fig-3.7.velocity"] = Found(
        spread,
        spread < UNCHANGED and depends > 1.0,
        f"Over lengths of {SEEN[0]:g} to {SEEN[-1]:g} of rest: {depends:.0f} N.",
    )
    for row, result in (("fig-3.7", one), ("fig-3.8", two)):
        speeds = [trial.setting["velocity_mm_per_s"] for trial in result.trials]
        found[f"{row}.concentric"], found[f"{row}.eccentric"] = Found(max(speeds)), Found(-min(speeds))
    for speed in (500, 300, 200):
        found[f"fig-3.7.ripple-{speed}"] = Found()
    return Chapter(found, (_surface("3.7", one), _surface("3.8", two), _over_velocity(force)))


def pair() -> Device:
    """The two 3/4 in actuators of Fig. 3.8, bare."""
    return overridden(load("klute-3-4"), {"muscle.count": 2, "muscle.resting_length_mm": 250.0}, "Fig. 3.8")


def _over_length(result: Result) -> tuple[Array, Array, Array]:
    """Length ratios, velocities [mm/s] and force [N] in motion (velocities, lengths)."""
    rest = 1e3 * result.device.parameters.muscle.resting_length
    trials = sorted(result.trials, key=lambda trial: trial.setting["velocity_mm_per_s"])
    rows = [_force_at(trial.recording, rest * SEEN) for trial in trials]
    return SEEN, np.array([trial.setting["velocity_mm_per_s"] for trial in trials]), np.array(rows)


def _force_at(recording: Recording, lengths: Array) -> Array:
    """Force [N] as the muscle passes ``lengths`` [mm], on its way."""
    length, force = recording["muscle_length"], recording["force"]
    moving = np.abs(np.gradient(length)) > 0.5 * np.abs(np.gradient(length)).max()
    order = np.argsort(length[moving])
    return np.asarray(np.interp(lengths, length[moving][order], force[moving][order]))


def _surface(number: str, result: Result) -> Picture:
    lengths, velocities, force = _over_length(result)
    rest = 1e3 * result.device.parameters.muscle.resting_length
    return Picture(
        number,
        f"{'one 3/4 in actuator' if number == '3.7' else 'two 3/4 in actuators'}, resting length {rest:.0f} mm, 5 bar",
        "λ1 = L/L0",
        "velocity [mm/s]",
        surface=Surface(lengths, velocities, force),
        z_label="force [N]",
        assumed="the range of lengths",
    )


def _over_velocity(force: dict[float, float]) -> Picture:
    relative = np.linspace(-0.5, 1.0, 151)
    velocity = np.array(sorted(force))
    # Over its own isometric force, as the muscles are.
    own = np.array([force[v] for v in velocity]) / force[SLOW]
    edges = [hill.Hill(value, value) for value in hill.ENVELOPE.a]
    curves = [np.array([hill.force_velocity(law, 1.0, float(v)) for v in relative]) for law in edges]
    p = printed.numbers()
    measured = np.array([p["fig-3.9.slow"], p["fig-3.9.fast"]])
    generic = np.array([hill.force_velocity(tables.GENERIC_HILL, 1.0, float(v)) for v in relative])
    return Picture(
        "3.9",
        "3/4 in at 0.96 of resting length, 5 bar, and the envelope",
        "V/V0",
        "F/F0",
        (
            Line("envelope, a/F0 = 0.12", relative, curves[0], "dashed", 7),
            Line("envelope, a/F0 = 0.41", relative, curves[1], "dotted", 7),
            Line("generic muscle", relative, generic),
            Line("actuator, model", velocity / VMAX, own),
            Line("actuator, printed", np.array([SLOW, FAST]) / VMAX, measured / measured[0], "points"),
        ),
        (-0.5, 1.0),
        (0.0, 1.4),
        assumed="V0 = 300 mm/s",
    )
