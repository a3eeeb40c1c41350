"""Bench datasets that are right, though unusual: no check may refuse them."""

from collections.abc import Iterator

import numpy as np
from benchmarks.robustness.plausibility.recordings import Base, Variant
from benchmarks.robustness.plausibility.wrong_trials import BASES, map_values, write_as

PROTOCOLS = ("steps", "ramps", "sines", "release", "hold", "slack", "mixed")
DEVICES = ("klute-1-1-4-pair", "klute-1-1-4-pair-valve", "klute-3-4-pair", "klute-3-4", "klute-1-1-4", "klute-1-2")
EFFECTS: tuple[tuple[str, tuple[tuple[str, float], ...]], ...] = (
    ("threshold_pressure", (("pressure_bar", 0.8),)),
    ("braid_hysteresis", (("slope_n_per_bar", 30.0), ("stiffness_n_per_mm", 40.0))),
    ("muscle_damping", (("coefficient_n_s_per_m", 600.0),)),
    ("bladder_relaxation", (("stiffness_n_per_mm", 8.0), ("time_constant_s", 1.0))),
    ("supply_droop", (("inverse_volume_per_l", 8.0),)),
    ("choked_valve", (("resistance_s_bar_per_dm3", 12.0), ("critical_ratio", 0.5))),
    ("volume_coupling", (("recovery_s", 0.2), ("exponent", 1.2))),
    ("leak", (("conductance_dm3_per_s_bar", 0.1),)),
    ("regulator_error", (("gain", 0.7),)),
    ("pressure_lag", (("time_constant_s", 0.3),)),
    ("pressure_delay", (("delay_s", 0.15),)),
    ("trapped_air", (("air_volume_cm3", 2.0),)),
    ("seal_friction", (("force_n", 60.0),)),
    ("tendon_slack", (("slack_mm", 5.0),)),
)


def list_variants() -> Iterator[Variant]:
    """Yield all right variants."""
    for name in PROTOCOLS:
        device = DEVICES[PROTOCOLS.index(name) % len(DEVICES)]
        yield Variant(f"protocol {name} on {device}", "", base=Base(device, (name,)))
    for device in DEVICES:
        yield Variant(f"{device}: isometric, isobaric, rest", "", base=Base(device, ("isometric", "isobaric", "rest")))
    for effect, parameters in EFFECTS:
        base = Base("klute-3-4-pair", ("steps", "mixed"), effects=((effect, parameters),))
        yield Variant(f"large effect {effect}", "", base=base)
    yield from _list_muscles()
    yield from _list_sensors()
    yield from _list_sampling()


def _list_muscles() -> Iterator[Variant]:
    """Yield muscles and tendons that differ from the nominal device."""
    for change in (("muscle.c10_kpa", 250.0), ("muscle.c10_kpa", 40.0), ("tendon.stiffness_1_n_per_mm", 30.0)):
        base = Base("klute-3-4-pair", changes=(change, ("muscle.friction_offset_n", 0.0)))
        yield Variant(f"{change[0]} = {change[1]:g}", "", base=base)
    for factor in (0.5, 0.7, 1.5, 2.0):
        for label in ("pair", "valve"):
            change = map_values("force", lambda v, k=factor: k * v)
            yield Variant(f"muscle {factor:g} times as strong, {label}", "", change, BASES[label])


def _list_sensors() -> Iterator[Variant]:
    """Yield imperfect sensors."""
    pair = BASES["pair"]
    yield Variant("load cell's zero at -60 N", "", map_values("force", lambda v: v - 60.0), pair)
    yield Variant("load cell's zero at 150 N", "", map_values("force", lambda v: v + 150.0), pair)
    yield Variant("pressure sensor's zero at 0.3 bar", "", map_values("pressure", lambda v: v + 0.3), pair)
    yield Variant("pressure sensor's gain 1.2", "", map_values("pressure", lambda v: 1.2 * v), pair)
    yield Variant("load cell clips at 600 N", "", map_values("force", lambda v: np.minimum(v, 600.0)), pair)
    yield Variant("load cell clips at 0", "", map_values("force", lambda v: np.maximum(v, 0.0)), BASES["bare"])
    yield Variant("pressure sensor clips at 3 bar", "", map_values("pressure", lambda v: np.minimum(v, 3.0)), pair)
    yield Variant("coarse digits", "", map_values("pressure", lambda v: np.round(v, 1)), pair)
    yield Variant("noise 20 times as large", "", base=Base(noise=20.0))
    yield Variant("no noise", "", base=Base(noise=0.0))
    loose = map_values("pressure", lambda v: np.where(np.arange(len(v)) % 97 == 0, 1e3, v))
    yield Variant("loose contact", "", loose, pair)
    gaps = map_values("force", lambda v: np.where(np.arange(len(v)) % 200 < 50, np.nan, v))
    yield Variant("empty cells", "", gaps, pair)
    yield Variant("draw-wire's zero elsewhere", "", map_values("muscle_length", lambda v: v + 700.0), pair)
    yield Variant("draw-wire zeroed at rest", "", map_values("muscle_length", lambda v: v - v[0]), pair)
    yield Variant("dead pressure sensor", "", map_values("pressure", lambda v: 0.0 * v), pair)
    drift = map_values("force", lambda v: v + np.linspace(0.0, 80.0, len(v)))
    yield Variant("drifting load cell", "", drift, pair)
    lag = map_values("force", lambda v: np.convolve(v, np.ones(20) / 20.0, "same"))
    yield Variant("filtered load cell", "", lag, pair)


def _list_sampling() -> Iterator[Variant]:
    """Yield unusual time axes and units."""
    for interval in (0.0005, 0.02, 0.1, 0.25):
        base = Base("klute-3-4-pair", ("ramps", "hold"), interval)
        yield Variant(f"sampled every {interval:g} s", "", base=base)
    for program in ("slow", "creep", "burst", "low-pressure"):
        for device in ("klute-3-4-pair", "klute-1-1-4-pair-valve"):
            yield Variant(f"{program} test on {device}", "", base=Base(device, (program,)))
    yield Variant("clock starts at 1e5 s", "", map_values("time", lambda v: v + 1e5), BASES["pair"])
    for channel, unit in (("force", "lbf"), ("length", "in"), ("pressure", "psi"), ("time", "ms")):
        yield Variant(f"{channel} in {unit}", "", write_as(channel, unit, unit), BASES["pair"])
