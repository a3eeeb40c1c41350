"""Sinusoids in recorded signals, by least squares."""

from typing import NamedTuple

import numpy as np

from klute_sim.types import Array


class Sinusoid(NamedTuple):
    """Sinusoid fitted to a signal."""

    phasor: complex
    """Amplitude and phase relative to a sine that starts at time 0."""
    coherence: float
    """Fraction of the variance around the fitted line that the sinusoid explains."""


def fit_sinusoid(time: Array, samples: Array, frequency: float) -> Sinusoid:
    """Fit a line and a sinusoid of ``frequency`` [Hz] to ``samples`` by least squares."""
    angle = 2.0 * np.pi * frequency * time
    line = np.stack([np.ones(len(time)), time - time.mean()], axis=1)
    wave = np.stack([np.sin(angle), np.cos(angle)], axis=1)
    both = np.hstack([line, wave])
    numbers = np.linalg.lstsq(both, samples)[0]
    left = float(((samples - both @ numbers) ** 2).sum())
    around = float(((samples - line @ np.linalg.lstsq(line, samples)[0]) ** 2).sum())
    return Sinusoid(complex(numbers[2], numbers[3]), 1.0 - left / around if around > 0.0 else float("nan"))
