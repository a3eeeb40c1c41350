"""Find walks whose pressures, the command and the measured one, are absolute.

Their difference agrees with gauge pressures, but the muscle does not. In swing it pulls the foot down against the
return spring, so a replay under one atmosphere too much has a larger tension there and another time series of the
ankle angle. The zero of the angle is often unknown, so only the level of the force counts.
"""

from collections.abc import Sequence

import numpy as np

from klute_sim.datasets.trial import COMMAND_CHANNEL, PRESSURE_CHANNEL
from klute_sim.gait.replay.measured_trial import MeasuredTrial
from klute_sim.laws.pneumatics import ATMOSPHERIC_PRESSURE
from klute_sim.plausibility.bench.absolute_pressures import LOWEST_ATMOSPHERE, REST_PERCENTILE
from klute_sim.plausibility.finding import Finding

MAX_REMAINING_MISFIT = 1.0 / 3.0
"""Largest ratio of the misfit after the correction to that before it, in one channel, as on the bench (assumed)."""
MAX_GROWTH = 1.1
"""Largest ratio of the two in every other channel (assumed: an unknown effect may remain)."""


def find_absolute_pressures(trials: Sequence[MeasuredTrial]) -> list[Finding]:
    """Return findings for all ``trials`` if their pressures are absolute: one gauge and one regulator serve them."""
    is_absolute = all(map(_is_never_vented, trials)) and all(map(_agrees_with_gauge_pressures, trials))
    return [finding for measured in trials for finding in _describe(measured)] if trials and is_absolute else []


def _list_pressures(measured: MeasuredTrial) -> dict[str, float]:
    """Return pressure channel -> its lowest value [Pa]."""
    series = {**measured.trial.prescribed, **measured.trial.measured}
    return {
        name: float(np.nanpercentile(series[name].value, REST_PERCENTILE))
        for name in (COMMAND_CHANNEL, PRESSURE_CHANNEL)
        if name in series
    }


def _is_never_vented(measured: MeasuredTrial) -> bool:
    return min(_list_pressures(measured).values()) >= LOWEST_ATMOSPHERE


def _agrees_with_gauge_pressures(measured: MeasuredTrial) -> bool:
    """Return whether the channels agree with a replay only if the command is lower by an atmosphere."""
    as_recorded = measured.compare()
    corrected = measured.compare(excess_pressure=ATMOSPHERIC_PRESSURE)
    if not as_recorded or corrected.keys() != as_recorded.keys():
        return False
    misfits = [
        (residuals.rms, corrected[name].rms)
        if name == "force"
        else (residuals.rms_without_offset, corrected[name].rms_without_offset)
        for name, residuals in as_recorded.items()
    ]
    is_better = any(after <= MAX_REMAINING_MISFIT * before for before, after in misfits)
    return is_better and all(after <= MAX_GROWTH * before for before, after in misfits)


def _describe(measured: MeasuredTrial) -> list[Finding]:
    atmosphere = f"{ATMOSPHERIC_PRESSURE / 1e5:.3f} bar"
    return [
        Finding(
            f"{name}-absolute",
            f"trial '{measured.trial.name}'",
            f"{name} is never below {lowest / 1e5:.2f} bar, and a replay of this device agrees with the measurements "
            f"only under a pressure that is lower by one atmosphere: it looks like absolute pressure; subtract "
            f"{atmosphere} from it",
        )
        for name, lowest in reversed(_list_pressures(measured).items())
    ]
