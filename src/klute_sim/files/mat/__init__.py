"""Arrays of numbers in MAT-files, the format of MATLAB's ``save``.

In order of dependence: ``contents`` (names of vectors and of the parts of matrices), ``level5`` (versions 5 to 7),
``hdf5`` and ``hdf5_process`` (version 7.3, optional extra) and ``opening``.
"""
