"""Mineral oil at other temperatures: viscosity by Walther's equation, and density.

``log10(log10(nu + 0.7)) = a - b log10(T)``, with the kinematic viscosity nu [mm2/s] and the absolute temperature T [K]
(ASTM D341). Two points determine a and b: an oil of grade ISO VG 32 with 32 mm2/s at 40 degrees Celsius and 5.4 mm2/s
at 100 degrees Celsius (the usual 5.4 is assumed; the grade states the first).
"""

import math

from klute_sim.laws.pneumatics import ZERO_CELSIUS

REFERENCE_TEMPERATURE = 20.0
"""Temperature at which the numbers of a device file hold [degrees Celsius] (assumed: room temperature)."""
EXPANSION_COEFFICIENT = 6.5e-4
"""Loss of density per kelvin, relative [1/K] (assumed; petroleum products of 920-700 kg/m3 have 6e-4 to 8e-4)."""
VISCOSITY_OFFSET = 0.7
"""Offset of Walther's equation [mm2/s]."""
_POINTS = ((40.0, 32.0), (100.0, 5.4))
"""Temperatures [degrees Celsius] and viscosities [mm2/s] of an oil of grade ISO VG 32."""
_LOG_TEMPERATURES = tuple(math.log(temperature + ZERO_CELSIUS) for temperature, _ in _POINTS)
_LOG_LOG_VISCOSITIES = tuple(math.log(math.log(viscosity + VISCOSITY_OFFSET)) for _, viscosity in _POINTS)
SLOPE = (_LOG_LOG_VISCOSITIES[0] - _LOG_LOG_VISCOSITIES[1]) / (_LOG_TEMPERATURES[1] - _LOG_TEMPERATURES[0])
"""Slope b of Walther's equation [1]; natural logarithms have the same slope."""
INTERCEPT = _LOG_LOG_VISCOSITIES[0] + SLOPE * _LOG_TEMPERATURES[0]
"""Intercept of Walther's equation in natural logarithms [1]."""


def compute_viscosity(temperature: float) -> float:
    """Return the kinematic viscosity [mm2/s] at ``temperature`` [degrees Celsius]."""
    return math.exp(math.exp(INTERCEPT - SLOPE * math.log(temperature + ZERO_CELSIUS))) - VISCOSITY_OFFSET


def compute_density_ratio(temperature: float) -> float:
    """Return the density at ``temperature`` [degrees Celsius] over that at the reference temperature."""
    return 1.0 - EXPANSION_COEFFICIENT * (temperature - REFERENCE_TEMPERATURE)
