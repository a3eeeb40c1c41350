"""Trials of gait: the pylon moves as measured, the measured reaction pushes on the foot, and the ankle is free."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from klute_sim.dataset.trial import Series, Trial, Use
from klute_sim.device import effects_file
from klute_sim.device.files import Device
from klute_sim.diagnose.experiment import COARSE, PRESSURE, Array, Course, Experiment, Motion, Setting, compared
from klute_sim.effects import catalogue
from klute_sim.errors import InputError
from klute_sim.laws.foot import Foot, arm
from klute_sim.rigs.replay.foot import foot_of
from klute_sim.rigs.replay.prescribed import CUTOFF, Prescribed, prescribed
from klute_sim.rigs.replay.rollout import Inputs, replay

STEP = 5e-4
"""Time step [s]; together with one twice as long, a tenth of this is no more exact than an encoder."""
BEFORE, AFTER = 0.06, 0.06
"""Around where the load comes or goes [s], what is not compared: it has spikes there, of a millisecond or so, that no
laboratory samples (assumed; see the tests of the replay). One is up to 45 ms before a foot is off the ground, when all
but the last of its sole has left."""
TAIL = 0.06
"""At the end of a trial [s], what is not compared: the ankle's acceleration is not known there."""
STEADY = 30.0
"""Rate of the load's moment [N.m/s] below which it is steady."""
PLACE = 1e-3
"""By how much the centre of pressure is moved to see what its noise does [m]."""
SWING = 0.1
"""Time without load before a foot strike, at least [s]: a foot may bounce as it comes or leaves (assumed; swing takes
some 0.4 s)."""


@dataclass(frozen=True, eq=False)
class OnGait(Experiment):
    """A trial of several strides."""

    foot: Foot = field(kw_only=True)
    """Without effects of the body."""
    inputs: Inputs = field(kw_only=True)
    """One of each per step; the command is :attr:`command`."""
    smoother: Inputs = field(kw_only=True)
    """The same of a motion that was smoothed with half the cutoff."""
    load: Array = field(kw_only=True)
    """Vertical [N], one per step."""
    strikes: Array = field(kw_only=True)
    """Foot strikes, since the beginning [s]; two or more."""
    usual: float = field(kw_only=True)
    """Duration of a stride, on average in all repeats [s]."""

    @cached_property
    def coarse(self) -> Experiment:
        """See :class:`Experiment`."""
        if self.step > STEP:
            return self
        inputs, smoother = (Inputs(*(s[::COARSE] for s in every)) for every in (self.inputs, self.smoother))
        few, load = self.command[::COARSE], self.load[::COARSE]
        return replace(self, step=self.step * COARSE, inputs=inputs, smoother=smoother, command=few, load=load)

    @cached_property
    def otherwise(self) -> tuple[Experiment, ...]:
        """See :class:`Experiment`."""
        return (replace(self, inputs=self.smoother),)

    @property
    def course(self) -> Course:
        """See :class:`Experiment`."""
        motions = ("unloading", "steady", "loading")
        return Course("load about the ankle [N·m]", 1.0, -self.inputs.ground, STEADY, motions)

    @property
    def embodied(self) -> bool:
        """See :class:`Experiment`."""
        return True

    @property
    def telling(self) -> tuple[str, ...]:
        """See :class:`Experiment`."""
        return "force", "ankle_angle", "muscle_length"

    @property
    def travel(self) -> float:
        """As far as the load would move the unit against the return spring alone."""
        return float(np.ptp(self.inputs.ground)) / self.foot.stiffness * arm(self.foot, 0.0)

    def trace(self, setting: Setting) -> Motion:
        """See :class:`Experiment`; at the beginning of each step."""
        given = effects_file.active(self.device.spec.effects, "body")
        foot = catalogue.edited(given | {(one.effect, one.form): dict(one.own) for one in setting.body}, self.foot)
        found = replay(setting.parameters, foot, self.inputs._replace(command=self.command), self.step)
        time: Array = self.begin + self.step * np.arange(float(len(self.command)))
        return Motion(time, found.tension, found.pressure, found.length, found.angle, found.moment)

    def swayed(self, later: Callable[[Array], Array]) -> tuple[Experiment, Experiment, Experiment]:
        """See :class:`Experiment`; what else is prescribed is where the load acts."""
        moved = self.inputs._replace(ground=self.inputs.ground - PLACE * self.load)
        return (
            replace(self, command=self.command + PRESSURE),
            replace(self, inputs=moved),
            replace(self, command=later(self.command)),
        )

    def circumstances(self) -> dict[str, Array]:
        """See :class:`Experiment`."""
        since = np.linspace(0.0, self.duration, len(self.command))
        return {
            "phase": self.stride(since) % 1.0,
            "pressure": self.command,
            "pressure change": self.smooth(np.abs(np.gradient(self.command, self.step))),
            "time": since,
        }

    def beside(self, repeats: Sequence[Experiment]) -> Experiment:
        """See :class:`Experiment`."""
        return replace(self, usual=float(np.mean([e.usual for e in repeats if isinstance(e, OnGait)])))

    def stride(self, since: Array) -> Array:
        """Strides since the first foot strike, and the phase of the present one, ``since`` [s] the beginning.

        Before the first strike and after the last, strides take as long as those next to them.
        """
        strides = np.arange(len(self.strikes), dtype=np.float64)
        first, last = self.strikes[1] - self.strikes[0], self.strikes[-1] - self.strikes[-2]
        found = np.interp(since, self.strikes, strides)
        found = np.where(since < self.strikes[0], (since - self.strikes[0]) / first, found)
        late = strides[-1] + (since - self.strikes[-1]) / last
        return np.where(since > self.strikes[-1], late, found)

    def clock(self, since: Array) -> Array:
        """Strides of repeats are matched by their phase, whatever they take."""
        return self.usual * self.stride(since)


