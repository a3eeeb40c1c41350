"""Mutations of the laws, the effects and the energy ledger, and the tests that must notice them."""

from typing import NamedTuple


class Mutation(NamedTuple):
    """One wrong text in one file."""

    name: str
    folder: str
    """Key of :data:`TESTS_OF_FOLDER`."""
    file: str
    """Path within the package."""
    old: str
    """Text that occurs exactly once in the file."""
    new: str
    """Text in its place."""


TESTS_OF_FOLDER = {
    # Every file but those of geometry and foot, which no mutation touches.
    "laws": (
        "tests/laws/test_mckibben.py",
        "tests/laws/test_gas_volume.py",
        "tests/laws/test_below_atmosphere.py",
        "tests/laws/test_damper_tendon_air.py",
        "tests/laws/test_damper_chamber.py",
        "tests/laws/test_valve.py",
        "tests/laws/test_hill.py",
        "tests/laws/test_air_limits.py",
        "tests/laws/test_pneumatic_step.py",
    ),
    # The sizes come first because they find most mutations within seconds.
    "effects": (
        "tests/effects/test_tendon_laws.py",
        "tests/effects/test_viscous_laws.py",
        "tests/effects/test_effect_sizes.py",
        "tests/effects/test_damper_effects.py",
        "tests/effects/test_rubber_and_braid.py",
        "tests/effects/test_effect_laws.py",
    ),
    "device": (
        "tests/device/test_dynamics.py",
        "tests/device/test_pneumatics.py::test_work_at_the_default_step_is_right_within_three_per_mille",
    ),
}
"""Tests that run for the mutations of a folder: those of the same name and no others."""

_MCKIBBEN, _DAMPER, _TENDON = "laws/mckibben.py", "laws/damper.py", "laws/tendon.py"
_VALVE, _STEP, _SUPPLY_VALVE = "laws/valve.py", "laws/pneumatic_step.py", "laws/supply_valve.py"
_FAMILIES = "effects/families"
_BRAID, _DAMPER_EFFECTS = f"{_FAMILIES}/muscle/braid_hysteresis.py", f"{_FAMILIES}/damper.py"
_TENDON_EFFECTS, _AIR, _SUPPLY = f"{_FAMILIES}/tendon.py", f"{_FAMILIES}/air.py", f"{_FAMILIES}/supply.py"

