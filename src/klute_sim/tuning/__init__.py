"""Tune a pressure profile, and device parameters with it, on the gait rig by CMA-ES.

Order of dependence: ``design_variables`` (what is tuned), ``objective`` (the cost), ``search`` (the optimization),
``results`` (tables and files of a search).
"""
