"""Report of sweeps and baselines: figure of the metrics of many runs."""
