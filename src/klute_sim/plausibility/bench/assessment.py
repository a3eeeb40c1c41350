"""How a trial agrees with a simulation of its device: as it is, and without each possible mistake."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from klute_sim.plausibility.bench.agreement import (
    Agreement,
    compare_trial,
    find_calibration,
    moves_under_load,
    simulate_trial,
)
from klute_sim.plausibility.bench.causality import leads
from klute_sim.plausibility.bench.mistakes import Mistake, list_mistakes
from klute_sim.plausibility.bench.trial import MEASURED, PRESCRIBED, RecordedTrial, Response
from klute_sim.plausibility.finding import Finding

MIN_MISFIT = 0.03
"""Misfit of a trial below which a trial needs no explanation (assumed: sensors are about as good as a hundredth)."""
MAX_CHANNEL_MISFIT = 0.6
"""Largest misfit of any channel without the mistake."""
MIN_IMPROVEMENT = 3.0
"""Smallest ratio of the misfit with the mistake to that without it; below, the evidence is not overwhelming."""
MIN_DECREASE = 0.003
"""Smallest decrease of the misfit."""
PRESSURE_PAIR = ("pressure", "pressure_command")
"""Effect and cause."""
EXCHANGED_PRESSURES = "pressure-pressure_command-exchanged"
"""Finding that effect and cause are exchanged."""
EVIDENCE = {"time-scale": (4.0, 0.12), EXCHANGED_PRESSURES: (1.5, 0.6)}
"""Finding -> smallest ratio and largest misfit, where they differ. A slow regulator looks like a wrong sampling rate at
first sight; a pressure that changes before its command is evidence of its own."""


class Outcome(NamedTuple):
    """What a trial is like without a mistake."""

    before: float
    """Misfit of the channels that are evidence, with the mistake."""
    after: float
    """Their misfit without it."""
    misfit: float
    """Misfit of all channels without it."""
    worst: float
    """Largest misfit of a channel without it."""
    scale_error: float
    """Sum of the errors of scale of the channels without it."""
    is_convincing: bool
    """Whether the evidence for the mistake is overwhelming in this trial."""


class Assessment:
    """A trial, its simulation and how they agree; simulated once."""

    def __init__(self, trial: RecordedTrial, magnitudes: Sequence[Finding]) -> None:
        """Assess ``trial``, whose ranges have the findings ``magnitudes``."""
        self.trial = trial
        self.magnitudes = list(magnitudes)
        self.has_wrong_range = bool(magnitudes)
        """Whether a range is wrong, or lengths of trials with the same columns are: a simulation means little then."""
        self._outcomes: dict[str, Outcome | None] = {}

    @cached_property
    def response(self) -> Response | None:
        """Simulated response of the declared device."""
        return simulate_trial(self.trial)

    @cached_property
    def is_loaded(self) -> bool:
        """Whether the unit moves under a nearly constant force."""
        return moves_under_load(self.trial)

    @cached_property
    def agreements(self) -> Mapping[str, Agreement]:
        """Measured channel -> agreement with the simulation."""
        return compare_trial(self.trial, self.response, has_constant_load=self.is_loaded)

    @property
    def misfit(self) -> float:
        """Misfit of all channels."""
        return combine_misfits(self.agreements)

    @property
    def scale_error(self) -> float:
        """Sum of the errors of scale of the channels."""
        return sum(agreement.scale_error for agreement in self.agreements.values())

    @property
    def is_credible(self) -> bool:
        """Whether the trial can be right as it is: it shows that it agrees with its simulation."""
        misfits = [agreement.misfit for agreement in self.agreements.values()]
        return bool(misfits) and not self.has_wrong_range and max(misfits) <= MAX_CHANNEL_MISFIT

    @property
    def is_suspicious(self) -> bool:
        """Whether the trial needs an explanation."""
        is_unlike = not self.agreements or self.misfit > MIN_MISFIT or self.has_wrong_range
        return is_unlike or self.has_leading_pressure

    @cached_property
    def has_leading_pressure(self) -> bool:
        """Whether the pressure changes before its command."""
        return leads(self.trial, *PRESSURE_PAIR)

    @cached_property
    def calibration(self) -> float | None:
        """Factor from measured to simulated force where both have one waveform and scales of no common unit."""
        return find_calibration(self.agreements["force"]) if "force" in self.agreements else None

    def find_outcome(self, key: str) -> Outcome | None:
        """Return what the trial is like without the mistake ``key``; None where it cannot have that mistake."""
        if key not in self._outcomes:
            mistake = next((mistake for mistake in list_mistakes(self.trial) if mistake.key == key), None)
            self._outcomes[key] = None if mistake is None else self.judge(mistake)
        return self._outcomes[key]

    def judge(self, mistake: Mistake) -> Outcome | None:
        """Return what the trial is like without ``mistake``; None where it cannot be compared then.

        Where the range of a channel is wrong already, only exchanged columns explain it better. Any slow regulator is
        explained better by the pressure that was reached than by the command, so that alone is no evidence of
        exchanged pressures.
        """
        name = mistake.name
        response = self.response
        if any(mistake.trial.channels[channel] is not self.trial.channels[channel] for channel in PRESCRIBED):
            response = simulate_trial(mistake.trial)
        corrected = compare_trial(mistake.trial, response, has_constant_load=self.is_loaded)
        if not corrected or not self.agreements.keys() <= corrected.keys():
            self._outcomes[mistake.key] = None
            return None
        min_ratio, max_misfit = EVIDENCE.get(name, (MIN_IMPROVEMENT, MAX_CHANNEL_MISFIT))
        before, after = (combine_misfits(agreements, mistake.evidence) for agreements in (self.agreements, corrected))
        worst = max(agreement.misfit for agreement in corrected.values())
        is_candidate = not self.has_wrong_range or name.endswith("-exchanged")
        is_candidate &= name != EXCHANGED_PRESSURES or self.has_leading_pressure
        min_misfit = max(min_ratio * after, MIN_DECREASE + after)
        is_convincing = is_candidate and worst <= max_misfit and before >= min_misfit
        if is_convincing and mistake.rival is not None:
            rival = compare_trial(mistake.rival, simulate_trial(mistake.rival), has_constant_load=self.is_loaded)
            is_convincing = combine_misfits(rival, mistake.evidence) >= min_misfit
        outcome = Outcome(
            before,
            after,
            combine_misfits(corrected),
            worst,
            # Units of one channel give equal waveforms: the right one gives the magnitude, too.
            sum(agreement.scale_error for agreement in corrected.values()),
            is_convincing,
        )
        self._outcomes[mistake.key] = outcome
        return outcome


def combine_misfits(agreements: Mapping[str, Agreement], channels: Sequence[str] = MEASURED) -> float:
    """Return the root mean square of the misfits of ``channels``; 1 where none of them can be compared."""
    misfits = [agreement.misfit for name, agreement in agreements.items() if name in channels]
    return float(np.sqrt(np.mean(np.square(misfits)))) if misfits else 1.0
