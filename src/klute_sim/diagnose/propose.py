"""The experiment that would tell two rivals apart: a command, or a change of the rig.

Both rivals are simulated in every protocol; the first may then be refitted to what the second predicts, held by the
data there are already. What is left in units of the noise is how well the experiment would separate them. Some pairs
no command can separate: an instrument's fault is told from physics by a second instrument.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from klute_sim.dataset.trial import Series
from klute_sim.device.files import Device
from klute_sim.diagnose.experiment import Array, Bench, Experiment, Setting
from klute_sim.diagnose.fit import DIFFERENCE, Evidence, Fit
from klute_sim.diagnose.on_bench import OnBench
from klute_sim.diagnose.protocols import PROTOCOLS, Protocol
from klute_sim.diagnose.search import DECISIVE
from klute_sim.errors import InputError

STEP = 2.5e-4
"""Of the simulation [s]."""
MUSCLE_LENGTH = 2e-5
"""Noise of a muscle-length sensor where there is none yet [m] (assumed)."""


class Change(NamedTuple):
    """A change of the rig."""

    words: str
    second: tuple[str, ...]
    """Channels that are read by a second, faultless instrument."""
    added: tuple[str, ...] = ()
    """Channels that were not recorded before."""


CHANGES = (
    Change("with the rig as it is", ()),
    Change("with a sensor for the muscle's own length", (), ("muscle_length",)),
    Change("with a second gauge at the muscle's own port", ("pressure",)),
    Change("with the load cell checked by a dead weight before and after", ("force",)),
)


class Proposal(NamedTuple):
    """An experiment and what it would tell."""

    protocol: Protocol
    change: Change
    separation: float
    """Chi squared, in independent samples, that the rivals differ by when refitted; two repeats."""

    def as_json(self) -> dict[str, Any]:
        """For ``verdict.json``."""
        if self.separation <= DECISIVE:
            sentence = (
                "No protocol or change of the rig that is known separates these; treat them as one until another "
                "kind of measurement does."
            )
        else:
            sentence = (
                f"Record protocol '{self.protocol.name}' twice, {self.change.words}: the rivals then differ by a chi "
                f"squared of about {self.separation:.0f} ({DECISIVE:.0f} decide)."
            )
        return {
            "protocol": self.protocol.name,
            "rig_change": self.change.words if self.change.second or self.change.added else None,
            "separation_chi2": round(self.separation, 1),
            "sentence": sentence,
        }


def propose(evidence: Evidence, device: Device, found: Fit, rival: Fit) -> Proposal:
    """The protocol and change of the rig that separate ``found`` from ``rival`` best.

    A change of the rig is only proposed where it separates at least twice as well as the best command without one.
    """
    every = [p for name in PROTOCOLS for p in _each(evidence, device, PROTOCOLS[name], found, rival)]
    if not every:
        raise InputError(f"no protocol can be run on device '{device.name}'")
    plain = max((p for p in every if not (p.change.second or p.change.added)), key=lambda p: p.separation)
    best = max(every, key=lambda p: p.separation)
    return best if best.separation > 2.0 * plain.separation and plain.separation < 10.0 * DECISIVE else plain


def _each(evidence: Evidence, device: Device, protocol: Protocol, found: Fit, rival: Fit) -> list[Proposal]:
    try:
        program = protocol.program(device)
    except InputError:
        return []
    grid = np.arange(STEP, program.time[-1], STEP)
    channels = dict.fromkeys([*evidence.noise, "muscle_length"])
    # As often as the data have it: for how long noise stays alike is known of that.
    interval = next(series for e in evidence.experiments for series in e.measured.values()).interval
    samples = np.arange(interval, program.time[-1], interval)
    experiment = OnBench(
        name=protocol.name,
        group=protocol.name,
        use="fit",
        device=device,
        begin=0.0,
        step=STEP,
        unit_length=np.interp(grid, program.time, program.unit_length),
        command=np.interp(grid, program.time, program.command),
        measured={channel: Series(samples, samples) for channel in channels},
    )
    rows = [found.steps, *(found.steps + DIFFERENCE * unit for unit in np.eye(len(found.steps)))]
    settings = [*(found.hypothesis.settings(row, [experiment]) for row in rows)]
    settings.append(rival.hypothesis.settings(rival.steps, [experiment]))
    shown = _shown(evidence.bench, settings, experiment, faulty=True)
    true = _shown(evidence.bench, settings, experiment, faulty=False)
    return [
        Proposal(protocol, change, _separation(found, _columns(evidence, interval, change, shown, true)))
        for change in CHANGES
        if not set(change.added) & set(evidence.noise)
    ]


def _shown(
    bench: Bench, settings: Sequence[Sequence[Setting]], experiment: Experiment, *, faulty: bool
) -> list[dict[str, Array]]:
    if not faulty:
        settings = [[one._replace(readings=()) for one in row] for row in settings]
    return [row[0] for row in bench.simulate(settings, [experiment])]


def _columns(
    evidence: Evidence,
    interval: float,
    change: Change,
    shown: list[dict[str, Array]],
    true: list[dict[str, Array]],
) -> list[Array]:
    """Weighted predictions, one vector per setting: of the channels there are, and of what the change adds."""
    found = []
    for seen, there in zip(shown, true, strict=True):
        parts = []
        for channel, noise in evidence.noise.items():
            weight = noise.weight(interval)
            parts.append(weight * seen[channel])
            if channel in change.second:
                parts.append(weight * there[channel])
        for channel in change.added:
            slowest = max(noise.correlation(interval) for noise in evidence.noise.values())
            parts.append(there[channel] / (MUSCLE_LENGTH * np.sqrt(slowest)))
        found.append(np.concatenate(parts))
    return found


def _separation(found: Fit, columns: list[Array]) -> float:
    here, *moved, other = columns
    slope = np.stack([(each - here) / DIFFERENCE for each in moved], axis=1) if moved else np.empty((len(here), 0))
    repeats = np.sqrt(2.0)
    matrix = np.concatenate([repeats * slope, found.jacobian])
    target = np.concatenate([repeats * (other - here), np.zeros(len(found.jacobian))])
    answer = np.linalg.lstsq(matrix, target, rcond=None)[0]
    left = target - matrix @ answer
    return float(left @ left)
