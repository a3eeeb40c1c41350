"""Noise of the measured channels and the misfit that it does not explain.

In order of dependence: ``autocorrelation``, ``repeats`` (noise from repeated trials), ``repeat_products``, ``misfit``
(lack of fit common to all repeats), ``trial_noise`` (one repeat noisier than the others), ``heteroscedastic`` (noise
that varies over a trial), ``p_value`` (misfit against that of clean datasets). How a channel was recorded:
``quantization`` (displays with finite resolution), ``spectrum``, ``window_noise`` and ``filtered_noise`` (filters).
"""
