"""klute-sim: a powered below-knee prosthesis with Klute's artificial muscle-tendon, in MuJoCo."""

from klute_sim.registration import register_environments as _register

__version__ = "0.1.0"

_register()
