"""Foot strikes and foot offs of a C3D file cut the strides."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from klute_sim.gait.contacts import Contact
from klute_sim.mocap.formats import c3d
from klute_sim.mocap.formats.c3d import GaitEvent
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.kinematics.leg import Leg
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing.sources import SourceFile
from klute_sim.mocap.reference_import import import_reference
from klute_sim.mocap.strides.listed_events import use_listed_events
from tests import synthetic_gait
from tests.synthetic_gait import LATER, MASS, PERIOD, Walker

LATENESS = 0.02
"""Delay [s] of the listed foot strikes behind those of the load."""


def write_c3d_with_events(folder: Path) -> Path:
    ezc3d = pytest.importorskip("ezc3d", reason="the extra 'c3d' is not installed")
    path = synthetic_gait.c3d(folder, Walker())
    file = ezc3d.c3d(str(path))
    rows = [
        (side.capitalize(), label, LATER[side] + n * PERIOD + offset)
        for side in ("right", "left")
        for n in range(4)
        for label, offset in (("Foot Strike", LATENESS), ("Foot Off", 0.63 * PERIOD))
    ]
    rows.append(("General", "Event", 0.5))
    times = np.array([[time // 60.0 for *_, time in rows], [time % 60.0 for *_, time in rows]])
    file.add_parameter("EVENT", "USED", [len(rows)])
    file.add_parameter("EVENT", "CONTEXTS", [context for context, *_ in rows])
    file.add_parameter("EVENT", "LABELS", [label for _, label, _ in rows])
    file.add_parameter("EVENT", "TIMES", times)
    file.write(str(folder / "events.c3d"))
    return folder / "events.c3d"


def test_events_are_read_with_side_and_kind(tmp_path: Path) -> None:
    events = c3d.read(write_c3d_with_events(tmp_path)).events
    strikes = [event.time for event in events if event.is_foot_strike and event.side == "left"]
    assert strikes == pytest.approx([LATER["left"] + n * PERIOD + LATENESS for n in range(4)], abs=1e-5)
    assert sum(event.is_foot_strike for event in events) == 8
    assert sum(not event.is_foot_strike for event in events) == 7  # the last one is after the end of the samples
    assert {event.side for event in events} == {"right", "left"}


def test_times_of_events_count_from_frame_one() -> None:
    rows = [
        ("Left", "Foot Strike", 1.5),
        ("Right", "foot-off", 2.0),
        ("Left", "Foot Strike", 0.5),
        ("", "Toe Off", 3.0),
    ]
    events = c3d._parse_events(rows, 1.0, 1.5)
    assert events == (GaitEvent(0.5, "left", True), GaitEvent(1.0, "right", False))


def test_strides_are_cut_at_the_listed_foot_strikes(tmp_path: Path) -> None:
    path, options = write_c3d_with_events(tmp_path), ImportOptions(mass=MASS)
    listed = import_reference([path], options)
    detected = import_reference([path], replace(options, use_listed_events=False))
    starts = [[stride.start for stride in result.strides["right"]] for result in (listed, detected)]
    assert starts[0] == pytest.approx([LATER["right"] + n * PERIOD + LATENESS for n in range(3)], abs=1e-4)
    assert all(0.01 < a - b < 0.03 for a, b in zip(*starts, strict=True))
    (sentence,) = [s for s in listed.log.derived if "right leg are cut at the 4 foot strikes that the file lists" in s]
    assert "ms after those of the load (--ignore-events uses the load)" in sentence
    assert not any("the file lists" in s for s in detected.log.derived)


def make_leg(*contacts: Contact) -> Leg:
    return Leg("right", "walk", np.linspace(0.0, 4.0, 401), {}, contacts)


def make_source(*times: float, side: str = "right") -> SourceFile:
    return SourceFile("walk.c3d", "C3D", "", events=tuple(GaitEvent(t, side, True) for t in times))


def test_a_strike_without_a_plate_ends_the_stride_before_it() -> None:
    leg = make_leg(Contact(1.0, 1.7, True, True))
    result = use_listed_events(leg, [make_source(0.99, 2.1)], ImportLog())
    assert [(c.foot_strike, c.has_toe_off) for c in result.contacts] == [(0.99, True), (2.1, False)]
    assert result.contacts[0].toe_off == 1.7
    assert use_listed_events(leg, [make_source(0.99, side="left")], ImportLog()) is leg


def test_events_far_from_every_contact_are_reported_and_not_used() -> None:
    log, leg = ImportLog(), make_leg(Contact(1.0, 1.7, True, True))
    assert use_listed_events(leg, [make_source(0.5, 1.4)], log) is leg
    assert "none of the 2 listed foot strikes of the right foot is within 0.1 s" in log.warnings[0]
    late = ImportLog()
    use_listed_events(leg, [make_source(1.06)], late)
    assert "60 ms after those of the load" in late.warnings[0]
