"""Run one method on one dataset."""

import sys

from benchmarks.hidden_effects.baselines import main

sys.exit(main())
