"""Foot strikes and foot offs that a file lists, in place of those that the load shows."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from klute_sim.gait.contacts import Contact
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.kinematics.leg import Leg
from klute_sim.mocap.parsing.sources import SourceFile

MATCH_TOLERANCE = 0.1
"""Largest difference [s] between a listed event and that of the load for which both are the same (assumed)."""
MAX_EVENT_DEVIATION = 0.03
"""Largest median difference [s] between listed and detected events that is not reported (assumed)."""


def use_listed_events(leg: Leg, trial: Sequence[SourceFile], log: ImportLog) -> Leg:
    """Return ``leg`` with the foot strikes and foot offs that the files of ``trial`` list, and log the difference.

    A listed foot strike without a load, as on a walkway with one force plate, ends the stride before it. Without listed
    foot strikes at the contacts with a plate, ``leg`` is unchanged.
    """
    events = [event for source in trial for event in source.events if event.side in ("", leg.side)]
    strikes = np.array([event.time for event in events if event.is_foot_strike])
    foot_offs = np.array([event.time for event in events if not event.is_foot_strike])
    contacts, differences = [], []
    for contact in leg.contacts:
        strike = _find_nearest(strikes, contact.foot_strike) if contact.has_foot_strike else None
        foot_off = _find_nearest(foot_offs, contact.toe_off) if contact.has_toe_off else None
        if strike is not None:
            differences.append(strike - contact.foot_strike)
        begin, end = strike, foot_off
        contacts.append(
            replace(
                contact,
                foot_strike=contact.foot_strike if begin is None else begin,
                toe_off=contact.toe_off if end is None else end,
            )
        )
    if not differences:
        if len(strikes):
            log.add_warning(
                f"{leg.trial}: none of the {len(strikes)} listed foot strikes of the {leg.side} foot is within "
                f"{MATCH_TOLERANCE:g} s of a contact with a force plate; those of the load were used"
            )
        return leg
    unloaded = [
        time for time in strikes if all(not c.foot_strike - MATCH_TOLERANCE < time <= c.toe_off for c in contacts)
    ]
    contacts += [Contact(float(time), float(time), has_foot_strike=True, has_toe_off=False) for time in unloaded]
    median = float(np.median(differences))
    sentence = (
        f"{leg.trial}: strides of the {leg.side} leg are cut at the {len(strikes)} foot strikes that the file lists, "
        f"{1e3 * abs(median):.0f} ms {'after' if median > 0.0 else 'before'} those of the load (--ignore-events "
        "uses the load)"
    )
    if abs(median) > MAX_EVENT_DEVIATION:
        log.add_warning(sentence)
    else:
        log.add_derived(sentence)
    return replace(leg, contacts=sorted(contacts, key=lambda contact: contact.foot_strike))


def _find_nearest(times: np.ndarray, time: float) -> float | None:
    """Return the nearest of ``times`` within :data:`MATCH_TOLERANCE` of ``time``."""
    if not len(times):
        return None
    nearest = float(times[np.abs(times - time).argmin()])
    return nearest if abs(nearest - time) <= MATCH_TOLERANCE else None
