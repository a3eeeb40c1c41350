"""Controllers that disturb the process that simulates them; worker processes import them from this module."""

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class KillingController:
    """Commands no pressure and kills its process in the first ``n_kills`` attempts, each recorded in ``folder``."""

    folder: str
    n_kills: int

    def pressure_at(self, phase: float) -> float:
        n_attempts = len(list(Path(self.folder).iterdir()))
        if phase == 0.0 and n_attempts < self.n_kills:
            (Path(self.folder) / str(n_attempts)).touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return 0.0

    def describe(self) -> dict[str, Any]:
        return {"kind": "killing", "n_kills": self.n_kills}


@dataclass(frozen=True)
class HeartbeatController:
    """Commands no pressure, and blocks for a minute while it rewrites ``path``."""

    path: str

    def pressure_at(self, phase: float) -> float:
        for beat in range(1200):
            Path(self.path).write_text(str(beat))
            time.sleep(0.05)
        return 0.0

    def describe(self) -> dict[str, Any]:
        return {"kind": "heartbeat"}
