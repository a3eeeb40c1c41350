"""Import of motion-capture data as a gait reference or as a dataset, and export of runs to OpenSim.

Order of dependence: ``formats`` (file formats), ``import_log`` and ``options``, ``parsing`` (columns, markers, units,
signs), ``kinematics`` (motion and loads of a leg), ``strides``, ``trial`` (legs of one trial), ``reference_import`` and
``reference_folder``, ``prosthesis_sensors`` and ``prosthesis_trials``, ``dataset_import``, ``export``.
"""