def on_gait(trial: Trial, use: Use) -> OnGait:
    """``trial`` made ready; raises InputError for one that cannot be replayed."""
    ready = prescribed(trial.prescribed, f"trial '{trial.name}'")
    smoother = prescribed(trial.prescribed, f"trial '{trial.name}'", cutoff=0.5 * CUTOFF)
    grid: Array = ready.begin + STEP * np.arange(float(int((ready.end - ready.begin) / STEP + 1e-6)))
    inputs = ready.inputs(grid)
    strikes = _strides(ready, f"trial '{trial.name}'")
    return OnGait(
        name=trial.name,
        group=trial.group,
        use=use,
        device=trial.device,
        begin=ready.begin,
        step=STEP,
        command=inputs.command,
        measured=_away(compared(trial, ready.begin, ready.end, ready.end - TAIL), ready),
        checked=trial.checked,
        foot=foot_of(_bare(trial.device)),
        inputs=inputs,
        smoother=smoother.inputs(grid),
        load=np.interp(grid, ready.vertical.time, ready.vertical.value),
        strikes=strikes,
        usual=float(np.mean(np.diff(strikes))),
    )


def _bare(device: Device) -> Device:
    """Without effects of the body."""
    kept = {name: own for name, own in device.spec.effects.items() if catalogue.effects()[name].kind != "body"}
    return replace(device, spec=device.spec.model_copy(update={"effects": kept}))


def _strides(ready: Prescribed, where: str) -> Array:
    """Times of the foot strikes that begin a stride, since the beginning [s]."""
    up, down = ready.strikes(), ready.lifts()
    swung = [k for k in up if not ((down > k - SWING) & (down < k)).any() and k - SWING > ready.vertical.time[0]]
    if len(swung) < 2:
        raise InputError(
            f"{where}: its load shows {len(swung)} foot strikes; a gait trial needs 2 or more, each after a swing, "
            "better 5"
        )
    return np.array(swung) - ready.begin


def _away(measured: Mapping[str, Series], ready: Prescribed) -> dict[str, Series]:
    """``measured`` without what is around where the load comes and goes."""
    found = {}
    for channel, series in measured.items():
        good = np.ones(len(series.time), dtype=np.bool_)
        for event in (*ready.strikes(), *ready.lifts()):
            good &= (series.time < event - BEFORE) | (series.time > event + AFTER)
        found[channel] = Series(series.time[good], series.value[good])
    return found
