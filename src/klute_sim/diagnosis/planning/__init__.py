"""Planning of measurements.

``measurement_plan``, ``mechanism_plan`` and ``measurement_readme`` make the commands, the dataset file and the
instructions for a tensile tester and for a joint. ``proposals``, ``joint_proposals`` and ``gait_proposals`` (with the
recordings of ``gait_protocols``) find the experiment that separates two models on each rig, ``next_experiment`` that of
a verdict, and ``direct_measurements`` the quantities that a tape or a known weight decides. ``identifiability`` shows
which effects look alike, and on which rig they differ; ``signatures`` shows the response to one effect.
"""
