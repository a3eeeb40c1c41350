"""A bench rig with another physics than the program's: the adversary of the hidden-effect benchmark.

Nothing here imports the laws of the program or those of the rest of the benchmark, and their code was not read for it.
Formulas of the muscle, the damper and the tendon without departures are those of the dissertation; everything else,
from the shape of the muscle's ends to the integrator, was chosen independently.
"""
