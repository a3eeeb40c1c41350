"""Bench protocols: tests at set values and identification excitations, one kind per module, in one registry.

Modules in order of dependence: ``protocol`` (base classes), one module per kind (``excitation`` holds the signals of
``identification``), and ``library`` (the registry and the reader of protocol files). The TOML files are the protocols
of the package.
"""
