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

from klute_sim.bench.protocols.identification import PROTOCOLS
from klute_sim.datasets.trial import Series
from klute_sim.device.device import Device, check_takes_pressure
from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS, Array, Simulator
from klute_sim.diagnosis.experiments.bench import BenchExperiment
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import FINITE_DIFFERENCE_STEP
from klute_sim.diagnosis.planning.proposals import MUSCLE_LENGTH_NOISE, RIG_CHANGES, RigChange
from klute_sim.diagnosis.selection.screening import PROBE_FRACTION
from klute_sim.effects import catalogue
from klute_sim.effects.effect import Effect
from klute_sim.errors import InputError

TIME_STEP, SAMPLE_INTERVAL = 1e-3, 5e-3
"""Of the simulation, and between samples [s]."""
NOISE_STD = {"force": 3.0, "pressure": 1e3, "muscle_length": MUSCLE_LENGTH_NOISE}
"""Standard deviation of a sample [SI] (assumed: an ordinary load cell and gauge)."""
RECORDED_CHANNELS = ("force", "pressure")
"""Channels of the rig as it is."""
RELATIVE_UNCERTAINTY = 0.1
"""Of its value, is the standard deviation of each of the device's uncertain numbers (assumed)."""
UNCERTAIN_PARAMETERS = (
    "muscle.c10_kpa",
    "muscle.friction_slope_n_per_bar",
    "tendon.slack_length_mm",
    "tendon.stiffness_1_n_per_mm",
    "tendon.stiffness_2_n_per_mm",
    "damper.orifice_concentric_mm",
    "damper.orifice_eccentric_mm",
)
"""What one seldom knows of a device."""
INDISTINGUISHABLE_COSINE = 0.95
"""Cosine between signatures from which two effects are of one class."""


class Signature(NamedTuple):
    """What is left of an effect's change."""

    term: EffectTerm
    direction: Array
    """Over all samples of all channels, of length 1."""
    signal_to_noise: float
    """Root of chi squared that the typical size makes, after projection."""
    orthogonal_fraction: float
    """Share of the change that projection left."""


@dataclass(frozen=True, eq=False)
class RigIdentifiability:
    """Signatures on one rig."""

    rig_change: RigChange
    """Of the rig."""
    signatures: tuple[Signature, ...]

    def cosine_matrix(self) -> Array:
        """(n, n) absolute cosines between the signatures."""
        rows = np.array([signature.direction for signature in self.signatures])
        return np.asarray(np.abs(rows @ rows.T))

    def cosine(self, term: EffectTerm, other: EffectTerm) -> float:
        """The entry of :meth:`cosines` for two of the terms."""
        return float(abs(self._directions[term] @ self._directions[other]))

    @cached_property
    def _directions(self) -> dict[EffectTerm, Array]:
        return {signature.term: signature.direction for signature in self.signatures}


def compute_identifiability(
    device: Device, simulator: Simulator, progress: Callable[[float], None] = lambda share: None
) -> list[RigIdentifiability]:
    """Signatures in all protocols with the rig as it is, then with each change of it.

    Raises InputError for a device that no protocol can be run on.
    """
    every = prepare_experiments(device)
    numbers = device.spec.collect_values()
    uncertain = tuple((key, RELATIVE_UNCERTAINTY * numbers[key]) for key in UNCERTAIN_PARAMETERS if numbers.get(key))
    plain = Hypothesis(device, uncertain, tuple(NOISE_STD.items()))
    terms = _list_terms(device)
    start = plain.initial_point()
    base = [plain.build_setups(start + FINITE_DIFFERENCE_STEP * unit, every) for unit in np.eye(len(start))]
    rows = [plain.build_setups(start, every), *base]
    tried = []
    for term in terms:
        hypothesis = plain.with_term(term)
        row = hypothesis.initial_point()
        for k in range(len(start), len(row)):
            if not hypothesis.parameters[k].is_logarithmic:
                row[k] = PROBE_FRACTION
        tried.append(hypothesis.build_setups(row, every))
    progress(0.05)
    shown = simulator.simulate([*rows, *tried], every)
    progress(0.7)
    true = simulator.simulate([[one._replace(sensors=()) for one in row] for row in [*rows, *tried]], every)
    progress(0.95)
    return [_compute_signatures(change, terms, len(base), shown, true) for change in RIG_CHANGES]


