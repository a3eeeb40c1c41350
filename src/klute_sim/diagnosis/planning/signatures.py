"""Response of the device to one effect at its typical size, in the identification protocol that shows it best."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from klute_sim.device.device import Device
from klute_sim.diagnosis.experiments.bench import BenchExperiment
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.planning.identifiability import NOISE_STD, prepare_experiments, remove_base_effect
from klute_sim.effects.effect import Effect
from klute_sim.types import Array


class ChannelResponse(NamedTuple):
    """A channel with and without the effect."""

    channel: str
    """Channel."""
    time: Array
    """Time [s]."""
    without_effect: Array
    """Values without the effect [SI]."""
    with_effect: Array
    """Values with the effect [SI]."""


class EffectResponse(NamedTuple):
    """Observed channels of one protocol with and without an effect."""

    term: EffectTerm
    """Effect in one of its forms."""
    protocol: str
    """Name of the protocol."""
    experiment: BenchExperiment
    """Prescribed length and command."""
    channels: tuple[ChannelResponse, ...]
    """Responses of all channels."""


def simulate_effect_response(device: Device, term: EffectTerm, simulator: Simulator) -> EffectResponse:
    """Return the response to ``term`` in the protocol with the largest response relative to noise.

    The part of the effect that the base model contains is removed first.
    """
    device = remove_base_effect(device, term.effect_definition)
    base = Hypothesis(device, (), tuple(NOISE_STD.items()))
    hypothesis = base.with_term(term)
    typical = np.array([0.0 if parameter.is_logarithmic else 1.0 for parameter in hypothesis.parameters])
    experiments = prepare_experiments(device)
    setups = [base.build_setups(base.initial_point(), experiments), hypothesis.build_setups(typical, experiments)]
    without_effect, with_effect = simulator.simulate(setups, experiments)
    sizes = [
        sum(float(np.mean((after[c] - before[c]) ** 2)) / NOISE_STD[c] ** 2 for c in before)
        for before, after in zip(without_effect, with_effect, strict=True)
    ]
    k = int(np.argmax(sizes))
    experiment = experiments[k]
    channels = tuple(
        ChannelResponse(c, series.time, without_effect[k][c], with_effect[k][c])
        for c, series in experiment.measured.items()
    )
    return EffectResponse(term, experiment.name, experiment, channels)


def simulate_effect_responses(device: Device, effect: Effect, simulator: Simulator) -> Iterator[EffectResponse]:
    """Yield the response to each form of ``effect``; instrument effects act on the force."""
    channel = None if effect.kind == "device" else "force"
    for form in effect.forms:
        yield simulate_effect_response(device, EffectTerm(effect.name, form.name, channel), simulator)
