"""Measured datasets: a folder of trial files with a ``dataset.toml`` that describes them.

In order of dependence: ``unit_conversion``, ``mechanism_channels`` and ``channels`` (channels of each rig),
``trial_files`` (one trial file), ``column_mapping`` (``[columns]``), ``trial``, ``checks`` (plausibility of trials),
``format`` (``dataset.toml``), ``split``, ``declarations`` (quantities with units in ``dataset.toml``), ``mechanism``
(model and devices of ``rig = "mjcf"``) and ``dataset``; ``write`` stands alone.
"""