def remove_base_effect(device: Device, effect: Effect) -> Device:
    """``device`` without what the base model has of ``effect``: on it the effect has its whole size.

    Raises InputError where a section of the device says what the effect would say, and for an effect of the body.
    """
    if effect.kind == "body":
        raise InputError(f"effect '{effect.name}' shows on walks only: the standard protocols are a bench's")
    obstacle = device.spec.find_incompatibility(effect.name)
    if obstacle:
        raise InputError(f"effect '{effect.name}' cannot be tried on device '{device.name}': {obstacle}")
    if not effect.replaces_switch:
        return device
    muscle = device.spec.muscle.model_copy(update={effect.replaces_switch: False})
    return replace(device, spec=device.spec.model_copy(update={"muscle": muscle}))


def prepare_experiments(device: Device) -> list[BenchExperiment]:
    """The standard protocols for ``device``, with every channel sampled; InputError where none can be run."""
    check_takes_pressure(device, "a protocol")
    found = []
    for name, protocol in PROTOCOLS.items():
        try:
            time, length, command = protocol.build_program(device)
        except InputError:
            continue
        grid = np.arange(TIME_STEP, time[-1], TIME_STEP)
        samples = np.arange(SAMPLE_INTERVAL, time[-1], SAMPLE_INTERVAL)
        measured = {channel: Series(samples, samples) for channel in NOISE_STD}
        pulled, commanded = np.interp(grid, time, length), np.interp(grid, time, command)
        found.append(
            BenchExperiment(name, name, "fit", device, 0.0, TIME_STEP, commanded, measured, unit_length=pulled)
        )
    if not found:
        raise InputError(f"no protocol can be run on device '{device.name}'")
    return found


def _list_terms(device: Device) -> list[EffectTerm]:
    found = []
    for effect in catalogue.get_named_effects().values():
        if not device.spec.can_add_effect(effect):
            continue
        if effect.kind == "device":
            found += [EffectTerm(effect.name, form.name) for form in effect.forms]
        elif effect.kind == "instrument":
            found += [
                EffectTerm(effect.name, effect.forms[0].name, channel)
                for channel in RECORDED_CHANNELS
                if channel in CHANNEL_UNITS
            ]
    return found


SimulatedChannels = Sequence[dict[str, Array]]
"""What the instruments show of one setting, per experiment."""


def _compute_signatures(
    rig_change: RigChange,
    terms: Sequence[EffectTerm],
    n_uncertain: int,
    observed: Sequence[SimulatedChannels],
    true_values: Sequence[SimulatedChannels],
) -> RigIdentifiability:
    columns = [_stack_channels(rig_change, faulty, there) for faulty, there in zip(observed, true_values, strict=True)]
    here, rest = columns[0], columns[1:]
    slopes = np.stack([(column - here) / FINITE_DIFFERENCE_STEP for column in rest[:n_uncertain]], axis=1)
    # What is believed of the device's numbers holds them: a row for each that asks for 0.
    basis, _ = np.linalg.qr(np.vstack([slopes, np.eye(n_uncertain)]))
    found = []
    for term, column in zip(terms, rest[n_uncertain:], strict=True):
        whole = np.concatenate([(column - here) / PROBE_FRACTION, np.zeros(n_uncertain)])
        left = whole - basis @ (basis.T @ whole)
        size, all_of_it = float(np.linalg.norm(left)), float(np.linalg.norm(whole))
        if size > 1e-6 * max(1.0, all_of_it):
            found.append(Signature(term, left / size, size, size / all_of_it))
    return RigIdentifiability(rig_change, tuple(found))


def _stack_channels(rig_change: RigChange, observed: SimulatedChannels, true_values: SimulatedChannels) -> Array:
    """All samples of the channels there are, and of those that the change adds, over their noise."""
    parts = []
    for faulty, there in zip(observed, true_values, strict=True):
        parts += [faulty[channel] / NOISE_STD[channel] for channel in RECORDED_CHANNELS]
        parts += [
            there[channel] / NOISE_STD[channel]
            for channel in (*rig_change.reference_channels, *rig_change.added_channels)
        ]
    return np.concatenate(parts)


