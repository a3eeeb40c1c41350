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
from klute_sim.device.ledger import Ledger, entries
from klute_sim.device.rollout import earlier, obstacle
from klute_sim.device.step import DEAD_TIME, MEMORY, Parameters, State, advance, taut, tension
from klute_sim.device.vector import pack, unpack
from klute_sim.errors import SimulationError

Array = NDArray[np.float64]

STATES = 4
"""Columns before those of the ledger: tension [N], gauge pressure [Pa], muscle length [m], its rate [m/s]."""


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
    """Of arrays instead of numbers."""


def run(
    row: Sequence[float],
    pressure: float,
    length: float,
    memory: tuple[float, ...],
    unit_length: Sequence[float],
    unit_rate: Sequence[float],
    command: Sequence[float],
    step: float,
    out: Array,
) -> None:
    """Fill ``out`` (samples, :data:`STATES` + ledger) after each ``step``; SI.

    ``row`` is the device's parameters; ``pressure``, ``length`` and ``memory`` are where it begins.
    """
    parameters = unpack(row)
    late = parameters.effects[DEAD_TIME] / step
    before = State(pressure, length, memory)
    for k in range(len(unit_length)):
        after = advance(parameters, before, unit_length[k], earlier(command, k - late), step)
        rate = (after.length - before.length) / step
        out[k, 0] = tension(parameters, after, unit_length[k], rate)
        out[k, 1], out[k, 2], out[k, 3] = after.pressure, after.length, rate
        told = entries(parameters, before, after, unit_length[k], unit_rate[k], step)
        # Spelled out, because a compiler has to follow it.
        out[k, 4], out[k, 5], out[k, 6] = told.gas_power, told.friction_power, told.damper_power
        out[k, 7], out[k, 8] = told.stop_power, told.effects_power
        out[k, 9], out[k, 10], out[k, 11] = told.bladder_energy, told.tendon_energy, told.air_mass
        before = after


@cache
def _compiled() -> Callable[..., None]:
    import numba

    from klute_sim.device import account, compiled, ledger, rollout

    law = compiled.device_law()
    early = compiled.copy_of(rollout, **law).earlier
    copy = compiled.copy_of(account, **law, entries=compiled.copy_of(ledger, **law).entries, earlier=early)
    number = numba.float64
    memory, series = numba.types.UniTuple(number, MEMORY), number[::1]
    signature = numba.void(series, number, number, memory, series, series, series, number, number[:, ::1])
    ready: Callable[..., None] = compiled.ready(partial(numba.njit, nogil=True), copy.run, signature)
    return ready


def account(
    parameters: Parameters,
    unit_length: ArrayLike,
    command: ArrayLike,
    step: float,
    *,
    unit_rate: ArrayLike | None = None,
    start: State | None = None,
    law: str = "auto",
) -> Account:
    """Let the device follow lengths [m] and pressure commands [Pa], one sample per ``step`` [s] each.

    ``unit_rate`` [m/s] is how fast the length changes at each sample (left out: central differences); ``start`` is
    where it begins (left out: the tendon just taut at the first length and command).

    Raises SimulationError if a result is not finite.
    """
    lengths, commands = (np.array(x, dtype=np.float64, order="C") for x in (unit_length, command))
    rates = np.gradient(lengths, step) if unit_rate is None else np.array(unit_rate, dtype=np.float64, order="C")
    begin = taut(parameters, float(lengths[0]), float(commands[0])) if start is None else start
    out = np.empty((len(lengths), STATES + len(Ledger._fields)))
    series: Any = (lengths, rates, commands)
    row: Any = np.array(pack(parameters))
    compiled = choose(law, obstacle) == "compiled"
    if not compiled:
        series, row = (x.tolist() for x in series), pack(parameters)
    function: Callable[..., None] = _compiled() if compiled else run
    function(row, float(begin.pressure), float(begin.length), begin.memory, *series, float(step), out)
    if not np.isfinite(out).all():
        first = int(np.argwhere(~np.isfinite(out))[0][0])
        raise SimulationError(f"the device has no finite state at t = {first * step:.4f} s")
    pull, pressure, length, rate, *rest = (np.ascontiguousarray(column) for column in out.T)
    told: Any = rest
    return Account(pull, pressure, length, rate, Ledger(*told))
