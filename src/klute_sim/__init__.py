"""klute-sim: a powered below-knee prosthesis with Klute's artificial muscle-tendon, in MuJoCo."""

__version__ = "0.1.0"
