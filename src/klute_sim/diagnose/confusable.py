"""What is easily taken for what: effects by what they change in the standard protocols, and the rig that splits them.

Every form of every effect is tried a little in every protocol. What the device's uncertain numbers could do instead is
projected off, and what is left are signatures: two effects with parallel ones look alike, whatever their sizes.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse.csgraph import connected_components

from klute_sim.dataset.trial import Series
from klute_sim.device.files import Device, refuse_openings
from klute_sim.diagnose.experiment import UNITS, Array, Bench
from klute_sim.diagnose.fit import DIFFERENCE
from klute_sim.diagnose.hypothesis import Hypothesis, Term
from klute_sim.diagnose.on_bench import OnBench
from klute_sim.diagnose.propose import CHANGES, MUSCLE_LENGTH, Change
from klute_sim.diagnose.protocols import PROTOCOLS
from klute_sim.diagnose.screen import SHARE
from klute_sim.effects import catalogue
from klute_sim.effects.effect import Effect
from klute_sim.errors import InputError

STEP, SAMPLE = 1e-3, 5e-3
"""Of the simulation, and between samples [s]."""
NOISE = {"force": 3.0, "pressure": 1e3, "muscle_length": MUSCLE_LENGTH}
"""Standard deviation of a sample [SI] (assumed: an ordinary load cell and gauge)."""
RECORDED = ("force", "pressure")
"""Channels of the rig as it is."""
UNCERTAIN = 0.1
"""Of its value, is the standard deviation of each of the device's uncertain numbers (assumed)."""
NUMBERS = (
    "muscle.c10_kpa",
    "muscle.friction_slope_n_per_bar",
    "tendon.slack_length_mm",
    "tendon.stiffness_1_n_per_mm",
    "tendon.stiffness_2_n_per_mm",
    "damper.orifice_concentric_mm",
    "damper.orifice_eccentric_mm",
)
"""What one seldom knows of a device."""
ALIKE = 0.95
"""Cosine between signatures from which two effects are of one class."""


class Signature(NamedTuple):
    """What is left of an effect's change."""

    term: Term
    direction: Array
    """Over all samples of all channels, of length 1."""
    size: float
    """Root of chi squared that the typical size makes, after projection."""
    kept: float
    """Share of the change that projection left."""


@dataclass(frozen=True, eq=False)
class Confusion:
    """Signatures on one rig."""

    change: Change
    """Of the rig."""
    signatures: tuple[Signature, ...]

    def cosines(self) -> Array:
        """(n, n) absolute cosines between the signatures."""
        rows = np.array([signature.direction for signature in self.signatures])
        return np.asarray(np.abs(rows @ rows.T))

    def cosine(self, one: Term, other: Term) -> float:
        """The entry of :meth:`cosines` for two of the terms."""
        return float(abs(self._directions[one] @ self._directions[other]))

    @cached_property
    def _directions(self) -> dict[Term, Array]:
        return {signature.term: signature.direction for signature in self.signatures}


def confusions(device: Device, bench: Bench, told: Callable[[float], None] = lambda share: None) -> list[Confusion]:
    """Signatures in all protocols with the rig as it is, then with each change of it.

    Raises InputError for a device that no protocol can be run on.
    """
    every = experiments(device)
    numbers = device.spec.numbers()
    uncertain = tuple((key, UNCERTAIN * numbers[key]) for key in NUMBERS if numbers.get(key))
    plain = Hypothesis(device, uncertain, tuple(NOISE.items()))
    terms = _terms(device)
    start = plain.start()
    base = [plain.settings(start + DIFFERENCE * unit, every) for unit in np.eye(len(start))]
    rows = [plain.settings(start, every), *base]
    tried = []
    for term in terms:
        hypothesis = plain.plus(term)
        row = hypothesis.start()
        for k in range(len(start), len(row)):
            if not hypothesis.unknowns[k].logarithmic:
                row[k] = SHARE
        tried.append(hypothesis.settings(row, every))
    told(0.05)
    shown = bench.simulate([*rows, *tried], every)
    told(0.7)
    true = bench.simulate([[one._replace(readings=()) for one in row] for row in [*rows, *tried]], every)
    told(0.95)
    return [_confusion(change, terms, len(base), shown, true) for change in CHANGES]


def bare(device: Device, effect: Effect) -> Device:
    """``device`` without what the base model has of ``effect``: on it the effect has its whole size.

    Raises InputError where a section of the device says what the effect would say, and for an effect of the body.
    """
    if effect.kind == "body":
        raise InputError(f"effect '{effect.name}' shows on walks only: the standard protocols are a bench's")
    obstacle = device.spec.obstacle(effect.name)
    if obstacle:
        raise InputError(f"effect '{effect.name}' cannot be tried on device '{device.name}': {obstacle}")
    if not effect.instead_of:
        return device
    muscle = device.spec.muscle.model_copy(update={effect.instead_of: False})
    return replace(device, spec=device.spec.model_copy(update={"muscle": muscle}))


def experiments(device: Device) -> list[OnBench]:
    """The standard protocols for ``device``, with every channel sampled; InputError where none can be run."""
    refuse_openings(device, "a protocol")
    found = []
    for name, protocol in PROTOCOLS.items():
        try:
            time, length, command = protocol.program(device)
        except InputError:
            continue
        grid = np.arange(STEP, time[-1], STEP)
        samples = np.arange(SAMPLE, time[-1], SAMPLE)
        measured = {channel: Series(samples, samples) for channel in NOISE}
        pulled, commanded = np.interp(grid, time, length), np.interp(grid, time, command)
        found.append(OnBench(name, name, "fit", device, 0.0, STEP, commanded, measured, unit_length=pulled))
    if not found:
        raise InputError(f"no protocol can be run on device '{device.name}'")
    return found


