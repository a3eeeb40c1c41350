"""One rollout of the device alone with everything about it written down, its ledger included; without MuJoCo.

:mod:`klute_sim.device.rollout` is for many rollouts of which only force, pressure and length matter. The steps are
the same. Compiled and plain Python give the same bits.
"""

from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from klute_sim.device.installation import choose
from klute_sim.device.instant import stages
from klute_sim.device.ledger import Ledger, ledger
from klute_sim.device.rollout import earlier, obstacle
from klute_sim.device.snapshot import FIELDS, tell
from klute_sim.device.step import DEAD_TIME, MEMORY, Parameters, State, advance, supplied, taut
from klute_sim.device.vector import pack, unpack
from klute_sim.errors import SimulationError
from klute_sim.laws import charging

Array = NDArray[np.float64]

STATES = 3
"""Columns before those of a snapshot: gauge pressure [Pa], muscle length [m], its rate [m/s]."""


class Account(NamedTuple):
    """One entry per sample; SI."""

    tension: Array
    """[N]"""
    pressure: Array
    """Gauge pressure [Pa]."""
    length: Array
    """Muscle length [m]."""
    rate: Array
    """Of the muscle's length in this step [m/s]."""
    ledger: Ledger


def run(
    rows: Sequence[Sequence[float]],
    pressure: float,
    length: float,
    memory: tuple[float, ...],
    unit_length: Sequence[float],
    command: Sequence[float],
    step: float,
    out: Array,
) -> None:
    """Fill ``out`` (samples, :data:`STATES` + :data:`FIELDS` + 2 for each effect) after each ``step``; SI.

    ``rows`` are the parameters of :func:`klute_sim.device.instant.stages`; ``pressure``, ``length`` and ``memory`` are
    where the device begins.
    """
    parameters = unpack(rows[-1])
    late = parameters.effects[DEAD_TIME] / step
    before = State(pressure, length, memory)
    for k in range(len(unit_length)):
        after = advance(parameters, before, unit_length[k], earlier(command, k - late), step)
        rate = (after.length - before.length) / step
        out[k, 0], out[k, 1], out[k, 2] = after.pressure, after.length, rate
        tell(rows, after, unit_length[k], rate, out[k, STATES:])
        before = after


@cache
def _compiled() -> Callable[..., None]:
    import numba

    from klute_sim.device import account, compiled, rollout, snapshot

    law = compiled.device_law()
    early = compiled.copy_of(rollout, **law).earlier
    copy = compiled.copy_of(account, **law, tell=snapshot.compiled_functions().tell, earlier=early)
    number = numba.float64
    memory, series = numba.types.UniTuple(number, MEMORY), number[::1]
    signature = numba.void(number[:, ::1], number, number, memory, series, series, number, number[:, ::1])
    ready: Callable[..., None] = compiled.ready(partial(numba.njit, nogil=True), copy.run, signature)
    return ready


def account(
    parameters: Parameters,
    unit_length: ArrayLike,
    command: ArrayLike,
    step: float,
    *,
    start: State | None = None,
    law: str = "auto",
) -> Account:
    """Let the device follow lengths [m] and pressure commands [Pa], one sample per ``step`` [s] each.

    ``start`` is where it begins (left out: the tendon just taut at the first length and command).

    Raises SimulationError if a result is not finite.
    """
    lengths, commands = (np.array(x, dtype=np.float64, order="C") for x in (unit_length, command))
    begin = taut(parameters, float(lengths[0]), float(commands[0])) if start is None else start
    names, devices = stages(parameters)
    out = np.empty((len(lengths), STATES + FIELDS + 2 * len(names)))
    rows: Any = np.array([pack(device) for device in devices])
    series: Any = (lengths, commands)
    compiled = choose(law, obstacle) == "compiled"
    if not compiled:
        series, rows = (x.tolist() for x in series), rows.tolist()
    function: Callable[..., None] = _compiled() if compiled else run
    function(rows, float(begin.pressure), float(begin.length), begin.memory, *series, float(step), out)
    if not np.isfinite(out).all():
        first = int(np.argwhere(~np.isfinite(out))[0][0])
        raise SimulationError(f"the device has no finite state at t = {first * step:.4f} s")
    pressure, length, rate = (np.ascontiguousarray(column) for column in out[:, :STATES].T)
    instants, own = out[:, STATES : STATES + FIELDS], out[:, STATES + FIELDS :].reshape(len(out), len(names), 2)
    counts = not charging.plain(supplied(parameters, begin.memory))
    told = ledger(instants, own, names, length, lengths, step, counts=counts)
    return Account(np.ascontiguousarray(instants[:, 0]), pressure, length, rate, told)
