"""A diagnosis for the rerun viewer: measured, before and after as series, and a layout made for them.

rerun is an optional extra and is imported when it is used.
"""

import hashlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from klute_sim.diagnose.diagnosis import Diagnosis
from klute_sim.diagnose.experiment import UNITS, Array
from klute_sim.errors import InputError, MissingExtraError
from klute_sim.report import diagnosis_words as words
from klute_sim.report.diagnosis_traces import Simulated, simulated

TIMELINE = "time"
"""From each trial's begin."""

GREY, ORANGE, BLUE = (150, 150, 150), (230, 132, 42), (31, 119, 180)


class Line(NamedTuple):
    """A series; the viewer draws in the order of the entities' names."""

    entity: str
    name: str
    colour: tuple[int, int, int]
    width: float
    time: Array
    value: Array
    """In the unit that the channel is shown in."""


def write(diagnosis: Diagnosis, path: Path) -> None:
    """Write the shown trials of ``diagnosis`` to ``path`` (.rrd).

    Raises MissingExtraError without rerun, InputError where the data were not sufficient to simulate anything.
    """
    try:
        import rerun as rr
    except ImportError:
        raise MissingExtraError("a rerun recording", "rerun") from None

    trials = simulated(diagnosis)
    if not trials:
        raise InputError("a rerun recording needs trials that were simulated; the data were insufficient for that")
    found = ", ".join(map(str, diagnosis.found))
    identity = hashlib.sha256(f"{diagnosis.dataset.digest} {found}".encode()).hexdigest()
    stream = rr.RecordingStream("klute-sim", recording_id=identity, send_properties=False)
    stream.save(path, default_blueprint=blueprint(diagnosis, trials))
    for number, one in enumerate(trials, start=1):
        for channel in _channels(one):
            for line in lines(diagnosis, one, number, channel):
                stream.send_columns(
                    line.entity,
                    indexes=[rr.TimeColumn(TIMELINE, duration=line.time)],
                    columns=rr.Scalars.columns(scalars=line.value),
                )
                style = rr.SeriesLines(names=line.name, colors=line.colour, widths=line.width)
                stream.log(line.entity, style, static=True)
    stream.flush()
    stream.disconnect()


def lines(diagnosis: Diagnosis, one: Simulated, number: int, channel: str) -> Iterator[Line]:
    """Of one channel of trial ``one``, the ``number``-th: the signal's, then the residuals'.

    Trials go by numbers, because their names may hold what an entity's name may not.
    """
    unit = UNITS[channel][1]
    time, measured = one.time(channel), one.experiment.measured[channel].value
    simulations = [("before", "refitted", ORANGE, one.before)]
    if diagnosis.found:
        simulations.append(("after", "with effects added", BLUE, one.after))
    here = f"trial_{number}/{channel}"
    yield Line(f"{here}/signal/measured", "measured", GREY, 1.0, time, measured / unit)
    for entity, name, colour, values in simulations:
        yield Line(f"{here}/signal/{entity}", name, colour, 2.0, time, values[channel] / unit)
    for entity, name, colour, values in simulations:
        yield Line(f"{here}/residual/{entity}", name, colour, 1.0, time, (measured - values[channel]) / unit)


def blueprint(diagnosis: Diagnosis, trials: Sequence[Simulated]) -> Any:
    """Layout: a tab for each trial; in it the channels side by side, residuals underneath; panels folded away."""
    import rerun.blueprint as rrb

    tabs = []
    for number, one in enumerate(trials, start=1):
        rows = []
        for part, title in (("signal", "{} [{}]"), ("residual", "{}, measured - simulated [{}]")):
            views = [
                rrb.TimeSeriesView(
                    origin=f"/trial_{number}/{channel}/{part}",
                    name=title.format(words.spoken(channel), UNITS[channel][0]),
                )
                for channel in _channels(one)
            ]
            rows.append(rrb.Horizontal(*views))
        use = "shown" if diagnosis.shown_on == "show" else "fitted"
        tabs.append(rrb.Vertical(*rows, row_shares=[2, 1], name=f"{one.experiment.name} ({use})"))
    return rrb.Blueprint(
        rrb.Tabs(*tabs),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
    )


def _channels(one: Simulated) -> list[str]:
    return [channel for channel, series in one.experiment.measured.items() if len(series.time)]
