"""Formulas of data-driven terms with fitted coefficients."""

from collections.abc import Mapping

from klute_sim import units
from klute_sim.effects.effect import Effect
from klute_sim.effects.families.discrepancy_terms import (
    UNKNOWN_ANKLE_MOMENT,
    UNKNOWN_FORCE,
    UNKNOWN_PRESSURE,
    UNKNOWN_TENDON_FORCE,
)
from klute_sim.effects.families.joint_terms import UNKNOWN_GUIDE_FORCE, UNKNOWN_JOINT_MOMENT

_BASIS_FUNCTIONS = {
    UNKNOWN_FORCE.name: ("p", "p^2", "b", "b e", "e", "e^2", "p e", "p e^2", "d", "p d", "e d", "s", "p s", "s |s|"),
    UNKNOWN_TENDON_FORCE.name: ("x", "x^2", "t"),
    UNKNOWN_PRESSURE.name: ("", "c", "c^2", "", "", "c", "f", ""),
    UNKNOWN_ANKLE_MOMENT.name: ("", "a", "a^2", "l", "l^2", "l a", "g", "l g", "p", "p a", "r", "w"),
    UNKNOWN_JOINT_MOMENT.name: ("", "q", "q^2", "q^3", "w", "w |w|", "sign(w)", "y", "z", ""),
    UNKNOWN_GUIDE_FORCE.name: ("", "q", "q^2", "q^3", "w", "w |w|", "sign(w)", "y", "z"),
}
"""Function of each parameter, by effect; '' for a constant term."""
_SUM_LABELS = {
    "dead_band_bar": "dead band =",
    "delay_s": "dead time =",
    "acceleration_kg_cm2": "inertia +=",
    UNKNOWN_ANKLE_MOMENT.name: "M +=",
    UNKNOWN_JOINT_MOMENT.name: "M -=",
    UNKNOWN_GUIDE_FORCE.name: "F -=",
    "N": "F +=",
    "bar": "target = command",
    "s": "dP/dt = (target - P)/tau, tau =",
}
"""Left side of the sum to which a parameter belongs, by parameter key, else by effect, else by unit."""
_SYMBOL_MEANINGS = {
    "p": "P/(5 bar)",
    "b": "P/(P + 0.5 bar)",
    "e": "(1 - L/L0)/0.25",
    "d": "v/sqrt(v^2 + (0.05 mm/s)^2)",
    "s": "v/sqrt(v^2 + (100 mm/s)^2)",
    "x": "stretch/(10 mm)",
    "t": "stretch/(stretch + 1 mm)",
    "c": "command/(5 bar)",
    "f": "1 while P falls",
    "a": "dorsiflexion/(15 deg)",
    "l": "dorsiflexing moment of the ground reaction/(100 N·m)",
    "g": "ground reaction along the pylon/(1 kN)",
    "r": "1 while the ankle dorsiflexes, -1 while it plantarflexes",
    "w": "velocity of dorsiflexion",
}
_JOINT_SYMBOL_MEANINGS = {
    UNKNOWN_JOINT_MOMENT.name: {
        "q": "(angle - rest angle of the joint's spring)/rad",
        "w": "speed/(rad/s)",
        "y": "friction that yields over 1 deg",
        "z": "friction that yields over 4 deg",
    },
    UNKNOWN_GUIDE_FORCE.name: {
        "q": "(position - rest position of the joint's spring)/(100 mm)",
        "w": "speed/(m/s)",
        "y": "friction that yields over 1 mm",
        "z": "friction that yields over 4 mm",
    },
}
"""Meanings of the symbols of a joint's functions, by effect; :data:`_SYMBOL_MEANINGS` has those of the others."""


def format_equation(effect: Effect, values: Mapping[str, float]) -> str:
    """Return the equation of the data-driven ``effect`` in one line.

    ``values`` are its parameters by key, in the units of the keys.
    """
    sums: dict[str, str] = {}
    used = ""
    for parameter, function in zip(effect.forms[0].parameters, _BASIS_FUNCTIONS[effect.name], strict=True):
        value, unit = values.get(parameter.key, 0.0), units.split_unit(parameter.key)[1]
        if value != 0.0:
            label = next(_SUM_LABELS[key] for key in (parameter.key, effect.name, unit) if key in _SUM_LABELS)
            term = f" {'-' if value < 0.0 else '+'} {abs(value):.3g} {unit} {function}"
            sums[label] = sums.get(label, label) + term.rstrip()
            used += function
    lines = [line.replace("= + ", "= ") for line in sums.values()]
    meanings = _JOINT_SYMBOL_MEANINGS.get(effect.name, _SYMBOL_MEANINGS)
    return "; ".join([*lines, *(f"{symbol} = {meaning}" for symbol, meaning in meanings.items() if symbol in used)])
