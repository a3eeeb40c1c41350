"""Controllers: the pressure that is commanded, and when.

``pressure`` holds the controllers that follow the gait phase; ``feedback`` defines those that use the sensors of a
prosthesis: ``state_machine`` and ``learned`` (a trained ``policy``). ``parse`` creates a controller from a string.
"""
