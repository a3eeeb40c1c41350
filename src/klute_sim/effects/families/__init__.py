"""Built-in effects, one module for each part of the experiment.

``muscle``, ``damper``, ``tendon``, ``supply`` and ``air`` belong to the device, ``body`` to ankle, foot and socket, and
``instrument`` to the sensors. ``discrepancy_terms`` holds data-driven terms without a physical name. The modules do not
depend on each other.
"""
