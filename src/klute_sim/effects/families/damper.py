"""Effects of the hydraulic damper: deviations of a real piston and a real orifice from the ideal ``c v|v|``."""

import math
from typing import Any

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter
from klute_sim.laws import oil
from klute_sim.laws.damper import DamperParameters, replace_damper_fields


def apply_discharge_loss(p: Any, state: Any, damper: DamperParameters) -> DamperParameters:
    """Return the damper with coefficients over Cd^2: (4.6) without its term -1, which is 5e-6 of (bore/orifice)^4."""
    d, loss = damper, p.discharge_coefficient * p.discharge_coefficient
    concentric, eccentric = d.concentric_coefficient / loss, d.eccentric_coefficient / loss
    return replace_damper_fields(
        d, concentric, eccentric, d.transition_speed, d.air_volume, d.rod_area, d.inverse_charge
    )


def add_laminar_flow(p: Any, state: Any, damper: DamperParameters) -> DamperParameters:
    """Return the damper with force ``c v sqrt(v^2 + vc^2)``: linear below the transition speed vc, quadratic above."""
    d, coefficients = damper, (damper.concentric_coefficient, damper.eccentric_coefficient)
    return replace_damper_fields(d, *coefficients, p.transition_speed, d.air_volume, d.rod_area, d.inverse_charge)


def trap_air(p: Any, state: Any, damper: DamperParameters) -> DamperParameters:
    """Return the damper with ``p.air_volume`` [m3] of air in each chamber (:mod:`klute_sim.laws.damper_chamber`)."""
    d, coefficients = damper, (damper.concentric_coefficient, damper.eccentric_coefficient)
    return replace_damper_fields(d, *coefficients, d.transition_speed, p.air_volume, d.rod_area, d.inverse_charge)


def mount_on_one_rod(p: Any, state: Any, damper: DamperParameters) -> DamperParameters:
    """Return the damper with a rod of diameter ``p.rod_diameter`` [m] on the side compressed while lengthening."""
    d, coefficients = damper, (damper.concentric_coefficient, damper.eccentric_coefficient)
    area = 0.25 * math.pi * p.rod_diameter * p.rod_diameter
    return replace_damper_fields(d, *coefficients, d.transition_speed, d.air_volume, area, d.inverse_charge)


def limit_suction(p: Any, state: Any, damper: DamperParameters) -> DamperParameters:
    """Return the damper with absolute charge pressure 1/``p.inverse_charge`` [Pa] on the side without the rod.

    :mod:`klute_sim.laws.damper_chamber` has the physics.
    """
    d, coefficients = damper, (damper.concentric_coefficient, damper.eccentric_coefficient)
    return replace_damper_fields(d, *coefficients, d.transition_speed, d.air_volume, d.rod_area, p.inverse_charge)


def change_oil_temperature(p: Any, state: Any, damper: DamperParameters) -> DamperParameters:
    """Return the damper with oil of ``p.temperature`` [degrees Celsius] (:mod:`klute_sim.laws.oil`).

    The orifice force is proportional to the density. Its laminar part is proportional to the viscosity, because the
    transition speed belongs to a Reynolds number: ``vc^2 + vr^2 ((nu/nu0)^2 - 1)``, with ``p.transition_speed`` = vr at
    the reference temperature. It is not below 0: a damper without laminar part at the reference temperature has none
    when it is warmer.
    """
    if p.temperature == oil.REFERENCE_TEMPERATURE:
        return damper
    d, density = damper, oil.compute_density_ratio(p.temperature)
    viscosity = oil.compute_viscosity(p.temperature) / oil.compute_viscosity(oil.REFERENCE_TEMPERATURE)
    change = p.transition_speed * p.transition_speed * (viscosity * viscosity - 1.0)
    transition_speed = math.sqrt(max(0.0, d.transition_speed * d.transition_speed + change))
    coefficients = density * d.concentric_coefficient, density * d.eccentric_coefficient
    return replace_damper_fields(d, *coefficients, transition_speed, d.air_volume, d.rod_area, d.inverse_charge)


