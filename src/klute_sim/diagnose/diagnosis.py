"""The whole workflow: check, noise, fit, gap, locate, name, doubt, add, show.

Trials that are kept back to show are not looked at before everything else is decided.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from threadpoolctl import threadpool_limits

from klute_sim.dataset.dataset import Dataset, split
from klute_sim.dataset.split import Split
from klute_sim.diagnose import check
from klute_sim.diagnose import noise as noises
from klute_sim.diagnose.display import Display, displayed
from klute_sim.diagnose.doubt import Rival, certified, fewer, rivals
from klute_sim.diagnose.equations import Equation, equations
from klute_sim.diagnose.experiment import UNITS, Bench, Experiment
from klute_sim.diagnose.fallback import fallback
from klute_sim.diagnose.fit import Evidence, Fit, fit
from klute_sim.diagnose.hypothesis import Hypothesis, Term
from klute_sim.diagnose.interval import intervals
from klute_sim.diagnose.locate import Place, locate
from klute_sim.diagnose.loudness import heard
from klute_sim.diagnose.noise import CERTAIN, Noise, significant
from klute_sim.diagnose.prepare import prepare
from klute_sim.diagnose.propose import propose
from klute_sim.diagnose.screen import check_names, terms
from klute_sim.diagnose.search import DECISIVE, Search, Step
from klute_sim.diagnose.store import Store
from klute_sim.diagnose.usable import usable

Verdict = Literal["nothing-missing", "named", "ambiguous", "unexplained", "insufficient-data"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Options:
    """What the user may choose."""

    only: tuple[str, ...] = ()
    """Effects to look for; none: all."""
    exclude: tuple[str, ...] = ()
    """Effects not to look for."""
    jobs: int = 0
    """Threads; 0: all cores."""
    seed: int = 0
    """Of where fits are tried again from."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Gap:
    """Root mean square of measured minus simulated, of one channel, on the trials shown [SI]."""

    before: float
    """With the nominal device."""
    refitted: float
    """With the device's uncertain numbers refitted and no effect added."""
    after: float
    """With the effects."""
    floor: float | None
    """What differs between repeats: no model can do better. Nobody knows where nothing was repeated."""


@dataclass(eq=False, kw_only=True)
class Diagnosis:
    """What was found."""

    dataset: Dataset
    split: Split
    verdict: Verdict
    reasons: list[str]
    """In plain words."""
    noise: dict[str, Noise] = field(default_factory=dict)
    base: Fit | None = None
    """The device without effects, its uncertain numbers fitted."""
    final: Fit | None = None
    """With the effects that were accepted."""
    found: tuple[Term, ...] = ()
    """What was added: effects, and where they do not explain everything, perhaps a data-driven term, the last."""
    intervals: list[tuple[float, float]] = field(default_factory=list)
    """Of the final fit's unknowns, 95 %."""
    rivals: list[Rival] = field(default_factory=list)
    where: list[Place] = field(default_factory=list)
    equations: list[Equation] = field(default_factory=list)
    """What each equation of the device lacks with nothing added; none where nothing was repeated, or clocks differ."""
    steps: list[Step] = field(default_factory=list)
    gap: dict[str, Gap] = field(default_factory=dict)
    shown_on: Literal["show", "fit"] = "show"
    """Which trials :attr:`gap` is of; fitted ones where none was kept back."""
    experiments: list[Experiment] = field(default_factory=list)
    displays: dict[str, Display] = field(default_factory=dict)
    """Channels that show whole steps only."""
    effective: float = 0.0
    """Independent samples that were fitted."""
    repeated: bool = True
    """Whether noise is known from repeats; else all that is left was taken for noise."""
    decisive: float = DECISIVE
    """Fall of BIC that was asked for."""
    next_experiment: dict[str, Any] | None = None
    """What to record to tell rivals apart."""
    device_written: bool = True
    """Whether the device as fitted can be a device file."""
    rollouts: int = 0


