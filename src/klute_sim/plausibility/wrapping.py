"""Geoms that a tendon wraps around: ends of the tendon within them, and a radius in another unit.

MuJoCo lets a tendon wrap around a sphere or a cylinder only between two sites outside of it; otherwise the path is
straight, and nothing says so.
"""

from typing import NamedTuple

from klute_sim.plausibility.finding import Finding
from klute_sim.plausibility.model_numbers import GEOMETRY_NAME
from klute_sim.plausibility.units import round_digits

MIN_RADIUS = 2e-4
"""Smallest radius [m] around which a cable bends (assumed)."""
MAX_RADIUS_RATIO = 10.0
"""Largest ratio of the radius to the distance of a site that is not explained by millimetres (assumed)."""


class Wrap(NamedTuple):
    """A geom that a tendon wraps around, and a site next to it on the path."""

    tendon: str
    """Name of the tendon."""
    geom: str
    """Name of the geom."""
    radius: float
    """Radius of the geom [m]."""
    site: str
    """Name of the site."""
    distance: float
    """Largest distance of the site from the axis or the centre of the geom between the stops of the joints [m]."""


def check_wrap(wrap: Wrap, place: str) -> list[Finding]:
    """Return a finding if the tendon cannot wrap around the geom, or the geom is too thin for a cable."""
    radius, distance = (f"{round_digits(1000.0 * value):g} mm" for value in (wrap.radius, wrap.distance))
    number = f"model.geom.{wrap.geom}.size_1"
    if wrap.radius < MIN_RADIUS:
        statement = (
            f"tendon '{wrap.tendon}' wraps around geom '{wrap.geom}', whose radius is {radius}; allowed: "
            f"{1000.0 * MIN_RADIUS:g} mm and more (assumed); correct `size` of the geom in the model, which is in m, "
            f"or {number}"
        )
        return [Finding(GEOMETRY_NAME, place, statement)]
    if wrap.distance > wrap.radius:
        return []
    is_in_millimetres = wrap.radius > MAX_RADIUS_RATIO * wrap.distance > MAX_RADIUS_RATIO * wrap.radius / 1000.0
    cause = (
        f"is the radius in mm? Write {round_digits(wrap.radius / 1000.0):g} m"
        if is_in_millimetres
        else f"move the site out of the geom, by a hundredth of the radius or more, or correct {number}"
    )
    statement = (
        f"site '{wrap.site}' of tendon '{wrap.tendon}' is {distance} from the axis of geom '{wrap.geom}', whose radius "
        f"is {radius}: on the rim or inside of the geom, where MuJoCo never wraps the tendon around it; {cause}"
    )
    return [Finding(GEOMETRY_NAME, place, statement)]
