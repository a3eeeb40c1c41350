"""Errors of the numbers in a device file: the commonest cause of a misfit that is not a missing effect.

A number that the dataset does not declare uncertain may still be wrong: a length read from the wrong end, a nominal
radius, a tube from another batch. Each such number is a candidate beside the effects. Its plausible error bounds it,
and says nothing more: two numbers that explain the data equally well are both reported, whichever is the likelier.
"""

from functools import cache
from typing import NamedTuple

from klute_sim.device.schema.document import DeviceSpec
from klute_sim.effects.effect import Effect, EffectForm, EffectParameter

NUMBER_ERROR_NAME = "number_error"
"""Name of the cause in verdicts, where an effect has its name in the catalogue."""
BOUND_SIGMAS = 6.0
"""Bounds of a number that is tested for an error, in plausible errors from the device's value (assumed). Numbers with
errors as large as that were not read wrongly, they are those of another device."""


class PlausibleError(NamedTuple):
    """Standard deviation of the error that a laboratory may make; both parts add."""

    absolute: float = 0.0
    """Part that does not depend on the value, in the unit of the key."""
    relative: float = 0.0
    """Part in proportion to the value."""
    source: str = "assumed"
    """Source of both parts."""


_CALIPER = PlausibleError(absolute=0.1, source="assumed: calipers on rubber or braid")
_MATERIAL = PlausibleError(relative=0.1, source="assumed: batches of one material")
DEFAULT_PLAUSIBLE_ERROR = PlausibleError(relative=0.05, source="assumed: data sheets")
PLAUSIBLE_ERRORS = {
    "muscle.resting_length_mm": PlausibleError(1.0, 0.005, "assumed: tape between crimped ends"),
    "muscle.braid_length_ratio": PlausibleError(relative=0.005, source="assumed: counted threads"),
    "muscle.turns_per_m": PlausibleError(relative=0.02, source="assumed: counted threads"),
    "muscle.bladder_radius_mm": _CALIPER,
    "muscle.bladder_thickness_mm": _CALIPER,
    "muscle.c10_kpa": _MATERIAL,
    "muscle.c01_kpa": _MATERIAL,
    "muscle.friction_slope_n_per_bar": _MATERIAL,
    "muscle.friction_offset_n": _MATERIAL,
    "damper.bore_mm": PlausibleError(relative=0.005, source="assumed: machined"),
    "damper.orifice_concentric_mm": PlausibleError(relative=0.02, source="assumed: drilled"),
    "damper.orifice_eccentric_mm": PlausibleError(relative=0.02, source="assumed: drilled"),
    "damper.oil_density_kg_m3": PlausibleError(relative=0.02, source="assumed: data sheet and temperature"),
    "tendon.slack_length_mm": PlausibleError(2.0, 0.0, "assumed: assembly, knots and crosshead zero"),
    "tendon.engagement_mm": PlausibleError(0.5, 0.0, "assumed: assembly"),
    "supply.rate_bar_per_s": PlausibleError(relative=0.2, source="assumed: depends on tubes and fittings"),
    "supply.gas_temperature_c": PlausibleError(3.0, 0.0, "assumed: a room over a day"),
    "supply.dead_volume_cm3": PlausibleError(relative=0.2, source="assumed: tubes and fittings"),
}
"""``section.key`` -> plausible error; :data:`DEFAULT_PLAUSIBLE_ERROR` for other keys."""


def list_error_candidates(spec: DeviceSpec, uncertain_keys: frozenset[str]) -> dict[str, float]:
    """Return ``section.key`` -> plausible error [unit of the key] of each number that may be wrong.

    ``uncertain_keys`` are fitted anyway. Counts cannot be a little wrong, zeros mean that a part is absent, the numbers
    of the foot have effects of their own, and those of a cylinder are its stops.
    """
    return {
        key: compute_plausible_error(key, value)
        for key, value in spec.collect_values().items()
        if key not in uncertain_keys
        and isinstance(value, float)
        and value != 0.0
        and not key.startswith(("foot.", "effects.", "cylinder."))
    }


def compute_plausible_error(key: str, value: float) -> float:
    """Return the plausible error of number ``key`` with ``value``, both in the unit of the key."""
    error = PLAUSIBLE_ERRORS.get(key, DEFAULT_PLAUSIBLE_ERROR)
    return error.absolute + error.relative * abs(value)


@cache
def make_number_effect(key: str) -> Effect:
    """Return the error of number ``key`` in the shape of an effect, whose one parameter is the number itself."""
    parameter = EffectParameter(
        key=key,
        neutral=0.0,
        lower=-BOUND_SIGMAS,
        upper=BOUND_SIGMAS,
        typical=1.0,
        source=PLAUSIBLE_ERRORS.get(key, DEFAULT_PLAUSIBLE_ERROR).source,
    )
    form = EffectForm(name="value", equation=f"{key} differs from the device file", parameters=(parameter,))
    return Effect(
        name=NUMBER_ERROR_NAME,
        description="A number of the device file is wrong.",
        kind="number",
        forms=(form,),
    )
