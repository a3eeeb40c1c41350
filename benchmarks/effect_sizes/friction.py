"""Sizes of the friction of braid, tendon and seals."""

from collections.abc import Mapping
from functools import partial

import numpy as np
from benchmarks.effect_sizes.size import (
    PRESET,
    EffectSize,
    compute_work,
    make_clamped_muscle,
    make_device,
    select_last_cycle,
    simulate,
    triangle,
)

from klute_sim.device.device import load_device
from klute_sim.device.dynamics import DeviceParameters
from klute_sim.device.equilibrium import compute_taut_state
from klute_sim.types import Array
from klute_sim.units import BAR

PRESSURE_BAR = 3.0
"""Gauge pressure of the measurements on a muscle [bar]."""
SHORT, LONG = 0.225, 0.241
"""Muscle lengths between which a loop is measured [m]."""
SPEED = 1e-3
"""Speed of a slow loop [m/s]: that of the dissertation's slowest test."""
N_MUSCLES = 2.0
"""Number of muscles of the preset."""


def measure_muscle_loop(
    effect: str, form: str, parameters: Mapping[str, float], pressure_bar: float = PRESSURE_BAR, speed: float = SPEED
) -> float:
    """Return the energy [J] that a cycle between :data:`SHORT` and :data:`LONG` loses."""
    device = make_device(effect, form, parameters, make_clamped_muscle())
    dt = min(1e-5, 0.01 * speed) / speed
    path = triangle(SHORT, LONG, speed, dt)
    pressure = pressure_bar * BAR
    trace = simulate(device, path, pressure, dt, compute_taut_state(device, SHORT, pressure))
    return compute_work(select_last_cycle(path), select_last_cycle(trace.tension))


def simulate_stretched_tendon(device: DeviceParameters, stretch: Array, dt: float) -> Array:
    """Return the tension [N] of a tendon under prescribed ``stretch`` [m].

    The unpressurised muscle rests against its stop, so the unit length prescribes the stretch.
    """
    taut = device.muscle.resting_length + device.tendon.slack_length
    trace = simulate(device, taut + stretch, 0.0, dt, compute_taut_state(device, taut, 0.0))
    assert np.ptp(trace.length) < 1e-9
    return trace.tension


def measure_tendon_loss(effect: str, form: str, parameters: Mapping[str, float]) -> float:
    """Return the fraction of the loading work that the tendon does not return, from slack to 12 mm of stretch."""
    dt, n = 0.01, 2400
    stretch = triangle(0.0, 12e-3, 12e-3 / (n * dt), dt)
    tension = simulate_stretched_tendon(make_device(effect, form, parameters), stretch, dt)
    stretch, tension = select_last_cycle(stretch), select_last_cycle(tension)
    loading = compute_work(stretch[: n + 1], tension[: n + 1])
    return (loading + compute_work(stretch[n:], tension[n:])) / loading


def measure_tendon_decay(effect: str, form: str, parameters: Mapping[str, float]) -> float:
    """Return the time constant [s] at which the tension of a tendon at constant stretch decays."""
    dt, n = 1e-3, 4000
    tension = simulate_stretched_tendon(make_device(effect, form, parameters), np.full(n, 5e-3), dt)
    excess = (tension - tension[-1])[:500]
    return -dt / float(np.polyfit(np.arange(500), np.log(excess), 1)[0])


def measure_tendon_step(effect: str, form: str, parameters: Mapping[str, float]) -> float:
    """Return the stiffness [N/mm] that a tendon has beyond its springs in the first instant of a stretch of 5 mm."""
    dt = 1e-5
    with_effect, without = (
        simulate_stretched_tendon(device, np.full(1, 5e-3), dt)[0]
        for device in (make_device(effect, form, parameters), load_device(PRESET).parameters)
    )
    return (with_effect - without) / 5.0


def measure_tendon_cycle(
    effect: str, form: str, parameters: Mapping[str, float], amplitude: float = 4e-3, frequency: float = 1.0
) -> float:
    """Return the work [J] that a sine of ``amplitude`` [m] about 6 mm of stretch loses in its third cycle."""
    n = 20_000
    phase = np.arange(3 * n + 1) / n
    stretch = 6e-3 - amplitude * np.cos(2.0 * np.pi * phase)
    tension = simulate_stretched_tendon(make_device(effect, form, parameters), stretch, 1.0 / (n * frequency))
    return compute_work(stretch[2 * n :], tension[2 * n :])


def state_braid_loop(slope_n_per_bar: float, corner: float = 0.0) -> float:
    """Return the energy [J] of a loop of friction ``n slope P``, whose stroke counts less by ``corner`` [m]."""
    friction = N_MUSCLES * slope_n_per_bar * PRESSURE_BAR
    return 2.0 * friction * (LONG - SHORT - corner)


def make_braid_rows() -> list[EffectSize]:
    """Return the loop areas of braid friction."""
    rows = []
    for slope in (4.0, 8.0, 16.0):
        reach = slope * PRESSURE_BAR / 40e3  # m: where the initial slope meets the full friction
        # After a reversal an elastoplastic element with reach r builds up its friction over 2 r and lacks half of it on
        # the way. Maxwell-slip elements have the reaches r/2, r, 3/2 r and carry 1/6, 1/3, 1/2.
        corners = {
            "coulomb": 0.0,
            "maxwell_slip": 2.0 * (1.0 / 12.0 + 1.0 / 3.0 + 3.0 / 4.0) * reach,
            "dahl": 2.0 * reach,
            "bouc_wen": 2.5 * reach,
        }
        for form, corner in corners.items():
            parameters = {"slope_n_per_bar": slope}
            if form != "coulomb":
                parameters["stiffness_n_per_mm"] = 40.0
            if form == "bouc_wen":
                parameters["gamma_over_beta"] = 1.0
            rows.append(
                EffectSize(
                    effect="braid_hysteresis",
                    form=form,
                    parameters=parameters,
                    quantity=f"loop area at {PRESSURE_BAR:g} bar, 16 mm, 1 mm/s [J]",
                    stated=state_braid_loop(slope, corner),
                    measure=partial(measure_muscle_loop, "braid_hysteresis", form, parameters),
                )
            )
    return rows


