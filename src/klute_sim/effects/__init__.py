"""Effects: physics that the dissertation's model omits, each with a name and off unless a device activates it.

Order of dependence: ``effect`` (what an effect is), ``smoothing`` (shared numerical elements), ``families`` (the
built-in effects), ``chain`` (all laws of one hook as one function), ``validation`` (checks of an effect),
``catalogue`` (all effects of this process).
"""