MUTATIONS = (
    Mutation("bladder slope 1.9", "laws", _MCKIBBEN, "dw_dlambda = 2.0 * ratio", "dw_dlambda = 1.9 * ratio"),
    Mutation(
        "no friction fade",
        "laws",
        _MCKIBBEN,
        "fade = min(1.0, pressure / FRICTION_FADE_PRESSURE)",
        "fade = 1.0",
    ),
    Mutation(
        "gas volume + 30 cm3",
        "laws",
        _MCKIBBEN,
        "return braid_volume(muscle, length) - muscle.n_actuators * bladder_volume(muscle)",
        "return braid_volume(muscle, length) - muscle.n_actuators * bladder_volume(muscle) + 30e-6",
    ),
    Mutation(
        "gas volume without the rubber",
        "laws",
        _MCKIBBEN,
        "return braid_volume(muscle, length) - muscle.n_actuators * bladder_volume(muscle)",
        "return braid_volume(muscle, length)",
    ),
    Mutation(
        "gas force 2 L^2", "laws", _MCKIBBEN, "(3.0 * length * length - b * b)", "(2.0 * length * length - b * b)"
    ),
    Mutation(
        "gas pulls below room pressure",
        "laws",
        _MCKIBBEN,
        "return 0.0 if pressure < 0.0 else pressure",
        "return pressure",
    ),
    Mutation("second invariant", "laws", _MCKIBBEN, "i2 = a * q + 1.0 / a + 1.0 / q", "i2 = a * q + 1.0 / a + q"),
    Mutation("lock length", "laws", _MCKIBBEN, "math.sqrt(3.0)", "math.sqrt(2.9)"),
    Mutation(
        "orifice without -1",
        "laws",
        _DAMPER,
        "(discharge_coefficient * discharge_coefficient) - 1.0)",
        "(discharge_coefficient * discharge_coefficient))",
    ),
    Mutation(
        "directions of the damper exchanged",
        "laws",
        _DAMPER,
        "damper.eccentric_coefficient if velocity > 0.0 else -damper.concentric_coefficient",
        "damper.concentric_coefficient if velocity > 0.0 else -damper.eccentric_coefficient",
    ),
    Mutation("required orifice", "laws", _DAMPER, "8.0 * damping * cd2", "4.0 * damping * cd2"),
    Mutation(
        "tendon energy 0.6",
        "laws",
        _TENDON,
        "stored = 0.5 * tendon.stiffness_1",
        "stored = 0.6 * tendon.stiffness_1",
    ),
    Mutation(
        "second spring from slack length",
        "laws",
        _TENDON,
        "tendon.stiffness_2 * (stretch - tendon.engagement_stretch)",
        "tendon.stiffness_2 * stretch",
    ),
    Mutation(
        "ISO 6358 without (1 - b)",
        "laws",
        _VALVE,
        "(min(ratio, laminar_ratio) - critical_ratio) / (1.0 - critical_ratio)",
        "(min(ratio, laminar_ratio) - critical_ratio)",
    ),
    Mutation(
        "sonic flow with T/T0",
        "laws",
        _VALVE,
        "math.sqrt(REFERENCE_TEMPERATURE / temperature)",
        "math.sqrt(temperature / REFERENCE_TEMPERATURE)",
    ),
    Mutation("series of restrictions", "laws", _VALVE, "** (-1.0 / 3.0)", "** (-1.0 / 2.0)"),
    Mutation(
        "isothermal exhaust",
        "laws",
        _STEP,
        "pressure_per_outflow=supply.polytropic_exponent * inside / mass",
        "pressure_per_outflow=inside / mass",
    ),
    Mutation("enclosed air isothermal", "laws", _STEP, "math.pow(ratio, air.polytropic_exponent)", "ratio"),
    Mutation(
        "tank drains twice as fast",
        "laws",
        _STEP,
        "- drawn_mass * AIR_GAS",
        "- 2.0 * drawn_mass * AIR_GAS",
    ),
    Mutation(
        "no downward rate limit",
        "laws",
        "laws/pneumatics.py",
        "        return pressure - max_change\n",
        "        return target\n",
    ),
    Mutation(
        "check valve lets air back",
        "laws",
        _SUPPLY_VALVE,
        "inside, supply.temperature), 0.0",
        "inside, supply.temperature), -1.0",
    ),
    Mutation(
        "Hill curvature", "laws", "laws/hill.py", "return isometric * hill.b / hill.a", "return isometric * hill.b"
    ),
    Mutation(
        "compressed air of the damper",
        "laws",
        "laws/damper_chamber.py",
        "air = damper.air_volume * (ATMOSPHERIC_PRESSURE / charge) / area * (pressure / absolute_pressure)",
        "air = 2.0 * damper.air_volume * (ATMOSPHERIC_PRESSURE / charge) / area * (pressure / absolute_pressure)",
    ),
    Mutation(
        "Dahl reach x 2",
        "effects",
        _BRAID,
        "x - state.length, p.slope * pressure / p.stiffness, 0.0, dt)",
        "x - state.length, 2.0 * p.slope * pressure / p.stiffness, 0.0, dt)",
    ),
    Mutation("Maxwell slip x 2", "effects", _BRAID, "3.0 * fraction * p.slope", "6.0 * fraction * p.slope"),
    Mutation("Maxwell slip stiffness", "effects", _BRAID, "p.stiffness / 3.0 *", "p.stiffness / 1.5 *"),
    Mutation(
        "Coulomb braid x 0.5", "effects", _BRAID, "p.slope * pressure * smooth", "0.5 * p.slope * pressure * smooth"
    ),
    Mutation(
        "Bouc-Wen without gamma",
        "effects",
        "effects/smoothing.py",
        "(1.0 - gamma_ratio) / ((1.0 + gamma_ratio)",
        "1.0 / (1.0",
    ),
    Mutation(
        "tendon loss x 0.5",
        "effects",
        _TENDON_EFFECTS,
        "p.loss_fraction / (2.0 - p.loss_fraction)",
        "0.5 * p.loss_fraction / (2.0 - p.loss_fraction)",
    ),
    Mutation(
        "tendon loss as half width",
        "effects",
        _TENDON_EFFECTS,
        "p.loss_fraction / (2.0 - p.loss_fraction)",
        "p.loss_fraction",
    ),
    Mutation(
        "tendon stiffening x 2", "effects", _TENDON_EFFECTS, "p.stiffening * stretch", "2.0 * p.stiffening * stretch"
    ),
    Mutation("tendon slack x 2", "effects", _TENDON_EFFECTS, "stretch - p.slack", "stretch - 2.0 * p.slack"),
    Mutation(
        "tendon relaxation x 2",
        "effects",
        _TENDON_EFFECTS,
        "p.stiffness * (stretch - state.relaxed_stretch)",
        "2.0 * p.stiffness * (stretch - state.relaxed_stretch)",
    ),
    Mutation(
        "Cd for Cd^2",
        "effects",
        _DAMPER_EFFECTS,
        "p.discharge_coefficient * p.discharge_coefficient",
        "p.discharge_coefficient",
    ),
    Mutation(
        "trapped air x 2", "effects", _DAMPER_EFFECTS, "d.transition_speed, p.air", "d.transition_speed, 2 * p.air"
    ),
    Mutation(
        "laminar speed x 2",
        "effects",
        _DAMPER_EFFECTS,
        "*coefficients, p.transition",
        "*coefficients, 2 * p.transition",
    ),
    Mutation("rod as a square", "effects", _DAMPER_EFFECTS, "0.25 * math.pi * p.rod", "p.rod"),
    Mutation("charge x 2", "effects", _DAMPER_EFFECTS, "d.rod_area, p.inverse", "d.rod_area, 0.5 * p.inverse"),
    Mutation(
        "muscle damping x 2",
        "effects",
        f"{_FAMILIES}/muscle/muscle_damping.py",
        "p.coefficient * velocity",
        "2.0 * p.coefficient * velocity",
    ),
    Mutation(
        "bladder relaxation x 2",
        "effects",
        f"{_FAMILIES}/muscle/bladder_relaxation.py",
        "p.stiffness * (length",
        "2.0 * p.stiffness * (length",
    ),
    Mutation(
        "thick wall x 0.5",
        "effects",
        f"{_FAMILIES}/muscle/bladder_wall.py",
        "p.share * (_thick",
        "0.5 * p.share * (_thick",
    ),
    Mutation(
        "softening x 0.5",
        "effects",
        f"{_FAMILIES}/muscle/bladder_wall.py",
        "p.share * math.tanh",
        "0.5 * p.share * math.tanh",
    ),
    Mutation(
        "braid strain x 2",
        "effects",
        f"{_FAMILIES}/muscle/braid_extensibility.py",
        "p.strain * pressure * length /",
        "2.0 * p.strain * pressure * length /",
    ),
    Mutation(
        "threshold pressure x 2",
        "effects",
        f"{_FAMILIES}/muscle/threshold_pressure.py",
        "return max(0.0, pressure - p.pressure)",
        "return max(0.0, pressure - 2.0 * p.pressure)",
    ),
    Mutation("leak x 2", "effects", _AIR, "        p.conductance,\n", "        2.0 * p.conductance,\n"),
    Mutation("tank x 2", "effects", _AIR, "1.0 / p.inverse_volume,", "2.0 / p.inverse_volume,"),
    Mutation(
        "valve resistance x 2",
        "effects",
        _AIR,
        "1.0 / max(fill_resistance, MIN_RESISTANCE)",
        "0.5 / max(fill_resistance, MIN_RESISTANCE)",
    ),
    Mutation(
        "pressure lag x 2",
        "effects",
        _SUPPLY,
        "dt / (p.time_constant + dt)",
        "dt / (2.0 * p.time_constant + dt)",
    ),
    Mutation(
        "regulator gain squared", "effects", _SUPPLY, "return p.gain * command", "return p.gain * p.gain * command"
    ),
    Mutation(
        "ledger without the stop",
        "device",
        "device/energy/outputs.py",
        "        return max(imbalance, 0.0)",
        "        return 0.0",
    ),
    Mutation(
        "stop that pulls",
        "device",
        "device/energy/outputs.py",
        "        return min(imbalance, 0.0)",
        "        return imbalance",
    ),
    Mutation(
        "work of the gas from half the pressure",
        "device",
        "device/energy/ledger.py",
        "mean(series.contact_pressure) * rate",
        "0.5 * mean(series.contact_pressure) * rate",
    ),
    Mutation(
        "damper twice in the ledger",
        "device",
        "device/energy/ledger.py",
        "        + series.damper_force\n",
        "        + 2.0 * series.damper_force\n",
    ),
    Mutation(
        "flow at the start of the step",
        "device",
        "device/dynamics.py",
        "_predict_motion(parameters, state, unit_length, dt), command",
        "state, command",
    ),
)
"""All mutations: those of a referee's review first within each folder, then the size of every effect."""
