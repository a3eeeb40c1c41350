"""Reports: text, tables, figures and pages of results, one folder for each kind of result.

Everything here reads results and returns text, tables or figures; the modules of :mod:`klute_sim.api` write the files.
Shared modules come first: ``style`` (appearance of figures) and ``html`` (templates).
"""