def diagnose(
    dataset: Dataset, options: Options | None = None, told: Callable[[str], None] = lambda sentence: None
) -> Diagnosis:
    """Find what the simulation of ``dataset`` lacks; ``told`` hears what is being done.

    Raises InputError for trials that their rig cannot simulate.
    """
    options = options or Options()
    check_names(dataset.device, options.only, options.exclude)
    parts = split(dataset)
    bench, store = Bench(options.jobs), Store(f"{dataset.digest} {dataset.device.digest} {options}")
    try:
        # Simulations share the cores already; a linear algebra of many threads would only wait for its turn.
        with threadpool_limits(1, user_api="blas"):
            found = _diagnose(dataset, parts, options, bench, store, told)
    finally:
        bench.close()
    store.forget()
    return found


def _diagnose(
    dataset: Dataset, parts: Split, options: Options, bench: Bench, store: Store, told: Callable[[str], None]
) -> Diagnosis:
    told("checking the data")
    every, fitted, reasons, against = usable(dataset, prepare(dataset, parts), bench)
    if against:
        return Diagnosis(
            dataset=dataset, split=parts, verdict="insufficient-data", reasons=[*reasons, *against], experiments=every
        )

    shown: dict[str, Display] = {}
    if check.repeated(fitted):
        every, shown = displayed(every, fitted)
        every = heard(every, fitted, bench)
        fitted = [e for e in every if e.use == "fit" and e.measured]
    told("fitting the device as it is")
    base, evidence = base_fit(dataset, fitted, bench, store)
    kept = [e for e in every if e.use == "select" and e.measured.keys() & evidence.noise]
    selection = [evidence.on([e for e in kept if e.group == group]) for group in noises.groups(kept)]
    candidates = terms(evidence, dataset.device, options.only, options.exclude)
    search = Search(evidence, selection, candidates, told, check.repeated(fitted))
    final = search.run(base)
    evidence = search.evidence
    told("fitting once more from elsewhere")
    final, sure = certified(evidence, final, np.random.default_rng(options.seed))
    smaller = fewer(search, final)
    if smaller is not None:
        final, sure = certified(evidence, smaller, np.random.default_rng(options.seed))
    told("looking for rivals")
    others = rivals(search, final)
    if others and others[0].difference < -search.decisive:
        final, sure = certified(evidence, others[0].fit, np.random.default_rng(options.seed))
        others = rivals(search, final)
    verdict, why = _verdict(search, final, others)
    if shown and "quantisation" not in options.exclude:
        why = [*(_in_steps(c, display) for c, display in shown.items()), *why]
        verdict = "named" if verdict == "nothing-missing" else verdict
    lacks = equations(evidence, final)
    if verdict == "unexplained":
        told("looking for a data-driven term")
        extra = fallback(search, final, base, lacks, options.exclude)
        why.append(extra.why)
        if extra.fit is not None:
            final, sure = certified(evidence, extra.fit, np.random.default_rng(options.seed))
            others = []  # they are rivals of what was found without it
            rest = "still show a misfit" if search.lacks(final) else "show no more misfit"
            why[-1] += f" With it, repeats {rest}."
        why += _proxies(final)
    if not sure:
        reasons.append("The fit does not come back to the same place from elsewhere: take its numbers with care.")
    result = Diagnosis(
        dataset=dataset,
        split=parts,
        verdict=verdict,
        reasons=[*reasons, *why],
        noise=dict(evidence.noise),
        base=base,
        final=final,
        found=final.hypothesis.terms,
        intervals=intervals(evidence, final),
        rivals=others,
        where=locate(evidence, base),
        equations=lacks,
        steps=search.steps,
        experiments=every,
        effective=evidence.effective,
        displays=shown,
        repeated=search.repeated,
        decisive=search.decisive,
    )
    if others and dataset.rig == "bench":  # protocols are for a tester
        told("looking for the experiment that separates them")
        result.next_experiment = propose(evidence, dataset.device, final, others[0].fit).as_json()
    told("showing it on trials kept back")
    _show(result, evidence)
    result.rollouts = bench.rollouts
    return result