def make_tendon_rows() -> list[EffectSize]:
    """Return the losses and the relaxation of the tendon."""
    rows = [
        EffectSize(
            effect="tendon_hysteresis",
            form="slip",
            parameters={"loss_fraction": loss},
            quantity="lost fraction of the loading work, 0 to 12 mm [1]",
            stated=loss,
            measure=partial(measure_tendon_loss, "tendon_hysteresis", "slip", {"loss_fraction": loss}),
        )
        for loss in (0.03, 0.05, 0.1, 0.3)
    ]
    for stiffness, time_constant in ((5.0, 0.3), (10.0, 0.3), (10.0, 0.6)):
        maxwell = {"stiffness_n_per_mm": stiffness, "time_constant_s": time_constant}
        for quantity, stated, measure in (
            ("stiffness of a sudden stretch beyond the springs [N/mm]", stiffness, measure_tendon_step),
            ("time constant of the tension at constant stretch [s]", time_constant, measure_tendon_decay),
        ):
            rows.append(
                EffectSize(
                    effect="tendon_hysteresis",
                    form="maxwell",
                    parameters=maxwell,
                    quantity=quantity,
                    stated=stated,
                    measure=partial(measure, "tendon_hysteresis", "maxwell", maxwell),
                )
            )
    for damping, frequency in ((1.0, 1.0), (2.0, 1.0), (1.0, 4.0)):
        viscous = {"damping_n_s_per_mm": damping}
        rows.append(
            EffectSize(
                effect="tendon_hysteresis",
                form="viscous",
                parameters=viscous,
                quantity=f"loop area, sine of 2 to 10 mm, {frequency:g} Hz [J]",
                stated=np.pi * 1e3 * damping * (2.0 * np.pi * frequency) * 4e-3**2,
                measure=partial(measure_tendon_cycle, "tendon_hysteresis", "viscous", viscous, frequency=frequency),
            )
        )
    for friction, presliding, amplitude in ((10.0, 1.0, 4.0), (20.0, 1.0, 4.0), (10.0, 4.0, 4.0), (10.0, 2.0, 2.0)):
        slip = {"friction_n": friction, "presliding_mm": presliding}
        path = sum(i / 6.0 * max(0.0, amplitude - presliding * i / 3.0) for i in (1, 2, 3))
        rows.append(
            EffectSize(
                effect="tendon_hysteresis",
                form="maxwell_slip",
                parameters=slip,
                quantity=f"loop area, amplitude {amplitude:g} mm [J]",
                stated=4e-3 * friction * path,
                measure=partial(
                    measure_tendon_cycle, "tendon_hysteresis", "maxwell_slip", slip, amplitude=1e-3 * amplitude
                ),
            )
        )
    return rows


def make_seal_rows() -> list[EffectSize]:
    """Return the loop areas of seal friction."""
    stroke = LONG - SHORT
    rows = [
        EffectSize(
            effect="seal_friction",
            form="coulomb",
            parameters={"force_n": force},
            quantity="loop area, 16 mm, 1 mm/s [J]",
            stated=2.0 * force * stroke,
            measure=partial(measure_muscle_loop, "seal_friction", "coulomb", {"force_n": force}),
        )
        for force in (7.5, 15.0, 30.0)
    ]
    for speed in (1e-3, 15e-3, 100e-3):
        stribeck = {"force_n": 15.0, "stick_fraction": 0.6, "stribeck_speed_mm_per_s": 15.0}
        peak = 1.0 + 0.6 * float(np.exp(-((speed / 15e-3) ** 2)))
        rows.append(
            EffectSize(
                effect="seal_friction",
                form="stribeck",
                parameters=stribeck,
                quantity=f"loop area, 16 mm, {1e3 * speed:g} mm/s [J]",
                stated=2.0 * 15.0 * peak * stroke,
                measure=partial(measure_muscle_loop, "seal_friction", "stribeck", stribeck, speed=speed),
            )
        )
    for force, presliding in ((15.0, 0.3), (30.0, 0.3), (15.0, 1.0)):
        parameters = {"force_n": force, "presliding_mm": presliding}
        rows.append(
            EffectSize(
                effect="seal_friction",
                form="presliding",
                parameters=parameters,
                quantity="loop area, 16 mm, 1 mm/s [J]",
                stated=2.0 * force * (stroke - 2e-3 * presliding),
                measure=partial(measure_muscle_loop, "seal_friction", "presliding", parameters),
            )
        )
    for force, growth, pressure_bar in ((8.0, 0.3, 1.0), (8.0, 0.3, 5.0), (16.0, 0.3, 5.0), (8.0, 0.6, 5.0)):
        pressed = {"force_n": force, "growth_per_bar": growth, "stiffness_n_per_mm": 50.0}
        friction = force * (1.0 + growth * pressure_bar)
        rows.append(
            EffectSize(
                effect="seal_friction",
                form="pressure",
                parameters=pressed,
                quantity=f"loop area at {pressure_bar:g} bar, 16 mm, 1 mm/s [J]",
                stated=2.0 * friction * (stroke - 2.0 * friction / 50e3),
                measure=partial(measure_muscle_loop, "seal_friction", "pressure", pressed, pressure_bar),
            )
        )
    return rows


ROWS = (*make_braid_rows(), *make_tendon_rows(), *make_seal_rows())
"""All rows."""
