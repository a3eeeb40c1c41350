"""Recording and layout of each kind of result: gait, bench, comparison, diagnosis, sweep, tuning, training."""