def _terms(device: Device) -> list[Term]:
    found = []
    for effect in catalogue.named().values():
        if not device.spec.may_lack(effect):
            continue
        if effect.kind == "device":
            found += [Term(effect.name, form.name) for form in effect.forms]
        elif effect.kind == "instrument":
            found += [Term(effect.name, effect.forms[0].name, channel) for channel in RECORDED if channel in UNITS]
    return found


Shown = Sequence[dict[str, Array]]
"""What the instruments show of one setting, per experiment."""


def _confusion(
    change: Change, terms: Sequence[Term], base: int, shown: Sequence[Shown], true: Sequence[Shown]
) -> Confusion:
    columns = [_column(change, faulty, there) for faulty, there in zip(shown, true, strict=True)]
    here, rest = columns[0], columns[1:]
    slopes = np.stack([(column - here) / DIFFERENCE for column in rest[:base]], axis=1)
    # What is believed of the device's numbers holds them: a row for each that asks for 0.
    basis, _ = np.linalg.qr(np.vstack([slopes, np.eye(base)]))
    found = []
    for term, column in zip(terms, rest[base:], strict=True):
        whole = np.concatenate([(column - here) / SHARE, np.zeros(base)])
        left = whole - basis @ (basis.T @ whole)
        size, all_of_it = float(np.linalg.norm(left)), float(np.linalg.norm(whole))
        if size > 1e-6 * max(1.0, all_of_it):
            found.append(Signature(term, left / size, size, size / all_of_it))
    return Confusion(change, tuple(found))


def _column(change: Change, shown: Shown, true: Shown) -> Array:
    """All samples of the channels there are, and of those that the change adds, over their noise."""
    parts = []
    for faulty, there in zip(shown, true, strict=True):
        parts += [faulty[channel] / NOISE[channel] for channel in RECORDED]
        parts += [there[channel] / NOISE[channel] for channel in (*change.second, *change.added)]
    return np.concatenate(parts)


class Alike(NamedTuple):
    """Effects of one class: each looks like another of them on the rig as it is."""

    terms: tuple[Term, ...]
    cosine: float
    """The largest between two of them."""
    split_by: Change | None
    """The change of the rig that makes them least alike; None: none makes all of them unlike (below :data:`ALIKE`)."""
    after: float
    """The largest cosine then."""

    @property
    def size(self) -> int:
        """How many effects; other forms of one are not others."""
        return len({(term.effect, term.channel) for term in self.terms})


def classes(found: Sequence[Confusion]) -> list[Alike]:
    """The classes of more than one effect, in the catalogue's order."""
    terms = [signature.term for signature in found[0].signatures]
    linked = found[0].cosines() >= ALIKE
    linked &= np.array([[_others(one, other) for other in terms] for one in terms])
    count, label = connected_components(linked)
    groups = [tuple(term for term, own in zip(terms, label, strict=True) if own == k) for k in range(count)]
    return [_alike(found, group) for group in groups if len(group) > 1]


def twins(found: Sequence[Confusion]) -> dict[Term, list[Alike]]:
    """Term -> each other effect that it looks like paired with it (the term itself first), most alike first."""
    result: dict[Term, list[Alike]] = {signature.term: [] for signature in found[0].signatures}
    for group in classes(found):
        for term in group.terms:
            pairs = [_alike(found, (term, other)) for other in group.terms if _others(term, other)]
            result[term] = sorted((p for p in pairs if p.cosine >= ALIKE), key=lambda pair: -pair.cosine)
    return result


def rows(found: Sequence[Confusion]) -> list[dict[str, Any]]:
    """For JSON: each term with its size over the noise, what refitting leaves of it, and what it looks like.

    ``closest`` is the most alike of all others, in its class or not.
    """
    alike, size = twins(found), {term: group.size for group in classes(found) for term in group.terms}

    def closest(term: Term) -> tuple[float, str]:
        return max((found[0].cosine(term, other), str(other)) for other in alike if _others(term, other))

    return [
        {
            "effect": term.effect,
            "form": term.form,
            "channel": term.channel,
            "class_size": size.get(term, 1),
            "closest": closest(term)[1],
            "closest_cosine": closest(term)[0],
            "size": signature.size,
            "kept": signature.kept,
            "alike": [
                {
                    "effect": str(pair.terms[1]),
                    "cosine": pair.cosine,
                    "split_by": pair.split_by.words if pair.split_by else None,
                    "cosine_then": pair.after,
                }
                for pair in alike[term]
            ],
        }
        for signature in found[0].signatures
        for term in [signature.term]
    ]


def _others(one: Term, other: Term) -> bool:
    """Whether these are different effects: other forms of one are not."""
    return (one.effect, one.channel) != (other.effect, other.channel)


def _alike(found: Sequence[Confusion], terms: tuple[Term, ...]) -> Alike:
    pairs = [pair for pair in combinations(terms, 2) if _others(*pair)]
    now, *then = (max(each.cosine(*pair) for pair in pairs) for each in found)
    least, change = min(zip(then, found[1:], strict=True), key=lambda each: each[0])
    return Alike(terms, now, change.change if least < ALIKE else None, least)
