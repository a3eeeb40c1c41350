"""Seal friction that grows with pressure or speed, holds, and deforms before it slides."""

import numpy as np
import pytest
from benchmarks.effect_sizes.size import make_clamped_muscle, make_device, simulate

PRESSED = {"force_n": 8.0, "growth_per_bar": 0.3, "stiffness_n_per_mm": 50.0}


VISCOUS = {"force_n": 8.0, "viscous_speed_mm_per_s": 200.0}


def simulate_seal(path: np.ndarray, pressure: float, form: str = "pressure") -> np.ndarray:
    """Return the tension [N] that the seal adds to a muscle on a rigid tie, with time steps of 10 ms."""
    bare = make_clamped_muscle()
    devices = (make_device("seal_friction", form, VISCOUS if form == "viscous" else PRESSED, bare), bare)
    with_seal, without = (simulate(device, path, pressure, 0.01).tension for device in devices)
    return with_seal - without


@pytest.mark.parametrize("pressure_bar", [0.0, 1.0, 5.0])
def test_sliding_friction_grows_with_pressure_and_holds(pressure_bar: float) -> None:
    out = np.linspace(0.225, 0.235, 1000)
    path = np.concatenate([out, np.full(500, out[-1]), out[::-1], np.full(500, out[0])])
    seal = simulate_seal(path, 1e5 * pressure_bar)
    expected = 8.0 * (1.0 + 0.3 * pressure_bar)
    assert seal[999] == pytest.approx(expected, rel=1e-6)
    assert seal[1000:1500] == pytest.approx(seal[999])
    assert seal[2499] == pytest.approx(-expected, rel=1e-6)
    assert seal[2500:] == pytest.approx(seal[2499])


def test_seal_deforms_with_its_stiffness_after_a_reversal() -> None:
    """At a reversal from full sliding, Dahl's slope is twice the stiffness."""
    out, step = np.linspace(0.225, 0.235, 1001), 1e-5
    seal = simulate_seal(np.concatenate([out, [out[-1] - step]]), 3e5)
    assert (seal[-2] - seal[-1]) / step == pytest.approx(2.0 * 50e3, rel=0.02)


@pytest.mark.parametrize("speed", [0.01, 0.1, 0.4])
def test_viscous_friction_grows_with_speed_and_opposes_it(speed: float) -> None:
    step = 0.01 * speed
    out = 0.225 + step * np.arange(int(0.012 / step) + 2)
    seal = simulate_seal(np.concatenate([out, out[::-1]]), 3e5, "viscous")
    expected = 8.0 * (1.0 + speed / 0.2)
    assert seal[1 : len(out)] == pytest.approx(expected, rel=3e-5)
    assert seal[len(out) + 1 :] == pytest.approx(-expected, rel=3e-5)