class IndistinguishableClass(NamedTuple):
    """Effects of one class: each looks like another of them on the rig as it is."""

    terms: tuple[EffectTerm, ...]
    cosine: float
    """The largest between two of them."""
    separated_by: RigChange | None
    """The change of the rig that makes them least alike; None: none makes all of them unlike (below :data:`ALIKE`)."""
    remaining_cosine: float
    """The largest cosine then."""

    @property
    def n_effects(self) -> int:
        """How many effects; other forms of one are not others."""
        return len({(term.effect, term.channel) for term in self.terms})


def find_indistinguishable_classes(rigs: Sequence[RigIdentifiability]) -> list[IndistinguishableClass]:
    """The classes of more than one effect, in the catalogue's order."""
    terms = [signature.term for signature in rigs[0].signatures]
    linked = rigs[0].cosine_matrix() >= INDISTINGUISHABLE_COSINE
    linked &= np.array([[_are_different_effects(one, other) for other in terms] for one in terms])
    count, label = connected_components(linked)
    groups = [tuple(term for term, own in zip(terms, label, strict=True) if own == k) for k in range(count)]
    return [_create_class(rigs, group) for group in groups if len(group) > 1]


def find_indistinguishable_pairs(rigs: Sequence[RigIdentifiability]) -> dict[EffectTerm, list[IndistinguishableClass]]:
    """Term -> each other effect that it looks like paired with it (the term itself first), most alike first."""
    result: dict[EffectTerm, list[IndistinguishableClass]] = {signature.term: [] for signature in rigs[0].signatures}
    for group in find_indistinguishable_classes(rigs):
        for term in group.terms:
            pairs = [_create_class(rigs, (term, other)) for other in group.terms if _are_different_effects(term, other)]
            result[term] = sorted(
                (p for p in pairs if p.cosine >= INDISTINGUISHABLE_COSINE), key=lambda pair: -pair.cosine
            )
    return result


def to_json_rows(rigs: Sequence[RigIdentifiability]) -> list[dict[str, Any]]:
    """For JSON: each term with its size over the noise, what refitting leaves of it, and what it looks like.

    ``closest`` is the most alike of all others, in its class or not.
    """
    alike, size = (
        find_indistinguishable_pairs(rigs),
        {term: group.n_effects for group in find_indistinguishable_classes(rigs) for term in group.terms},
    )

    def closest(term: EffectTerm) -> tuple[float, str]:
        return max((rigs[0].cosine(term, other), str(other)) for other in alike if _are_different_effects(term, other))

    return [
        {
            "effect": term.effect,
            "form": term.form,
            "channel": term.channel,
            "class_size": size.get(term, 1),
            "closest": closest(term)[1],
            "closest_cosine": closest(term)[0],
            "size": signature.signal_to_noise,
            "kept": signature.orthogonal_fraction,
            "alike": [
                {
                    "effect": str(pair.terms[1]),
                    "cosine": pair.cosine,
                    "split_by": pair.separated_by.description if pair.separated_by else None,
                    "cosine_then": pair.remaining_cosine,
                }
                for pair in alike[term]
            ],
        }
        for signature in rigs[0].signatures
        for term in [signature.term]
    ]


def _are_different_effects(term: EffectTerm, other: EffectTerm) -> bool:
    """Whether these are different effects: other forms of one are not."""
    return (term.effect, term.channel) != (other.effect, other.channel)


def _create_class(rigs: Sequence[RigIdentifiability], terms: tuple[EffectTerm, ...]) -> IndistinguishableClass:
    pairs = [pair for pair in combinations(terms, 2) if _are_different_effects(*pair)]
    now, *then = (max(each.cosine(*pair) for pair in pairs) for each in rigs)
    least, change = min(zip(then, rigs[1:], strict=True), key=lambda each: each[0])
    return IndistinguishableClass(terms, now, change.rig_change if least < INDISTINGUISHABLE_COSINE else None, least)
