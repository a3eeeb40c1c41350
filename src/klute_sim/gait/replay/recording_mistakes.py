"""Mistakes in the recording of walks that matter to a replay, most of which only a replay of the device shows."""

from collections.abc import Collection, Sequence

from klute_sim.datasets.trial import Trial
from klute_sim.gait.replay.absolute_pressures import find_absolute_pressures
from klute_sim.gait.replay.clock_delay import find_clock_delays
from klute_sim.gait.replay.measured_trial import MeasuredTrial
from klute_sim.gait.replay.unloaded_steps import find_unloaded_steps
from klute_sim.plausibility.finding import Finding, are_accepted


def find_recording_mistakes(trials: Sequence[Trial], accepted: Collection[str] = ()) -> list[Finding]:
    """Return what the replays of gait ``trials`` show to be implausible.

    Trials with steps beside the plates are not replayed. ``accepted`` holds names of findings that the user accepts:
    absolute pressures that are not accepted make a replay meaningless. Of a device that is commanded by valve opening,
    the pressures are not examined.
    """
    unloaded = find_unloaded_steps(trials)
    places = {finding.place for finding in unloaded}
    trials = [trial for trial in trials if f"trial '{trial.name}'" not in places]
    measured = [MeasuredTrial(trial) for trial in trials]
    has_pressures = all(trial.device.parameters.supply.command_is_opening == 0.0 for trial in trials)
    pressures = find_absolute_pressures(measured) if has_pressures else []
    delays = find_clock_delays(measured) if are_accepted(pressures, accepted) else []
    return [*unloaded, *pressures, *delays]
