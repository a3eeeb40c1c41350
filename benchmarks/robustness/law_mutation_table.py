"""Mutations of the laws, the effects and the energy ledger, and the tests that must notice them."""

from typing import NamedTuple

TESTS_OF_FOLDER = {
    # Every file but those of geometry and foot, which no mutation touches.
    "laws": (
        "tests/laws/test_mckibben.py",
        "tests/laws/test_oil.py",
        "tests/laws/test_gas_volume.py",
        "tests/laws/test_below_atmosphere.py",
        "tests/laws/test_damper_tendon_air.py",
        "tests/laws/test_damper_chamber.py",
        "tests/laws/test_valve.py",
        "tests/laws/test_hill.py",
        "tests/laws/test_air_limits.py",
        "tests/laws/test_pneumatic_step.py",
        "tests/laws/test_regulator_upstream.py",
    ),
    # The sizes come first because they find most mutations within seconds.
    "effects": (
        "tests/effects/test_tendon_laws.py",
        "tests/effects/test_viscous_laws.py",
        "tests/effects/test_damper_effects.py",
        "tests/effects/test_end_taper.py",
        "tests/effects/test_seal_friction.py",
        "tests/effects/test_threshold_pressure.py",
        "tests/effects/test_passive_tension.py",
        "tests/effects/test_hose.py",
        "tests/effects/test_effect_sizes.py",
        "tests/effects/test_rubber_and_braid.py",
        "tests/effects/test_effect_laws.py",
    ),
    "device": (
        "tests/device/test_dynamics.py",
        "tests/device/test_pneumatics.py::test_work_at_the_default_step_is_right_within_three_per_mille",
        "tests/effects/test_downstream_restriction.py::test_motion_does_not_move_the_pressure_of_a_lagging_regulator",
    ),
}
"""Tests that run for the mutations of a folder: those of the same name and no others."""


class Mutation(NamedTuple):
    """One wrong text in one file."""

    file: str
    """Path within the package."""
    old: str
    """Text that occurs exactly once in the file."""
    new: str
    """Text in its place."""
    description: str = ""
    """What is wrong; '' for a wrong factor."""

    @property
    def folder(self) -> str:
        """Key of :data:`TESTS_OF_FOLDER`."""
        return self.file.split("/")[0]

    @property
    def name(self) -> str:
        """Name in the results: the file, and what is wrong in it."""
        return f"{self.file.removesuffix('.py')}: {self.description or ' '.join(self.new.split())}"


_MUSCLE_EFFECTS = "effects/families/muscle"

