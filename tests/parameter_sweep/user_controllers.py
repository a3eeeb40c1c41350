"""Controllers that do things to the process that walks with them; processes of a sweep import them from here."""

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Deadly:
    """No pressure; the process that asks is killed, the first few times. Who asks is written into ``folder``."""

    folder: str
    times: int

    def pressure_at(self, phase: float) -> float:
        asked = len(list(Path(self.folder).iterdir()))
        if phase == 0.0 and asked < self.times:
            (Path(self.folder) / str(asked)).touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return 0.0

    def describe(self) -> dict[str, Any]:
        return {"kind": "deadly", "times": self.times}


@dataclass(frozen=True)
class Beating:
    """No pressure, and no answer for a minute, in which ``file`` is written again and again."""

    file: str

    def pressure_at(self, phase: float) -> float:
        for beat in range(1200):
            Path(self.file).write_text(str(beat))
            time.sleep(0.05)
        return 0.0

    def describe(self) -> dict[str, Any]:
        return {"kind": "beating"}
