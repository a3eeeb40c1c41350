"""What one effect changes in a standard protocol, at its typical size."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from klute_sim.device.files import Device
from klute_sim.diagnose.confusable import NOISE, bare, experiments
from klute_sim.diagnose.experiment import Array, Bench
from klute_sim.diagnose.hypothesis import Hypothesis, Term
from klute_sim.diagnose.on_bench import OnBench
from klute_sim.effects.effect import Effect


class Shown(NamedTuple):
    """A channel with and without the effect."""

    channel: str
    time: Array
    """[s]"""
    without: Array
    """[SI]"""
    having: Array
    """[SI]"""


class Signature(NamedTuple):
    """One protocol, as the instruments would show it."""

    term: Term
    protocol: str
    experiment: OnBench
    shown: tuple[Shown, ...]


def signature(device: Device, term: Term, bench: Bench) -> Signature:
    """The protocol in which ``term`` shows most, over the channels' usual noise.

    What the base model has of it is switched off before.
    """
    device = bare(device, term.entry)
    plain = Hypothesis(device, (), tuple(NOISE.items()))
    hypothesis = plain.plus(term)
    typical = np.array([0.0 if u.logarithmic else 1.0 for u in hypothesis.unknowns])
    every = experiments(device)
    settings = [plain.settings(plain.start(), every), hypothesis.settings(typical, every)]
    without, having = bench.simulate(settings, every)
    sizes = [
        sum(float(np.mean((after[c] - before[c]) ** 2)) / NOISE[c] ** 2 for c in before)
        for before, after in zip(without, having, strict=True)
    ]
    k = int(np.argmax(sizes))
    e = every[k]
    shown = tuple(Shown(c, e.measured[c].time, without[k][c], having[k][c]) for c in e.measured)
    return Signature(term, e.name, e, shown)


def signatures(device: Device, effect: Effect, bench: Bench) -> Iterator[Signature]:
    """One of every form of ``effect``; an instrument's is that of the force."""
    channel = None if effect.kind == "device" else "force"
    for form in effect.forms:
        yield signature(device, Term(effect.name, form.name, channel), bench)