WRONG_SIZES = {
    "laws/mckibben.py": (("muscle.n_actuators * bladder_volume(muscle)\n", 0.5),),
    "laws/damper_chamber.py": (
        ("damper.air_volume * (ATMOSPHERIC_PRESSURE / charge)", 2.0),
        ("area * _get_charge(damper)", 2.0),
        ("max_w * dt\n", 0.5),
        ("OIL_COLUMN_LENGTH / OIL_BULK_MODULUS * pressure", 2.0),
    ),
    "laws/damper.py": (
        ("8.0 * damping * cd2", 0.5),
        ("damper.rod_area / damper.piston_area", 2.0),
    ),
    "laws/oil.py": (
        ("EXPANSION_COEFFICIENT * (temperature", -1.0),
        ("(_LOG_LOG_VISCOSITIES[0] - _LOG_LOG_VISCOSITIES[1])", 0.5),
    ),
    "laws/valve.py": (("bore / scale", 2.0), ("HOSE_FRICTION_FACTOR * length", 2.0)),
    "laws/pneumatic_step.py": (("drawn_mass * AIR_GAS", 2.0),),
    "effects/smoothing.py": (("rate * size) /", 2.0), ("path / max_stretch), displacement", 2.0)),
    "effects/families/damper.py": (
        ("p.transition_speed, d.air_volume", 2.0),
        ("p.air_volume, d.rod_area", 2.0),
        ("p.rod_diameter * p.rod_diameter", 2.0),
        ("p.inverse_charge)", 0.5),
        ("p.transition_speed * p.transition_speed * (viscosity", 2.0),
        ("density * d.concentric_coefficient", 2.0),
        ("density * d.eccentric_coefficient", 0.5),
    ),
    "effects/families/seal.py": (
        ("p.force * smooth_sign(velocity)\n\n\ndef viscous", 2.0),
        ("velocity / p.viscous_speed", 2.0),
        ("p.stick_fraction * (", 2.0),
        ("state.speed / p.stribeck", 2.0),
        ("p.force * (state.seal_displacement", -1.0),
        ("p.stiffness * state.seal_displacement", -1.0),
        ("p.force * (1.0 + p.growth * pressure)", 2.0),
        ("p.growth * pressure)", 0.5),
    ),
    "effects/families/hose.py": (
        ("p.length, p.inner_diameter)", 2.0),
        ("p.inner_diameter * p.inner_diameter", 2.0),
    ),
    "effects/families/tendon.py": (
        ("p.loss_fraction / (2.0 - p.loss_fraction)", 0.5),
        ("p.stiffening * stretch", 2.0),
        ("tendon.stiffness_2 * p.transition", 0.5),
        ("p.slack", 2.0),
        ("p.stiffness * (stretch - state.relaxed_stretch)", 2.0),
        ("p.damping * state.stretch_rate", 2.0),
        ("p.friction / p.presliding", 2.0),
        ("p.friction / p.presliding", -1.0),
        ("FRICTION_FRACTIONS[0] * p.presliding", 2.0),
        ("FRICTION_FRACTIONS[2] * p.presliding", 0.5),
    ),
    "effects/families/air.py": (
        ("p.conductance,\n", 2.0),
        ("1.0 / p.inverse_volume,", 2.0),
        ("p.fill_resistance * p.exhaust_factor", 2.0),
        ("1.0 / max(fill_resistance, MIN_RESISTANCE)", 0.5),
        ("p.exponent, s.leak_conductance", 0.5),
        ("p.recovery, s.dead_volume", 2.0),
    ),
    "effects/families/supply.py": (
        ("p.time_constant + dt)", 2.0),
        ("p.gain * command", 2.0),
        ("2.0 * p.damping_ratio", 0.5),
        ("dt * state.rate", 0.5),
    ),
    f"{_MUSCLE_EFFECTS}/braid_hysteresis.py": (
        ("p.slope * pressure / p.stiffness, 0.0", 2.0),
        ("p.gamma_over_beta, dt", 0.5),
        ("3.0 * fraction * p.slope", 2.0),
        ("p.stiffness / 3.0 *", 2.0),
        ("p.stiffness * state.hysteretic_stretch", -1.0),
        ("p.slope * pressure * smooth", 0.5),
    ),
    f"{_MUSCLE_EFFECTS}/end_taper.py": (
        ("p.cone_ratio * length * growth", 0.5),
        ("p.cone_ratio * length * growth", -1.0),
        ("p.factor * (1.0 - length", 2.0),
        ("p.diameters * 2.0", 0.5),
        ("excess * (muscle.resting_length", -1.0),
    ),
    f"{_MUSCLE_EFFECTS}/passive_tension.py": (
        ("muscle.n_actuators * size", -1.0),
        ("2.0 * muscle.bladder_radius", 0.5),
        ("switch * offset", 0.5),
        ("p.rise * (1.0 - math", 0.5),
        ("p.rise * math", 2.0),
    ),
    f"{_MUSCLE_EFFECTS}/muscle_damping.py": (
        ("p.coefficient * velocity\n", 2.0),
        ("p.coefficient * velocity *", 2.0),
        ("(p.exponent - 1.0)", 0.5),
    ),
    f"{_MUSCLE_EFFECTS}/bladder_relaxation.py": (("p.stiffness * (length", 2.0),),
    f"{_MUSCLE_EFFECTS}/bladder_wall.py": (("p.share * (_thick", 0.5), ("p.share * math.tanh", 0.5)),
    f"{_MUSCLE_EFFECTS}/braid_extensibility.py": (("p.strain * pressure * length /", 2.0),),
    f"{_MUSCLE_EFFECTS}/threshold_pressure.py": (
        ("p.pressure)\n\n\ndef", 2.0),
        ("REFERENCE_DIAMETER / (2.0", 2.0),
    ),
    "device/energy/ledger.py": (
        ("mean(series.contact_pressure) * rate", 0.5),
        ("series.damper_force\n", 2.0),
    ),
    "device/dynamics.py": (("hose_length / pneumatics", 2.0),),
}
"""Products that occur once in a file, each with the factor that a mutation writes before it."""

