"""A compilation that takes long is announced once, on a terminal only."""

import io
import sys
import time

import pytest

from klute_sim.device.backend import notice


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(
    ("stream", "seconds", "n_notices"), [(Terminal(), 0.2, 1), (Terminal(), 0.0, 0), (io.StringIO(), 0.2, 0)]
)
def test_long_compilation_is_announced_once_on_a_terminal(
    stream: io.StringIO, seconds: float, n_notices: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    notice._write_notice.cache_clear()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr(notice, "NOTICE_DELAY_S", 0.05)
    for _ in range(2):
        with notice.announce_slow_compilation():
            time.sleep(seconds)
    assert stream.getvalue().count(notice.NOTICE) == n_notices
    notice._write_notice.cache_clear()
