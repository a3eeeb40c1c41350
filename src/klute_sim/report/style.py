"""How figures look that are drawn from more than one file."""

from typing import Any

STYLE: Any = {
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "text.parse_math": False,  # names of trials come from the user: a dollar sign is a dollar sign
}
"""For ``matplotlib.rc_context``."""