DISCHARGE_LOSS = Effect(
    name="discharge_loss",
    description="The jet behind a sharp-edged orifice contracts: the damper is stronger than its design.",
    kind="device",
    forms=(
        EffectForm(
            name="constant",
            equation="orifice force / C_d^2",
            parameters=(
                EffectParameter(
                    key="discharge_coefficient",
                    neutral=1.0,
                    lower=0.4,
                    upper=1.0,
                    typical=0.7,
                    source="dissertation chapter 4: as low as 0.61 in reality, 1 in the design",
                ),
            ),
            laws={"damper": apply_discharge_loss},
        ),
    ),
)

LAMINAR_ORIFICE = Effect(
    name="laminar_orifice",
    description="At low speed the oil flow is laminar: the damper is linear and stronger than the quadratic law.",
    kind="device",
    forms=(
        EffectForm(
            name="smooth",
            equation="c v sqrt(v^2 + v_c^2)",
            parameters=(
                EffectParameter(
                    key="transition_speed_mm_per_s",
                    neutral=0.0,
                    lower=0.0,
                    upper=500.0,
                    typical=40.0,
                    source="assumed: an orifice of 1 mm passes its critical Reynolds number at tens of mm/s of piston",
                ),
            ),
            laws={"damper": add_laminar_flow},
        ),
    ),
)

TRAPPED_AIR = Effect(
    name="trapped_air",
    description="Air in the damper's oil is a spring in series with the orifice: the damper yields after a reversal.",
    kind="device",
    forms=(
        EffectForm(
            name="isothermal",
            equation="x = e + z, F = p A = D(dz/dt), A e = V_a p/(p_a + p) + A h p/B",
            parameters=(
                EffectParameter(
                    key="air_volume_cm3",
                    neutral=0.0,
                    lower=0.0,
                    upper=10.0,
                    typical=1.0,
                    source="assumed: at atmospheric pressure, a bubble of one cubic centimetre in each chamber",
                ),
            ),
            laws={"damper": trap_air},
        ),
    ),
)

ROD_SIDE_AREA = Effect(
    name="rod_side_area",
    description="The piston has a rod on one side only: less area, less flow and less force while lengthening.",
    kind="device",
    forms=(
        EffectForm(
            name="single_rod",
            equation="lengthening: r D(r v), r = 1 - (d/D)^2",
            parameters=(
                EffectParameter(
                    key="rod_diameter_mm",
                    neutral=0.0,
                    lower=0.0,
                    upper=18.0,
                    typical=8.0,
                    source="assumed: a cylinder of 20 mm bore with a rod of 8 mm; the design ignores the rod",
                ),
            ),
            laws={"damper": mount_on_one_rod},
        ),
    ),
)

CAVITATION = Effect(
    name="cavitation",
    description=(
        "Fast shortening draws a void into the damper's oil, which limits its force. Lengthening closes the void, with "
        "the piston and the flow through the orifice, before the damper resists: a dead stroke."
    ),
    kind="device",
    forms=(
        EffectForm(
            name="charge",
            equation="shortening: F >= -A p0; void' = |v| - w, w = D^-1(A p0)",
            parameters=(
                EffectParameter(
                    key="inverse_charge_per_bar",
                    neutral=0.0,
                    lower=0.0,
                    upper=1.0,
                    typical=0.3,
                    source="assumed: 1 over the absolute charge of 3.3 bar; shock absorbers have 20-30 bar "
                    "(kfz-tech.de), an open reservoir 1 bar",
                ),
            ),
            laws={"damper": limit_suction},
        ),
    ),
)

OIL_TEMPERATURE = Effect(
    name="oil_temperature",
    description="Cold oil is thicker and denser: the damper is stronger, most of all at low speed.",
    kind="device",
    forms=(
        EffectForm(
            name="walther",
            equation="c rho/rho0, v_c^2 + v_r^2 ((nu/nu0)^2 - 1), log log(nu + 0.7) = a - b log T",
            parameters=(
                EffectParameter(
                    key="temperature_c",
                    neutral=20.0,
                    lower=-10.0,
                    upper=80.0,
                    typical=5.0,
                    source="assumed: a cold room; the numbers of a device file hold at 20 degrees Celsius",
                ),
                EffectParameter(
                    key="transition_speed_mm_per_s",
                    neutral=None,
                    lower=1.0,
                    upper=500.0,
                    typical=40.0,
                    source="assumed: that of laminar_orifice, at 20 degrees Celsius",
                ),
            ),
            laws={"damper": change_oil_temperature},
        ),
    ),
)
