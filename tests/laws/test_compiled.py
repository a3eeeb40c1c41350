"""The device's laws and its step are one source: compiled, they give the same bits as in plain Python."""

import random
import types

import pytest
from compiling import compiled

from klute_sim.device import step
from klute_sim.device.files import load
from klute_sim.device.step import State
from klute_sim.laws import damper, mckibben, pneumatics, tendon


@pytest.fixture(scope="module")
def fast() -> types.ModuleType:
    laws = {"_damper": damper, "mckibben": mckibben, "pneumatics": pneumatics, "_tendon": tendon}
    return compiled(step, **{name: compiled(module) for name, module in laws.items()})


@pytest.mark.parametrize("name", ["klute-1-1-4-pair", "klute-3-4-pair", "klute-1-2"])
def test_compiled_steps_are_bit_identical(fast: types.ModuleType, name: str) -> None:
    parameters = load(name).parameters
    pick = random.Random(7)
    rest = parameters.muscle.resting_length
    slow_state = fast_state = State(0.0, rest)
    for _ in range(2000):
        length = parameters.tendon.slack_length + pick.uniform(0.75, 1.0 if parameters.tendon.rigid else 1.06) * rest
        command, h = pick.uniform(-1e5, 7e5), pick.choice([1e-4, 5e-4, 5e-3])
        slow_state = step.advance(parameters, slow_state, length, command, h)
        fast_state = State(*fast.advance(parameters, fast_state, length, command, h))
        assert [x.hex() for x in fast_state] == [x.hex() for x in slow_state]
        rate = pick.uniform(-0.5, 0.5)
        pulls = [m.tension(parameters, slow_state, length, rate) for m in (step, fast)]
        assert pulls[0].hex() == pulls[1].hex()
