"""One step of the forward selection, and why it was decided so."""

from dataclasses import dataclass, field

from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.selection.screening import Candidate


@dataclass(frozen=True, eq=False)
class SelectionStep:
    """One step of the selection, with or without an added effect."""

    initial_fit: Fit
    """Fit before the step."""
    candidates: tuple[Candidate, ...]
    """Screened candidates, best first."""
    refits: tuple[Fit, ...]
    """Fits of the shortlist: the accepted one first, then by BIC."""
    added_term: EffectTerm | None
    """Accepted effect; None if no candidate was accepted."""
    validation_gains: dict[str, float]
    """Relative fall of chi squared of the accepted effect in each validation group."""
    reason: str
    """Reason for the decision."""
    rejections: dict[EffectTerm, str] = field(default_factory=dict)
    """Reason for the rejection of each tested candidate."""