def base_fit(
    dataset: Dataset, fitted: Sequence[Experiment], bench: Bench, store: Store | None = None
) -> tuple[Fit, Evidence]:
    """The device without new effects, and the evidence weighed by the noise of its residuals."""
    plain = Hypothesis(dataset.device, tuple(dataset.uncertain.items()), ())
    bare = Evidence(bench, fitted, {})
    weigh = noises.measure if check.repeated(fitted) else noises.supposed
    noise = weigh(fitted, bare.residuals(plain, [plain.start()])[0])
    found = None
    for _ in range(2):  # the noise of the inputs shows through the device, so it changes a little with it
        deviations = tuple((channel, each.deviation) for channel, each in noise.items())
        hypothesis = Hypothesis(plain.device, plain.uncertain, deviations)
        evidence = Evidence(bench, fitted, noise, store)
        found = fit(evidence, hypothesis, found.steps if found else None)
        noise = weigh(fitted, found.residuals)
    assert found is not None
    return found, evidence


def _verdict(search: Search, final: Fit, others: Sequence[Rival]) -> tuple[Verdict, list[str]]:
    own = final.hypothesis.terms
    misfits = {channel: each for channel, each in search.misfits(final).items() if significant(each)}
    if misfits:
        worst = max(misfits, key=lambda channel: misfits[channel].certainty)
        left = (
            f"All repeats of '{worst}' still show a misfit of {misfits[worst].size / misfits[worst].floor:.2f} times "
            f"the noise ({misfits[worst].certainty:.0f} standard errors; {CERTAIN:.0f} are allowed)."
        )
        last = f"What was tried last: {search.steps[-1].why}."
        return "unexplained", [left, *([] if own else [last])]
    if not own:
        return "nothing-missing" if search.repeated else "insufficient-data", [f"{search.steps[-1].why}."]
    found = {(term.effect, term.channel): term for term in own}  # by now, perhaps, in a simpler form than was added
    kept = [s for s in search.steps if s.added is not None and (s.added.effect, s.added.channel) in found]
    first = [f"{found[s.added.effect, s.added.channel]}: {s.why}." for s in kept if s.added is not None]
    if not all(step.gains for step in kept):
        first.append("There was no second group of trials to check that by: it rests on the fitted ones alone.")
    if not search.repeated:
        return "insufficient-data", first
    if others:
        names = ", ".join(sorted({str(rival.fit.hypothesis.terms[-1]) for rival in others}))
        return "ambiguous", [
            *first,
            f"{names} would explain the data as well: BIC differs by no more than {search.decisive:.0f}.",
        ]
    return "named", first


def _in_steps(channel: str, display: Display) -> str:
    unit, si = UNITS[channel]
    return (
        f"'{channel}' shows whole steps of {display.step / si:.4g} {unit} only, {1.0 / display.dither:.1f} times the "
        "noise before it: a quantisation, read off the data's own grid."
    )


def _proxies(final: Fit) -> list[str]:
    named = " and ".join(str(term) for term in final.hypothesis.terms if not term.entry.data_driven)
    return [f"Only a proxy was found: {named} explains part of the gap."] if named else []


def _show(result: Diagnosis, evidence: Evidence) -> None:
    """Open the trials that were kept back; nothing is decided after this."""
    kept = [e for e in result.experiments if e.use == "show" and e.measured]
    result.shown_on = "show" if kept else "fit"
    on = evidence.on(kept or evidence.experiments)
    assert result.base is not None
    assert result.final is not None
    nominal, base, final = result.base.hypothesis, result.base, result.final
    residuals = [
        on.residuals(nominal, [nominal.start()])[0],
        on.residuals(base.hypothesis, [base.steps])[0],
        on.residuals(final.hypothesis, [final.steps])[0],
    ]
    floors = evidence.noise if check.repeated(evidence.experiments) else {}
    plain = [replace(e, loud={}) for e in on.experiments]
    floors = {**floors, **noises.measure(plain, residuals[2])}
    for channel in noises.channels(on.experiments):
        rms = [
            float(np.sqrt(np.mean(np.concatenate([found[channel] for found in each if channel in found]) ** 2)))
            for each in residuals
        ]
        floor = floors[channel].deviation if channel in floors else None
        result.gap[channel] = Gap(before=rms[0], refitted=rms[1], after=rms[2], floor=floor)
