"""Campaign: are files with wrong units, signs or columns named, and unusual but right ones accepted?

    python -m benchmarks.robustness.plausibility

``recordings`` simulates bench datasets, ``wrong_trials`` and ``right_trials`` change them, and ``device_files`` changes
device files. Each variant has the name of the finding that must be reported; '' means that none may be.
"""
