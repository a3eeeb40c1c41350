"""``python -m klute_sim`` is ``klute-sim``."""

from klute_sim.cli import main

main()
