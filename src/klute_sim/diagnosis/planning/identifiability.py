"""Identifiability: which effects look alike in the identification protocols, and on which rig they differ.

Every form of every effect is simulated at a fraction of its typical size in every protocol. The sensitivities to the
uncertain numbers of the device are projected out, and the remainder is the signature of the effect. Effects with
parallel signatures are indistinguishable at any size.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse.csgraph import connected_components

from klute_sim.bench.protocols.library import load_identification_protocols
from klute_sim.datasets.trial import TimeSeries
from klute_sim.device.device import Device, check_accepts_pressure
from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS
from klute_sim.diagnosis.experiments.bench import BenchExperiment
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import FINITE_DIFFERENCE_STEP
from klute_sim.diagnosis.planning.measurement_plan import DEFAULT_UNCERTAINTIES
from klute_sim.diagnosis.planning.proposals import MUSCLE_LENGTH_NOISE, RigChange, list_rig_changes
from klute_sim.diagnosis.selection.screening import MIN_ORTHOGONAL_FRACTION, PROBE_FRACTION
from klute_sim.effects import catalogue
from klute_sim.effects.effect import Effect
from klute_sim.errors import InputError
from klute_sim.types import Array, ProgressCallback

TIME_STEP, SAMPLE_INTERVAL = 1.25e-3, 5e-3
"""Time step of the simulation, and time between samples [s]: a whole number of coarse steps."""
NOISE_STD = {"force": 3.0, "pressure": 1e3, "muscle_length": MUSCLE_LENGTH_NOISE}
"""Standard deviation of a sample of each channel [SI] (assumed: an ordinary load cell and gauge)."""
RECORDED_CHANNELS = ("force", "pressure")
"""Channels of the rig as it is."""
RELATIVE_UNCERTAINTY = 0.1
"""Relative standard deviation of the uncertain numbers of the device (assumed)."""
UNCERTAIN_PARAMETERS = tuple(DEFAULT_UNCERTAINTIES)
"""Keys of the numbers of a device that are rarely known exactly."""
INDISTINGUISHABLE_COSINE = 0.95
"""Cosine between signatures above which two effects are indistinguishable (assumed)."""


class Signature(NamedTuple):
    """Signature of an effect."""

    term: EffectTerm
    """Effect in one of its forms."""
    direction: Array
    """Unit vector over all samples of all channels."""
    signal_to_noise: float
    """Root of chi squared at the typical size, after projection."""
    orthogonal_fraction: float
    """Norm after projection over the norm before."""


@dataclass(frozen=True, eq=False)
class RigIdentifiability:
    """Signatures of all effects on one rig."""

    rig_change: RigChange
    """Change of the rig."""
    signatures: tuple[Signature, ...]
    """Signatures in the order of the catalogue."""

    def cosine_matrix(self) -> Array:
        """Return the absolute cosines between the signatures, shape (n, n)."""
        rows = np.array([signature.direction for signature in self.signatures])
        return np.asarray(np.abs(rows @ rows.T))

    def cosine(self, term: EffectTerm, other: EffectTerm) -> float:
        """Return the absolute cosine between the signatures of two terms."""
        return float(abs(self._directions[term] @ self._directions[other]))

    @cached_property
    def _directions(self) -> dict[EffectTerm, Array]:
        return {signature.term: signature.direction for signature in self.signatures}


def compute_identifiability(
    device: Device, simulator: Simulator, progress: ProgressCallback = lambda fraction, stage: None
) -> list[RigIdentifiability]:
    """Return the signatures on the rig as it is, then with each change of the rig.

    Raises InputError when no protocol can be run on ``device``.
    """
    experiments = prepare_experiments(device)
    values = device.spec.collect_values()
    uncertain = tuple((key, RELATIVE_UNCERTAINTY * values[key]) for key in UNCERTAIN_PARAMETERS if values.get(key))
    base = Hypothesis(device, uncertain, tuple(NOISE_STD.items()))
    terms = _list_terms(device)
    x0 = base.initial_point()
    perturbed = [base.build_setups(x0 + FINITE_DIFFERENCE_STEP * unit, experiments) for unit in np.eye(len(x0))]
    base_setups = [base.build_setups(x0, experiments), *perturbed]
    probe_setups = []
    for term in terms:
        hypothesis = base.with_term(term)
        x = hypothesis.initial_point()
        for k in range(len(x0), len(x)):
            if not hypothesis.parameters[k].is_logarithmic:
                x[k] = PROBE_FRACTION
        probe_setups.append(hypothesis.build_setups(x, experiments))
    setups = [*base_setups, *probe_setups]
    progress(0.05, "simulating")
    observed = simulator.simulate(setups, experiments)
    progress(0.7, "simulating")
    true_values = simulator.simulate([[setup._replace(sensors=()) for setup in row] for row in setups], experiments)
    progress(0.95, "simulating")
    return [
        _compute_signatures(change, terms, len(perturbed), observed, true_values) for change in list_rig_changes(device)
    ]


def remove_base_effect(device: Device, effect: Effect) -> Device:
    """Return ``device`` without the part of ``effect`` that the base model contains.

    Raises InputError for an effect of the body or of a mechanism, and where a section of the device replaces the
    effect.
    """
    if effect.kind in ("body", "mechanism"):
        rig = "in gait" if effect.kind == "body" else "on a mechanism"
        raise InputError(f"effect '{effect.name}' acts {rig} only; the identification protocols run on the bench")
    incompatibility = device.spec.find_incompatibility(effect.name)
    if incompatibility:
        raise InputError(f"effect '{effect.name}' cannot be tested on device '{device.name}': {incompatibility}")
    if not effect.replaces_switch or device.spec.muscle is None:
        return device
    muscle = device.spec.muscle.model_copy(update={effect.replaces_switch: False})
    return device.with_spec(device.spec.model_copy(update={"muscle": muscle}))


def prepare_experiments(device: Device) -> list[BenchExperiment]:
    """Return the identification protocols for ``device``, with all channels sampled.

    Raises InputError when none can be run.
    """
    check_accepts_pressure(device, "a protocol")
    experiments = []
    for name, protocol in load_identification_protocols().items():
        try:
            time, unit_length, command = protocol.build_program(device)
        except InputError:
            continue
        grid = np.arange(TIME_STEP, time[-1], TIME_STEP)
        samples = np.arange(SAMPLE_INTERVAL, time[-1], SAMPLE_INTERVAL)
        experiments.append(
            BenchExperiment(
                name=name,
                group=name,
                use="fit",
                device=device,
                start_time=0.0,
                dt=TIME_STEP,
                command=np.interp(grid, time, command),
                measured={channel: TimeSeries(samples, samples) for channel in NOISE_STD},
                unit_length=np.interp(grid, time, unit_length),
            )
        )
    if not experiments:
        raise InputError(f"no protocol can be run on device '{device.name}'")
    return experiments


def _list_terms(device: Device) -> list[EffectTerm]:
    terms = []
    for effect in catalogue.get_named_effects().values():
        if not device.spec.can_add_effect(effect):
            continue
        if effect.kind == "device":
            terms += [EffectTerm(effect.name, form.name) for form in device.spec.list_candidate_forms(effect)]
        elif effect.kind == "instrument":
            channels = [channel for channel in RECORDED_CHANNELS if channel in CHANNEL_UNITS]
            terms += [EffectTerm(effect.name, form.name, channel) for form in effect.forms for channel in channels]
    return terms


SimulatedChannels = Sequence[dict[str, Array]]
"""Channels of one setup, one mapping per experiment."""


def _compute_signatures(
    rig_change: RigChange,
    terms: Sequence[EffectTerm],
    n_uncertain: int,
    observed: Sequence[SimulatedChannels],
    true_values: Sequence[SimulatedChannels],
) -> RigIdentifiability:
    columns = [_stack_channels(rig_change, *rows) for rows in zip(observed, true_values, strict=True)]
    base, probes = columns[0], columns[1:]
    rows = [(column - base) / FINITE_DIFFERENCE_STEP for column in probes[:n_uncertain]]
    sensitivities = np.reshape(rows, (n_uncertain, len(base))).T
    # The priors of the device's numbers add one row each.
    basis, _ = np.linalg.qr(np.vstack([sensitivities, np.eye(n_uncertain)]))
    signatures = []
    for term, column in zip(terms, probes[n_uncertain:], strict=True):
        change = np.concatenate([(column - base) / PROBE_FRACTION, np.zeros(n_uncertain)])
        orthogonal = change - basis @ (basis.T @ change)
        norm, full_norm = float(np.linalg.norm(orthogonal)), float(np.linalg.norm(change))
        if norm > MIN_ORTHOGONAL_FRACTION * max(1.0, full_norm):
            signatures.append(Signature(term, orthogonal / norm, norm, norm / full_norm))
    return RigIdentifiability(rig_change, tuple(signatures))


def _stack_channels(rig_change: RigChange, observed: SimulatedChannels, true_values: SimulatedChannels) -> Array:
    """Return all samples of the recorded channels, and of those that the change adds, over their noise."""
    parts = []
    for observed_row, true_row in zip(observed, true_values, strict=True):
        parts += [observed_row[channel] / NOISE_STD[channel] for channel in RECORDED_CHANNELS]
        parts += [
            true_row[channel] / NOISE_STD[channel]
            for channel in (*rig_change.reference_channels, *rig_change.added_channels)
        ]
    return np.concatenate(parts)


class IndistinguishableClass(NamedTuple):
    """Effects of which each is indistinguishable from another one of the class on the rig as it is."""

    terms: tuple[EffectTerm, ...]
    """Effects in the order of the catalogue."""
    cosine: float
    """Largest cosine between two of them."""
    separated_by: RigChange | None
    """Change of the rig with the smallest cosine; None if every change leaves some of them indistinguishable."""
    remaining_cosine: float
    """Largest cosine after this change."""

    @property
    def n_effects(self) -> int:
        """Number of effects; forms of one effect count once."""
        return len({(term.effect, term.channel) for term in self.terms})


def find_indistinguishable_classes(rigs: Sequence[RigIdentifiability]) -> list[IndistinguishableClass]:
    """Return the classes of two or more effects, in the order of the catalogue."""
    terms = [signature.term for signature in rigs[0].signatures]
    is_linked = rigs[0].cosine_matrix() >= INDISTINGUISHABLE_COSINE
    is_linked &= np.array([[_are_different_effects(term, other) for other in terms] for term in terms])
    count, labels = connected_components(is_linked)
    classes = [tuple(term for term, label in zip(terms, labels, strict=True) if label == k) for k in range(count)]
    return [_create_class(rigs, members) for members in classes if len(members) > 1]


def find_indistinguishable_pairs(rigs: Sequence[RigIdentifiability]) -> dict[EffectTerm, list[IndistinguishableClass]]:
    """Return, for each term, its pairs with indistinguishable effects (the term itself first), most alike first."""
    pairs: dict[EffectTerm, list[IndistinguishableClass]] = {signature.term: [] for signature in rigs[0].signatures}
    for group in find_indistinguishable_classes(rigs):
        for term in group.terms:
            candidates = [
                _create_class(rigs, (term, other)) for other in group.terms if _are_different_effects(term, other)
            ]
            alike = [pair for pair in candidates if pair.cosine >= INDISTINGUISHABLE_COSINE]
            pairs[term] = sorted(alike, key=lambda pair: -pair.cosine)
    return pairs


def to_json_rows(rigs: Sequence[RigIdentifiability]) -> list[dict[str, Any]]:
    """Return one JSON object per term: signal-to-noise ratio, orthogonal fraction and indistinguishable effects.

    ``closest`` is the most similar other effect, in the same class or not.
    """
    pairs = find_indistinguishable_pairs(rigs)
    class_sizes = {term: group.n_effects for group in find_indistinguishable_classes(rigs) for term in group.terms}

    def find_closest(term: EffectTerm) -> tuple[float, str]:
        return max((rigs[0].cosine(term, other), str(other)) for other in pairs if _are_different_effects(term, other))

    rows = []
    for signature in rigs[0].signatures:
        term = signature.term
        closest_cosine, closest = find_closest(term)
        rows.append(
            {
                "effect": term.effect,
                "form": term.form,
                "channel": term.channel,
                "class_size": class_sizes.get(term, 1),
                "closest": closest,
                "closest_cosine": closest_cosine,
                "signal_to_noise": signature.signal_to_noise,
                "orthogonal_fraction": signature.orthogonal_fraction,
                "similar_effects": [
                    {
                        "effect": str(pair.terms[1]),
                        "cosine": pair.cosine,
                        "separated_by": pair.separated_by.description if pair.separated_by else None,
                        "remaining_cosine": pair.remaining_cosine,
                    }
                    for pair in pairs[term]
                ],
            }
        )
    return rows


def _are_different_effects(term: EffectTerm, other: EffectTerm) -> bool:
    """Return whether the terms are different effects, not forms of one effect."""
    return (term.effect, term.channel) != (other.effect, other.channel)


def _create_class(rigs: Sequence[RigIdentifiability], terms: tuple[EffectTerm, ...]) -> IndistinguishableClass:
    pairs = [pair for pair in combinations(terms, 2) if _are_different_effects(*pair)]
    cosine, *changed_cosines = (max(rig.cosine(*pair) for pair in pairs) for rig in rigs)
    remaining_cosine, rig = min(zip(changed_cosines, rigs[1:], strict=True), key=lambda item: item[0])
    separated_by = rig.rig_change if remaining_cosine < INDISTINGUISHABLE_COSINE else None
    return IndistinguishableClass(terms, cosine, separated_by, remaining_cosine)
