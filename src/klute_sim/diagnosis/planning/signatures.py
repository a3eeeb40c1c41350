"""What one effect changes in a standard protocol, at its typical size."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from klute_sim.device.device import Device
from klute_sim.diagnosis.experiments.base import Array, Simulator
from klute_sim.diagnosis.experiments.bench import BenchExperiment
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.planning.identifiability import NOISE_STD, prepare_experiments, remove_base_effect
from klute_sim.effects.effect import Effect


class ChannelResponse(NamedTuple):
    """A channel with and without the effect."""

    channel: str
    time: Array
    """[s]"""
    without_effect: Array
    """[SI]"""
    with_effect: Array
    """[SI]"""


class EffectResponse(NamedTuple):
    """One protocol, as the instruments would show it."""

    term: EffectTerm
    protocol: str
    experiment: BenchExperiment
    channels: tuple[ChannelResponse, ...]


def simulate_effect_response(device: Device, term: EffectTerm, simulator: Simulator) -> EffectResponse:
    """The protocol in which ``term`` shows most, over the channels' usual noise.

    What the base model has of it is switched off before.
    """
    device = remove_base_effect(device, term.effect_definition)
    plain = Hypothesis(device, (), tuple(NOISE_STD.items()))
    hypothesis = plain.with_term(term)
    typical = np.array([0.0 if u.is_logarithmic else 1.0 for u in hypothesis.parameters])
    every = prepare_experiments(device)
    settings = [plain.build_setups(plain.initial_point(), every), hypothesis.build_setups(typical, every)]
    without, having = simulator.simulate(settings, every)
    sizes = [
        sum(float(np.mean((after[c] - before[c]) ** 2)) / NOISE_STD[c] ** 2 for c in before)
        for before, after in zip(without, having, strict=True)
    ]
    k = int(np.argmax(sizes))
    e = every[k]
    shown = tuple(ChannelResponse(c, e.measured[c].time, without[k][c], having[k][c]) for c in e.measured)
    return EffectResponse(term, e.name, e, shown)


def simulate_effect_responses(device: Device, effect: Effect, simulator: Simulator) -> Iterator[EffectResponse]:
    """One of every form of ``effect``; an instrument's is that of the force."""
    channel = None if effect.kind == "device" else "force"
    for form in effect.forms:
        yield simulate_effect_response(device, EffectTerm(effect.name, form.name, channel), simulator)
