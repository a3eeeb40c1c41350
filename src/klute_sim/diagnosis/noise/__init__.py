"""Noise of the measured channels and the misfit that it does not explain.

In order of dependence: ``autocorrelation``, ``repeats`` (noise from repeated trials), ``misfit`` (lack of fit common
to all repeats), ``heteroscedastic`` (noise that varies over a trial), ``quantization`` (displays with finite
resolution).
"""