WRONG_LAWS = (
    ("bladder slope 1.9", "laws/mckibben.py", "dw_dlambda = 2.0 * ratio", "dw_dlambda = 1.9 * ratio"),
    ("no friction fade", "laws/mckibben.py", "fade = min(1.0, pressure / FRICTION_FADE_PRESSURE)", "fade = 1.0"),
    ("gas volume with the rubber", "laws/mckibben.py", " - muscle.n_actuators * bladder_volume(muscle)\n", "\n"),
    ("gas force 2 L^2", "laws/mckibben.py", "(3.0 * length * length - b * b)", "(2.0 * length * length - b * b)"),
    ("gas that pulls", "laws/mckibben.py", "return 0.0 if pressure < 0.0 else pressure", "return pressure"),
    ("second invariant", "laws/mckibben.py", "i2 = a * q + 1.0 / a + 1.0 / q", "i2 = a * q + 1.0 / a + q"),
    ("lock length", "laws/mckibben.py", "braid_length / math.sqrt(3.0)", "braid_length / math.sqrt(2.9)"),
    ("orifice without -1", "laws/damper.py", "* discharge_coefficient) - 1.0)", "* discharge_coefficient))"),
    (
        "directions exchanged",
        "laws/damper.py",
        "damper.eccentric_coefficient if velocity > 0.0 else -damper.concentric_coefficient",
        "damper.concentric_coefficient if velocity > 0.0 else -damper.eccentric_coefficient",
    ),
    ("rod without less flow", "laws/damper.py", "w, vc2 = ratio * velocity", "w, vc2 = velocity"),
    ("rod without less area", "laws/damper.py", "return ratio * coefficient", "return coefficient"),
    ("void that vanishes", "laws/damper_chamber.py", "compression = state.void", "compression = 0.0"),
    ("spring energy 0.6 k x^2", "laws/tendon.py", "stored = 0.5 *", "stored = 0.6 *"),
    ("second spring from slack", "laws/tendon.py", "(stretch - tendon.engagement_stretch)", "stretch"),
    ("ISO 6358 without 1 - b", "laws/valve.py", " - critical_ratio) / (1.0 - critical_ratio)", " - critical_ratio)"),
    (
        "sonic flow with T/T0",
        "laws/valve.py",
        "math.sqrt(REFERENCE_TEMPERATURE / temperature)",
        "math.sqrt(temperature / REFERENCE_TEMPERATURE)",
    ),
    ("series of restrictions", "laws/valve.py", "** (-1.0 / 3.0)", "** (-1.0 / 2.0)"),
    ("isothermal exhaust", "laws/pneumatic_step.py", "=supply.polytropic_exponent * inside / mass", "=inside / mass"),
    ("isothermal motion", "laws/pneumatic_step.py", "math.pow(ratio, air.polytropic_exponent)", "ratio"),
    ("no downward rate limit", "laws/pneumatics.py", "  return pressure - max_change\n", "  return target\n"),
    ("speed of sound isothermal", "laws/pneumatics.py", "HEAT_CAPACITY_RATIO * AIR_GAS_CONSTANT", "AIR_GAS_CONSTANT"),
    (
        "leaky check valve",
        "laws/supply_valve.py",
        "inside, supply.temperature), 0.0",
        "inside, supply.temperature), -1.0",
    ),
    (
        "regulator of full supply",
        "laws/pneumatic_step.py",
        "source, opening_is_fixed = min(source, target), False",
        "source, opening_is_fixed = source, False",
    ),
    ("vent past the regulator", "laws/pneumatic_step.py", "target = sink = regulate", "target = regulate"),
    (
        "needle after a regulator of any rate",
        "laws/pneumatic_step.py",
        "regulate(supply, held, target, dt)",
        "min(max(target, 0.0), supply.max_pressure)",
    ),
    (
        "regulator that starts at the muscle",
        "laws/pneumatic_step.py",
        "regulate(supply, held,",
        "regulate(supply, pressure,",
    ),
    (
        "regulator that follows the motion",
        "device/dynamics.py",
        "get_gas_state(state), pressure - state.pressure)",
        "get_gas_state(state), 0.0)",
    ),
    ("Hill curvature", "laws/hill.py", "return isometric * hill.b / hill.a", "return isometric * hill.b"),
    (
        "Bouc-Wen without gamma",
        "effects/smoothing.py",
        "(1.0 - gamma_ratio) / ((1.0 + gamma_ratio)",
        "1.0 / (1.0",
    ),
    ("slider on one side", "effects/smoothing.py", ", position + max_distance)", ", position)"),
    ("loss as half width", "effects/families/tendon.py", "_fraction / (2.0 - p.loss_fraction)", "_fraction"),
    (
        "damper of a slack tendon",
        "effects/families/tendon.py",
        "taut_stretch = max(0.0, stretch)",
        "taut_stretch = stretch",
    ),
    ("friction of a slack tendon", "effects/families/tendon.py", "x = max(0.0, stretch)", "x = stretch"),
    (
        "Cd for Cd^2",
        "effects/families/damper.py",
        "p.discharge_coefficient * p.discharge_coefficient",
        "p.discharge_coefficient",
    ),
    ("viscosity not squared", "effects/families/damper.py", "viscosity * viscosity - 1.0", "viscosity - 1.0"),
    ("no limit at the stop", "device/energy/outputs.py", "return max(imbalance, 0.0)", "return 0.0"),
    ("stop that pulls", "device/energy/outputs.py", "return min(imbalance, 0.0)", "return imbalance"),
    (
        "flow at the start of the step",
        "device/dynamics.py",
        "air = step_pressure(parameters, before, command",
        "air = step_pressure(parameters, state, command",
    ),
)
"""Other mutations: description, file, text and the text in its place."""

MUTATIONS = (
    *(
        Mutation(file, product, f"{factor} * {product}")
        for file, products in WRONG_SIZES.items()
        for product, factor in products
    ),
    *(Mutation(file, old, new, description) for description, file, old, new in WRONG_LAWS),
)
"""All mutations."""
