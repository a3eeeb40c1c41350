"""Built-in effects, one module for each part of the experiment.

``muscle``, ``damper``, ``tendon``, ``supply`` and ``air`` belong to the device, ``body`` to ankle, foot and socket, and
``instrument`` to the sensors. ``discrepancy_terms`` and ``joint_terms`` hold data-driven terms without a physical name,
whose formulas are in ``discrepancy_formulas``. The modules of physical effects do not depend on each other.
"""
