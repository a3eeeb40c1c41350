"""Figure of the signature of an effect: the difference has a row of its own."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from klute_sim.diagnosis.planning.signatures import ChannelResponse, EffectResponse
from klute_sim.report.effects.figures import build_signature_figure
from tests.report.figure_checks import check_figure


def test_difference_has_a_row_of_its_own() -> None:
    time = np.linspace(0.0, 1.0, 50)
    experiment: Any = SimpleNamespace(
        dt=0.02, command=1e5 * time, unit_length=0.3 + 0.01 * time, device=SimpleNamespace(name="klute")
    )
    term: Any = SimpleNamespace(effect="tendon_slack", form="offset")
    channel = ChannelResponse("force", time, 100.0 * time, 90.0 * time)
    figure = build_signature_figure(EffectResponse(term, "ramps", experiment, (channel,)))
    check_figure(figure)
    length, command, above, below = figure.axes
    assert length.lines[0].get_ydata() == pytest.approx(300.0 + 10.0 * time)
    assert command.lines[0].get_ydata() == pytest.approx(time)
    assert [line.get_label() for line in above.lines] == ["without", "with"]
    zero, difference = below.lines
    assert set(np.asarray(zero.get_ydata()).tolist()) == {0.0}
    assert difference.get_ydata() == pytest.approx(-10.0 * time)
    assert below.get_ylabel() == "with -\nwithout [N]"
